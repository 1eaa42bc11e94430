//! A fit of a small field that is known.

use microsig_core::Particle;
use microsig_core::emission::emitted_rays;
use microsig_core::optics::{FieldComa, FieldOptics, FocusSurface};
use microsig_core::render::Context;
use microsig_core::render::waves::Emission;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt as _, SeedableRng as _};
use rayon::prelude::*;

use super::local::COUNT;
use super::*;

/// Edge of the scan and half width of the windows, px.
const EDGE: usize = 230;
const HALF: usize = 9;

fn options(places_px: Vec<[f64; 2]>) -> FieldOptions {
    let given =
        Given { magnification: 10.0, pixel_size_um: 16.0, ri_medium: 1.0, ri_lens: 1.5, depth_factor: 1.0 };
    let (emission, lens) = (Emission::Volume, Lens::Aplanatic);
    let waves = WaveModel { wavelength_um: 0.56, emission, lens, layers: None };
    FieldOptions { given, diameter_um: 2.0, direction: 1.0, waves, half_window: Some(HALF), places_px }
}

/// The optics of the test at a place, mm.
fn truth([x, y]: [f64; 2]) -> Local {
    let r2 = x * x + y * y;
    let mut local = [0.0; COUNT];
    local[FOCUS] = 1.0 + 8.0 * x - 4.0 * y + 30.0 * r2;
    local[SLOPE] = 0.01 + 0.1 * x;
    local[SLOPE + 1] = 0.1 * y;
    local[NA] = 0.3;
    local[MERIDIONAL] = 1.0 - 2.0 * r2;
    local[COMA] = 0.03 - 0.3 * x;
    local[COMA + 1] = -0.3 * y;
    local[ASTIGMATISM] = -0.02 + 0.2 * x;
    local[ASTIGMATISM + 1] = 0.2 * y;
    local[SPHERICAL] = 0.02;
    local[BLUR] = 0.8;
    local
}

/// Coefficients of [`truth`], and errors that are allowed without noise.
const TRUTH: [(&str, f64, f64); 14] = [
    ("focus_um", 1.0, 0.05),
    ("focus.tilt_um_per_mm.0", 8.0, 0.3),
    ("focus.tilt_um_per_mm.1", -4.0, 0.3),
    ("focus.curvature_um_per_mm2", 30.0, 2.0),
    ("chief_ray.slope.0", 0.01, 0.001),
    ("chief_ray.per_mm", 0.1, 0.005),
    ("numerical_aperture", 0.3, 0.002),
    ("vignetting.meridional_per_mm2", 2.0, 0.2),
    ("coma.constant.0", 0.03, 0.003),
    ("coma.per_mm", -0.3, 0.02),
    ("astigmatism.constant.0", -0.02, 0.003),
    ("astigmatism.per_mm", 0.2, 0.02),
    ("spherical", 0.02, 0.003),
    ("blur_um", 0.8, 0.02),
];

fn place_mm([x_px, y_px]: [f64; 2]) -> [f64; 2] {
    let settings = Settings {
        pixel_dim_x: EDGE as u32,
        pixel_dim_y: EDGE as u32,
        ..instrument(&options(Vec::new())).settings
    };
    FieldOptics::place(&settings, x_px, y_px)
}

/// Five by four particles on dark counts of 100, each with a brightness of its own; with a seed, with noise of
/// 4 counts and 0.1 of the light in two frames of each plane.
fn scan(seed: Option<u64>) -> (Scan, Vec<[f64; 2]>) {
    let instrument = instrument(&options(Vec::new()));
    let stage_um: Vec<f64> = (0..9).map(|i| 4.0 * f64::from(i) - 15.0).collect();
    let places_px: Vec<[f64; 2]> = (0..20)
        .map(|i| [20.0 + 47.0 * f64::from(i % 5) + 0.3, 25.0 + 59.0 * f64::from(i / 5) - 0.2])
        .collect();
    let mut planes = vec![vec![100.0f64; EDGE * EDGE]; stage_um.len()];
    for (k, at) in places_px.iter().enumerate() {
        let place = place_mm(*at);
        let local = truth(place);
        let r = libm::hypot(place[0], place[1]);
        let images =
            instrument.images(&local, place.map(|at| at / r), [-30.0, 30.0], 2 * HALF, FINE).unwrap();
        for (plane, stage_um) in planes.iter_mut().zip(&stage_um) {
            let depth_um = instrument.depth_um(&local, *stage_um);
            let moved = depth_um * instrument.px_per_um();
            let middle = at.map(|at| at.round());
            let reach = HALF as i64 + 2;
            let offsets = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| [x as f64, y as f64]));
            let offsets: Vec<[f64; 2]> = offsets.collect();
            let relative = |offset: &[f64; 2]| {
                [0, 1].map(|axis| middle[axis] + offset[axis] - at[axis] - local[SLOPE + axis] * moved)
            };
            let shares = images.shares(depth_um, &offsets.iter().map(relative).collect::<Vec<_>>());
            for (offset, share) in offsets.iter().zip(shares) {
                let [x, y] = [0, 1].map(|axis| (middle[axis] + offset[axis]) as usize - 1);
                if let Some(count) = plane.get_mut(y * EDGE + x) {
                    *count += (3e5 + 1e4 * k as f64) * share;
                }
            }
        }
    }
    let frames = if seed.is_some() { 2 } else { 1 };
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed.unwrap_or(0));
    // Nearly normal: the sum of twelve uniform numbers has a variance of 1.
    let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
    let mut noise = |count: f64| match seed {
        Some(_) => libm::sqrt(16.0 + 0.1 * (count - 100.0)) * normal(),
        None => 0.0,
    };
    let planes = (0..frames * planes.len())
        .map(|i| planes[i / frames].iter().map(|count| (count + noise(*count)).round() as u16).collect())
        .collect();
    let stage_um = stage_um.into_iter().flat_map(|z| std::iter::repeat_n(z, frames)).collect();
    let scan =
        Scan { width: EDGE, height: EDGE, planes, stage_um, full_scale: u16::MAX, warnings: Vec::new() };
    (scan, places_px)
}

#[test]
#[ignore = "slow: .ci/full"]
fn the_optics_of_a_known_field_are_found() {
    let (scan, places_px) = scan(None);
    let made = fit_field(&scan, &options(places_px), &|_| ()).unwrap();
    let fitted = &made.fitted;
    assert!(fitted.particles.iter().all(|particle| particle.is_single), "{:?}", fitted.particles);
    assert!(fitted.r2_of_field > 0.999, "{}", fitted.r2_of_field);
    for (key, expected, allowed) in TRUTH {
        let found = fitted.coefficients.iter().find(|c| c.key == key).unwrap();
        assert!((found.value - expected).abs() < allowed, "{found:?}, not {expected}");
    }
}

#[test]
fn the_twin_is_a_scenario_with_the_optics_of_the_field() {
    let options = options(Vec::new());
    let fitted = FieldFit {
        coefficients: Vec::new(),
        field: FieldOptics {
            coma: FieldComa { constant: (0.04, -0.001), per_mm: -0.127 },
            focus: FocusSurface { curvature_um_per_mm2: 5.2, tilt_um_per_mm: (0.0, -3.8) },
            ..FieldOptics::default()
        },
        numerical_aperture: 0.441,
        blur_um: 0.86,
        focus_um: -1.5,
        depths_um: [-38.5, 41.5],
        noise: [14.8, 0.09, 0.0],
        is_noise_measured: true,
        background: 100.2,
        quantities: Vec::new(),
        particles: Vec::new(),
        r2_of_field: 0.99,
        chi2_of_field: 1.4,
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
    // 200,000 counts of light are that of a particle: photons times counts per electron.
    let particle = Particle::sphere(0.0, 0.0, 0.0, 2.0);
    let counts = emitted_rays(&twin.settings, &particle) * twin.settings.gain * 0.09;
    assert!((counts / 2e5 - 1.0).abs() < 1e-3, "{counts}");
}

#[test]
fn the_optics_of_few_particles_are_taken_as_constant() {
    let (scan, places_px) = scan(None);
    let made = fit_field(&scan, &options(vec![places_px[7]]), &|_| ()).unwrap().fitted;
    let of = |key: &str| made.coefficients.iter().find(|c| c.key == key).map(|c| c.value);
    assert!((of("numerical_aperture").unwrap() - 0.3).abs() < 0.002, "{:?}", made.coefficients);
    assert!((of("blur_um").unwrap() - 0.8).abs() < 0.03, "{:?}", made.coefficients);
    assert_eq!(of("coma.per_mm"), None);
    assert!(made.warnings.iter().any(|text| text.contains("taken as the same over the field")));
}

/// The 95 % intervals of each term, over scans that differ by noise only.
#[test]
#[ignore = "slow: .ci/full"]
#[expect(clippy::print_stdout, reason = "the counts are also of interest when they suffice")]
fn intervals_of_a_field_cover_its_terms() {
    let seeds = 40_u64;
    // Two minutes each.
    let fits = (0..seeds).into_par_iter().map(|seed| {
        let (scan, places_px) = scan(Some(seed));
        fit_field(&scan, &options(places_px), &|_| ()).unwrap().fitted
    });
    let mut covered = std::collections::BTreeMap::<&str, u32>::new();
    for made in fits.collect::<Vec<_>>() {
        for (key, truth, _) in TRUTH {
            let found = made.coefficients.iter().find(|c| c.key == key).unwrap();
            *covered.entry(key).or_default() += u32::from((found.value - truth).abs() < 1.96 * found.sd);
        }
    }
    println!("covered by intervals of {seeds}: {covered:?}");
    let missed = |count: &u32| f64::from(*count) < 0.85 * seeds as f64;
    assert!(!covered.values().any(missed));
}
