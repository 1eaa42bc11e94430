//! Fits of scans that the fit did not make: images of a microscope with terms of the field as in a
//! scenario, at a tenth of the fit's tolerance, with shot noise.

use microsig_core::Particle;
use microsig_core::emission::emitted_rays;
use microsig_core::optics::{ChiefRay, FieldAstigmatism, FieldComa, FieldOptics, FocusSurface, Vignetting};
use microsig_core::random::{normal, poisson};
use microsig_core::render::Context;
use microsig_core::render::waves::{Emission, PupilFunction, WavesRenderer};
use microsig_core::stream::{Purpose, Streams};

use super::*;

/// Half width of the windows, and distance of particles, px.
const HALF: usize = 8;
const PITCH: usize = 49;

/// Diameter of the particles, um.
const DIAMETER_UM: f64 = 1.0;

/// Dark counts, background light and read noise, counts.
const OFFSET: f64 = 80.0;
const GLOW: f64 = 20.0;
const READ_NOISE: f64 = 2.0;

fn options(places_px: Vec<[f64; 2]>) -> WaveOptions {
    let given =
        Given { magnification: 10.0, pixel_size_um: 16.0, ri_medium: 1.0, ri_lens: 1.5, depth_factor: 1.0 };
    let emission = Emission::Volume;
    let waves = WaveModel { wavelength_um: 0.56, emission, layers: None };
    WaveOptions {
        given,
        diameter_um: Some(DIAMETER_UM),
        direction: 1.0,
        waves,
        is_field: true,
        half_window: Some(HALF),
        places_px,
        all_px: Vec::new(),
    }
}

/// A microscope.
struct Truth {
    field: FieldOptics,
    numerical_aperture: f64,
    focus_um: f64,
    spherical: f64,
    transmission: f64,
    blur_um: f64,
    /// Scatter of the focus of particles, um.
    scatter_um: f64,
}

impl Truth {
    /// The same optics over the whole field, without aberrations.
    fn uniform() -> Truth {
        Truth {
            field: FieldOptics::default(),
            numerical_aperture: 0.3,
            focus_um: 1.0,
            spherical: 0.0,
            transmission: 0.0,
            blur_um: 0.8,
            scatter_um: 0.0,
        }
    }

    /// Terms of all kinds, some of which are 0.
    fn varied() -> Truth {
        Truth {
            field: FieldOptics {
                focus: FocusSurface {
                    curvature_um_per_mm2: 30.0,
                    tilt_um_per_mm: (8.0, 0.0),
                    scatter_um: 0.0,
                },
                chief_ray: ChiefRay { slope: (0.01, 0.0), per_mm: 0.1 },
                distortion_per_mm2: 0.0,
                light_per_mm2: -3.0,
                coma: FieldComa { constant: (0.03, 0.0), per_mm: -0.3 },
                astigmatism: FieldAstigmatism { constant: (-0.02, 0.0), per_mm: 0.2, per_mm2: 0.0 },
                vignetting: Vignetting { meridional_per_mm2: 2.0 },
            },
            spherical: 0.02,
            transmission: -0.2,
            ..Self::uniform()
        }
    }

    /// All coefficients that a fit finds.
    fn coefficients(&self) -> Vec<(&'static str, f64)> {
        let FieldOptics { focus, chief_ray, coma, astigmatism, vignetting, .. } = &self.field;
        vec![
            ("focus_um", self.focus_um),
            ("focus.tilt_um_per_mm.0", focus.tilt_um_per_mm.0),
            ("focus.tilt_um_per_mm.1", focus.tilt_um_per_mm.1),
            ("focus.curvature_um_per_mm2", focus.curvature_um_per_mm2),
            ("chief_ray.slope.0", chief_ray.slope.0),
            ("chief_ray.slope.1", chief_ray.slope.1),
            ("chief_ray.per_mm", chief_ray.per_mm),
            ("numerical_aperture", self.numerical_aperture),
            ("vignetting.meridional_per_mm2", vignetting.meridional_per_mm2),
            ("coma.constant.0", coma.constant.0),
            ("coma.constant.1", coma.constant.1),
            ("coma.per_mm", coma.per_mm),
            ("astigmatism.constant.0", astigmatism.constant.0),
            ("astigmatism.constant.1", astigmatism.constant.1),
            ("astigmatism.per_mm", astigmatism.per_mm),
            ("astigmatism.per_mm2", astigmatism.per_mm2),
            ("spherical", self.spherical),
            ("blur_um", self.blur_um),
            ("transmission", self.transmission),
            ("light_per_mm2", self.field.light_per_mm2),
        ]
    }
}

/// The light of each particle on its surroundings, per light emitted into the half space, by plane.
struct Images {
    /// Edge of the scan, px.
    edge: usize,
    places_px: Vec<[f64; 2]>,
    stage_um: Vec<f64>,
    /// By particle and plane: indices of pixels and light.
    shares: Vec<Vec<Vec<(usize, f64)>>>,
}

impl Images {
    /// `across` x `across` particles.
    fn of(truth: &Truth, across: usize) -> Images {
        let edge = PITCH * across;
        let stage_um: Vec<f64> = (0..7).map(|i| 5.0 * f64::from(i) - 14.0).collect();
        let place = |i: usize| [25.3 + (PITCH * (i % across)) as f64, 24.8 + (PITCH * (i / across)) as f64];
        let places_px: Vec<[f64; 2]> = (0..across * across).map(place).collect();
        let WaveOptions { given, waves, .. } = options(Vec::new());
        let settings = Settings {
            magnification: given.magnification,
            numerical_aperture: truth.numerical_aperture,
            pixel_size: given.pixel_size_um,
            pixel_dim_x: edge as u32,
            pixel_dim_y: edge as u32,
            ..Settings::setting1()
        };
        let pupil = PupilFunction {
            zernike: vec![(11, truth.spherical)],
            transmission: truth.transmission,
            ..PupilFunction::default()
        };
        let optics = WaveOptics {
            emission: waves.emission,
            lens: Lens::Aplanatic,
            pupil,
            blur_um: truth.blur_um,
            ..WaveOptics::new(waves.wavelength_um)
        };
        let renderer = WavesRenderer::new(&settings, &optics, 0.1 * FINE).unwrap();
        let reach = HALF as i64 + 3;
        let of_particle = |(number, [x, y]): (usize, &[f64; 2])| {
            let scatter_um = truth.scatter_um
                * normal(&mut Streams::new(1).stream(Purpose::FocusScatter, 0, number as u32));
            let local = truth.field.at(FieldOptics::place(&settings, *x, *y));
            let images =
                renderer.single_images_at(&local, [-30.0, 30.0], DIAMETER_UM, [reach as usize + 3; 2]);
            let plane = |stage: &f64| {
                let particle = Particle::sphere(*x, *y, stage - truth.focus_um + scatter_um, DIAMETER_UM);
                let seen = truth.field.apparent(&settings, &particle);
                let (column, row) = (x.round() as i64, y.round() as i64);
                let pixels: Vec<[i64; 2]> = (row - reach..=row + reach)
                    .flat_map(|y| (column - reach..=column + reach).map(move |x| [x, y]))
                    .collect();
                let at: Vec<[f64; 2]> =
                    pixels.iter().map(|[x, y]| [*x as f64 - seen.x_px, *y as f64 - seen.y_px]).collect();
                let shares = images.shares(seen.z_um, &at);
                let index = |[x, y]: &[i64; 2]| (*y as usize - 1) * edge + *x as usize - 1;
                pixels.iter().map(index).zip(shares.iter().map(|share| seen.c_int * share)).collect()
            };
            stage_um.iter().map(plane).collect()
        };
        let shares = places_px.iter().enumerate().map(of_particle).collect();
        Images { edge, places_px, stage_um, shares }
    }

    /// Two frames of each plane, of particles with this mean light and 5 % of scatter, with shot noise of one count per
    /// count and read noise.
    fn scan(&self, light: f64, seed: u64) -> Scan {
        let streams = Streams::new(seed);
        let mut stream = streams.stream(Purpose::Intensity, 0, 0);
        let lights: Vec<f64> =
            self.places_px.iter().map(|_| light * (1.0 + 0.05 * normal(&mut stream))).collect();
        let mut planes = Vec::new();
        for plane in 0..self.stage_um.len() {
            let mut mean = vec![GLOW; self.edge * self.edge];
            for (shares, light) in self.shares.iter().zip(&lights) {
                shares[plane].iter().for_each(|(at, share)| mean[*at] += light * share);
            }
            for _ in 0..2 {
                let mut count = |mean: &f64| {
                    let electrons = poisson(&mut stream, *mean) as f64;
                    (OFFSET + electrons + READ_NOISE * normal(&mut stream)).round() as u16
                };
                planes.push(mean.iter().map(&mut count).collect());
            }
        }
        let stage_um = self.stage_um.iter().flat_map(|z| [*z; 2]).collect();
        Scan {
            width: self.edge,
            height: self.edge,
            planes,
            stage_um,
            full_scale: u16::MAX,
            warnings: Vec::new(),
        }
    }

    fn fit(&self, light: f64, seed: u64) -> FieldFit {
        let scan = self.scan(light, seed);
        fit_waves(&scan, &options(self.places_px.clone()), &|_, _| ()).unwrap().fitted
    }
}

/// Errors in standard deviations.
fn errors(made: &FieldFit, truth: &Truth) -> Vec<(&'static str, f64)> {
    let error = |(key, truth): (&'static str, f64)| {
        let found = made.coefficients.iter().find(|c| c.key == key)?;
        Some((key, (found.value - truth) / found.sd))
    };
    truth.coefficients().into_iter().filter_map(error).collect()
}

/// Mean errors of one particle's quantities over many recordings, in standard deviations of one. Weights from the counts
/// (Neyman's chi-squared) give a background of 0.32 counts less, a transmission that is off by 0.42 of its standard
/// deviation, and an NA off by 0.21: four and two standard deviations in a fit of a hundred particles.
#[test]
fn shot_noise_moves_no_quantity() {
    const RECORDINGS: u32 = 300;
    let truth = Truth::uniform();
    let images = Images::of(&truth, 1);
    let options = options(images.places_px.clone());
    let instrument = instrument(&options);
    let mut local = [0.0; local::COUNT];
    (local[FOCUS], local[NA], local[MERIDIONAL], local[BLUR], local[DIAMETER]) =
        (truth.focus_um, truth.numerical_aperture, 1.0, truth.blur_um, DIAMETER_UM);
    for (axis, at) in images.places_px[0].iter().enumerate() {
        local[X + axis] = at - at.round();
    }
    // The derivatives do not depend on the recording.
    let mut model = None;
    let mut errors = vec![0.0; free(&options).len()];
    let mut background = 0.0;
    for recording in 0..RECORDINGS {
        let scan = images.scan(4e4, u64::from(recording));
        let frames = Frames::of(&scan);
        let candidates = particles::given(&scan, &options.places_px).unwrap();
        let (subjects, _) =
            subjects::of(&scan, &frames, &instrument, (&candidates, candidates.len()), HALF, 1).unwrap();
        let (at, differences) =
            model.get_or_insert_with(|| subjects[0].model(&local, &free(&options), 0.1 * FINE).unwrap());
        let fit = subjects[0].normal(&local, at, differences, &free(&options));
        let covariance = fit.quadratic.matrix.inverse().unwrap();
        for (i, by) in covariance.times(&fit.quadratic.right).iter().enumerate() {
            errors[i] += by / libm::sqrt(covariance.at(i, i));
        }
        background += fit.background();
    }
    let off = background / f64::from(RECORDINGS) - OFFSET - GLOW;
    assert!(off.abs() < 0.05, "background off by {off} counts");
    for (quantity, error) in free(&options).iter().zip(errors) {
        // Four standard errors of the mean.
        let mean = error / f64::from(RECORDINGS);
        assert!(
            mean.abs() < 4.0 / libm::sqrt(f64::from(RECORDINGS)),
            "{}: {mean}",
            local::QUANTITIES[*quantity].0
        );
    }
}

#[test]
fn the_twin_is_a_scenario_with_the_optics_of_the_field() {
    let options = options(Vec::new());
    let fitted = FieldFit {
        coefficients: Vec::new(),
        field: FieldOptics {
            coma: FieldComa { constant: (0.04, -0.001), per_mm: -0.127 },
            focus: FocusSurface { curvature_um_per_mm2: 5.2, tilt_um_per_mm: (0.0, -3.8), scatter_um: 0.15 },
            ..FieldOptics::default()
        },
        numerical_aperture: 0.441,
        blur_um: 0.86,
        particle_diameter_um: DIAMETER_UM,
        focus_um: -1.5,
        depths_um: [-38.5, 41.5],
        noise: [14.8, 0.09, 0.0],
        is_noise_measured: true,
        background: 100.2,
        quantities: Vec::new(),
        particles: Vec::new(),
        r2_of_field: 0.99,
        chi2_of_field: 1.4,
        excess_sd: 50.0,
        r2_of_signal: 0.99,
        verdict: crate::Verdict::Good,
        warnings: Vec::new(),
    };
    let files = output::Files {
        fitted: &fitted,
        options: &options,
        spherical: 0.013,
        transmission: -0.1,
        size_px: [512, 500],
        light: (2e5, 4e4),
        particles: 80,
    };
    let folder = tempfile::tempdir().unwrap();
    let (name, bytes) = crate::output::settings(&files.settings()).unwrap();
    std::fs::write(folder.path().join(name), bytes).unwrap();
    let text = files.scenario();
    let twin =
        scenario::load_text(&text, ("scenario.ron", folder.path()), &[], None, &Context::default()).unwrap();
    let optics = &twin.spec.optics;
    assert_eq!((optics.field, optics.blur_um), (Some(fitted.field), Some(0.86)), "{text}");
    assert_eq!(twin.settings.numerical_aperture, 0.441);
    // 200,000 counts of light for a particle: photons times counts per electron.
    let particle = Particle::sphere(0.0, 0.0, 0.0, DIAMETER_UM);
    let counts = emitted_rays(&twin.settings, &particle) * twin.settings.gain * 0.09;
    assert!((counts / 2e5 - 1.0).abs() < 1e-3, "{counts}");
}

#[test]
fn the_optics_of_few_particles_are_taken_as_constant() {
    let truth = Truth::uniform();
    let made = Images::of(&truth, 1).fit(3e5, 0);
    assert!(made.coefficients.iter().all(|c| !c.key.contains("per_mm")), "{:?}", made.coefficients);
    for (key, error) in errors(&made, &truth) {
        // One of eleven is beyond four with a probability of 0.07 %.
        assert!(error.abs() < 4.0, "{key}: {error} standard deviations");
    }
    assert!(made.warnings.iter().any(|text| text.contains("taken as the same over the field")));
}

/// One scan of a bead near focus without repeated frames, of unknown diameter: widths of images tell no aperture, and the noise
/// follows from the residuals.
#[test]
fn aperture_aberrations_diameter_and_noise_of_a_small_bead_are_found() {
    let given =
        Given { magnification: 1.0, pixel_size_um: 0.1, ri_medium: 1.0, ri_lens: 1.5, depth_factor: 1.0 };
    let waves = WaveModel { wavelength_um: 0.52, emission: Emission::Surface, layers: None };
    let options = WaveOptions {
        given,
        diameter_um: None,
        waves,
        is_field: false,
        half_window: Some(10),
        ..options(vec![[13.0, 13.0]])
    };
    let mut truth = [0.0; local::COUNT];
    for (quantity, value) in [
        (FOCUS, 0.1),
        (X, 0.2),
        (Y, -0.1),
        (NA, 0.8),
        (MERIDIONAL, 1.0),
        (COMA, -0.05),
        (ASTIGMATISM, 0.12),
        (SPHERICAL, 0.06),
        (DIAMETER, 0.4),
    ] {
        truth[quantity] = value;
    }
    let (edge, light) = (25, 2e5);
    let images = instrument(&options).images(&truth, [1.0, 0.0], [-2.0, 2.0], 12, 0.1 * FINE).unwrap();
    let stage_um: Vec<f64> = (0..9).map(|i| 0.3 * (f64::from(i) - 4.0)).collect();
    let mut stream = Streams::new(1).stream(Purpose::Intensity, 0, 0);
    let places: Vec<[f64; 2]> = (0..edge * edge)
        .map(|i| [(i % edge) as f64 - 12.0 - truth[X], (i / edge) as f64 - 12.0 - truth[Y]])
        .collect();
    let mut plane = |stage: &f64| -> Vec<u16> {
        let shares = images.shares(stage - truth[FOCUS], &places);
        let mut count = |share: f64| {
            OFFSET + poisson(&mut stream, light * share) as f64 + READ_NOISE * normal(&mut stream)
        };
        shares.into_iter().map(|share| count(share).round() as u16).collect()
    };
    let scan = Scan {
        width: edge,
        height: edge,
        planes: stage_um.iter().map(&mut plane).collect(),
        stage_um,
        full_scale: u16::MAX,
        warnings: Vec::new(),
    };
    let made = fit_waves(&scan, &options, &|_, _| ()).unwrap().fitted;
    for (key, quantity) in [
        ("numerical_aperture", NA),
        ("coma.constant.0", COMA),
        ("coma.constant.1", COMA + 1),
        ("astigmatism.constant.0", ASTIGMATISM),
        ("astigmatism.constant.1", ASTIGMATISM + 1),
        ("spherical", SPHERICAL),
        ("particle_diameter_um", DIAMETER),
        ("transmission", TRANSMISSION),
        ("focus_um", FOCUS),
    ] {
        let found = made.coefficients.iter().find(|c| c.key == key).unwrap();
        // One of nine is beyond four standard deviations with a probability of 0.06 %.
        assert!((found.value - truth[quantity]).abs() < 4.0 * found.sd, "{found:?}, not {}", truth[quantity]);
    }
    assert_eq!(made.verdict, crate::Verdict::NoiseLimited, "{}", made.sentence());
    // Few pixels show the background alone.
    assert!((made.noise[1] - 1.0).abs() < 0.1 && (made.noise[0] - 4.1).abs() < 2.0, "{:?}", made.noise);
}

#[test]
fn the_scatter_of_the_focus_is_that_of_the_particles_and_0_for_none() {
    for scatter_um in [0.0, 0.4] {
        let images = Images::of(&Truth { scatter_um, ..Truth::uniform() }, 3);
        let made = images.fit(3e5, 2);
        let found = made.coefficients.iter().find(|c| c.key == dependence::SCATTER).unwrap();
        assert!((found.value - scatter_um).abs() < 1.96 * found.sd, "{found:?}, not {scatter_um}");
        assert_eq!(
            (found.value, made.field.focus.scatter_um > 0.0),
            (made.field.focus.scatter_um, scatter_um > 0.0)
        );
    }
}

#[test]
fn windows_are_as_wide_as_the_spacing_allows() {
    let candidate = |k: usize, pitch: f64| particles::Candidate {
        x: pitch * (k % 5) as f64,
        y: pitch * (k / 5) as f64,
        brightness: 1.0,
    };
    for (particles, pitch, half) in [(25, 34.0, 17), (25, 9.0, 8), (1, 34.0, usize::MAX)] {
        let candidates: Vec<_> = (0..particles).map(|k| candidate(k, pitch)).collect();
        assert_eq!(particles::half_spacing(&candidates), half);
    }
}

/// A neighbor that is not to be fitted is masked all the same.
#[test]
fn the_light_of_particles_that_are_not_fitted_is_masked() {
    let truth = Truth::uniform();
    let images = Images::of(&truth, 1);
    let mut scan = images.scan(3e5, 0);
    // A second image of the particle, 11 px to the right.
    let edge = images.edge;
    let shifted = |plane: &Vec<u16>| -> Vec<u16> {
        let light = |at: usize| if at % edge < 11 { 0.0 } else { f64::from(plane[at - 11]) - OFFSET - GLOW };
        (0..plane.len()).map(|at| (f64::from(plane[at]) + light(at)).max(0.0) as u16).collect()
    };
    scan.planes = scan.planes.iter().map(shifted).collect();
    let [x, y] = images.places_px[0];
    let chi2 = |all_px: Vec<[f64; 2]>| {
        let options = WaveOptions { all_px, ..options(vec![[x, y]]) };
        let shares = std::sync::Mutex::new(Vec::new());
        let made = fit_waves(&scan, &options, &|_, share| shares.lock().unwrap().extend(share)).unwrap();
        assert_eq!(shares.into_inner().unwrap(), [0.0, COMPARING]);
        (made.fitted.particles.len(), made.fitted.chi2_of_field)
    };
    let (particles, masked) = chi2(vec![[x + 1.0, y], [x + 11.0, y]]);
    let (_, lit) = chi2(Vec::new());
    assert!(particles == 1 && masked < 1.2 && lit > 1.5, "{masked}, {lit}");
}

/// The 95 % intervals of each term, over scans that differ by noise and the light of particles.
#[test]
#[ignore = "slow: .ci/full"]
#[expect(clippy::print_stdout, reason = "the counts are also of interest when they suffice")]
fn intervals_of_a_field_cover_its_terms() {
    let scans = 16_u64;
    // Half a minute each.
    let truth = Truth::varied();
    let images = Images::of(&truth, 4);
    let mut covered = std::collections::BTreeMap::<&str, Vec<f64>>::new();
    for seed in 0..scans {
        let made = images.fit(3e5, seed);
        assert!((made.background - OFFSET - GLOW).abs() < 0.3, "{}", made.background);
        for (key, error) in errors(&made, &truth) {
            covered.entry(key).or_default().push(error);
        }
    }
    let inside = |errors: &[f64]| errors.iter().filter(|error| error.abs() < 1.96).count();
    for (key, errors) in &covered {
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        println!("{key}: {} of {scans}, mean error {mean:.2} standard deviations", inside(errors));
    }
    assert_eq!(covered.len(), truth.coefficients().len());
    assert!(covered.values().all(|errors| inside(errors) as f64 >= 0.85 * scans as f64));
}
