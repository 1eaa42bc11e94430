//! APTV: depth from the two widths of astigmatic particle images.
//!
//! A particle image is a connected region above a threshold; its widths are the square roots of the second
//! central moments of the light above it along x and y. The widths over the calibration stack form a curve in
//! the plane of widths, and a particle has the depth of the nearest point of the curve (Cierpka et al.
//! 2010, Meas. Sci. Technol. 21, 045401); with stacks of several sizes, of all their curves. Overlapping
//! particles merge into one region whose widths are off the curve, and are dropped. Without a cylindrical
//! lens the curve folds back on itself: depths on both sides of the focus are indistinguishable.

use super::calibration::CalibrationImage;
use super::gray_image::GrayImage;
use std::sync::{Mutex, PoisonError};

use super::{Localization, Method, calibration};
use storage::error::{Error, Result};

/// Standard deviation of the Gaussian filter before segmentation, px; prevents faint images from breaking up.
const SMOOTH_PX: f32 = 1.5;

/// Segmentation threshold, in standard deviations of the filtered noise.
const ABOVE_NOISE: f32 = 5.0;

/// A region ends where its light falls below this fraction of its peak, ...
const OF_PEAK: f32 = 0.08;

/// ... such that the faintest image of the calibration is still seen whole at this fraction of its
/// brightness. Noise sets the limit only where it is higher: if images extended to their faintest rims, more
/// of them would overlap, and less noise would mean fewer particles.
const LEAST_BRIGHTNESS: f32 = 0.5;

/// Minimum area of a region, px^2.
const LEAST_AREA: usize = 12;

/// Maximum distance from the curve, relative to the sum of both widths.
const TOLERANCE: f64 = 0.12;

/// Number of neighboring depths on each side used to smooth a point of the curve.
const NEIGHBORS: usize = 2;

/// Points of the curve per step of the stack.
const DENSITY: usize = 20;

pub(super) const METHOD: Method = Method {
    name: "aptv",
    about: "Depth from the two widths of astigmatic particle images, linked",
    run: |job| {
        let (curve, left_out) = CalibrationCurve::from_sizes(&calibration::read(job.dataset)?)?;
        left_out.into_iter().for_each(|warning| job.warn(warning));
        curve.warning().into_iter().for_each(|warning| job.warn(warning));
        let tally = Mutex::new(Tally::default());
        let found = job.particles(|_, image| {
            let (found, image_tally) = curve.find(image);
            tally.lock().unwrap_or_else(PoisonError::into_inner).add(&image_tally);
            found
        })?;
        let tally = tally.into_inner().unwrap_or_else(PoisonError::into_inner);
        tally.warning(job.recording.image_share()).into_iter().for_each(|warning| job.warn(warning));
        Ok(found)
    },
};

/// Numbers of bright regions by outcome.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Tally {
    measured: usize,
    at_edge: usize,
    off_curve: usize,
    small: usize,
    /// Number of pixels in bright regions, and of all pixels.
    bright: usize,
    pixels: usize,
}

impl Tally {
    fn add(&mut self, other: &Tally) {
        self.measured += other.measured;
        self.at_edge += other.at_edge;
        self.off_curve += other.off_curve;
        self.small += other.small;
        self.bright += other.bright;
        self.pixels += other.pixels;
    }

    /// Why regions were not measured, by reason, with possible remedies if those are the majority;
    /// `image_share` is the fraction of the frame that contains particles.
    fn warning(&self, image_share: f64) -> Option<String> {
        let Tally { measured, at_edge, off_curve, small, .. } = self;
        let lost = at_edge + off_curve + small;
        let regions = measured + lost;
        if regions == 0 {
            return Some(format!(
                "no particles found: nothing exceeds {ABOVE_NOISE} standard deviations of the filtered noise; more light or \
                 less noise would help"
            ));
        }
        if lost == 0 {
            return None;
        }
        let mut said = format!(
            "{measured} of {regions} bright regions were measured: {at_edge} touch the edge of the image, {off_curve} have widths \
             off the calibration curve, as overlapping particles do, {small} are smaller than {LEAST_AREA} px"
        );
        if 2 * measured < regions {
            // Randomly placed images cover a fraction 1 - exp(-N_S) of a frame, and a fraction exp(-4 N_S) of
            // them does not touch another.
            let covered = self.bright as f64 / (self.pixels as f64 * image_share);
            let n_s = -(1.0 - covered).max(1e-3).ln();
            let frame =
                if image_share < 1.0 { "the part of the frame that contains particles" } else { "the frame" };
            said += &format!(
                ". Particle images cover N_S = {n_s:.2} of {frame}, which leaves about {:.0} % of them isolated; fewer \
                 particles, a smaller depth range or a lower magnification would help, or methods for overlapping images \
                 (ncc, mle)",
                100.0 * (-4.0 * n_s).exp()
            );
        }
        Some(said)
    }
}

/// A bright region.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Region {
    /// Centroid, relative to the center of the first pixel, px.
    at: [f64; 2],
    /// Standard deviations of its intensity along x and y, px.
    widths: [f64; 2],
}

/// Calibration curve: widths as functions of depth.
#[derive(Debug)]
pub(super) struct CalibrationCurve {
    /// Depth (um) and widths (px), densely sampled.
    points: Vec<(f64, [f64; 2])>,
    /// Offset of the centroid from the particle's position for each point, px.
    offsets: Vec<[f64; 2]>,
    /// Least height of bright regions above the background, counts.
    least: f32,
    ambiguous: bool,
}

impl CalibrationCurve {
    /// The points of the curves of all stacks, and warnings of sizes that are too faint for a curve.
    fn from_sizes(stacks: &[Vec<CalibrationImage>]) -> Result<(Self, Vec<String>)> {
        let peak = |step: &CalibrationImage| {
            let smooth = step.image.smoothed(SMOOTH_PX);
            smooth.counts.iter().copied().fold(0.0, f32::max) - smooth.background().0
        };
        let least =
            OF_PEAK * LEAST_BRIGHTNESS * stacks.iter().flatten().map(peak).fold(f32::INFINITY, f32::min);
        let mut all = CalibrationCurve { points: Vec::new(), offsets: Vec::new(), least, ambiguous: false };
        let curves =
            calibration::usable_sizes(stacks.iter().map(|steps| CalibrationCurve::new(steps, least)))?;
        for curve in curves.0 {
            all.points.extend(curve.points);
            all.offsets.extend(curve.offsets);
            all.ambiguous |= curve.ambiguous;
        }
        Ok((all, curves.1))
    }

    /// The curve of a calibration stack, of regions at least `least` counts above the background.
    fn new(steps: &[CalibrationImage], least: f32) -> Result<Self> {
        let mut seen: Vec<(f64, [f64; 4])> = Vec::new();
        for step in steps {
            let near = |b: &Region| (b.at[0] - step.at[0]).powi(2) + (b.at[1] - step.at[1]).powi(2);
            let region = regions(&step.image, least).0.into_iter().min_by(|a, b| near(a).total_cmp(&near(b)));
            if let Some(b) = region.filter(|b| near(b) < 25.0) {
                let offset = [b.at[0] - step.at[0], b.at[1] - step.at[1]];
                seen.push((step.z_um, [b.widths[0], b.widths[1], offset[0], offset[1]]));
            }
        }
        if seen.len() < 5 {
            let found = seen.len();
            return Err(Error::input(format!(
                "calibration: the particle is visible above the noise in {found} of {} images; expected at least 5",
                steps.len()
            )));
        }
        let smooth: Vec<(f64, [f64; 4])> = (0..seen.len()).map(|i| smoothed(&seen, i)).collect();
        let dense = smooth.windows(2).flat_map(|pair| {
            let [(za, a), (zb, b)] = [pair[0], pair[1]];
            (0..DENSITY).map(move |k| {
                let t = k as f64 / DENSITY as f64;
                (za + t * (zb - za), std::array::from_fn::<f64, 4, _>(|i| a[i] + t * (b[i] - a[i])))
            })
        });
        let dense: Vec<(f64, [f64; 4])> = dense.chain(smooth.last().copied()).collect();
        let roundish = smooth.iter().filter(|(_, w)| (w[0] - w[1]).abs() < 0.1 * (w[0] + w[1])).count();
        Ok(CalibrationCurve {
            points: dense.iter().map(|(z, w)| (*z, [w[0], w[1]])).collect(),
            offsets: dense.iter().map(|(_, w)| [w[2], w[3]]).collect(),
            least,
            ambiguous: 2 * roundish > smooth.len(),
        })
    }

    /// A warning if depths from this curve are ambiguous.
    pub(super) fn warning(&self) -> Option<String> {
        self.ambiguous.then(|| {
            "the calibration images are round at most depths: without astigmatism, the widths do not determine on which side of the \
            focus a particle is"
                .to_owned()
        })
    }

    /// The particles of an image, and the outcome for all its bright regions.
    fn find(&self, image: &GrayImage) -> (Vec<Localization>, Tally) {
        let (regions, mut tally) = regions(image, self.least);
        let found: Vec<Localization> = regions.iter().filter_map(|region| self.place(region)).collect();
        tally.measured = found.len();
        tally.off_curve += regions.len() - found.len();
        (found, tally)
    }

    fn place(&self, region: &Region) -> Option<Localization> {
        let distance = |(_, w): &(f64, [f64; 2])| (w[0] - region.widths[0]).hypot(w[1] - region.widths[1]);
        let (nearest, off) =
            self.points.iter().map(distance).enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let [ox, oy] = self.offsets[nearest];
        (off <= TOLERANCE * (region.widths[0] + region.widths[1])).then(|| Localization {
            x_px: region.at[0] - ox + 1.0,
            y_px: region.at[1] - oy + 1.0,
            z_um: Some(self.points[nearest].0),
            ..Localization::default()
        })
    }
}

/// A point of the curve smoothed by a least-squares parabola through the point and its neighbors.
fn smoothed(points: &[(f64, [f64; 4])], i: usize) -> (f64, [f64; 4]) {
    let near = &points[i.saturating_sub(NEIGHBORS)..(i + NEIGHBORS + 1).min(points.len())];
    let z0 = points[i].0;
    let scale = near.iter().map(|(z, _)| (z - z0).abs()).fold(0.0, f64::max);
    let powers = |z: f64| {
        let t = (z - z0) / scale;
        glam::DVec3::new(1.0, t, t * t)
    };
    let mut normal = glam::DMat3::ZERO;
    let mut right = [glam::DVec3::ZERO; 4];
    for (z, values) in near {
        let p = powers(*z);
        normal += glam::DMat3::from_cols(p * p.x, p * p.y, p * p.z);
        right.iter_mut().zip(values).for_each(|(r, v)| *r += p * *v);
    }
    // There are at least three points at different depths, so the matrix is not singular.
    let inverse = normal.inverse();
    (z0, right.map(|r| (inverse * r).x))
}

/// The bright regions of an image, at least `least` counts above the background, that do not touch its edge,
/// and counts of the others. A region is cut off at a fraction of its own peak, so that its widths depend
/// neither on its brightness nor on faint rims, by which it may touch others.
fn regions(image: &GrayImage, least: f32) -> (Vec<Region>, Tally) {
    let (w, h) = (image.width, image.height);
    let smooth = image.smoothed(SMOOTH_PX);
    let (level, noise) = smooth.background();
    let threshold = level + (ABOVE_NOISE * noise).max(least).max(1e-3);
    let mut open: Vec<bool> = smooth.counts.iter().map(|c| *c > threshold).collect();
    let mut found = Vec::new();
    let bright = open.iter().filter(|o| **o).count();
    let mut tally = Tally { pixels: w * h, bright, ..Tally::default() };
    let on_edge = |i: &usize| [0, w - 1].contains(&(i % w)) || [0, h - 1].contains(&(i / w));
    let peak = |pixels: &[usize]| pixels.iter().fold(0.0, |peak, &i| smooth.counts[i].max(peak)) - level;
    for whole in (0..w * h).filter_map(|start| connected(&mut open, (w, h), start)).collect::<Vec<_>>() {
        let cut = threshold.max(level + OF_PEAK * peak(&whole));
        whole.iter().for_each(|&i| open[i] = smooth.counts[i] > cut);
        for region in
            whole.iter().filter_map(|&start| connected(&mut open, (w, h), start)).collect::<Vec<_>>()
        {
            if region.len() < LEAST_AREA {
                tally.small += 1;
            } else if region.iter().any(on_edge) {
                tally.at_edge += 1;
            } else if cut > threshold && cut - level > 1.5 * OF_PEAK * peak(&region) {
                // Cut off by the threshold of a brighter neighbor.
                tally.off_curve += 1;
            } else {
                found.push(moments(&smooth, cut, &region));
            }
        }
    }
    (found, tally)
}

/// The open pixels that are connected to a pixel; they are then closed. `None` if the pixel is not open.
fn connected(open: &mut [bool], (w, h): (usize, usize), start: usize) -> Option<Vec<usize>> {
    std::mem::take(&mut open[start]).then(|| {
        let (mut region, mut next) = (vec![start], 0);
        while next < region.len() {
            let (x, y) = (region[next] % w, region[next] / w);
            next += 1;
            for v in y.saturating_sub(1)..(y + 2).min(h) {
                for u in x.saturating_sub(1)..(x + 2).min(w) {
                    if std::mem::take(&mut open[v * w + u]) {
                        region.push(v * w + u);
                    }
                }
            }
        }
        region
    })
}

/// Centroid and widths of the light above `level`, which is the threshold of the region, so that single
/// pixels at its rim have little effect.
fn moments(image: &GrayImage, level: f32, region: &[usize]) -> Region {
    let w = image.width;
    let mut sums = [0.0; 5];
    for &i in region {
        let light = f64::from(image.counts[i] - level);
        let (x, y) = ((i % w) as f64, (i / w) as f64);
        for (sum, term) in sums.iter_mut().zip([1.0, x, y, x * x, y * y]) {
            *sum += light * term;
        }
    }
    let [total, x, y, xx, yy] = sums;
    let at = [x / total, y / total];
    let width = |square: f64, mean: f64| (square / total - mean * mean).max(0.0).sqrt();
    Region { at, widths: [width(xx, at[0]), width(yy, at[1])] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Gaussian image whose widths along x and y vary oppositely with depth, as with a cylindrical lens.
    fn image(size: usize, at: [f64; 2], z_um: f64) -> GrayImage {
        let widths = [3.0 + 0.05 * z_um, 3.0 - 0.05 * z_um].map(|s| s as f32);
        GrayImage::from_fn((size, size), |x, y| {
            let [dx, dy] = [(x as f32 - at[0] as f32) / widths[0], (y as f32 - at[1] as f32) / widths[1]];
            let noise = ((x * 7 + y * 13) % 5) as f32;
            100.0 + noise + 3e4 / (widths[0] * widths[1]) * (-0.5 * (dx * dx + dy * dy)).exp()
        })
    }

    #[test]
    fn depth_comes_back_from_the_widths() {
        let steps: Vec<CalibrationImage> = (-10..=10)
            .map(|k| {
                let z_um = 2.0 * f64::from(k);
                CalibrationImage { z_um, at: [30.0, 30.0], image: image(61, [30.0, 30.0], z_um) }
            })
            .collect();
        let curve = CalibrationCurve::from_sizes(&[steps]).unwrap().0;
        assert!(curve.warning().is_none());
        for z in [-17.3, -6.1, 0.4, 11.9] {
            let (found, _) = curve.find(&image(80, [41.25, 38.6], z));
            assert_eq!(found.len(), 1);
            assert!((found[0].z_um.unwrap() - z).abs() < 0.5, "{found:?} for {z}");
            assert!((found[0].x_px - 42.25).abs() < 0.1 && (found[0].y_px - 39.6).abs() < 0.1, "{found:?}");
        }
    }

    #[test]
    fn regions_that_are_not_measured_are_counted_and_explained() {
        let steps: Vec<CalibrationImage> = (-10..=10)
            .map(|k| {
                let z_um = 2.0 * f64::from(k);
                CalibrationImage { z_um, at: [30.0, 30.0], image: image(61, [30.0, 30.0], z_um) }
            })
            .collect();
        let curve = CalibrationCurve::from_sizes(&[steps]).unwrap().0;
        // Two overlapping particles and one at the edge.
        let parts = [([40.0, 40.0], 15.0), ([46.0, 48.0], -15.0), ([2.0, 70.0], 0.0)];
        let images = parts.map(|(at, z_um)| image(90, at, z_um));
        let mut sum = images[0].clone();
        for other in &images[1..] {
            sum.counts.iter_mut().zip(&other.counts).for_each(|(a, b)| *a += b - 100.0);
        }
        let (found, tally) = curve.find(&sum);
        assert_eq!((found.len(), tally.measured, tally.at_edge, tally.off_curve), (0, 0, 1, 1), "{tally:?}");
        let said = tally.warning(1.0).unwrap();
        assert!(said.starts_with("0 of 2 bright regions were measured: 1 touch the edge"), "{said}");
        assert!(said.contains("1 have widths off") && said.contains(" of the frame, "), "{said}");
        // A single lost region is counted; overlap is reported only if most regions are lost.
        let one = Tally { measured: 9, at_edge: 0, off_curve: 0, small: 1, ..tally };
        let said = one.warning(1.0).unwrap();
        assert!(said.contains("1 are smaller") && !said.contains("N_S"), "{said}");
        assert_eq!(Tally { small: 0, ..one }.warning(1.0), None);
        assert!(Tally::default().warning(1.0).unwrap().contains("nothing exceeds 5 standard deviations"));
        // If particles occupy only a third of the frame, images are three times as dense.
        let dense = Tally { measured: 1, at_edge: 0, off_curve: 9, small: 0, bright: 1000, pixels: 10_000 };
        let said = dense.warning(1.0 / 3.0).unwrap();
        let n_s = -(1.0f64 - 0.3).ln();
        assert!(said.contains(&format!("N_S = {n_s:.2} of the part")), "{said}");
        assert!(said.contains(&format!("about {:.0} %", 100.0 * (-4.0 * n_s).exp())), "{said}");
    }

    #[test]
    fn a_stack_without_a_particle_is_an_error() {
        let dark = GrayImage::from_fn((40, 40), |x, y| ((x * 7 + y * 13) % 5) as f32);
        let steps: Vec<CalibrationImage> = (0..9)
            .map(|k| CalibrationImage { z_um: f64::from(k), at: [20.0, 20.0], image: dark.clone() })
            .collect();
        let why = CalibrationCurve::from_sizes(std::slice::from_ref(&steps)).unwrap_err().to_string();
        assert!(why.contains("expected at least 5"), "{why}");
        // Beside one that is seen, it is left out.
        let seen =
            steps.iter().map(|step| CalibrationImage { image: image(40, [20.0; 2], step.z_um), ..*step });
        let (curve, left_out) = CalibrationCurve::from_sizes(&[steps.clone(), seen.collect()]).unwrap();
        assert!(!curve.points.is_empty());
        assert!(left_out[0].contains("diameter 1 (the smallest first) are not searched for"), "{left_out:?}");
    }
}
