//! The sum of fields.

use super::Inner;
use crate::fields::prelude::*;
use crate::wall::nearer;
use std::sync::Arc;

const SUM: ParameterCheck = ParameterCheck("sum");
/// Maximum number of passes over the walls of all fields.
const MAX_ROUNDS: u32 = 8;

/// The sum of one or more fields.
#[derive(Debug)]
pub struct Sum(Vec<Inner>);

impl Sum {
    /// The sum of one or more fields.
    pub fn new(fields: Vec<Box<dyn VelocityField>>) -> Result<Self> {
        if fields.is_empty() {
            return Err(SUM.fault("fields", "none", "one or more"));
        }
        Ok(Sum(fields.into_iter().map(Inner::from).collect()))
    }
}

impl VelocityField for Sum {
    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        self.0.iter().map(|field| field.velocity(x, t)).sum()
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        self.0.iter().fold(DMat3::ZERO, |sum, field| sum + field.gradient(x, t))
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        if let [only] = self.0.as_slice() { only.flow_map(x, t0, t1) } else { None }
    }

    fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
        if let [only] = self.0.as_slice() { only.invariant(x, t) } else { None }
    }

    fn is_divergence_free(&self) -> bool {
        self.0.iter().all(|field| field.is_divergence_free())
    }

    fn is_steady(&self) -> bool {
        self.0.iter().all(|field| field.is_steady())
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        self.0.iter().map(|field| field.max_speed(region, t0, t1)).sum::<f64>() * ROUNDING_MARGIN
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        // The step limits refer to the speed of each field alone: convert each to a length, then to a time at
        // the speed of the sum.
        let speed = self.velocity(x, t).length();
        self.0
            .iter()
            .filter_map(|field| Some(field.step_limit(x, t)? * field.velocity(x, t).length() / speed))
            .filter(|limit| *limit > 0.0)
            .reduce(f64::min)
    }

    /// The largest share of any term; the share of the sum is larger if the data of terms end in different
    /// places.
    fn share_without_data(&self, region: &Region) -> f64 {
        self.0.iter().map(|field| field.share_without_data(region)).fold(0.0, f64::max)
    }

    fn wall(&self, x: DVec3, t: f64) -> Option<Wall> {
        self.0.iter().fold(None, |nearest, field| nearer(nearest, field.wall(x, t)))
    }

    fn walls_same_along(&self) -> [bool; 3] {
        let walled = self.0.iter().filter(|field| field.wall(DVec3::ZERO, 0.0).is_some());
        walled.map(|field| field.walls_same_along()).fold([true; 3], |a, b| [0, 1, 2].map(|k| a[k] && b[k]))
    }

    fn confine(&self, mut x: DVec3, t: f64, radius: f64) -> DVec3 {
        // A particle moved out of the walls of one field may overlap the walls of another.
        for _ in 0..MAX_ROUNDS {
            let held = self.0.iter().fold(x, |x, field| field.confine(x, t, radius));
            if held == x {
                break;
            }
            x = held;
        }
        x
    }

    fn for_diameter(&self, d_um: f64) -> Option<Inner> {
        let own: Vec<Option<Inner>> = self.0.iter().map(|field| field.for_diameter(d_um)).collect();
        if own.iter().all(Option::is_none) {
            return None;
        }
        let parts = own.into_iter().zip(&self.0).map(|(own, field)| own.unwrap_or_else(|| field.clone()));
        Some(Arc::new(Sum(parts.collect())))
    }
}
