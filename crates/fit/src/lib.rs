//! Fits the settings of a real microscope to its calibration scan.
//!
//! A scan shows particles at rest at known stage positions. The background is estimated from the dark side of
//! the histogram (`background`), particles are found in the sum over planes (`particles`), and moments give
//! drift and the direction of the cylindrical lens (`moments`). Then traced rays are fitted to the widths of
//! images over depth, from many initial values (`curves`), and, from the best of these, expected images to
//! all pixels (`images`).
//!
//! According to Rossi 2020, the virtual focal lengths "must be found empirically"; this module does so.

mod background;
mod curves;
mod images;
mod intervals;
mod linear;
mod moments;
mod optics;
mod outcome;
mod output;
mod particles;
mod rejection;
mod scan;
mod state;

use background::Background;
use curves::{Known, Start};
use images::Problem;
use intervals::Covariance;
use moments::Shape;
use optics::Shared;
use state::{Bead, Misfit, State};

pub use optics::{ExtraParameter, Given};
pub use outcome::{Fitted, FittedParticle, Parameter, PlaneFit, Verdict};
pub use scan::{Scan, StagePositions};
use storage::error::Result;

/// Whether the fit has two focal planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Astigmatic {
    /// If the focal planes found from widths along and across differ.
    Auto,
    /// Given by the user.
    Known(bool),
}

/// Options of [`fit`].
#[derive(Debug, Clone)]
pub struct FitOptions {
    /// Given properties of the microscope.
    pub given: Given,
    /// Particle diameter, um; fitted if `None`.
    pub diameter_um: Option<f64>,
    /// +1: stage positions increase away from the lens; -1: toward it; fitted if `None`.
    pub direction: Option<f64>,
    /// Whether the fit has two focal planes.
    pub astigmatic: Astigmatic,
    /// Whether the brightness of each plane is fitted.
    pub free_flux: bool,
    /// Half width of the windows, px; from the size of the images if `None`.
    pub half_window: Option<usize>,
    /// Positions of the particles, px, with the first pixel's center at (1, 1); detected if `None`.
    pub places_px: Option<Vec<[f64; 2]>>,
    /// Additional quantities to fit, which scans of real objectives determine poorly.
    pub free: Vec<ExtraParameter>,
    /// Resamples of the particles for a second estimate of standard deviations; 0: none.
    pub bootstrap: usize,
    /// Seed of the resamples.
    pub seed: u64,
}

/// Tolerances of expected images, as a fraction of their peaks: while starting points are compared, and in
/// the final fit.
const COARSE: f64 = 1e-2;
const FINE: f64 = 1e-3;
const FINE_ASTIGMATIC: f64 = 3e-3;

/// Maximum number of iterations of minimization, estimate of the variance of light and rejection in the final
/// fit.
const ROUNDS: usize = 3;

/// Minimum difference of -2 ln(likelihood) between the two directions of the stage, for the direction to be
/// known.
const KNOWN_DIRECTION: f64 = 20.0;

/// A fit with the files that describe it.
#[derive(Debug)]
pub struct FitFiles {
    /// Result of the fit.
    pub fitted: Fitted,
    /// Names and contents of the files.
    pub files: Vec<(&'static str, Vec<u8>)>,
}

/// Fits the settings to a scan.
///
/// # Errors
/// [`storage::Error::Input`] if the scan has no usable particle or does not determine all parameters.
pub fn fit(scan: &Scan, options: &FitOptions) -> Result<FitFiles> {
    let background = Background::of(&scan.planes);
    let candidates = match &options.places_px {
        Some(places) => particles::given(places),
        None => particles::find(scan, background)?,
    };
    let half = options.half_window.unwrap_or_else(|| particles::half_width(scan, background, &candidates));
    let windows = particles::windows(scan, &candidates, half)?;
    let shape = Shape::of(scan, background, &windows);
    let astigmatic = match options.astigmatic {
        Astigmatic::Auto => shape.astigmatic,
        Astigmatic::Known(known) => known,
    };
    let both = [1.0, -1.0];
    let directions = options.direction.as_ref().map_or(&both[..], std::slice::from_ref);
    let known = Known {
        scan,
        background,
        windows: &windows,
        shape: &shape,
        given: options.given,
        diameter_um: options.diameter_um,
        directions,
        astigmatic,
    };
    let mut problem = Problem {
        scan,
        background,
        windows: &windows,
        shared: shared(options, astigmatic),
        free_flux: options.free_flux,
        rejected: vec![vec![false; scan.planes.len()]; windows.particles.len()],
        tolerance: COARSE,
    };
    let (start, margin) = best_start(&problem, &shape, &curves::starts(&known))?;
    problem.tolerance = if astigmatic { FINE_ASTIGMATIC } else { FINE };
    let state = converge(&mut problem, start)?;
    let misfits = problem.misfits(&state, None)?;
    let chi2 = chi2(&misfits);
    let normal = problem.normal(&state)?;
    let covariance = Covariance::of(&normal, windows.particles.len(), chi2).ok_or_else(|| {
        storage::Error::input("the scan does not determine all parameters: give --diameter, or a longer scan")
    })?;
    let resampled = intervals::bootstrap(&normal, windows.particles.len(), options.bootstrap, options.seed);
    let mut fitted = Fitted::of(&problem, &state, &misfits, &covariance, &resampled, options);
    fitted.direction_margin = margin;
    if margin.is_some_and(|margin| margin < KNOWN_DIRECTION) {
        fitted.warnings.push(
            "the scan does not determine whether stage positions increase away from the lens or toward it: give --z-direction".to_owned(),
        );
    }
    let mut files = vec![
        output::settings(&fitted)?,
        output::parameters(&fitted)?,
        output::scenario(&fitted, options.given.depth_factor, state.microscope.diameter_um),
    ];
    files.extend(output::images(&problem, &state)?);
    Ok(FitFiles { fitted, files })
}

fn shared(options: &FitOptions, astigmatic: bool) -> Vec<Shared> {
    let mut shared = vec![Shared::NumericalAperture, Shared::FocalLength];
    if astigmatic {
        shared.extend([Shared::FocusShift, Shared::Angle]);
    }
    if options.diameter_um.is_none() {
        shared.push(Shared::Diameter);
    }
    shared.extend(options.free.iter().map(|key| key.shared()));
    shared
}

fn chi2(misfits: &[(usize, usize, Misfit)]) -> f64 {
    let (chi2, n) = misfits.iter().fold((0.0, 0), |(c, n), (_, _, m)| (c + m.chi2, n + m.pixels));
    chi2 / f64::from(u32::try_from(n).unwrap_or(u32::MAX).max(1))
}

/// The state with the highest likelihood after a few steps from each starting point, and the difference of -2
/// ln(likelihood) to the other direction of the stage; `None` if that was not tried.
fn best_start(problem: &Problem, shape: &Shape, starts: &[Start]) -> Result<(State, Option<f64>)> {
    let mut tried: Vec<(f64, State)> = Vec::new();
    for start in starts {
        let mut state = first_state(problem, shape, start)?;
        for steps in [3, 4] {
            state.variance_per_count = problem.variance_per_count(&state)?;
            state = problem.minimize(state, steps, 1e-2)?;
        }
        state.variance_per_count = problem.variance_per_count(&state)?;
        let likelihood =
            problem.misfits(&state, None)?.iter().map(|(_, _, m)| m.minus_two_log_likelihood).sum();
        tried.push((likelihood, state));
    }
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((least, best)) = tried.first().cloned() else {
        return Err(storage::Error::input("the fit has no starting point"));
    };
    let other = tried.iter().find(|(_, state)| state.direction != best.direction);
    Ok((best, other.map(|(likelihood, _)| likelihood - least)))
}

/// Final fit: minimizes, estimates the variance of light from the residuals and rejects outlying windows,
/// repeatedly.
fn converge(problem: &mut Problem, mut state: State) -> Result<State> {
    for round in 0..ROUNDS {
        state = problem.minimize(state, 15, 1e-3)?;
        state.variance_per_count = problem.variance_per_count(&state)?;
        let outliers = rejection::outliers(&problem.misfits(&state, None)?);
        if outliers.is_empty() && round > 0 {
            break;
        }
        for (k, i) in outliers {
            problem.rejected[k][i] = true;
        }
    }
    problem.minimize(state, 15, 1e-3)
}

fn first_state(problem: &Problem, shape: &Shape, start: &Start) -> Result<State> {
    let beads = shape
        .places
        .iter()
        .zip(&start.z_um)
        .map(|(place, &z_um)| Bead {
            x: place[0],
            y: place[1],
            z_um,
            light: 1.0,
            background: problem.background.mean,
        })
        .collect();
    problem.with_light(State {
        microscope: start.microscope,
        direction: start.direction,
        drift: shape.drift,
        beads,
        flux: vec![1.0; problem.scan.planes.len()],
        variance_per_count: 1.0,
    })
}
