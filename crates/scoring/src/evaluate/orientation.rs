//! Orientation of spheroids: the angle between true and found symmetry axes.
//!
//! An axis has no sign, so angles are 0 to 90 degrees. A random guess of the axis is off by 1 rad on average:
//! the mean of the polar angle over a hemisphere.

use super::matching::{Matching, NONE};
use super::statistics::{Interval, quantile, ratio, sorted};
use super::track_set::TrackSet;
use super::units::{Matched, Units};

/// Angle of a missed spheroid and of a ghost, degrees: at least as large as any found spheroid's, so that neither
/// omitted rows nor rows at random positions improve the score.
pub(super) const UNFOUND_DEG: f64 = 90.0;

/// Maximum number of spheroids for which the best constant axis is searched.
const SEARCHED: usize = 2000;

scores! {
    /// Angles between the true and found axes of spheroids, from `axis_x, axis_y, axis_z` or `alpha_rad,
    /// beta_rad` of the result.
    pub struct Orientation {
        /// Number of true spheroids.
        pub n_true: usize,
        /// Number of found spheroids with an axis.
        pub n: usize,
        /// Mean angle between true and found axes.
        #[schemars(range(min = 0.0, max = 90.0), extend("x-unit" = "deg"))]
        pub mean_deg: Option<f64>,
        /// Median angle between true and found axes.
        #[schemars(range(min = 0.0, max = 90.0), extend("x-unit" = "deg"))]
        pub median_deg: Option<f64>,
        /// Root mean square angle between true and found axes.
        #[schemars(range(min = 0.0, max = 90.0), extend("x-unit" = "deg"))]
        pub rms_deg: Option<f64>,
        /// Mean angle over all true spheroids and all ghosts. A spheroid that is found without an axis, or that
        /// has a ghost within its gate in addition to its match, counts with the angle of a guess: the constant
        /// axis that is closest to all true axes. Missed spheroids and ghosts count as 90 degrees.
        #[schemars(range(min = 0.0, max = 90.0), extend("x-unit" = "deg"))]
        pub mean_all_deg: Option<f64>,
        /// Mean angle between the true axes and this guess; 1 rad = 57.3 degrees if the true axes have no
        /// preferred direction.
        #[schemars(range(min = 0.0, max = 90.0), extend("x-unit" = "deg"))]
        pub guess_deg: Option<f64>,
        /// 95 % interval of mean_deg.
        #[schemars(inner(range(min = 0.0, max = 90.0)))]
        pub interval_mean_deg: Interval,
        /// 95 % interval of mean_all_deg.
        #[schemars(inner(range(min = 0.0, max = 90.0)))]
        pub interval_mean_all_deg: Interval,
    }
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
    /// Angles of the matched particles. `true_axes` and `found_axes`: one per row of the tables; NaN
    /// for particles without an axis, `found_axes` is empty if the result has none. `ambiguous` marks the
    /// true particles that have a ghost within their gate. `None` if the truth has no axes.
    ///
    /// Also gives the sums over units of what counts in `mean_all_deg`: number and angle.
    pub fn of(
        (truth, result): (&TrackSet, &TrackSet),
        (true_axes, found_axes): (&[[f64; 3]], &[[f64; 3]]),
        (matching, ambiguous): (&Matching, &[bool]),
        units: &Units,
    ) -> Option<(Self, Vec<[f64; 2]>)> {
        if true_axes.is_empty() {
            return None;
        }
        let axis = |i: usize| true_axes[truth.points[i].source as usize];
        let mut angles = vec![None; truth.len()];
        for (i, j) in matching.pairs().filter(|_| !found_axes.is_empty()) {
            angles[i] = angle_deg(axis(i), found_axes[result.points[j].source as usize]);
        }
        let all: Vec<[f64; 3]> =
            (0..truth.len()).map(axis).filter(|axis| axis.iter().all(|v| v.is_finite())).collect();
        let guess = best_constant(&all);
        let counted = |i: usize| match matching.result_for[i] {
            NONE => Some(UNFOUND_DEG),
            _ => angles[i].filter(|_| !ambiguous[i]).or_else(|| angle_deg(axis(i), guess)),
        };
        // Number of true spheroids, number of angles, their sum and sum of squares; number and sum of the
        // angles that count in the mean of all.
        let is_spheroid = |i: usize| axis(i).iter().all(|v| v.is_finite());
        let spheroids = (0..truth.len()).filter(|&i| is_spheroid(i));
        let sums = units.sums(units.matched(matching).map(|(unit, point)| {
            let sums = match point {
                Matched::Pair(i, _) | Matched::Missed(i) if is_spheroid(i) => {
                    let [n, sum, squares] = angles[i].map_or([0.0; 3], |a| [1.0, a, a * a]);
                    [1.0, n, sum, squares, 1.0, counted(i).unwrap_or(0.0)]
                }
                Matched::Ghost => [0.0, 0.0, 0.0, 0.0, 1.0, UNFOUND_DEG],
                _ => [0.0; 6],
            };
            (unit, sums)
        }));
        let mean = |s: &[f64; 6]| ratio(s[2], s[1]);
        let all = |s: &[f64; 6]| ratio(s[5], s[4]);
        let [interval_mean_deg, interval_mean_all_deg] = units.intervals(&sums, |s| [mean(s), all(s)]);
        let total = sums.iter().fold([0.0; 6], |t: [f64; 6], u| std::array::from_fn(|k| t[k] + u[k]));
        let found = sorted(spheroids.clone().filter_map(|i| angles[i]));
        let score = (total[0] > 0.0).then(|| Orientation {
            n_true: total[0] as usize,
            n: found.len(),
            mean_deg: mean(&total),
            median_deg: quantile(&found, 0.5),
            rms_deg: ratio(total[3], total[1]).map(f64::sqrt),
            mean_all_deg: all(&total),
            guess_deg: ratio(spheroids.filter_map(|i| angle_deg(axis(i), guess)).sum(), total[0]),
            interval_mean_deg,
            interval_mean_all_deg,
        })?;
        Some((score, sums.iter().map(|s| [s[4], s[5]]).collect()))
    }
}

/// The constant axis with the least mean angle to axes, to a fraction of a degree.
fn best_constant(axes: &[[f64; 3]]) -> [f64; 3] {
    let some: Vec<[f64; 3]> = axes.iter().step_by(axes.len().div_ceil(SEARCHED).max(1)).copied().collect();
    let sum = |[a, b]: [f64; 2]| {
        let of = |axis: &[f64; 3]| angle_deg(*axis, direction([a, b])).unwrap_or(0.0);
        some.iter().map(of).sum::<f64>()
    };
    // Polar angle and azimuth, steps of 6 degrees over half of the sphere, then ever smaller ones.
    let mut step = 6f64.to_radians();
    let coarse = (0..=15).flat_map(|i| (0..60).map(move |j| [f64::from(i) * step, f64::from(j) * step]));
    let nearer = |a: &[f64; 2], b: &[f64; 2]| sum(*a).total_cmp(&sum(*b));
    let mut best = coarse.min_by(nearer).unwrap_or_default();
    while step > 1e-3 {
        step *= 0.5;
        let around =
            (0..9).map(|k| [best[0] + step * f64::from(k / 3 - 1), best[1] + step * f64::from(k % 3 - 1)]);
        best = around.min_by(nearer).unwrap_or(best);
    }
    direction(best)
}

/// The axis of a polar angle and azimuth, rad.
fn direction([polar, azimuth]: [f64; 2]) -> [f64; 3] {
    [polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()]
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
    fn a_preferred_direction_is_the_best_guess() {
        // Axes within about 0.3 rad of one at a polar angle of 1 rad.
        let axes: Vec<[f64; 3]> = (0..500)
            .map(|i| f64::from(i) * 0.618_033_988_7)
            .map(|t| direction([1.0 + 0.3 * t.sin(), 2.0 + 0.3 * (2.0 * t + 1.0).cos()]))
            .collect();
        let off = angle_deg(best_constant(&axes), direction([1.0, 2.0])).unwrap();
        assert!(off < 3.0, "{off}");
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
        assert!((mean - 1f64.to_degrees()).abs() < 0.01, "{mean}");
    }
}
