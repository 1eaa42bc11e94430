//! Finite exposure: the streak of a particle that moves while the shutter is open.
//!
//! The time of a frame is the middle of its exposure. Light is collected over [t - open/2, t + open/2]; with
//! several flashes per frame, over such an interval about each of them; the flashes are symmetric about the
//! time of the frame. A moving particle is drawn as K points per flash, at the midpoints of K equal parts of
//! the interval, each with 1/K of the light of the flash. K = ceil(path / spacing), at most 64, where the
//! spacing is a quarter of a pixel. The ground truth of a frame is the particle position at the middle of the
//! exposure and its mean velocity over the exposure, without Brownian motion. Brownian motion during the
//! exposure is described in [`crate::sequence`].

use crate::{ParameterCheck, Result, Streak, StreakPoint, Tracer};
use glam::DVec3;

const CHECK: ParameterCheck = ParameterCheck("exposure");

/// Maximum number of points per flash.
const MAX_POINTS: f64 = 64.0;

/// Maximum number of flashes per frame.
const MAX_FLASHES: u32 = 100;

/// When a frame collects light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shutter {
    open_s: f64,
    flashes: u32,
    spacing_s: f64,
    piece_um: f64,
}

impl Shutter {
    /// A shutter that is open for `open_s` (s, >= 0) in each of `flashes` flashes (1 to 100) at intervals of
    /// `spacing_s` (s; > 0 and >= `open_s` if there are several). Points of a streak are at most `piece_um`
    /// (um, > 0) apart.
    pub fn new(open_s: f64, flashes: u32, spacing_s: f64, piece_um: f64) -> Result<Self> {
        CHECK.not_negative("exposure_s", open_s)?;
        CHECK.positive("piece_um", piece_um)?;
        if !(1..=MAX_FLASHES).contains(&flashes) {
            return Err(CHECK.fault("flashes.count", flashes, "1 to 100"));
        }
        if flashes > 1 {
            CHECK.positive("flashes.spacing_s", spacing_s)?;
            if spacing_s < open_s {
                let allowed = format!("a time >= exposure_s = {open_s}: flashes do not overlap");
                return Err(CHECK.fault("flashes.spacing_s", spacing_s, &allowed));
            }
        }
        Ok(Shutter { open_s, flashes, spacing_s: if flashes > 1 { spacing_s } else { 0.0 }, piece_um })
    }

    /// Duration of a flash, s.
    pub fn open_s(&self) -> f64 {
        self.open_s
    }

    /// Time from the first opening to the last closing, s.
    pub fn span_s(&self) -> f64 {
        self.open_s + f64::from(self.flashes - 1) * self.spacing_s
    }

    /// Number of points per flash for a particle that moves `path_um` (um) in the image plane during the
    /// whole span.
    pub(crate) fn points(&self, path_um: f64) -> u32 {
        let path = path_um * self.open_s / self.span_s();
        // The factor prevents rounding from giving five points for a path of exactly four spacings. A path of
        // NaN gives 0 points; its trajectory ends in an error elsewhere.
        libm::ceil(path / self.piece_um * (1.0 - 1e-12)).clamp(1.0, MAX_POINTS) as u32
    }

    /// Times of the points relative to the middle of the exposure, s, ascending.
    pub(crate) fn offsets_s(&self, points: u32) -> Vec<f64> {
        let flash = |k: u32| (f64::from(k) - 0.5 * f64::from(self.flashes - 1)) * self.spacing_s;
        let within = |i: u32| ((f64::from(i) + 0.5) / f64::from(points) - 0.5) * self.open_s;
        (0..self.flashes).flat_map(|k| (0..points).map(move |i| flash(k) + within(i))).collect()
    }

    /// Whether a part of the exposure contains its middle.
    pub(crate) fn splits(&self, points: u32) -> bool {
        points % 2 == 1 && self.flashes % 2 == 1
    }

    /// First and last times, relative to the middle of the exposure (s), of the parts that the points stand
    /// for, in ascending order; the part that contains the middle is split there.
    pub(crate) fn parts_s(&self, points: u32) -> Vec<(f64, f64)> {
        let flash = |k: u32| (f64::from(k) - 0.5 * f64::from(self.flashes - 1)) * self.spacing_s;
        let edge = |i: u32| (f64::from(i) / f64::from(points) - 0.5) * self.open_s;
        let parts = (0..self.flashes)
            .flat_map(|k| (0..points).map(move |i| (flash(k) + edge(i), flash(k) + edge(i + 1))));
        let mut parts: Vec<(f64, f64)> = parts.collect();
        if self.splits(points) {
            let middle = parts.len() / 2;
            parts.insert(middle + 1, (0.0, parts[middle].1));
            parts[middle].1 = 0.0;
        }
        parts
    }

    /// The streak of a particle that moves on a straight line, as recorded tracks do between frames.
    pub(crate) fn straight(&self, tracer: &Tracer) -> Streak {
        let velocity = tracer.velocity.unwrap_or(DVec3::ZERO);
        let points = self.points(velocity.truncate().length() * self.span_s());
        let at =
            |offset: f64| StreakPoint { position: tracer.position + velocity * offset, axis: tracer.axis };
        Streak {
            points: self.offsets_s(points).into_iter().map(at).collect(),
            share: 1.0 / f64::from(points),
            closing: at(0.5 * self.span_s()),
        }
    }
}
