//! Moments of particle images over depth: lateral drift, direction of the cylindrical lens, focal planes.

use super::background::Background;
use super::particles::Windows;
use super::scan::Scan;

/// First and second moments of one window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moments {
    /// Light above the background, counts.
    pub(super) light: f64,
    /// Centroid relative to the middle of the window, px.
    pub(super) centroid: [f64; 2],
    /// Central second moments xx, xy, yy, px^2.
    pub(super) second: [f64; 3],
}

/// Properties of a scan from moments.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    /// Common lateral drift, px per um of stage position.
    pub(super) drift: [f64; 2],
    /// Position of each particle at the mean stage position, relative to the middle of its window, px.
    pub(super) places: Vec<[f64; 2]>,
    /// Direction, rad, in (-pi/4, pi/4], for which the difference of the widths along and across it changes
    /// most over depth; the cylindrical lens has power along it or across it.
    pub(super) axis: f64,
    /// Stage positions of the smallest width along the axis and across it, um.
    pub(super) focus: [f64; 2],
    /// Whether these differ by more than a spherical lens can cause.
    pub(super) astigmatic: bool,
}

/// Images are astigmatic if the distance of the two focal planes exceeds this fraction of the scan's range.
const ASTIGMATIC: f64 = 0.12;

impl Shape {
    pub(super) fn of(scan: &Scan, background: Background, windows: &Windows) -> Shape {
        let all: Vec<Vec<Moments>> = windows
            .particles
            .iter()
            .map(|window| {
                scan.planes.iter().map(|plane| moments(plane, background, &window.pixels)).collect()
            })
            .collect();
        let mean = scan.mean_stage_um();
        let offsets: Vec<f64> = scan.stage_um.iter().map(|s| s - mean).collect();
        let (drift, places) = drift(&all, &offsets);
        let axis = axis(&all);
        let focus =
            [axis, axis + std::f64::consts::FRAC_PI_2].map(|angle| focus(&all, &scan.stage_um, angle));
        let astigmatic = (focus[0] - focus[1]).abs() > ASTIGMATIC * scan.range_um();
        Shape { drift, places, axis, focus, astigmatic }
    }
}

fn moments(plane: &[u16], background: Background, pixels: &[(usize, [f64; 2])]) -> Moments {
    // Only pixels above the noise contribute.
    let value = |at: usize| f64::from(plane[at]) - background.mean;
    let weigh = |keep: &dyn Fn(f64, [f64; 2]) -> bool| {
        let (mut sum, mut first, mut second) = (0.0, [0.0; 2], [0.0; 3]);
        for &(at, [x, y]) in pixels {
            let v = value(at);
            if keep(v, [x, y]) {
                sum += v;
                first[0] += v * x;
                first[1] += v * y;
                second[0] += v * x * x;
                second[1] += v * x * y;
                second[2] += v * y * y;
            }
        }
        (sum, first, second)
    };
    let bright = 4.0 * background.noise;
    let (sum, first, second) = weigh(&|v, _| v > bright);
    if sum <= 0.0 {
        return Moments { light: 0.0, centroid: [0.0; 2], second: [0.0; 3] };
    }
    let [x, y] = first.map(|f| f / sum);
    let second = [second[0] / sum - x * x, second[1] / sum - x * y, second[2] / sum - y * y];
    Moments { light: sum, centroid: [x, y], second }
}

/// Weighted linear regression of the centroids over stage position, with one slope for all particles. Returns
/// the slope (px/um) and the position of each particle (px).
fn drift(all: &[Vec<Moments>], offsets: &[f64]) -> ([f64; 2], Vec<[f64; 2]>) {
    let weight = |m: &Moments| if m.light > 0.0 { m.light / (1.0 + m.second[0] + m.second[2]) } else { 0.0 };
    let mut slope = [0.0; 2];
    for (axis, slope) in slope.iter_mut().enumerate() {
        let (mut across, mut along) = (0.0, 0.0);
        for particle in all {
            let total: f64 = particle.iter().map(weight).sum::<f64>().max(f64::MIN_POSITIVE);
            let mean = |value: &dyn Fn(usize) -> f64| {
                (0..particle.len()).map(|i| weight(&particle[i]) * value(i)).sum::<f64>() / total
            };
            let (s0, c0) = (mean(&|i| offsets[i]), mean(&|i| particle[i].centroid[axis]));
            for (m, s) in particle.iter().zip(offsets) {
                across += weight(m) * (s - s0) * (m.centroid[axis] - c0);
                along += weight(m) * (s - s0) * (s - s0);
            }
        }
        *slope = if along > 0.0 { across / along } else { 0.0 };
    }
    let places = all
        .iter()
        .map(|particle| {
            let total: f64 = particle.iter().map(weight).sum::<f64>().max(f64::MIN_POSITIVE);
            [0, 1].map(|axis| {
                let rest = |(m, s): (&Moments, &f64)| weight(m) * (m.centroid[axis] - slope[axis] * s);
                particle.iter().zip(offsets).map(rest).sum::<f64>() / total
            })
        })
        .collect();
    (slope, places)
}

/// Half the angle (rad) of the principal direction in which (m_xx - m_yy, 2 m_xy) varies over depth.
fn axis(all: &[Vec<Moments>]) -> f64 {
    let q = |m: &Moments| [m.second[0] - m.second[2], 2.0 * m.second[1]];
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for particle in all {
        let n = particle.len().max(1) as f64;
        let mean = [0, 1].map(|i| particle.iter().map(|m| q(m)[i]).sum::<f64>() / n);
        for m in particle {
            let [a, b] = [q(m)[0] - mean[0], q(m)[1] - mean[1]];
            xx += a * a;
            xy += a * b;
            yy += b * b;
        }
    }
    let direction = 0.5 * libm::atan2(2.0 * xy, xx - yy);
    0.5 * direction
}

/// Stage position of the smallest mean width along a direction, um: the vertex of a parabola fitted to the
/// planes around the minimum, or the minimum itself at an end of the scan.
fn focus(all: &[Vec<Moments>], stage_um: &[f64], angle: f64) -> f64 {
    let (c, s) = (libm::cos(angle), libm::sin(angle));
    let width: Vec<f64> = (0..stage_um.len())
        .map(|i| {
            let along = |m: &Moments| c * c * m.second[0] + 2.0 * c * s * m.second[1] + s * s * m.second[2];
            let lit = all.iter().map(|particle| &particle[i]).filter(|m| m.light > 0.0);
            let (sum, n) = lit.fold((0.0, 0.0), |(sum, n), m| (sum + along(m), n + 1.0));
            if n > 0.0 { sum / n } else { f64::INFINITY }
        })
        .collect();
    let least = (0..width.len()).min_by(|&a, &b| width[a].total_cmp(&width[b])).unwrap_or(0);
    let from = least.saturating_sub(3);
    let to = (least + 4).min(width.len());
    if least == 0 || least + 1 == width.len() {
        return stage_um[least];
    }
    vertex(&stage_um[from..to], &width[from..to])
        .unwrap_or(stage_um[least])
        .clamp(stage_um[from].min(stage_um[to - 1]), stage_um[from].max(stage_um[to - 1]))
}

/// The vertex of the least-squares parabola through points; `None` if it opens downward.
fn vertex(x: &[f64], y: &[f64]) -> Option<f64> {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let mut sums = [0.0; 5];
    let mut right = [0.0; 3];
    for (x, y) in x.iter().zip(y) {
        let d = x - mean;
        let mut power = 1.0;
        for (k, sum) in sums.iter_mut().enumerate() {
            *sum += power;
            if k < 3 {
                right[k] += power * y;
            }
            power *= d;
        }
    }
    let matrix = glam::DMat3::from_cols_array(&[
        sums[0], sums[1], sums[2], sums[1], sums[2], sums[3], sums[2], sums[3], sums[4],
    ]);
    let p = matrix.inverse() * glam::DVec3::from_array(right);
    (p.z > 0.0 && p.is_finite()).then(|| mean - p.y / (2.0 * p.z))
}
