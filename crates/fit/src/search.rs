//! The search for the best fit: from several starting points to one state.

use super::curves::Start;
use super::derivatives::Derivatives;
use super::images::{Accuracy, Problem};
use super::moments::Shape;
use super::optics::Microscope;
use super::rejection;
use super::state::{Bead, Noise, State};
use storage::error::{Error, Result};

/// Maximum number of iterations in the final fit; each minimizes, estimates the variance of light and rejects
/// windows.
const ROUNDS: usize = 3;

/// Maximum number of steps of one minimization in the final fit.
const STEPS: usize = 25;

/// Accuracy while starting points are compared, and in the final fit.
pub(super) const COARSE: Accuracy = Accuracy { tolerance: 1e-2, of_sides: 1e-2, central: false, steps: 1.0 };
const FINE: Accuracy = Accuracy { tolerance: 3e-3, of_sides: 3e-3, central: true, steps: 1.0 };
/// Accuracy of the last steps: the error of [`FINE`] shifts the focal length of a low-noise scan by one
/// standard deviation, this one by half a standard deviation.
const FINEST: Accuracy = Accuracy { tolerance: 1e-3, ..FINE };

/// Accuracy where quantities nearly compensate each other. Errors of images of 1e-3 of the peak shift the
/// pixel size of a scan by several standard deviations along the valley. Differences over long steps have
/// errors of third order, which do not compensate each other as the derivatives do and look like information
/// along the valley: the standard deviation of a pixel size is 0.19 % with whole steps, 0.76 % with quarters,
/// 1.07 % with eighths and 1.09 % with sixteenths.
const OF_VALLEYS: Accuracy = Accuracy { tolerance: 3e-3, of_sides: 5e-4, central: true, steps: 0.125 };
/// That of the last steps.
const FINEST_OF_VALLEYS: Accuracy = Accuracy { tolerance: 5e-4, ..OF_VALLEYS };

/// Predicted decrease of chi2 at which minimization ends: while starting points are compared, and in the
/// final fit.
pub(super) const ROUGHLY: f64 = 10.0;
const CONVERGED: f64 = 0.1;

/// While starting points are compared, one particle in this many planes represents the scan.
const COMPARED_PLANES: usize = 9;

/// The state with the highest likelihood after a few steps from each starting point, and the difference of -2
/// ln(likelihood) to the other direction of the stage; `None` if that was not tried.
pub(super) fn best_start(
    problem: &mut Problem,
    shape: &Shape,
    starts: &[Start],
) -> Result<(State, Option<f64>)> {
    let (beads, planes) = (problem.windows.particles.len(), problem.scan.planes.len());
    let is_compared = |k: usize, i: usize| {
        let step = |i: usize| i * (COMPARED_PLANES - 1) / (planes - 1).max(1);
        k == 0 && (i == 0 || i + 1 == planes || step(i) != step(i - 1))
    };
    problem.rejected = (0..beads).map(|k| (0..planes).map(|i| !is_compared(k, i)).collect()).collect();
    let mut tried: Vec<(f64, f64, State)> = Vec::new();
    for (i, start) in starts.iter().enumerate() {
        problem.stage = format!("starting point {} of {}", i + 1, starts.len());
        let mut state = first_state(problem, shape, start.microscope, start.direction, &start.z_um)?;
        let mut derivatives = None;
        for steps in [3, 5] {
            state.noise = problem.noises(&state)?.with_model;
            state = problem.minimize(state, steps, 1e-2, &mut derivatives)?;
        }
        let noises = problem.noises(&state)?;
        let pure = State { noise: noises.pure, ..state.clone() };
        state.noise = noises.with_model;
        let moved_um = state.beads[0].z_um - start.z_um[0];
        tried.push((problem.likelihood(&pure)?, moved_um, state));
    }
    problem.rejected = vec![vec![false; planes]; beads];
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((least, moved_um, best)) = tried.first() else {
        return Err(Error::input("the fit has no starting point"));
    };
    let other = tried.iter().find(|(.., state)| state.direction != best.direction);
    let mut best = best.clone();
    // The other particles are shifted with the first.
    best.beads.iter_mut().skip(1).for_each(|bead| bead.z_um += moved_um);
    Ok((problem.with_light(best)?, other.map(|(likelihood, ..)| likelihood - least)))
}

/// Final fit: minimizes, estimates the variance of light from the residuals and rejects outlying windows,
/// repeatedly. `derivatives` are replaced by those at the last step.
pub(super) fn converge(
    problem: &mut Problem,
    mut state: State,
    derivatives: &mut Option<Derivatives>,
) -> Result<State> {
    let [fine, finest] =
        if problem.is_nearly_degenerate() { [OF_VALLEYS, FINEST_OF_VALLEYS] } else { [FINE, FINEST] };
    problem.accuracy = fine;
    problem.converged = CONVERGED;
    state.noise = problem.noises(&state)?.with_model;
    for round in 0..ROUNDS {
        problem.stage = format!("round {}", round + 1);
        state = problem.minimize(state, STEPS, 1e-3, derivatives)?;
        state.noise = problem.noises(&state)?.with_model;
        let outliers = rejection::outliers(&problem.misfits(&state, None)?);
        let windows = problem.n_beads() * problem.scan.planes.len();
        if rejection::are_too_many(windows - problem.used().count() + outliers.len(), windows) {
            problem.rejected.iter_mut().for_each(|planes| planes.fill(false));
            break;
        }
        if outliers.is_empty() && round > 0 {
            break;
        }
        for (k, i) in outliers {
            problem.rejected[k][i] = true;
        }
    }
    problem.stage = "last round".to_owned();
    problem.accuracy = finest;
    problem.minimize(state, STEPS, 1e-4, derivatives)
}

fn first_state(
    problem: &Problem,
    shape: &Shape,
    microscope: Microscope,
    direction: f64,
    z_um: &[f64],
) -> Result<State> {
    let beads = shape
        .places
        .iter()
        .zip(z_um)
        .map(|(place, &z_um)| Bead {
            x: place[0],
            y: place[1],
            z_um,
            light: 1.0,
            background: problem.background.mean,
        })
        .collect();
    let background2 = problem.background.noise * problem.background.noise;
    problem.with_light(State {
        microscope,
        direction,
        drift: shape.drift,
        beads,
        flux: vec![1.0; problem.scan.planes.len()],
        noise: Noise { background2, per_count: 1.0, per_count2: 0.0 },
    })
}
