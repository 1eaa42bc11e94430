//! The fit of a whole field: the optics of an objective as they vary over the field of view.
//!
//! Single particles are found over the field (`particles`), repeated frames give the noise (`frames`), each
//! particle is fitted by wave optics with aberrations of its own (`local`, `particle`), and the laws of the
//! field follow from all that are single (`laws`). Particles are taken to lie on a plane across the stage's
//! motion: a tilt of the plane is a tilt of the focus.

mod frames;
mod laws;
mod local;
mod output;
mod particle;

use microsig_core::Settings;
use microsig_core::optics::FieldOptics;
use microsig_core::render::waves::{Lens, WaveOptics};
use serde::Serialize;

use crate::background::Background;
use crate::images::Watch;
use crate::linear::Symmetric;
use crate::optics::Given;
use crate::particles::{self, Candidate, Window};
use crate::scan::Scan;
use crate::waves::WaveModel;
use frames::Frames;
pub use laws::Coefficient;
use laws::{Evidence, Laws};
use local::{
    ASTIGMATISM, BLUR, COMA, FOCUS, Instrument, Local, MERIDIONAL, NA, QUANTITIES, SLOPE, SPHERICAL,
    TRANSMISSION, X, Y,
};
use particle::{COARSE, FINE, Fit, Subject};
use storage::error::{Error, Result};

/// Options of [`fit_field`].
#[derive(Debug, Clone)]
pub struct FieldOptions {
    /// Given properties of the microscope.
    pub given: Given,
    /// Particle diameter, um: it cannot be told from blur.
    pub diameter_um: f64,
    /// +1: stage positions increase away from the lens; -1: toward it. Images tell only if the spherical
    /// aberration is known.
    pub direction: f64,
    /// Light and objective.
    pub waves: WaveModel,
    /// Half width of the windows, px; from the size of the images if `None`.
    pub half_window: Option<usize>,
    /// Positions of the particles, px, with the first pixel's center at (1, 1); detected if `None`.
    pub places_px: Option<Vec<[f64; 2]>>,
}

/// One particle of a field.
#[derive(Debug, Clone, Serialize)]
pub struct FieldParticle {
    /// Position in focus, px, with the first pixel's center at (1, 1).
    pub x_px: f64,
    /// See `x_px`.
    pub y_px: f64,
    /// Place in the field, mm from its center in the particles' space.
    pub place_mm: [f64; 2],
    /// Whether its images are those of one particle; otherwise it is perhaps two, or a dirty one.
    pub is_single: bool,
    /// Mean square of residuals over the variance of the mean of repeated frames, with values of its own.
    pub chi2: f64,
    /// Explained part of the images' variance, with values of its own.
    pub r2: f64,
    /// The same with the laws of the field; only position, light and background are its own.
    pub chi2_of_laws: f64,
    /// See `chi2_of_laws`.
    pub r2_of_laws: f64,
    /// Mean light, counts.
    pub light: f64,
    /// Values of its own, by quantity.
    pub measured: Vec<f64>,
    /// Their standard deviations.
    pub sd: Vec<f64>,
    /// Values of the laws.
    pub law: Vec<f64>,
}

/// The images of a particle at some planes, for a report.
#[derive(Debug, Clone)]
pub struct FieldImages {
    /// Index of the particle.
    pub particle: usize,
    /// Edge of an image, px.
    pub edge: usize,
    /// For each plane its stage position (um), data and model, counts above the background.
    pub planes: Vec<(f64, Vec<f64>, Vec<f64>)>,
}

/// The result of a fit of a whole field.
#[derive(Debug, Clone, Serialize)]
pub struct FieldFit {
    /// Coefficients of the laws.
    pub coefficients: Vec<Coefficient>,
    /// The optics as in a scenario.
    pub field: FieldOptics,
    /// Numerical aperture.
    pub numerical_aperture: f64,
    /// Standard deviation of the blur, um.
    pub blur_um: f64,
    /// Stage position in focus at the center of the field, um.
    pub focus_um: f64,
    /// Depth range of the scan, um.
    pub depths_um: [f64; 2],
    /// Variance of a count: background (counts^2), per count of light (counts), per squared count.
    pub noise: [f64; 3],
    /// Whether that is the noise between repeated frames; otherwise only the background's is known.
    pub is_noise_measured: bool,
    /// Background, counts.
    pub background: f64,
    /// Names of the quantities of each particle.
    pub quantities: Vec<&'static str>,
    /// All particles, nearest to the center first.
    pub particles: Vec<FieldParticle>,
    /// Mean over single particles, by the laws.
    pub r2_of_laws: f64,
    /// Median over single particles, by the laws, in units of the variance of one frame.
    pub chi2_of_laws: f64,
    /// What to know about the result.
    pub warnings: Vec<String>,
}

/// A fit with the files that describe it.
#[derive(Debug)]
pub struct FieldFiles {
    /// Result of the fit.
    pub fitted: FieldFit,
    /// Images from the center to the corner.
    pub images: Vec<FieldImages>,
    /// Names and contents of the files.
    pub files: Vec<(&'static str, Vec<u8>)>,
}

/// Largest number of particles.
const MOST: usize = 60;

/// Smallest number of single particles that determine the laws.
const FEWEST: usize = 8;

/// Number of planes that are used.
const PLANES: usize = 17;

/// A particle is not single if its chi2 exceeds the median of all by this factor.
const DOUBLE: f64 = 1.8;

/// The quantities of a particle that are fitted.
const FREE: [usize; 14] = [
    FOCUS,
    X,
    Y,
    SLOPE,
    SLOPE + 1,
    NA,
    MERIDIONAL,
    COMA,
    COMA + 1,
    ASTIGMATISM,
    ASTIGMATISM + 1,
    SPHERICAL,
    BLUR,
    TRANSMISSION,
];

/// Fits the optics of a whole field to a scan; `watch` receives progress messages.
///
/// # Errors
/// [`storage::Error::Input`] if the scan has too few single particles.
pub fn fit_field(scan: &Scan, options: &FieldOptions, watch: Watch<'_>) -> Result<FieldFiles> {
    watch("noise of repeated frames");
    let frames = Frames::of(scan);
    watch("particles");
    let background = Background::of(&scan.planes);
    let candidates = match &options.places_px {
        Some(places) => particles::given(places),
        None => particles::find(scan, background, particles::FAINT)?,
    };
    let half = options.half_window.unwrap_or_else(|| particles::half_width(scan, background, &candidates));
    let windows = windows(scan, &candidates, half)?;
    let instrument = instrument(options);
    let place = |window: &Window| {
        let settings = Settings {
            pixel_dim_x: scan.width as u32,
            pixel_dim_y: scan.height as u32,
            ..instrument.settings.clone()
        };
        FieldOptics::place(&settings, window.column as f64 + 1.0, window.row as f64 + 1.0)
    };
    let radius = |[x, y]: [f64; 2]| libm::hypot(x, y);
    let mut all: Vec<&Window> = windows.iter().collect();
    all.sort_by(|a, b| radius(place(a)).total_cmp(&radius(place(b))));
    let found = all.len();
    let kept = spread_out(&all.iter().map(|window| place(window)).collect::<Vec<_>>(), MOST);
    let all: Vec<&Window> = kept.into_iter().map(|i| all[i]).collect();
    let places: Vec<[f64; 2]> = all.iter().map(|window| place(window)).collect();
    let subjects: Vec<Subject> = all
        .iter()
        .zip(&places)
        .map(|(&window, &[x, y])| {
            let r = radius([x, y]);
            Subject {
                instrument: &instrument,
                frames: &frames,
                window,
                half,
                planes: evenly(frames.planes.len(), PLANES),
                toward: if r > 0.0 { [x / r, y / r] } else { [1.0, 0.0] },
                masks: Vec::new(),
            }
        })
        .collect();
    let rough = rough(&subjects, &candidates);
    let subjects: Vec<Subject> = subjects
        .into_iter()
        .map(|subject| {
            let masks = subject.planes.iter().map(|plane| mask(&subject, &candidates, *plane, &rough));
            Subject { masks: masks.collect(), ..subject }
        })
        .collect();
    let (subjects, places): (Vec<Subject>, Vec<[f64; 2]>) =
        subjects.into_iter().zip(places).filter(|(subject, _)| subject.is_clear()).unzip();
    let mut fits: Vec<Fit> = Vec::with_capacity(subjects.len());
    for (k, subject) in subjects.iter().enumerate() {
        watch(&format!("particle {} of {}", k + 1, subjects.len()));
        // The nearest particle that was fitted well is nearly right.
        let nearest = (0..k)
            .filter(|&j| is_good(&fits[j], &fits))
            .min_by(|&a, &b| distance(places[a], places[k]).total_cmp(&distance(places[b], places[k])));
        fits.push(single(subject, nearest.map(|j| fits[j].local))?);
    }
    watch("laws of the field");
    let median = median(fits.iter().map(Fit::chi2).collect());
    let is_single: Vec<bool> = fits.iter().map(|fit| fit.chi2() < DOUBLE * median).collect();
    let singles: Vec<usize> = (0..fits.len()).filter(|k| is_single[*k]).collect();
    if singles.len() < FEWEST {
        return Err(Error::input(format!(
            "{} single particles in the scan, of {} with windows of {1} px; the laws of a field need at least {FEWEST}: omit the \
             planes with the largest images (--planes A-B) or set a smaller --window",
            singles.len(),
            2 * half + 1
        )));
    }
    let evidence = |fits: &[Fit]| -> Vec<Evidence> {
        singles.iter().filter_map(|&k| evidence_of(places[k], &fits[k])).collect()
    };
    let undetermined =
        || Error::input("the particles do not determine the laws of the field: they must be spread over it");
    let laws = Laws::of(&evidence(&fits)).ok_or_else(undetermined)?;
    watch("laws of the field: refinement");
    let refined = about_laws(&subjects, &fits, &singles, |k| laws.at(places[k], &fits[k].local))?;
    let laws = Laws::of(&evidence(&refined)).ok_or_else(undetermined)?;
    watch("images by the laws");
    let of_laws: Vec<Fit> = (0..fits.len())
        .map(|k| {
            let start = laws.at(places[k], &fits[k].local);
            subjects[k].fit(&start, &[X, Y], FINE, 2)
        })
        .collect::<Result<_>>()?;
    let result = Outcome {
        scan,
        options,
        frames: &frames,
        subjects: &subjects,
        places: &places,
        candidates: &candidates,
        found,
    };
    result.files(&fits, &is_single, &laws, &of_laws)
}

/// Fits of single particles by one step from the laws, where the quadratic approximations hold for all of
/// them.
fn about_laws(
    subjects: &[Subject],
    fits: &[Fit],
    singles: &[usize],
    at_laws: impl Fn(usize) -> Local,
) -> Result<Vec<Fit>> {
    let mut refined = fits.to_vec();
    for &k in singles {
        let fit = subjects[k].fit_at(&at_laws(k), &FREE, FINE)?;
        let mut local = fit.local;
        if let Some(step) = fit.quadratic.matrix.solve(&fit.quadratic.right) {
            FREE.iter().zip(step).for_each(|(&quantity, by)| local[quantity] += by);
        }
        refined[k] = Fit { local, ..fit };
    }
    Ok(refined)
}

/// Windows around all particles that are far enough from the edge and not saturated.
fn windows(scan: &Scan, candidates: &[Candidate], half: usize) -> Result<Vec<Window>> {
    let reach = half as isize;
    let pixels = |column: usize, row: usize| -> Vec<(usize, [f64; 2])> {
        let offsets = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)));
        let at = |(dx, dy): (isize, isize)| {
            (row as isize + dy) as usize * scan.width + (column as isize + dx) as usize
        };
        offsets.map(|(dx, dy)| (at((dx, dy)), [dx as f64, dy as f64])).collect()
    };
    let mut windows = Vec::new();
    let (mut cut, mut saturated) = (0, 0);
    for candidate in candidates {
        let (column, row) = (candidate.x.round() as usize, candidate.y.round() as usize);
        if column < half || row < half || column + half >= scan.width || row + half >= scan.height {
            cut += 1;
            continue;
        }
        let window = Window::new([column, row], pixels(column, row));
        let full = |plane: &Vec<u16>| {
            let full = window.pixels.iter().filter(|(at, _)| plane[*at] >= scan.full_scale);
            full.count() >= particles::SATURATED_PIXELS
        };
        if scan.planes.iter().any(full) {
            saturated += 1;
            continue;
        }
        windows.push(window);
    }
    if windows.is_empty() {
        return Err(Error::input(format!(
            "none of {} particles can be used with windows of {1} x {1} px: {cut} are cut by the edge of the image, {saturated} \
             are saturated",
            candidates.len(),
            2 * half + 1
        )));
    }
    Ok(windows)
}

/// How large images are: stage position in focus (um) and growth (px/um).
struct Rough {
    focus_um: f64,
    growth: f64,
}

/// From the moments of the particles that have no neighbors, or of all.
fn rough(subjects: &[Subject], candidates: &[Candidate]) -> Rough {
    let alone =
        |subject: &&Subject| neighbors(subject.window, candidates, 2.0 * subject.half as f64).is_empty();
    let mut usable: Vec<&Subject> = subjects.iter().filter(alone).collect();
    if usable.is_empty() {
        usable = subjects.iter().collect();
    }
    let starts: Vec<Local> = usable.into_iter().map(particle::start).collect();
    let of = |quantity: usize| median(starts.iter().map(|start| start[quantity]).collect());
    let na = of(NA);
    let per_px = subjects.first().map_or(1.0, |subject| subject.instrument.px_per_um());
    Rough { focus_um: of(FOCUS), growth: na / libm::sqrt(1.0 - na * na) * per_px }
}

/// Offsets of other particles within a distance of the middle of a window, px.
fn neighbors(window: &Window, candidates: &[Candidate], within: f64) -> Vec<[f64; 2]> {
    let offset = |other: &Candidate| [other.x - window.column as f64, other.y - window.row as f64];
    let near = |[x, y]: &[f64; 2]| (OWN..within).contains(&libm::hypot(*x, *y));
    candidates.iter().map(offset).filter(near).collect()
}

/// Distance within which a maximum is the particle's own, px.
const OWN: f64 = 2.0;

/// Radius of images in focus, and margin around geometric images, px.
const MARGIN_PX: f64 = 4.0;

/// The pixels of a window to which no neighbor gives light in a plane.
fn mask(subject: &Subject, candidates: &[Candidate], plane: usize, rough: &Rough) -> Vec<bool> {
    let defocus_um = (subject.frames.stage_um[plane] - rough.focus_um).abs();
    let radius = defocus_um * rough.growth + MARGIN_PX;
    let others = neighbors(subject.window, candidates, 2.0 * subject.half as f64 + radius);
    let is_clear =
        |&(_, [dx, dy]): &(usize, [f64; 2])| others.iter().all(|[x, y]| libm::hypot(dx - x, dy - y) > radius);
    subject.window.pixels.iter().map(is_clear).collect()
}

/// The parts of a result.
struct Outcome<'a> {
    scan: &'a Scan,
    options: &'a FieldOptions,
    frames: &'a Frames,
    subjects: &'a [Subject<'a>],
    places: &'a [[f64; 2]],
    candidates: &'a [Candidate],
    found: usize,
}

impl Outcome<'_> {
    fn files(&self, fits: &[Fit], is_single: &[bool], laws: &Laws, of_laws: &[Fit]) -> Result<FieldFiles> {
        let Outcome { scan, options, frames, subjects, places, candidates, .. } = self;
        let repeats = frames.repeats.iter().sum::<usize>() as f64 / frames.repeats.len() as f64;
        let singles: Vec<usize> = (0..fits.len()).filter(|k| is_single[*k]).collect();
        let light: Vec<([f64; 2], f64)> = singles.iter().map(|&k| (places[k], of_laws[k].light())).collect();
        let (light_per_mm2, light_sd) = light_law(&light);
        let mut coefficients = laws.coefficients.clone();
        coefficients.push(Coefficient {
            key: "light_per_mm2",
            value: light_per_mm2,
            sd: light_sd,
            unit: "1/mm^2",
        });
        // What is within its error is no light law.
        let light_per_mm2 = if light_per_mm2.abs() > 2.0 * light_sd { light_per_mm2 } else { 0.0 };
        let quantities: Vec<&'static str> = FREE.iter().map(|q| QUANTITIES[*q].0).collect();
        let particles: Vec<FieldParticle> = (0..fits.len())
            .map(|k| {
                let window = subjects[k].window;
                let local = &fits[k].local;
                let law = laws.at(places[k], local);
                let covariance = fits[k].quadratic.matrix.inverse();
                let sd = |i: usize| {
                    covariance.as_ref().map_or(f64::NAN, |c| libm::sqrt(fits[k].chi2() * c.at(i, i).max(0.0)))
                };
                FieldParticle {
                    x_px: window.column as f64 + 1.0 + local[X],
                    y_px: window.row as f64 + 1.0 + local[Y],
                    place_mm: places[k],
                    is_single: is_single[k],
                    chi2: fits[k].chi2(),
                    r2: fits[k].r2(),
                    chi2_of_laws: of_laws[k].chi2(),
                    r2_of_laws: of_laws[k].r2(),
                    light: of_laws[k].light(),
                    measured: FREE.iter().map(|q| local[*q]).collect(),
                    sd: (0..FREE.len()).map(sd).collect(),
                    law: FREE.iter().map(|q| law[*q]).collect(),
                }
            })
            .collect();
        let mean_r2 = singles.iter().map(|&k| of_laws[k].r2()).sum::<f64>() / singles.len() as f64;
        let chi2 = median(singles.iter().map(|&k| of_frame(of_laws[k].chi2(), repeats)).collect());
        let warnings = self.warnings(fits.len(), singles.len());
        let noise = frames.noise;
        let stage = |f: fn(f64, f64) -> f64, start: f64| {
            frames.stage_um.iter().map(|s| options.direction * (s - laws.focus_um())).fold(start, f)
        };
        let fitted = FieldFit {
            coefficients,
            field: laws.field(options.direction, light_per_mm2),
            numerical_aperture: laws.numerical_aperture(),
            blur_um: laws.blur_um(),
            focus_um: laws.focus_um(),
            depths_um: [stage(f64::min, f64::INFINITY), stage(f64::max, f64::NEG_INFINITY)],
            noise: [noise.background2, noise.per_count, noise.per_count2],
            is_noise_measured: frames.is_noise_measured,
            background: frames.background,
            quantities,
            particles,
            r2_of_laws: mean_r2,
            chi2_of_laws: chi2,
            warnings,
        };
        let shown = center_to_corner(&fitted.particles);
        let images = shown.into_iter().map(|k| images(k, &subjects[k], &of_laws[k])).collect();
        let mean_light = median(light.iter().map(|(_, light)| *light).collect());
        let twin = output::Twin {
            fitted: &fitted,
            options,
            spherical: laws.spherical(),
            transmission: laws.transmission(),
            size_px: [scan.width, scan.height],
            light: mean_light,
            particles: candidates.len(),
        };
        let mut json = serde_json::to_vec_pretty(&fitted).map_err(|e| Error::input(e.to_string()))?;
        json.push(b'\n');
        let files = vec![
            ("field.json", json),
            ("scenario.ron", twin.scenario().into_bytes()),
            ("particles.csv", output::table(&fitted)),
        ];
        Ok(FieldFiles { fitted, images, files })
    }

    fn warnings(&self, particles: usize, singles: usize) -> Vec<String> {
        let mut warnings = self.scan.warnings.clone();
        if !self.frames.is_noise_measured {
            warnings.push(
                "the scan has no repeated frames: only the noise of the background is known, so chi2 and intervals are too large \
                 and too small where images are bright"
                    .to_owned(),
            );
        }
        let doubtful = particles - singles;
        if doubtful > 0 {
            warnings.push(format!(
                "{doubtful} of {} particles are not described as single ones (two, or dirty) and are left out",
                particles
            ));
        }
        if self.found > particles {
            warnings.push(format!("{particles} of {} particles are used, spread over the field", self.found));
        }
        warnings.push(format!(
            "the direction of the stage ({} the lens) is taken as given: reversed, images are the same with aberrations of the \
             opposite sign",
            if self.options.direction > 0.0 { "away from" } else { "toward" }
        ));
        warnings
    }
}

/// Chi-squared of single frames, from that of means of `repeats` frames: their residuals share the errors of
/// the model and have less noise.
fn of_frame(chi2: f64, repeats: f64) -> f64 {
    1.0 + (chi2 - 1.0) / repeats
}

fn instrument(options: &FieldOptions) -> Instrument {
    let FieldOptions { given, waves, .. } = options;
    Instrument {
        settings: Settings {
            magnification: given.magnification,
            pixel_size: given.pixel_size_um,
            ri_medium: given.ri_medium,
            ri_lens: given.ri_lens,
            cyl_focal_length: 0.0,
            ..Settings::setting1()
        },
        light: WaveOptics {
            emission: waves.emission,
            lens: Lens::Aplanatic,
            layers: waves.layers,
            ..WaveOptics::new(waves.wavelength_um)
        },
        d_um: options.diameter_um,
        direction: options.direction,
    }
}

/// The fit of one particle, from another's values or from scratch.
fn single(subject: &Subject, like: Option<Local>) -> Result<Fit> {
    let own = particle::start(subject);
    let start = match like {
        Some(mut like) => {
            (like[X], like[Y]) = (own[X], own[Y]);
            like
        }
        None => {
            let some = evenly(subject.planes.len(), PLANES / 2 + 1);
            let few = Subject {
                planes: some.iter().map(|i| subject.planes[*i]).collect(),
                masks: some.iter().filter_map(|i| subject.masks.get(*i).cloned()).collect(),
                ..*subject
            };
            few.fit(&own, &[FOCUS, X, Y, NA, BLUR], COARSE, 12)?.local
        }
    };
    subject.fit(&start, &FREE, FINE, if like.is_some() { 4 } else { 8 })
}

fn is_good(fit: &Fit, all: &[Fit]) -> bool {
    fit.chi2() < DOUBLE * median(all.iter().map(Fit::chi2).collect())
}

fn evidence_of(place: [f64; 2], fit: &Fit) -> Option<Evidence> {
    let inverse = fit.quadratic.matrix.inverse()?;
    let n = inverse.n;
    let mut covariance = Symmetric::zeros(n);
    for i in 0..n {
        (0..n).for_each(|j| covariance.add(i, j, fit.chi2() * inverse.at(i, j)));
    }
    Some(Evidence { place, local: fit.local, free: fit.free.clone(), covariance })
}

/// Relative change of light per squared distance from the center, and its standard deviation: a straight line
/// through the light of particles, without those far off.
fn light_law(light: &[([f64; 2], f64)]) -> (f64, f64) {
    let middle = median(light.iter().map(|(_, light)| *light).collect());
    let points: Vec<(f64, f64)> = light
        .iter()
        .map(|([x, y], light)| (x * x + y * y, light / middle))
        .filter(|(_, light)| (0.5..2.0).contains(light))
        .collect();
    let n = points.len() as f64;
    let (mean_r2, mean) = points.iter().fold((0.0, 0.0), |(a, b), (r2, light)| (a + r2 / n, b + light / n));
    let spread: f64 = points.iter().map(|(r2, _)| (r2 - mean_r2) * (r2 - mean_r2)).sum();
    if points.len() < 4 || spread == 0.0 {
        return (0.0, f64::INFINITY);
    }
    let slope = points.iter().map(|(r2, light)| (r2 - mean_r2) * (light - mean)).sum::<f64>() / spread;
    let left = |(r2, light): &(f64, f64)| light - mean - slope * (r2 - mean_r2);
    let variance = points.iter().map(|point| left(point) * left(point)).sum::<f64>() / (n - 2.0);
    let center = mean - slope * mean_r2;
    (slope / center, libm::sqrt(variance / spread) / center)
}

/// So many indices of `of`, evenly spaced, the first and the last included.
fn evenly(of: usize, most: usize) -> Vec<usize> {
    let count = of.min(most);
    (0..count).map(|i| i * (of - 1) / (count - 1).max(1)).collect()
}

/// So many places that cover the field: each next one is that farthest from those before.
fn spread_out(places: &[[f64; 2]], most: usize) -> Vec<usize> {
    let mut kept: Vec<usize> = Vec::new();
    let mut left: Vec<usize> = (0..places.len()).collect();
    while kept.len() < most && !left.is_empty() {
        let apart =
            |i: usize| kept.iter().map(|k| distance(places[*k], places[i])).fold(f64::INFINITY, f64::min);
        let next = if kept.is_empty() {
            0
        } else {
            (0..left.len()).max_by(|a, b| apart(left[*a]).total_cmp(&apart(left[*b]))).unwrap_or(0)
        };
        kept.push(left.remove(next));
    }
    kept.sort_unstable();
    kept
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Three single particles: near the center, halfway, and far out.
fn center_to_corner(particles: &[FieldParticle]) -> Vec<usize> {
    let singles: Vec<usize> = (0..particles.len()).filter(|k| particles[*k].is_single).collect();
    let mut shown: Vec<usize> = evenly(singles.len(), 3).into_iter().map(|i| singles[i]).collect();
    shown.dedup();
    shown
}

fn images(particle: usize, subject: &Subject, fit: &Fit) -> FieldImages {
    let edge = 2 * subject.half + 1;
    let planes = evenly(subject.planes.len(), 7).into_iter().map(|i| {
        let plane = subject.planes[i];
        let seen = &fit.seen[i];
        let (mut data, mut model) = (vec![0.0; edge * edge], vec![0.0; edge * edge]);
        let is_used = |pixel: usize| subject.masks.get(i).is_none_or(|mask| mask[pixel]);
        let pixels = subject.window.pixels.iter().zip(&seen.model).enumerate();
        for (_, ((at, [dx, dy]), value)) in pixels.filter(|(pixel, _)| is_used(*pixel)) {
            let place = (dy + subject.half as f64) as usize * edge + (dx + subject.half as f64) as usize;
            data[place] = subject.frames.planes[plane][*at] - seen.background;
            model[place] = value - seen.background;
        }
        (subject.frames.stage_um[plane], data, model)
    });
    FieldImages { particle, edge, planes: planes.collect() }
}
