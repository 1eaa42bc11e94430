//! APTV: depth from the two widths of astigmatic particle images.
//!
//! A particle image is a connected region brighter than the noise; its widths are the second moments of its light along x
//! and y. Over the calibration stack they draw a curve in the plane of widths, and the depth of a particle is that of the
//! nearest point of the curve (Cierpka et al. 2010, Meas. Sci. Technol. 21, 045401). Overlapping particles are one region
//! with widths that are off the curve, and are dropped. Without a cylindrical lens the curve runs back on itself: depths on
//! both sides of the focus look the same.

use super::Found;
use super::picture::Picture;
use super::recording::Step;
use crate::error::{Error, Result};

/// Smoothing before regions are cut out, px: it holds faint images together.
const SMOOTH_PX: f32 = 1.5;

/// Regions are this many standard deviations of the smoothed noise bright.
const ABOVE_NOISE: f32 = 5.0;

/// Smallest region, px.
const LEAST_AREA: usize = 12;

/// Farthest a particle may be from the curve, as part of its mean width.
const TOLERANCE: f64 = 0.12;

/// Points of the stack on each side that smooth one point of the curve.
const NEIGHBOURS: usize = 2;

/// Points of the smooth curve for each step of the stack.
const DENSITY: usize = 20;

/// A bright region.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Blob {
    /// Centre of its light, from the middle of the first pixel, px.
    at: [f64; 2],
    /// Standard deviation of its light along x and y, px.
    widths: [f64; 2],
}

/// Widths over depth.
#[derive(Debug)]
pub(super) struct Curve {
    /// Depth, um, and widths, px, close together.
    points: Vec<(f64, [f64; 2])>,
    /// Where the centre of light lies beside the particle's place, px, for each point.
    offsets: Vec<[f64; 2]>,
    ambiguous: bool,
}

impl Curve {
    /// The curve of a calibration stack.
    ///
    /// # Errors
    /// Fewer than five images of it show a particle.
    pub(super) fn new(steps: &[Step]) -> Result<Self> {
        let mut seen: Vec<(f64, [f64; 4])> = Vec::new();
        for step in steps {
            let near = |b: &Blob| (b.at[0] - step.at[0]).powi(2) + (b.at[1] - step.at[1]).powi(2);
            let blob = blobs(&step.picture).into_iter().min_by(|a, b| near(a).total_cmp(&near(b)));
            if let Some(b) = blob.filter(|b| near(b) < 25.0) {
                let offset = [b.at[0] - step.at[0], b.at[1] - step.at[1]];
                seen.push((step.z_um, [b.widths[0], b.widths[1], offset[0], offset[1]]));
            }
        }
        if seen.len() < 5 {
            let found = seen.len();
            return Err(Error::input(format!(
                "calibration: the particle stands out of the noise in {found} of {} images; expected at least 5",
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
        Ok(Curve {
            points: dense.iter().map(|(z, w)| (*z, [w[0], w[1]])).collect(),
            offsets: dense.iter().map(|(_, w)| [w[2], w[3]]).collect(),
            ambiguous: 2 * roundish > smooth.len(),
        })
    }

    /// What should be known about depths from this curve.
    pub(super) fn warning(&self) -> Option<String> {
        self.ambiguous.then(|| {
            "the calibration's images are round at most depths: without astigmatism widths do not tell which side of the \
             focus a particle is on"
                .to_owned()
        })
    }

    /// The particles of an image.
    pub(super) fn find(&self, picture: &Picture) -> Vec<Found> {
        blobs(picture).iter().filter_map(|blob| self.place(blob)).collect()
    }

    fn place(&self, blob: &Blob) -> Option<Found> {
        let distance = |(_, w): &(f64, [f64; 2])| (w[0] - blob.widths[0]).hypot(w[1] - blob.widths[1]);
        let (nearest, off) =
            self.points.iter().map(distance).enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let [ox, oy] = self.offsets[nearest];
        (off <= TOLERANCE * (blob.widths[0] + blob.widths[1])).then(|| Found {
            x_px: blob.at[0] - ox + 1.0,
            y_px: blob.at[1] - oy + 1.0,
            z_um: Some(self.points[nearest].0),
        })
    }
}

/// The parabola of least squares through a point and its neighbours, at the point.
fn smoothed(points: &[(f64, [f64; 4])], i: usize) -> (f64, [f64; 4]) {
    let near = &points[i.saturating_sub(NEIGHBOURS)..(i + NEIGHBOURS + 1).min(points.len())];
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
    // At least three of the points are there, at depths of their own: the matrix is regular.
    let inverse = normal.inverse();
    (z0, right.map(|r| (inverse * r).x))
}

/// The bright regions of an image that do not touch its edge.
fn blobs(picture: &Picture) -> Vec<Blob> {
    let (w, h) = (picture.width, picture.height);
    let smooth = picture.smoothed(SMOOTH_PX);
    let (level, noise) = smooth.background();
    let threshold = level + (ABOVE_NOISE * noise).max(1e-3);
    let mut open: Vec<bool> = smooth.counts.iter().map(|c| *c > threshold).collect();
    let mut found = Vec::new();
    let mut region = Vec::new();
    for start in 0..w * h {
        if !open[start] {
            continue;
        }
        region.clear();
        region.push(start);
        open[start] = false;
        let mut next = 0;
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
        let on_edge = |i: &usize| [0, w - 1].contains(&(i % w)) || [0, h - 1].contains(&(i / w));
        if region.len() >= LEAST_AREA && !region.iter().any(on_edge) {
            found.push(moments(&smooth, level, &region));
        }
    }
    found
}

fn moments(picture: &Picture, level: f32, region: &[usize]) -> Blob {
    let w = picture.width;
    let mut sums = [0.0; 5];
    for &i in region {
        let light = f64::from(picture.counts[i] - level);
        let (x, y) = ((i % w) as f64, (i / w) as f64);
        for (sum, term) in sums.iter_mut().zip([1.0, x, y, x * x, y * y]) {
            *sum += light * term;
        }
    }
    let [total, x, y, xx, yy] = sums;
    let at = [x / total, y / total];
    let width = |square: f64, mean: f64| (square / total - mean * mean).max(0.0).sqrt();
    Blob { at, widths: [width(xx, at[0]), width(yy, at[1])] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Gaussian image whose widths cross over depth, as behind a cylindrical lens.
    fn image(size: usize, at: [f64; 2], z_um: f64) -> Picture {
        let widths = [3.0 + 0.05 * z_um, 3.0 - 0.05 * z_um].map(|s| s as f32);
        Picture::from_fn((size, size), |x, y| {
            let [dx, dy] = [(x as f32 - at[0] as f32) / widths[0], (y as f32 - at[1] as f32) / widths[1]];
            let noise = ((x * 7 + y * 13) % 5) as f32;
            100.0 + noise + 3e4 / (widths[0] * widths[1]) * (-0.5 * (dx * dx + dy * dy)).exp()
        })
    }

    #[test]
    fn depth_comes_back_from_the_widths() {
        let steps: Vec<Step> = (-10..=10)
            .map(|k| {
                let z_um = 2.0 * f64::from(k);
                Step { z_um, at: [30.0, 30.0], picture: image(61, [30.0, 30.0], z_um) }
            })
            .collect();
        let curve = Curve::new(&steps).unwrap();
        assert!(curve.warning().is_none());
        for z in [-17.3, -6.1, 0.4, 11.9] {
            let found = curve.find(&image(80, [41.25, 38.6], z));
            assert_eq!(found.len(), 1);
            assert!((found[0].z_um.unwrap() - z).abs() < 0.5, "{found:?} for {z}");
            assert!((found[0].x_px - 42.25).abs() < 0.1 && (found[0].y_px - 39.6).abs() < 0.1, "{found:?}");
        }
    }

    #[test]
    fn a_stack_without_a_particle_is_an_error() {
        let picture = Picture::from_fn((40, 40), |x, y| ((x * 7 + y * 13) % 5) as f32);
        let steps: Vec<Step> =
            (0..9).map(|k| Step { z_um: f64::from(k), at: [20.0, 20.0], picture: picture.clone() }).collect();
        assert!(Curve::new(&steps).unwrap_err().to_string().contains("expected at least 5"));
    }
}
