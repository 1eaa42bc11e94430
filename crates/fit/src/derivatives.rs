//! Derivatives of the images of all windows with respect to the fitted quantities.
//!
//! They take most of the time of a fit, but a step of the fit needs them only approximately: the images alone
//! decide whether a step is accepted and where the fit ends. They are therefore reused until the state has
//! moved far.

use rayon::prelude::*;

use super::imager::Imager;
use super::images::{Accuracy, Problem};
use super::optics::{Microscope, Shared};
use super::state::State;
use storage::error::Result;

/// Derivatives are computed again when a shared quantity has changed by more than this fraction of the step
/// of their differences, or when an image or its edge has moved by more than this many px.
const STALE: f64 = 0.5;
const STALE_PX: f64 = 0.3;

/// Derivatives of the fractions of light on all pixels of all windows.
#[derive(Debug)]
pub(super) struct Derivatives {
    at: State,
    accuracy: Accuracy,
    planes: usize,
    /// By particle and plane; empty for windows that were not used. For each pixel the derivatives with
    /// respect to each shared quantity (in the units of [`Shared::moved`]), and to x and y (1/px) and z
    /// (1/um) of the particle.
    windows: Vec<Vec<f32>>,
}

/// A shared quantity below and above its value.
struct Side {
    microscopes: [Microscope; 2],
    /// `None` for the image at the value itself.
    imagers: [Option<Imager>; 2],
    /// Distance of the two values, in the units of [`Shared::moved`].
    step: f64,
}

impl Derivatives {
    /// The derivatives of a window: for each pixel, those with respect to the shared quantities and to x, y
    /// and z.
    pub(super) fn window(&self, bead: usize, plane: usize) -> &[f32] {
        &self.windows[bead * self.planes + plane]
    }

    /// Whether these are the derivatives at exactly this state.
    pub(super) fn are_of(&self, state: &State) -> bool {
        (self.at.microscope, &self.at.beads) == (state.microscope, &state.beads)
    }

    /// Whether the derivatives are good enough for a state, with the same accuracy.
    fn hold_at(&self, problem: &Problem, state: &State) -> bool {
        let at = &self.at;
        let is_near = |shared: &Shared| {
            let step = shared.step(&at.microscope).unwrap_or(f64::INFINITY);
            shared.distance(&at.microscope, &state.microscope).abs() <= STALE * step
        };
        let edge_um = problem.scan.stage_um.iter().map(|s| (s - problem.scan.mean_stage_um()).abs());
        let farthest_um = edge_um.fold(0.0, f64::max);
        let drifted = |axis: usize| (at.drift[axis] - state.drift[axis]).abs() * farthest_um;
        let depth_um = STALE_PX / at.microscope.edge_px_per_um();
        let stays = at.beads.iter().zip(&state.beads).all(|(old, new)| {
            (old.x - new.x).abs() + drifted(0) <= STALE_PX
                && (old.y - new.y).abs() + drifted(1) <= STALE_PX
                && (old.z_um - new.z_um).abs() <= depth_um
        });
        // More accurate images alone do not make the derivatives more accurate.
        let of_sides = |accuracy: Accuracy| (accuracy.of_sides, accuracy.central, accuracy.steps);
        of_sides(self.accuracy) == of_sides(problem.accuracy)
            && stays
            && problem.shared.iter().all(is_near)
            && problem.used().all(|(k, i)| !self.window(k, i).is_empty())
    }
}

impl Problem<'_> {
    /// The derivatives at a state: the known ones if they are good enough, otherwise new ones.
    pub(super) fn derivatives(&self, known: Option<Derivatives>, state: &State) -> Result<Derivatives> {
        match known.filter(|known| known.hold_at(self, state)) {
            Some(known) => Ok(known),
            None => self.new_derivatives(state),
        }
    }

    fn new_derivatives(&self, state: &State) -> Result<Derivatives> {
        let (accuracy, microscope, planes) = (self.accuracy, &state.microscope, self.scan.planes.len());
        let own = self.imager(microscope, accuracy.of_sides)?;
        let sides = self.shared.iter().map(|shared| self.side(state, *shared)).collect::<Result<Vec<_>>>()?;
        let windows = (0..self.n_beads() * planes)
            .into_par_iter()
            .map(|at| {
                let (k, i) = (at / planes, at % planes);
                if self.rejected[k][i] {
                    Vec::new()
                } else {
                    self.window_derivatives(state, &own, &sides, k, i)
                }
            })
            .collect();
        Ok(Derivatives { at: state.clone(), accuracy, planes, windows })
    }

    /// `None` if the derivative is analytical.
    fn side(&self, state: &State, shared: Shared) -> Result<Option<Side>> {
        let (at, accuracy) = (&state.microscope, self.accuracy);
        let Some(step) = shared.step(at).map(|step| accuracy.steps * step) else { return Ok(None) };
        let new = |microscope: &Microscope| self.imager(microscope, accuracy.of_sides).map(Some);
        let high = shared.moved(*at, step);
        let side = if accuracy.central {
            let low = shared.moved(*at, -step);
            Side { microscopes: [low, high], imagers: [new(&low)?, new(&high)?], step: 2.0 * step }
        } else {
            Side { microscopes: [*at, high], imagers: [None, new(&high)?], step }
        };
        Ok(Some(side))
    }

    fn window_derivatives(
        &self,
        state: &State,
        own: &Imager,
        sides: &[Option<Side>],
        k: usize,
        i: usize,
    ) -> Vec<f32> {
        let microscope = &state.microscope;
        let places = self.places(state, k, i);
        let gradients = own.gradients(microscope, self.depth(state, microscope, k, i), &places);
        let n = sides.len() + 3;
        let mut out = vec![0.0; places.len() * n];
        for (at, (shared, side)) in self.shared.iter().zip(sides).enumerate() {
            let values = match side {
                Some(Side { microscopes, imagers, step }) => {
                    let [low, high] = [0, 1].map(|side| match &imagers[side] {
                        Some(imager) => self.values(imager, state, &microscopes[side], k, i),
                        None => gradients.iter().map(|gradient| gradient[0]).collect(),
                    });
                    low.iter().zip(&high).map(|(low, high)| (high - low) / step).collect()
                }
                None => analytical(*shared, state, self.scan.stage_um[i], &gradients),
            };
            out.chunks_mut(n).zip(values).for_each(|(pixel, value): (_, f64)| pixel[at] = value as f32);
        }
        for (pixel, [_, by_x, by_y, by_z, _]) in out.chunks_mut(n).zip(&gradients) {
            pixel[n - 3..].copy_from_slice(&[*by_x as f32, *by_y as f32, *by_z as f32]);
        }
        out
    }
}

/// The derivative with respect to a shared quantity that follows from those with respect to depth and angle.
fn analytical(shared: Shared, state: &State, stage_um: f64, gradients: &[[f64; 5]]) -> Vec<f64> {
    let by_depth_factor = -state.direction * stage_um / state.microscope.depth_factor;
    let of = |[_, _, _, by_z, by_angle]: &[f64; 5]| match shared {
        Shared::Angle => *by_angle,
        _ => by_z * by_depth_factor,
    };
    gradients.iter().map(of).collect()
}
