//! Orientation of spheroids: the angle between true and found symmetry axes.
//!
//! An axis has no sign, so angles are 0 to 90 degrees. An axis that is guessed is 1 rad off on average: the
//! mean of the polar angle over a hemisphere.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::matching::Matching;
use super::statistics::{Bootstrap, Interval, quantile, ratio};
use super::track_set::TrackSet;

/// Mean angle between an axis and one that is guessed, degrees.
const GUESS_DEG: f64 = 180.0 / std::f64::consts::PI;

/// Angles between the true and found axes of spheroids, for results with `axis_x, axis_y, axis_z` or
/// `alpha_rad, beta_rad`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Orientation {
    /// True spheroids.
    pub n_true: usize,
    /// Found spheroids with an axis.
    pub n: usize,
    /// Mean angle between true and found axes.
    #[schemars(range(min = 0.0, max = 90.0), extend("x-unit" = "deg"))]
    pub mean_deg: Option<f64>,
    /// Median angle.
    #[schemars(range(min = 0.0, max = 90.0), extend("x-unit" = "deg"))]
    pub median_deg: Option<f64>,
    /// Root mean square angle.
    #[schemars(range(min = 0.0, max = 90.0), extend("x-unit" = "deg"))]
    pub rms_deg: Option<f64>,
    /// Mean angle over all true spheroids; one that is missed or has no axis counts as a guess, 1 rad = 57.3
    /// degrees.
    #[schemars(range(min = 0.0, max = 90.0), extend("x-unit" = "deg"))]
    pub mean_all_deg: Option<f64>,
    /// 95 % interval of mean_deg.
    #[schemars(inner(range(min = 0.0, max = 90.0)))]
    pub interval_mean_deg: Interval,
    /// 95 % interval of mean_all_deg.
    #[schemars(inner(range(min = 0.0, max = 90.0)))]
    pub interval_mean_all_deg: Interval,
}

/// The angle between two axes, degrees; `None` if one is undefined.
fn angle_deg(a: [f64; 3], b: [f64; 3]) -> Option<f64> {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    // Precise at small angles, where the cosine is not.
    let angle = dot(cross, cross).sqrt().atan2(dot(a, b).abs()).to_degrees();
    (dot(a, a) * dot(b, b) > 0.0).then_some(angle).filter(|angle| angle.is_finite())
}

impl Orientation {
    /// Angles of the matched particles. `true_axes` and `found_axes` are those of the rows of the tables; NaN
    /// for particles without an axis. `None` if truth or result has none.
    pub fn of(
        (truth, result): (&TrackSet, &TrackSet),
        (true_axes, found_axes): (&[[f64; 3]], &[[f64; 3]]),
        matching: &Matching,
        bootstrap: &Bootstrap,
    ) -> Option<Self> {
        if true_axes.is_empty() || found_axes.is_empty() {
            return None;
        }
        let axis = |i: usize| true_axes[truth.points[i].source as usize];
        let mut angles = vec![None; truth.len()];
        for (i, j) in matching.pairs() {
            angles[i] = angle_deg(axis(i), found_axes[result.points[j].source as usize]);
        }
        // Number of true spheroids, number of angles, their sum and sum of squares.
        let spheroids = (0..truth.len()).filter(|&i| axis(i).iter().all(|v| v.is_finite()));
        let sums = spheroids.clone().map(|i| {
            let sums = angles[i].map_or([1.0, 0.0, 0.0, 0.0], |a| [1.0, 1.0, a, a * a]);
            (truth.points[i].frame, sums)
        });
        let units = bootstrap.by_frame(sums);
        let mean = |s: &[f64; 4]| ratio(s[2], s[1]);
        let all = |s: &[f64; 4]| ratio(s[2] + (s[0] - s[1]) * GUESS_DEG, s[0]);
        let [interval_mean_deg, interval_mean_all_deg] = bootstrap.intervals(&units, |s| [mean(s), all(s)]);
        let total = units.iter().fold([0.0; 4], |t: [f64; 4], u| std::array::from_fn(|k| t[k] + u[k]));
        let mut sorted: Vec<f64> = spheroids.filter_map(|i| angles[i]).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        (total[0] > 0.0).then(|| Orientation {
            n_true: total[0] as usize,
            n: sorted.len(),
            mean_deg: mean(&total),
            median_deg: quantile(&sorted, 0.5),
            rms_deg: ratio(total[3], total[1]).map(f64::sqrt),
            mean_all_deg: all(&total),
            interval_mean_deg,
            interval_mean_all_deg,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_no_sign_and_any_length() {
        let close = |a, b, expected: f64| (angle_deg(a, b).unwrap() - expected).abs() < 1e-12;
        assert!(close([1.0, 0.0, 0.0], [-2.0, 0.0, 0.0], 0.0));
        assert!(close([1.0, 0.0, 0.0], [0.0, 0.0, 3.0], 90.0));
        assert!(close([1.0, 1.0, 0.0], [1.0, 0.0, 0.0], 45.0));
        assert_eq!(angle_deg([0.0; 3], [1.0, 0.0, 0.0]), None);
        assert_eq!(angle_deg([f64::NAN; 3], [1.0, 0.0, 0.0]), None);
    }

    #[test]
    fn a_guessed_axis_is_one_radian_off_on_average() {
        // Axes at equal steps of the cosine of the polar angle, which is uniform on a sphere.
        let n = 20_000;
        let cosine = |i: i32| (f64::from(i) + 0.5) / f64::from(n);
        let guess =
            |i| angle_deg([0.0, 0.0, 1.0], [(1.0 - cosine(i).powi(2)).sqrt(), 0.0, cosine(i)]).unwrap();
        let mean = (0..n).map(guess).sum::<f64>() / f64::from(n);
        // The sum over n steps is within 1/n of the integral.
        assert!((mean - GUESS_DEG).abs() < 0.01, "{mean}");
    }
}
