//! The fit of a whole field: the optics of an objective as they vary over the field of view.
//!
//! Single particles are found over the field (`particles`), repeated frames give the noise (`frames`), each
//! particle is fitted by wave optics with aberrations of its own (`local`, `particle`), and the field dependence
//! follows from all that are single (`dependence`). Particles are taken to lie on a plane across the stage's
//! motion: a tilt of the plane is a tilt of the focus.

mod dependence;
mod frames;
mod local;
mod outcome;
mod output;
mod particle;
mod subjects;

use microsig_core::Settings;
use microsig_core::render::waves::{Lens, WaveOptics};

use crate::background::Background;
use crate::images::Watch;
use crate::optics::Given;
use crate::particles;
use crate::scan::Scan;
use crate::waves::WaveModel;
pub use dependence::Coefficient;
use dependence::{Evidence, FieldDependence};
use frames::Frames;
use local::{
    ASTIGMATISM, BLUR, COMA, FOCUS, Instrument, Local, MERIDIONAL, NA, SLOPE, SPHERICAL, TRANSMISSION, X, Y,
};
use microsig_core::linear::Symmetric;
use outcome::Outcome;
pub use outcome::{FieldFiles, FieldFit, FieldImages, FieldParticle, PlaneImages};
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
    /// Positions of the particles to fit, px, with the first pixel's center at (1, 1).
    pub places_px: Vec<[f64; 2]>,
    /// Those of all particles, whose light is masked; those closer than 3 px in x and y to one to fit are this one.
    pub all_px: Vec<[f64; 2]>,
}

/// Number of planes from which a first fit starts.
const FEW_PLANES: usize = 9;

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
    let fitted = particles::given(scan, &options.places_px)?.len();
    let candidates = particles::given(scan, &[options.places_px.as_slice(), &options.all_px].concat())?;
    let half = options.half_window.unwrap_or_else(|| {
        // Beyond half the spacing, most light comes from other particles and is masked.
        particles::half_width(scan, background, &candidates).min(particles::half_spacing(&candidates))
    });
    let instrument = instrument(options);
    let (subjects, found) = subjects::of(scan, &frames, &instrument, (&candidates, fitted), half)?;
    let middle = |k: usize| subjects[k].place_mm;
    let mut fits: Vec<Fit> = Vec::with_capacity(subjects.len());
    for (k, subject) in subjects.iter().enumerate() {
        watch(&format!("particle {} of {}", k + 1, subjects.len()));
        // The nearest particle that was fitted well is nearly right.
        let nearest = (0..k)
            .filter(|&j| is_good(&fits[j], &fits))
            .min_by(|&a, &b| distance(middle(a), middle(k)).total_cmp(&distance(middle(b), middle(k))));
        fits.push(single(subject, nearest.map(|j| fits[j].local))?);
    }
    watch("field dependence");
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
            "the particles do not determine the field dependence: they must be spread over the field",
        )
    };
    let dependence = FieldDependence::of(&evidence(&fits)).ok_or_else(undetermined)?;
    watch("field dependence: refinement");
    let refined = about_field(&subjects, &fits, &singles, |k| dependence.at(places[k], &fits[k].local))?;
    let dependence = FieldDependence::of(&evidence(&refined)).ok_or_else(undetermined)?;
    watch("images with the fitted field dependence");
    let of_field: Vec<Fit> = (0..fits.len())
        .map(|k| {
            let start = dependence.at(places[k], &fits[k].local);
            subjects[k].fit(&start, &[FOCUS, X, Y], FINE, 3)
        })
        .collect::<Result<_>>()?;
    let result =
        Outcome { scan, options, frames: &frames, subjects: &subjects, candidates: &candidates, found };
    result.files(&fits, &is_single, &dependence, &of_field)
}

/// Fits of single particles by one step from the field dependence, where the quadratic approximations hold for all of
/// them.
fn about_field(
    subjects: &[Subject],
    fits: &[Fit],
    singles: &[usize],
    at_field: impl Fn(usize) -> Local,
) -> Result<Vec<Fit>> {
    let mut refined = fits.to_vec();
    for &k in singles {
        let fit = subjects[k].fit_at(&at_field(k), &FREE, FINE)?;
        let mut local = fit.local;
        if let Some(step) = fit.quadratic.matrix.solve(&fit.quadratic.right) {
            FREE.iter().zip(step).for_each(|(&quantity, by)| local[quantity] += by);
        }
        refined[k] = Fit { local, ..fit };
    }
    Ok(refined)
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
            let some = evenly(subject.planes.len(), FEW_PLANES);
            let few = Subject {
                planes: some.iter().map(|i| subject.planes[*i]).collect(),
                masks: some.iter().filter_map(|i| subject.masks.get(*i).cloned()).collect(),
                window: subject.window.clone(),
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
