//! Measured vectors paired with the true displacement.

use crate::results::FlowVector;

/// End-point error from which a vector is an outlier, px.
pub(super) const INLIER_PX: f64 = 1.0;

/// A measured vector and the true displacement at its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComparedVector {
    /// The measured vector.
    pub measured: FlowVector,
    /// The true displacement: dx, dy (px), dz (um).
    pub truth: [f64; 3],
}

impl ComparedVector {
    /// Result - truth along x and y, px.
    pub fn error(&self) -> [f64; 2] {
        [self.measured.moved[0] - self.truth[0], self.measured.moved[1] - self.truth[1]]
    }

    /// End-point error: length of the error in the image plane, px.
    pub fn endpoint(&self) -> f64 {
        let [u, v] = self.error();
        (u * u + v * v).sqrt()
    }
}
