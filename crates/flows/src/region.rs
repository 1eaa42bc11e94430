//! Axes and axis-aligned boxes in object space.

use crate::error::{ParameterCheck, Result};
use glam::DVec3;

/// A coordinate axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// Image columns, to the right.
    X,
    /// Image rows, downward.
    Y,
    /// The optical axis, away from the lens.
    Z,
}

impl Axis {
    /// All three.
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// The unit vector along the axis.
    pub fn unit(self) -> DVec3 {
        DVec3::AXES[self as usize]
    }
}

/// An axis-aligned box, um, of positive volume: points with `min` <= x < `max`, so that touching boxes share
/// no point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    min: DVec3,
    max: DVec3,
}

impl Region {
    /// The box between two corners, um; every coordinate of `min` must be less than the same one of `max`.
    pub fn new(min: DVec3, max: DVec3) -> Result<Self> {
        let check = ParameterCheck("region");
        check.finite_vector("min_um", min)?;
        check.finite_vector("max_um", max)?;
        if min.cmplt(max).all() {
            Ok(Region { min, max })
        } else {
            Err(check.fault("max_um", max, &format!("each coordinate > min_um = {min}")))
        }
    }

    /// The corner with the smallest coordinates, um.
    pub fn min(&self) -> DVec3 {
        self.min
    }

    /// The corner with the largest coordinates, um; not itself a point of the box.
    pub fn max(&self) -> DVec3 {
        self.max
    }

    /// Lengths of the edges, um.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Volume, um^3.
    pub fn volume(&self) -> f64 {
        self.size().element_product()
    }

    /// Whether a point (um) is in the box.
    pub fn contains(&self, x: DVec3) -> bool {
        x.cmpge(self.min).all() && x.cmplt(self.max).all()
    }

    /// The point at the fractions `unit` (each in [0, 1)) of the edges.
    pub fn at(&self, unit: DVec3) -> DVec3 {
        self.min + unit * self.size()
    }

    /// The eight corners.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |axis: usize| if i >> axis & 1 == 0 { self.min[axis] } else { self.max[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        })
    }

    /// Along each axis, the greatest distance between `center` and a point of the box, um.
    pub(crate) fn reach(&self, center: DVec3) -> DVec3 {
        (self.min - center).abs().max((self.max - center).abs())
    }

    /// Along each axis, the smallest distance between `center` and a point of the box, um; 0 if the box spans
    /// `center`.
    pub(crate) fn clearance(&self, center: DVec3) -> DVec3 {
        (center.clamp(self.min, self.max) - center).abs()
    }

    /// The bounding box of the mapped corners; it contains the image of the whole box if `map` is affine.
    pub(crate) fn mapped(&self, map: impl Fn(DVec3) -> DVec3) -> Region {
        let images = self.corners().map(map);
        let min = images.into_iter().reduce(DVec3::min).unwrap_or(self.min);
        let max = images.into_iter().reduce(DVec3::max).unwrap_or(self.max);
        Region { min, max }
    }

    /// The box enlarged by `margin` (um) on every side.
    pub(crate) fn grown(&self, margin: f64) -> Region {
        Region { min: self.min - margin, max: self.max + margin }
    }

    /// The smallest box that contains both boxes.
    pub(crate) fn joined(&self, other: &Region) -> Region {
        Region { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The same box with one edge replaced; `None` if that leaves no volume.
    pub(crate) fn with_edge(&self, axis: Axis, low: f64, high: f64) -> Option<Region> {
        let mut region = *self;
        region.min[axis as usize] = low;
        region.max[axis as usize] = high;
        (low < high).then_some(region)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_needs_a_volume() {
        assert!(Region::new(DVec3::ZERO, DVec3::new(1.0, 0.0, 1.0)).is_err());
        assert!(Region::new(DVec3::ZERO, DVec3::new(1.0, f64::NAN, 1.0)).is_err());
        let region = Region::new(DVec3::new(-1.0, 0.0, 2.0), DVec3::new(1.0, 3.0, 6.0)).unwrap();
        assert_eq!(region.volume(), 24.0);
        assert!(region.contains(region.min()) && !region.contains(region.max()));
        assert_eq!(region.corners()[5], DVec3::new(1.0, 0.0, 6.0));
    }
}
