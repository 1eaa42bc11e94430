//! Levenberg-Marquardt minimization of the image fit.

use super::derivatives::Derivatives;
use super::images::Problem;
use super::optics::Shared;
use super::state::State;
use storage::error::Result;

impl Problem<'_> {
    /// The state moved by a step of the parameters.
    pub(super) fn moved(&self, state: &State, step: &[f64]) -> State {
        let mut to = state.clone();
        // The whole step is scaled down: where quantities nearly compensate each other, only the direction of
        // the step leads along the valley.
        let share = |(shared, by): (&Shared, &f64)| shared.longest(&state.microscope) / by.abs();
        let share = self.shared.iter().zip(step).map(share).fold(1.0, f64::min);
        for (shared, &by) in self.shared.iter().zip(step) {
            to.microscope = shared.moved(to.microscope, share * by);
        }
        to.microscope = to.microscope.bounded();
        let n = self.shared.len();
        to.drift = [state.drift[0] + step[n], state.drift[1] + step[n + 1]];
        for (k, bead) in to.beads.iter_mut().enumerate() {
            let step = &step[self.bead_parameter(k)..];
            bead.x += step[0].clamp(-2.0, 2.0);
            bead.y += step[1].clamp(-2.0, 2.0);
            bead.z_um += step[2].clamp(-20.0, 20.0);
            bead.light = (bead.light + step[3]).max(0.1 * bead.light);
            bead.background += step[4];
        }
        if self.free_flux {
            for (i, flux) in to.flux.iter_mut().enumerate() {
                *flux = (*flux + step[self.flux_parameter(i)]).max(0.1 * *flux);
            }
        }
        to
    }

    /// Levenberg-Marquardt minimization from a state, with at most `steps` steps. `known`: the derivatives of
    /// the last step before, replaced by those of the last step.
    pub(super) fn minimize(
        &self,
        mut state: State,
        steps: usize,
        damping: f64,
        known: &mut Option<Derivatives>,
    ) -> Result<State> {
        let mut damping = damping;
        for step in 1..=steps {
            let derivatives = self.derivatives(known.take(), &state)?;
            let derivatives = known.insert(derivatives);
            let normal = self.normal(&state, derivatives)?;
            let fresh = derivatives.are_of(&state);
            let pixels: usize = normal.variances.iter().map(Vec::len).sum();
            let loss = normal.loss / (pixels.max(1) as f64);
            (self.watch)(&format!("{}, step {step}: misfit {loss:.4} per pixel", self.stage), None);
            let n = normal.right.len();
            let predicted = |step: &[f64]| step.iter().zip(&normal.right).map(|(s, r)| s * r).sum::<f64>();
            // The remaining decrease, which damped steps do not reveal where parameters nearly compensate
            // each other.
            let left = normal.matrix.solve(&normal.right).map_or(f64::INFINITY, |step| predicted(&step));
            let mut accepted = None;
            while damping < 1e8 {
                let mut damped = normal.matrix.clone();
                (0..n).for_each(|i| damped.add(i, i, damping * normal.matrix.at(i, i) + 1e-12));
                let Some(step) = damped.solve(&normal.right) else {
                    damping *= 10.0;
                    continue;
                };
                let next = self.moved(&state, &step);
                let misfits = self.misfits(&next, Some(&normal.variances))?;
                let loss: f64 = misfits.iter().map(|(_, _, m)| m.loss).sum();
                if loss < normal.loss {
                    damping = (0.2 * damping).max(1e-7);
                    accepted = Some(next);
                    break;
                }
                if left < self.converged || fresh && predicted(&step) < self.converged {
                    return Ok(state);
                }
                if !fresh {
                    break;
                }
                damping = (5.0 * damping).max(1e-4);
            }
            let Some(next) = accepted else {
                if fresh {
                    break;
                }
                // Perhaps the step failed because its derivatives are old.
                *known = None;
                continue;
            };
            state = next;
            if left < self.converged {
                break;
            }
        }
        Ok(state)
    }
}
