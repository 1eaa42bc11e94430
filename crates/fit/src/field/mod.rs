//! The fit by waves: the optics of an objective, the same everywhere or as they vary over the field of view.
//!
//! Single particles are found over the field (`particles`), repeated frames or residuals give the noise (`frames`), each
//! particle is fitted by wave optics with aberrations of its own (`local`, `particle`), and the optics, with their field
//! dependence, follow from all that are single (`dependence`). Particles are taken to lie on a plane across the stage's
//! motion: a tilt of the plane is a tilt of the focus.

mod dependence;
mod frames;
mod local;
mod outcome;
mod output;
mod particle;
mod subjects;

use microsig_core::Settings;
use microsig_core::linear::Symmetric;
use microsig_core::render::waves::{Emission, Layers, Lens, WaveOptics};

use crate::background::Background;
use crate::images::Watch;
use crate::noise::{self, Pixel};
use crate::optics::Given;
use crate::particles;
use crate::scan::Scan;
pub use dependence::Coefficient;
use dependence::{Evidence, FieldDependence};
use frames::Frames;
use local::{
    ASTIGMATISM, BLUR, COMA, DIAMETER, FOCUS, Instrument, Local, MERIDIONAL, NA, SLOPE, SPHERICAL,
    TRANSMISSION, X, Y, bounded,
};
use outcome::Outcome;
pub use outcome::{FieldFiles, FieldFit, FieldImages, FieldParticle, PlaneImages};
use particle::{FINE, Fit, Subject};
use storage::error::{Error, Result};

/// Given properties of light and objective. Astigmatism is an aberration of the pupil here, not a cylindrical lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WaveModel {
    /// Wavelength in vacuum, um.
    pub wavelength_um: f64,
    /// The part of a particle that emits light.
    pub emission: Emission,
    /// Layers between particles and objective. `None`: the layers for which the objective was designed.
    pub layers: Option<Layers>,
}

/// Options of [`fit_waves`].
#[derive(Debug, Clone)]
pub struct WaveOptions {
    /// Given properties of the microscope.
    pub given: Given,
    /// Particle diameter, um, and the blur of the camera is fitted; if `None`, a diameter that contains all blur.
    pub diameter_um: Option<f64>,
    /// +1: stage positions increase away from the lens; -1: toward it. Images tell only if the spherical
    /// aberration is known.
    pub direction: f64,
    /// Light and objective.
    pub waves: WaveModel,
    /// Whether the field dependence is fitted.
    pub is_field: bool,
    /// Half width of the windows, px; from the size of the images if `None`.
    pub half_window: Option<usize>,
    /// Positions of the particles to fit, px, with the first pixel's center at (1, 1).
    pub places_px: Vec<[f64; 2]>,
    /// Those of all particles, whose light is masked; those closer than 3 px in x and y to one to fit are this one.
    pub all_px: Vec<[f64; 2]>,
}

/// Largest number of particles, of a field and of the same optics everywhere.
const MOST: [usize; 2] = [40, 8];

/// A particle is not single if its chi2 exceeds the median of all by this factor.
const DOUBLE: f64 = 1.8;

/// Shares of the time after which the refinement and the last images begin; measured with 17 particles.
const REFINING: f64 = 0.65;
const COMPARING: f64 = 0.89;

/// Largest number of steps of the first particle's fit, and of those that start from one nearby.
const STEPS: usize = 20;
const STEPS_FROM_NEARBY: usize = 4;

/// The quantities of a particle that are fitted: not both blur and diameter, and vignetting only of a field.
fn free(options: &WaveOptions) -> Vec<usize> {
    let all = [FOCUS, X, Y, SLOPE, SLOPE + 1, NA, MERIDIONAL, COMA, COMA + 1, ASTIGMATISM, ASTIGMATISM + 1];
    let fixed = if options.diameter_um.is_some() { DIAMETER } else { BLUR };
    all.into_iter()
        .chain([SPHERICAL, BLUR, TRANSMISSION, DIAMETER])
        .filter(|quantity| *quantity != fixed && (options.is_field || *quantity != MERIDIONAL))
        .collect()
}

/// Fits the optics to a scan by waves; `watch` receives progress messages.
///
/// # Errors
/// [`storage::Error::Input`] if the scan has too few single particles.
pub fn fit_waves(scan: &Scan, options: &WaveOptions, watch: Watch<'_>) -> Result<FieldFiles> {
    watch("noise of repeated frames", None);
    let frames = Frames::of(scan);
    watch("particles", None);
    let background = Background::of(&scan.planes);
    let fitted = particles::given(scan, &options.places_px)?.len();
    let candidates = particles::given(scan, &[options.places_px.as_slice(), &options.all_px].concat())?;
    let half = options.half_window.unwrap_or_else(|| {
        // Beyond half the spacing, most light comes from other particles and is masked.
        particles::half_width(scan, background, &candidates).min(particles::half_spacing(&candidates))
    });
    let instrument = instrument(options);
    let free = instrument.free.as_slice();
    let most = MOST[usize::from(!options.is_field)];
    let (mut subjects, found) = subjects::of(scan, &frames, &instrument, (&candidates, fitted), half, most)?;
    watch("starts", None);
    let mut start = subjects[0].best_start()?;
    if !frames.is_noise_measured {
        watch("noise of residuals", None);
        let fit = subjects[0].fit(&start, free, FINE, STEPS)?;
        start = fit.local;
        let noise = noise::estimate(&subjects[0].residuals(&fit), frames.noise).with_model;
        subjects.iter_mut().for_each(|subject| subject.noise = noise);
    }
    let middle = |k: usize| subjects[k].place_mm;
    let mut fits: Vec<Fit> = Vec::with_capacity(subjects.len());
    for (k, subject) in subjects.iter().enumerate() {
        watch(
            &format!("particle {} of {}", k + 1, subjects.len()),
            Some(REFINING * k as f64 / subjects.len() as f64),
        );
        // The nearest particle that was fitted well is nearly right.
        let nearest = (0..k)
            .filter(|&j| is_good(&fits[j], &fits))
            .min_by(|&a, &b| distance(middle(a), middle(k)).total_cmp(&distance(middle(b), middle(k))));
        let (like, steps) = nearest.map_or((start, STEPS), |j| (fits[j].local, STEPS_FROM_NEARBY));
        let mut local = like;
        if k > 0 {
            [local[X], local[Y]] = subject.sharpest().1;
        }
        fits.push(subject.fit(&local, free, FINE, steps)?);
    }
    let median = median(fits.iter().map(Fit::chi2).collect());
    let is_single: Vec<bool> = fits.iter().map(|fit| fit.chi2() < DOUBLE * median).collect();
    let singles: Vec<usize> = (0..fits.len()).filter(|k| is_single[*k]).collect();
    let places: Vec<[f64; 2]> =
        subjects.iter().zip(&fits).map(|(subject, fit)| subject.place_of(&fit.local)).collect();
    let evidence = |fits: &[Fit]| -> Vec<Evidence> {
        singles.iter().filter_map(|&k| evidence_of(places[k], &fits[k])).collect()
    };
    let undetermined = || {
        Error::input(
            "the particles do not determine the optics: use a longer scan or, of a field, particles spread over it",
        )
    };
    let dependence_of =
        |fits: &[Fit]| FieldDependence::of(&evidence(fits), options.is_field).ok_or_else(undetermined);
    let dependence = dependence_of(&fits)?;
    let mut refined = fits.clone();
    // The optics of one particle are its own.
    for (n, &k) in singles.iter().enumerate().filter(|_| singles.len() > 1) {
        let share = n as f64 / singles.len() as f64;
        watch("optics of all particles: refinement", Some(REFINING + (COMPARING - REFINING) * share));
        refined[k] = about_field(&subjects[k], &fits[k].free, &dependence.at(places[k], &fits[k].local))?;
    }
    let dependence = dependence_of(&refined)?;
    if !frames.is_noise_measured {
        // From here on, only the noise counts, without the residuals attributed to errors of the model.
        let pixels: Vec<Pixel> = singles.iter().flat_map(|&k| subjects[k].residuals(&fits[k])).collect();
        let noise = noise::estimate(&pixels, frames.noise).pure;
        subjects.iter_mut().for_each(|subject| subject.noise = noise);
    }
    let of_field: Vec<Fit> = (0..fits.len())
        .map(|k| {
            let share = COMPARING + (1.0 - COMPARING) * k as f64 / fits.len() as f64;
            watch("images with the fitted optics", Some(share));
            let start = dependence.at(places[k], &fits[k].local);
            subjects[k].fit(&start, &[FOCUS, X, Y], FINE, 3)
        })
        .collect::<Result<_>>()?;
    let result =
        Outcome { scan, options, frames: &frames, subjects: &subjects, candidates: &candidates, found };
    result.files(&fits, &is_single, &dependence, &of_field)
}

/// The fit of a single particle by one step from the field dependence, where the quadratic approximations hold for all of
/// them.
fn about_field(subject: &Subject, free: &[usize], at_field: &Local) -> Result<Fit> {
    let fit = subject.fit_at(at_field, free, FINE)?;
    let mut local = fit.local;
    if let Some(step) = fit.quadratic.matrix.solve(&fit.quadratic.right) {
        free.iter().zip(step).for_each(|(&quantity, by)| local[quantity] += by);
    }
    Ok(Fit { local: bounded(local), ..fit })
}

fn instrument(options: &WaveOptions) -> Instrument {
    let WaveOptions { given, waves, .. } = options;
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
        diameter_um: options.diameter_um,
        direction: options.direction,
        free: free(options),
    }
}

fn is_good(fit: &Fit, all: &[Fit]) -> bool {
    fit.chi2() < DOUBLE * median(all.iter().map(Fit::chi2).collect())
}

fn evidence_of(place: [f64; 2], fit: &Fit) -> Option<Evidence> {
    let inverse = fit.quadratic.matrix.inverse()?;
    let n = inverse.n();
    let mut covariance = Symmetric::zeros(n);
    for i in 0..n {
        (0..n).for_each(|j| covariance.add(i, j, fit.chi2() * inverse.at(i, j)));
    }
    Some(Evidence { place, local: fit.local, free: fit.free.clone(), covariance })
}

/// So many indices of `of`, evenly spaced, the first and the last included.
fn evenly(of: usize, most: usize) -> Vec<usize> {
    let count = of.min(most);
    (0..count).map(|i| i * (of - 1) / (count - 1).max(1)).collect()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests;
