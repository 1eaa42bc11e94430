//! Renderers of the microscopes that a fit visits. Their tables take most of the time of a fit, so that those
//! of the last few microscopes are kept.

use std::sync::{Mutex, PoisonError};

use super::imager::Imager;
use super::optics::{Microscope, Shared};
use storage::error::Result;

/// Number of microscopes whose tables are kept: those of a step's beginning and of trials for its end.
const KEPT: usize = 3;

/// Derivatives are taken again from new images where a quantity has changed by more than this fraction of the
/// step of their differences.
const STALE: f64 = 0.5;

/// The renderers of the microscopes used last.
#[derive(Debug, Default)]
pub(super) struct Renderers {
    recent: Mutex<Vec<(Key, Imager)>>,
}

/// A microscope, the tolerance of images, and the edge of windows, px.
type Key = (Microscope, f64, usize);

impl Renderers {
    /// The renderer of a microscope for windows of `edge_px` px; clones share tables.
    pub(super) fn get(&self, microscope: &Microscope, tolerance: f64, edge_px: usize) -> Result<Imager> {
        let key = (*microscope, tolerance, edge_px);
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = recent.iter().position(|(known, _)| *known == key) {
            let found = recent.remove(at);
            recent.push(found);
        } else {
            let made = Imager::new(microscope, tolerance, edge_px)?;
            recent.push((key, made));
            if recent.len() > KEPT {
                recent.remove(0);
            }
        }
        Ok(recent[recent.len() - 1].1.clone())
    }
}

/// The renderers for numerical derivatives with respect to shared quantities.
#[derive(Debug)]
pub(super) struct Sides {
    at: Microscope,
    accuracy: Accuracy,
    /// For each shared quantity with a numerical derivative: renderers one step below and above.
    pub(super) of: Vec<Option<Side>>,
}

/// A shared quantity below and above its value.
#[derive(Debug)]
pub(super) struct Side {
    pub(super) microscopes: [Microscope; 2],
    pub(super) renderers: [Imager; 2],
    /// Distance of the two values, in the units of [`Shared::moved`].
    pub(super) step: f64,
}

/// Accuracy of images and of their derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Accuracy {
    /// Error of images, as a fraction of their peaks.
    pub(super) tolerance: f64,
    /// Error of the images of which differences are taken.
    pub(super) of_sides: f64,
    /// Whether differences are central; otherwise only the upper image is new.
    pub(super) central: bool,
}

impl Sides {
    /// The renderers about a microscope, which has the renderer `own`.
    pub(super) fn about(
        at: &Microscope,
        own: &Imager,
        shared: &[Shared],
        accuracy: Accuracy,
        edge_px: usize,
    ) -> Result<Sides> {
        let mut of = Vec::new();
        for shared in shared {
            let Some(step) = shared.step(at) else {
                of.push(None);
                continue;
            };
            let new = |microscope: &Microscope| Imager::new(microscope, accuracy.of_sides, edge_px);
            let high = shared.moved(*at, step);
            of.push(Some(if accuracy.central {
                let low = shared.moved(*at, -step);
                Side { microscopes: [low, high], renderers: [new(&low)?, new(&high)?], step: 2.0 * step }
            } else {
                Side { microscopes: [*at, high], renderers: [own.clone(), new(&high)?], step }
            }));
        }
        Ok(Sides { at: *at, accuracy, of })
    }

    /// Whether the derivatives hold for a microscope, too, with the same accuracy.
    pub(super) fn hold_at(&self, microscope: &Microscope, shared: &[Shared], accuracy: Accuracy) -> bool {
        let is_near = |shared: &Shared| {
            let step = shared.step(&self.at).unwrap_or(f64::INFINITY);
            shared.distance(&self.at, microscope).abs() <= STALE * step
        };
        // Finer images of the microscope itself do not make derivatives finer.
        let same = (self.accuracy.of_sides, self.accuracy.central) == (accuracy.of_sides, accuracy.central);
        same && shared.iter().all(is_near)
    }
}
