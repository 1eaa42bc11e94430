//! The Cramér-Rao bound: the lowest standard deviation of any unbiased estimate of the position of an
//! isolated particle.
//!
//! F_ij = sum over pixels of (d mu / d theta_i) (d mu / d theta_j) / v, theta = (x, y, z, brightness),
//! sigma_i >= sqrt((F^-1)_ii); v = background_noise^2 + gain (mu - background) + 1/12, because ray counts are
//! Poisson distributed and images are rounded to integers. A detector model adds its shot noise; `mode:
//! expected` and Gaussian particle images have no ray noise. The bound depends on the scenario's optics and
//! noise and on a particle of median diameter and brightness; no image is read. With `mode: rays` it is only
//! a reference: rays are stratified and their total is nearly fixed, so that counts of neighboring pixels are
//! correlated, and an estimator that fits the model can have smaller errors. mu and its derivatives come from
//! `microsig_core::render::expected`, with `mode: waves` from `microsig_core::render::waves`; for Gaussian
//! particle images they are integrals over pixels, independent of z. Overlap, image edges and the dependence
//! of v on theta are neglected.

use microsig_core::linear::Symmetric;
use microsig_core::render::{
    Context, ExpectedPatch, Gradient, Renderer, RendererSpec, ShapeGradient, Window,
};
use microsig_core::sensor::{PixelMaps, Response};
use microsig_core::{Particle, Settings, Spheroid};
use rayon::prelude::*;
use serde::Serialize;

use super::curves::{Bin, Curve};
use super::detection::Detection;
use super::statistics::median;
use scenario::{Scenario, spec};
use storage::dataset::manifest::ScoringGates;
use storage::error::Result;

/// Error of the expected images relative to their peaks; the bound is needed to a few percent.
const TOLERANCE: f64 = 3e-3;
/// Edge of a square sensor that contains every usable particle image, px; wider images are too faint to
/// detect.
const SIZE: u32 = 801;

scores! {
    /// Cramer-Rao bound of an isolated particle over depth (`--crlb`); with `mode: rays` only a reference,
    /// because ray counts vary less than the independent Poisson counts that the bound assumes.
    pub struct Crlb {
        /// Particle diameter for the bound: the median of the dataset.
        not_negative d_um: f64,
        /// One entry per bin of the curve over z.
        pub bins: Vec<BoundBin>,
        /// Cramer-Rao bound of the axes of spheroids: the root mean square angle of an isolated one, median over a sample of
        /// the true ones.
        #[schemars(range(min = 0.0), extend("x-unit" = "deg"))]
        pub crlb_axis_deg: Option<f64>,
        /// crlb_axis_deg / (1.2011 orientation.median_deg): for normal errors, the root mean square of an angle is 1.2011 times
        /// its median.
        not_negative efficiency_axis: Option<f64>,
    }
}

/// Root mean square over the median of an angle with independent normal errors of the same size along two directions:
/// sqrt(2 / (2 ln 2)).
const RMS_OF_MEDIAN: f64 = 1.2011;

/// Number of spheroids whose bounds are computed.
const SAMPLE: usize = 16;

scores! {
    /// The bound at the center of a depth bin, and the efficiency of the result there.
    pub struct BoundBin {
        /// Depth of the center of the bin.
        pub z_um: f64,
        /// Cramer-Rao bound of the standard deviation of x.
        not_negative crlb_x_px: Option<f64>,
        /// Cramer-Rao bound of the standard deviation of y.
        not_negative crlb_y_px: Option<f64>,
        /// Cramer-Rao bound of the standard deviation of z.
        not_negative crlb_z_um: Option<f64>,
        /// Cramer-Rao bound of the standard deviation of the diameter, if the result has diameters. Position and brightness are
        /// estimated with it.
        not_negative crlb_d_um: Option<f64>,
        /// crlb_x_px / RMS error of x.
        not_negative efficiency_x: Option<f64>,
        /// crlb_y_px / RMS error of y.
        not_negative efficiency_y: Option<f64>,
        /// crlb_z_um / RMS error of z.
        not_negative efficiency_z: Option<f64>,
    }
}

/// The bound of a scenario in every bin of the curve over depth; for Gaussian particle images without such a
/// curve, in a single bin. `sizes`: diameter (um) and brightness of each particle. With `has_diameters` also the bound of
/// the diameter. The inner `Err` says why
/// there is no bound.
pub fn from_scenario(
    scenario: &Scenario,
    sizes: &[[f64; 2]],
    detection: Option<&Detection>,
    curves: &[Curve],
    has_diameters: bool,
) -> Result<std::result::Result<Crlb, &'static str>> {
    let Some(detection) = detection else { return Ok(Err("it is defined for particles only")) };
    if scenario.settings.gain == 0.0 {
        return Ok(Err("images of gain 0 are empty"));
    }
    let known = |v: &f64| v.is_finite() && *v > 0.0;
    let [Some(d_um), Some(c_int)] = [0, 1].map(|k| median(sizes.iter().map(|size| size[k])).filter(known))
    else {
        return Ok(Err("there are no particles with a diameter"));
    };
    let noise = Noise::of(scenario, c_int)?;
    let curve = curves.iter().find(|c| c.against == "z_um");
    let spot = scenario.spec.optics.gaussian;
    let all = match (curve, spot) {
        (Some(curve), _) => curve.bins.clone(),
        (None, Some(_)) => vec![whole(detection, scenario.depth_range_um)],
        (None, None) => return Ok(Err("truth and result must both have a depth")),
    };
    let depths_um: Vec<f64> = all.iter().map(|bin| f64::midpoint(bin.from, bin.to)).collect();
    let images = Images::of(scenario, d_um, &depths_um)?;
    let bounds = (0..all.len()).into_par_iter().map(|k| images.bound(k, &noise));
    let bounds: Vec<[Option<f64>; 3]> = bounds.collect();
    let mut bins: Vec<BoundBin> = all.iter().zip(bounds).map(|(bin, bound)| bin_of(bin, bound)).collect();
    if has_diameters && let Images::Drawn { images, renderer, depth_factor } = &images {
        let [smaller, larger] = [1.0 - DIAMETER_STEP, 1.0 + DIAMETER_STEP].map(|factor| factor * d_um);
        let bound = |(bin, base): (&mut BoundBin, &Option<Gradient>)| {
            let z_um = bin.z_um / depth_factor;
            let [low, high] = [image(renderer, smaller, z_um)?, image(renderer, larger, z_um)?];
            let images = base.as_ref().zip(low).zip(high);
            bin.crlb_d_um = images.and_then(|((base, low), high)| {
                diameter_bound(base, [&low, &high], larger - smaller, &noise)
            });
            Ok(())
        };
        bins.par_iter_mut().zip(images).map(bound).collect::<Result<()>>()?;
    }
    Ok(Ok(Crlb { d_um, bins, ..Crlb::default() }))
}

/// Images of a particle at several depths.
enum Images {
    /// Gaussian particle images, of a diameter (um).
    Spots(spec::Gaussian, f64),
    /// The other ones, with a depth in um per unit of their derivative.
    Drawn { images: Vec<Option<Gradient>>, renderer: Box<Renderer>, depth_factor: f64 },
}

impl Images {
    fn of(scenario: &Scenario, d_um: f64, depths_um: &[f64]) -> Result<Self> {
        if let Some(spot) = scenario.spec.optics.gaussian {
            return Ok(Images::Spots(spot, d_um));
        }
        let depth_factor = scenario.depth_factor();
        let renderer = renderer_of(scenario.spec.renderer(), &scenario.settings, &scenario.context)?;
        let images = depths_um.par_iter().map(|z_um| image(&renderer, d_um, z_um / depth_factor));
        let images = images.collect::<Result<_>>()?;
        Ok(Images::Drawn { images, renderer: Box::new(renderer), depth_factor })
    }

    /// The bound x px, y px, z um of the `k`-th image.
    fn bound(&self, k: usize, noise: &[Noise]) -> [Option<f64>; 3] {
        match self {
            Images::Spots(spot, d_um) => {
                spot_bound(*spot, noise, *d_um).map_or([None; 3], |[x, y]| [Some(x), Some(y), None])
            }
            Images::Drawn { images, depth_factor, .. } => {
                let bound = images[k].as_ref().and_then(|image| bound(image, noise));
                bound.map_or([None; 3], |[x, y, z]| [Some(x), Some(y), Some(z * depth_factor)])
            }
        }
    }
}

/// What the image of an isolated particle can tell at each of several depths.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct DepthBounds {
    /// Diameter of the particle, um.
    pub d_um: f64,
    /// Least standard deviations at each depth.
    pub depths: Vec<DepthBound>,
    /// The smallest of them.
    pub best: PositionBound,
    /// Their mean over the depths at which they exist.
    pub mean: PositionBound,
    /// Ranges of depth (um) in which z is determined: images at all depths that are farther away than the gate of `evaluate`
    /// in depth, a tenth of the depth range, can be told apart from the one there with 95 % probability. Where they
    /// cannot, a particle may be found on the wrong side of focus.
    pub determined_um: Vec<[f64; 2]>,
    /// The fraction of the depths at which z is determined.
    pub determined_share: f64,
}

/// Least standard deviations of a position; `None` if the image does not determine it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct PositionBound {
    /// x, px.
    pub crlb_x_px: Option<f64>,
    /// y, px.
    pub crlb_y_px: Option<f64>,
    /// z, um.
    pub crlb_z_um: Option<f64>,
}

/// The bound at a depth.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct DepthBound {
    /// Depth, um.
    pub z_um: f64,
    /// Least standard deviations.
    #[serde(flatten)]
    pub bound: PositionBound,
    /// Whether z is determined.
    pub is_determined: bool,
}

/// Distance, in standard deviations, at which two images are distinguished with 95 % probability: twice the 95 % quantile of the
/// normal distribution.
const TOLD_APART: f64 = 3.29;

/// Fraction of the brightness below which a particle at another depth is not taken for the one here.
const DARK: f64 = 0.01;

/// Number of pixels of all images that are compared with each other.
const COMPARED_PX: usize = 10_000_000;

impl DepthBounds {
    /// The bounds of a particle of diameter `d_um` (um), with the brightness and illumination typical of the scenario, at
    /// depths in ascending order (um).
    pub fn of(scenario: &Scenario, d_um: f64, depths_um: &[f64]) -> Result<Self> {
        let mut noise: Vec<(f64, Vec<Noise>)> = Vec::new();
        for z_um in depths_um {
            let c_int = scenario.brightness(d_um, *z_um);
            noise.push(match noise.last() {
                Some(last) if last.0 == c_int => last.clone(),
                _ => (c_int, Noise::of(scenario, c_int)?),
            });
        }
        let images = Images::of(scenario, d_um, depths_um)?;
        let is_determined = images.determined(depths_um, &noise);
        let depths = depths_um.par_iter().enumerate().map(|(k, z_um)| {
            let [crlb_x_px, crlb_y_px, crlb_z_um] = images.bound(k, &noise[k].1);
            let bound = PositionBound { crlb_x_px, crlb_y_px, crlb_z_um };
            DepthBound { z_um: *z_um, bound, is_determined: is_determined[k] }
        });
        let depths: Vec<DepthBound> = depths.collect();
        let over = |of: fn(Vec<f64>) -> Option<f64>| {
            let values = |value: fn(&PositionBound) -> Option<f64>| {
                of(depths.iter().filter_map(|depth| value(&depth.bound)).collect())
            };
            PositionBound {
                crlb_x_px: values(|bound| bound.crlb_x_px),
                crlb_y_px: values(|bound| bound.crlb_y_px),
                crlb_z_um: values(|bound| bound.crlb_z_um),
            }
        };
        let runs =
            depths.chunk_by(|a, b| a.is_determined == b.is_determined).filter(|run| run[0].is_determined);
        Ok(DepthBounds {
            d_um,
            best: over(|all| all.into_iter().reduce(f64::min)),
            mean: over(|all| {
                Some(all.iter().sum::<f64>() / all.len() as f64).filter(|mean| mean.is_finite())
            }),
            determined_um: runs.map(|run| [run[0].z_um, run[run.len() - 1].z_um]).collect(),
            determined_share: is_determined.iter().filter(|is| **is).count() as f64
                / depths.len().max(1) as f64,
            depths,
        })
    }
}

impl Images {
    /// Whether z is determined at each depth, see [`DepthBounds::determined_um`].
    fn determined(&self, depths_um: &[f64], noise: &[(f64, Vec<Noise>)]) -> Vec<bool> {
        let (Images::Drawn { images, depth_factor, .. }, [low, .., high]) = (self, depths_um) else {
            return vec![false; depths_um.len()];
        };
        if low >= high {
            return vec![false; depths_um.len()];
        }
        let gate_um = ScoringGates::over(high - low).z_um;
        let all_px: usize = images.iter().flatten().map(|image| image.pixels.len()).sum();
        // Of very large images, some.
        let compared: Vec<usize> = (0..images.len()).step_by(all_px.div_ceil(COMPARED_PX).max(1)).collect();
        let slack_um = 0.5 * (high - low) / compared.len() as f64 / depth_factor;
        let is_alike = |i: usize, j: usize| {
            let Some((a, b)) = images[i].as_ref().zip(images[j].as_ref()) else { return false };
            let (wide, other) = if a.pixels.len() >= b.pixels.len() { (a, b) } else { (b, a) };
            noise[j].0 > DARK * noise[i].0 && apart(wide, other, &noise[i].1, slack_um) < TOLD_APART
        };
        let is_far = |i: usize, j: usize| (depths_um[i] - depths_um[j]).abs() > gate_um;
        (0..images.len())
            .into_par_iter()
            .map(|i| {
                noise[i].0 > 0.0
                    && images[i].is_some()
                    && !compared.iter().any(|j| is_far(i, *j) && is_alike(i, *j))
            })
            .collect()
    }
}

/// By how many standard deviations two images differ, whatever the brightness and (to first order) the position of the
/// first one, and its depth within about `slack_um`. The window of the first one contains both.
fn apart(base: &Gradient, other: &Gradient, noise: &[Noise], slack_um: f64) -> f64 {
    let mut information = [[0.0; 5]; 5];
    information[3][3] = 1.0 / (slack_um * slack_um);
    for (k, [light, x, y, z]) in base.pixels.iter().enumerate() {
        let change = light_at(other, base, k) - light;
        add(&mut information, &[*light, *x, *y, *z, change], weight(noise, *light));
    }
    bounds(&information).map_or(0.0, |bound| 1.0 / bound[4])
}

/// Light of an image at the `k`-th pixel of another one.
fn light_at(image: &Gradient, base: &Gradient, k: usize) -> f64 {
    let (own, window) = (base.window, image.window);
    let at = [(k % own.width) as i64 + own.x0 - window.x0, (k / own.width) as i64 + own.y0 - window.y0];
    let is_in = (0..window.width as i64).contains(&at[0]) && (0..window.height as i64).contains(&at[1]);
    if is_in { image.pixels[at[1] as usize * window.width + at[0] as usize][0] } else { 0.0 }
}

/// Relative change of the diameter for the derivative of an image.
const DIAMETER_STEP: f64 = 0.02;

/// The bound of the diameter (um), from an image and the images of a smaller and a larger particle, which differ by `step_um`
/// in diameter.
fn diameter_bound(
    base: &Gradient,
    [low, high]: [&Gradient; 2],
    step_um: f64,
    noise: &[Noise],
) -> Option<f64> {
    let mut information = [[0.0; 5]; 5];
    for (k, [light, x, y, z]) in base.pixels.iter().enumerate() {
        let slope = (light_at(high, base, k) - light_at(low, base, k)) / step_um;
        add(&mut information, &[*light, *x, *y, *z, slope], weight(noise, *light));
    }
    bounds(&information).map(|bound| bound[4])
}

impl Crlb {
    /// With the bound of axes: of true spheroids and their depths (um), of which a sample is taken, and the median angle of
    /// those that are found.
    pub fn with_axes(
        self,
        scenario: &Scenario,
        spheroids: &[(f64, Spheroid)],
        median_deg: Option<f64>,
    ) -> Result<Self> {
        if spheroids.is_empty() {
            return Ok(self);
        }
        let bounds = SpheroidBounds::new(scenario, self.d_um)?;
        let sample: Vec<_> = spheroids.iter().step_by(spheroids.len().div_ceil(SAMPLE).max(1)).collect();
        let of = |(z_um, spheroid): &&(f64, Spheroid)| bounds.at(*z_um, *spheroid);
        let found = sample.par_iter().map(of).collect::<Result<Vec<_>>>()?;
        let crlb_axis_deg = median(found.into_iter().flatten().map(|bound| bound.axis_deg));
        let found = median_deg.filter(|median| *median > 0.0);
        let efficiency_axis =
            crlb_axis_deg.zip(found).map(|(bound, median)| bound / (RMS_OF_MEDIAN * median));
        Ok(Crlb { crlb_axis_deg, efficiency_axis, ..self })
    }
}

/// Bounds of isolated spheroids in the images of a scenario.
#[derive(Debug)]
pub struct SpheroidBounds {
    renderer: Renderer,
    noise: Vec<Noise>,
    depth_factor: f64,
    d_um: f64,
}

/// What an image can tell about a spheroid of known size and shape: least standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpheroidBound {
    /// x, px.
    pub x_px: f64,
    /// y, px.
    pub y_px: f64,
    /// z, um.
    pub z_um: f64,
    /// Root mean square angle of the axis, degrees.
    pub axis_deg: f64,
    /// Relative standard deviation of the aspect ratio, if it is estimated, too.
    pub aspect: f64,
    /// Highest peak of the image over the noise of the background.
    pub snr: f64,
    /// By how many standard deviations the image differs from the one with the axis mirrored toward the lens, with the
    /// brightness and (to first order) position and depth that make both most alike.
    pub mirror_sd: f64,
}

impl SpheroidBounds {
    /// For spheroids of this equatorial diameter (um).
    pub fn new(scenario: &Scenario, d_um: f64) -> Result<Self> {
        let spec = scenario.spec.renderer().without_ray_noise(TOLERANCE);
        let renderer = spec.build(&large(&scenario.settings), &scenario.context)?;
        let depth_factor = scenario.depth_factor();
        Ok(SpheroidBounds { renderer, noise: Noise::of(scenario, 1.0)?, depth_factor, d_um })
    }

    /// The bound at a depth (um); `None` if the image does not determine the spheroid.
    pub fn at(&self, z_um: f64, spheroid: Spheroid) -> Result<Option<SpheroidBound>> {
        self.above(FAINT, z_um, spheroid)
    }

    /// The bound from pixels above this fraction of the peak.
    fn above(&self, faint: f64, z_um: f64, spheroid: Spheroid) -> Result<Option<SpheroidBound>> {
        let middle = f64::from(SIZE / 2 + 1);
        let of = |spheroid| {
            let sphere = Particle::sphere(middle, middle, z_um / self.depth_factor, self.d_um);
            Particle { spheroid: Some(spheroid), ..sphere }
        };
        let particle = of(spheroid);
        self.renderer.check(&particle)?;
        let window = self.renderer.mean_patch(&particle).map(|patch| bright(&patch, faint));
        let Some(image) = window.and_then(|window| self.renderer.shape_gradient(&particle, Some(window)))
        else {
            return Ok(None);
        };
        let (mut known, mut fitted) = ([[0.0; 6]; 6], [[0.0; 7]; 7]);
        let mut peak = 0.0f64;
        for pixel in &image.pixels {
            let weight = weight(&self.noise, pixel[0]);
            peak = peak.max(pixel[0]);
            let [light, x, y, z, first, second, _] = *pixel;
            add(&mut known, &[light, x, y, z, first, second], weight);
            add(&mut fitted, pixel, weight);
        }
        let Some(bound) = bounds(&known) else { return Ok(None) };
        let [x, y, z] = spheroid.axis();
        let mirrored = of(Spheroid::from_axis(spheroid.e_p, [x, y, -z]));
        Ok(Some(SpheroidBound {
            x_px: bound[1],
            y_px: bound[2],
            z_um: bound[3] * self.depth_factor,
            axis_deg: bound[4].hypot(bound[5]).to_degrees(),
            aspect: bounds(&fitted).map_or(f64::INFINITY, |bound| bound[6]),
            snr: peak * weight(&self.noise, 0.0).sqrt(),
            mirror_sd: self.difference(&image, &mirrored),
        }))
    }

    /// Standard deviations between the images of two particles, without what changes of the first one's
    /// brightness, position and depth explain.
    fn difference(&self, image: &ShapeGradient, other: &Particle) -> f64 {
        let Some(patch) = self.renderer.mean_patch(other) else { return f64::INFINITY };
        let other = patch.on(image.window);
        // The last parameter is the share of the other image: its bound is that share's standard deviation.
        let mut information = [[0.0; 5]; 5];
        for (pixel, other) in image.pixels.iter().zip(other) {
            let [light, x, y, z, ..] = *pixel;
            add(&mut information, &[light, x, y, z, other - light], weight(&self.noise, light));
        }
        bounds(&information).map_or(0.0, |bound| 1.0 / bound[4])
    }
}

/// Light below this fraction of the peak tells nothing about a spheroid. By wave optics, it would be most of the window.
const FAINT: f64 = 1e-3;

/// The smallest window that contains all pixels above a fraction of the peak.
fn bright(patch: &ExpectedPatch, faint: f64) -> Window {
    let faint = faint * patch.counts.iter().copied().fold(0.0, f64::max);
    let width = patch.window.width;
    let lit = || (0..patch.counts.len()).filter(|&i| patch.counts[i] > faint);
    let span = |of: fn(usize, usize) -> usize| {
        let (low, high) = lit().map(|i| of(i, width)).fold((usize::MAX, 0), |(a, b), v| (a.min(v), b.max(v)));
        (low.min(high), (high + 1).saturating_sub(low))
    };
    let ((left, width), (top, height)) = (span(|i, width| i % width), span(|i, width| i / width));
    Window { x0: patch.window.x0 + left as i64, y0: patch.window.y0 + top as i64, width, height }
}

/// The bound [x px, y px, z um] of a bin, and the efficiency of the result there.
fn bin_of(bin: &Bin, [x, y, z]: [Option<f64>; 3]) -> BoundBin {
    let efficiency = |bound: Option<f64>, rms: Option<f64>| {
        bound.zip(rms).filter(|(_, rms)| *rms > 0.0).map(|(bound, rms)| bound / rms)
    };
    BoundBin {
        z_um: f64::midpoint(bin.from, bin.to),
        crlb_x_px: x,
        crlb_y_px: y,
        crlb_z_um: z,
        crlb_d_um: None,
        efficiency_x: efficiency(x, bin.rms_x_px),
        efficiency_y: efficiency(y, bin.rms_y_px),
        efficiency_z: efficiency(z, bin.rms_z_um),
    }
}

/// One bin over all depths, for results without depth.
fn whole(detection: &Detection, (from, to): (f64, f64)) -> Bin {
    Bin { from, to, rms_x_px: detection.rmse_x_px, rms_y_px: detection.rmse_y_px, ..Bin::default() }
}

/// Sub-pixel positions along each axis over which the bound is averaged: for small spots it depends on them.
const PLACES: usize = 8;

/// The bound of a pixel-integrated Gaussian particle image: sigma of x and y, px, RMS over sub-pixel
/// positions. Brightness is estimated too; the image does not depend on depth.
fn spot_bound(spot: spec::Gaussian, noise: &[Noise], d_um: f64) -> Option<[f64; 2]> {
    // exp(-8 r^2 / d^2) = exp(-r^2 / (2 w^2))
    let w = spot.diameter_px * spot.reference_um.map_or(1.0, |reference| d_um / reference) / 4.0;
    let half = (6.0 * w).ceil() as i32 + 1;
    let root = std::f64::consts::SQRT_2 * w;
    let density = |x: f64| libm::exp(-x * x / (2.0 * w * w));
    // For each pixel along an axis: the integral over it, and its derivative with respect to the spot's
    // position.
    let axis = |place: f64| -> Vec<[f64; 2]> {
        let pixel = |k: i32| {
            let (a, b) = (f64::from(k) - 0.5 - place, f64::from(k) + 0.5 - place);
            let integral =
                w * (0.5 * std::f64::consts::PI).sqrt() * (libm::erf(b / root) - libm::erf(a / root));
            [integral, density(a) - density(b)]
        };
        (-half..=half).map(pixel).collect()
    };
    let places: Vec<Vec<[f64; 2]>> =
        (0..PLACES).map(|k| axis((k as f64 + 0.5) / PLACES as f64 - 0.5)).collect();
    let mut squares = [0.0; 2];
    for (columns, rows) in places.iter().flat_map(|c| places.iter().map(move |r| (c, r))) {
        let mut information = [[0.0; 3]; 3];
        for ([y, by_y], [x, by_x]) in rows.iter().flat_map(|r| columns.iter().map(move |c| (r, c))) {
            let counts = spot.peak_counts * x * y;
            let slopes = [spot.peak_counts * by_x * y, spot.peak_counts * x * by_y, counts];
            add(&mut information, &slopes, weight(noise, counts));
        }
        let [x, y, _] = bounds(&information)?;
        squares[0] += x * x;
        squares[1] += y * y;
    }
    Some(squares.map(|s| (s / (PLACES * PLACES) as f64).sqrt()))
}

/// Camera response: a pixel with `n` rays has `slope n` counts above the background, with variance
/// `background + of_light n`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Noise {
    slope: f64,
    background: f64,
    of_light: f64,
}

/// Variance of rounding to integers, counts^2.
const ROUNDING: f64 = 1.0 / 12.0;

impl Noise {
    /// A scenario's sensor for particles of brightness `c_int` at the image center: of pixels that represent
    /// its maps, if it has any; other variation between pixels is neglected, and a background image is
    /// replaced by its mean.
    fn of(scenario: &Scenario, c_int: f64) -> Result<Vec<Self>> {
        let Response { slope, background_noise, .. } = scenario.response()?;
        // A brighter particle has more counts per ray, not more rays.
        let slope = slope * c_int;
        // Ray noise, then shot noise. Expected and Gaussian images have no ray noise.
        let rays = if scenario.renderer.has_ray_noise() { slope * slope } else { 0.0 };
        let camera = scenario.detector.as_ref().filter(|detector| detector.shot_noise);
        let shot = camera.map_or(0.0, |detector| slope * detector.gain_counts_per_e);
        let mean = Noise {
            slope,
            background: background_noise * background_noise + ROUNDING,
            of_light: rays + shot,
        };
        let Some(detector) = scenario.detector.as_ref().filter(|of| of.maps != PixelMaps::default()) else {
            return Ok(vec![mean]);
        };
        let PixelMaps { gain_counts_per_e: gains, variance_counts2: variances, .. } = &detector.maps;
        let of_own = scenario.settings.background_noise;
        let (gain, read) = (detector.gain_counts_per_e, detector.read_noise_e);
        // Shot noise of the background, electrons^2.
        let electrons =
            ((background_noise * background_noise - of_own * of_own) / (gain * gain) - read * read).max(0.0);
        let pixel = |k: usize| {
            let own = gains.as_ref().map_or(gain, |map| map[k]);
            let ratio = own / gain;
            let read = variances.as_ref().map_or(own * own * read * read, |map| map[k]);
            Noise {
                slope: slope * ratio,
                background: own * own * electrons + read + of_own * of_own + ROUNDING,
                of_light: (rays + shot) * ratio * ratio,
            }
        };
        let Settings { pixel_dim_x, pixel_dim_y, .. } = scenario.settings;
        let mut all: Vec<Noise> = (0..pixel_dim_x as usize * pixel_dim_y as usize).map(pixel).collect();
        all.sort_unstable_by(|a, b| weight(&[*a], 0.0).total_cmp(&weight(&[*b], 0.0)));
        let n = REPRESENTATIVES.min(all.len());
        Ok((0..n).map(|i| all[(2 * i + 1) * all.len() / (2 * n)]).collect())
    }
}

/// Number of pixels that represent a camera with maps: quantiles of the information in the dark.
const REPRESENTATIVES: usize = 64;

/// Fisher information about the light of a pixel with `light`, averaged over pixels: a particle is equally
/// likely to be on any of them.
fn weight(noise: &[Noise], light: f64) -> f64 {
    let of = |n: &Noise| n.slope * n.slope / (n.background + n.of_light * light.max(0.0));
    noise.iter().map(of).sum::<f64>() / noise.len() as f64
}

/// The renderer of noise-free images with derivatives for the images of a scenario, on a sensor that contains
/// them.
fn renderer_of(spec: RendererSpec, settings: &Settings, context: &Context) -> Result<Renderer> {
    Ok(spec.with_derivatives(TOLERANCE).build(&large(settings), context)?)
}

/// The same settings with a sensor that contains all images.
fn large(settings: &Settings) -> Settings {
    Settings { pixel_dim_x: SIZE, pixel_dim_y: SIZE, ..settings.clone() }
}

/// The noise-free image of a sphere in the middle of a sufficiently large sensor, with its derivatives.
fn image(renderer: &Renderer, d_um: f64, z_um: f64) -> Result<Option<Gradient>> {
    let middle = f64::from(SIZE / 2 + 1);
    let particle = Particle::sphere(middle, middle, z_um, d_um);
    renderer.check(&particle)?;
    Ok(renderer.gradient(&particle, None))
}

fn bound(image: &Gradient, noise: &[Noise]) -> Option<[f64; 3]> {
    let mut information = [[0.0; 4]; 4];
    for [counts, by_x, by_y, by_z] in &image.pixels {
        add(&mut information, &[*by_x, *by_y, *by_z, *counts], weight(noise, *counts));
    }
    bounds(&information).map(|b| [b[0], b[1], b[2]])
}

/// Adds one pixel, whose light has these derivatives, to the Fisher information.
fn add<const N: usize>(information: &mut [[f64; N]; N], slopes: &[f64; N], weight: f64) {
    for (row, a) in information.iter_mut().zip(slopes) {
        row.iter_mut().zip(slopes).for_each(|(f, b)| *f += a * b * weight);
    }
}

/// Square roots of the diagonal of the inverse; `None` if the matrix is not positive definite.
fn bounds<const N: usize>(matrix: &[[f64; N]; N]) -> Option<[f64; N]> {
    let diagonal = Symmetric::of(N, matrix.concat()).inverse_diagonal(1e-12)?;
    let mut bounds = [0.0; N];
    bounds.iter_mut().zip(diagonal).for_each(|(bound, variance)| *bound = variance.sqrt());
    Some(bounds)
}

#[cfg(test)]
mod tests {
    use microsig_core::formats::tiff::{self, PixelScale};
    use microsig_core::sensor::{Counts, Image};

    use super::*;
    use scenario::{parse, resolve};

    /// A spot A exp(-r^2 / (2 w^2)) in white noise s: sigma_x = sqrt(2 / pi) s / A px, for any width w.
    #[test]
    fn a_gaussian_spot_has_the_bound_of_the_closed_form() {
        for width in [1.5f64, 2.0, 4.0] {
            let (amplitude, noise) = (100.0, 10.0);
            let mut information = [[0.0; 3]; 3];
            for i in -30..=30 {
                for j in -30..=30 {
                    let (x, y) = (f64::from(i), f64::from(j));
                    let spot = amplitude * (-(x * x + y * y) / (2.0 * width * width)).exp();
                    let slopes = [spot * x / (width * width), spot * y / (width * width), spot];
                    add(&mut information, &slopes, 1.0 / (noise * noise));
                }
            }
            let [x, y, _] = bounds(&information).unwrap();
            let closed = noise / amplitude * (2.0 / std::f64::consts::PI).sqrt();
            // 2 % is required; the sampling error of a spot with w = 1.5 px is far smaller.
            assert!(
                (x / closed - 1.0).abs() < 0.02 && (y / closed - 1.0).abs() < 0.02,
                "{width}: {x} {closed}"
            );
        }
    }

    /// Pixel integration has no effect on a spot much larger than a pixel, and raises the bound of a small
    /// one.
    #[test]
    fn a_spot_that_pixels_integrate_has_nearly_the_bound_of_the_closed_form() {
        let noise = Noise { slope: 1.0, background: 100.0 + ROUNDING, of_light: 0.0 };
        let of = |diameter_px: f64, reference_um: Option<f64>| {
            let spot = spec::Gaussian { diameter_px, reference_um, peak_counts: 1000.0 };
            spot_bound(spot, &[noise], 2.0).unwrap()
        };
        let closed = noise.background.sqrt() / 1000.0 * (2.0 / std::f64::consts::PI).sqrt();
        let [x, y] = of(12.0, None);
        assert!((x / closed - 1.0).abs() < 0.02 && (y / x - 1.0).abs() < 1e-9, "{x} {closed}");
        assert_eq!(of(8.0, Some(4.0)), of(4.0, None));
        let small = of(2.0, None)[0] / closed;
        assert!(small > 1.02 && small < 2.0, "{small}");
        assert_eq!(spot_bound(spec::Gaussian::default(), &[Noise { slope: 0.0, ..noise }], 2.0), None);
    }

    #[test]
    fn a_camera_adds_the_noise_of_its_electrons() {
        let dataset = tempfile::tempdir().unwrap();
        let uneven = Image {
            width: 4,
            height: 2,
            bits: 16,
            counts: Counts::Whole((0..8).map(|i| 5 + 10 * i).collect()),
        };
        let scale = PixelScale::um_per_px(1.0);
        let file = std::fs::File::create(dataset.path().join("uneven.tif")).unwrap();
        tiff::write(file, &uneven, &scale, "uneven.tif").unwrap();
        let noise = |more: &str, c_int: f64| {
            let text = format!(
                r#"(name: "four", motion: flow(field: poiseuille()), timing: pairs(count: 1),
                    particles: (number: count(1)), optics: (preset: setting1, pixel_dim_x: 4, pixel_dim_y: 2,
                    gain: 4, background_mean: 60, background_noise: 3), {more})"#
            );
            Noise::of(
                &resolve(parse(&text, "s.ron").unwrap(), dataset.path(), &Context::default()).unwrap(),
                c_int,
            )
            .unwrap()
        };
        let one = |more: &str, c_int: f64| {
            let all = noise(more, c_int);
            assert_eq!(all.len(), 1);
            all[0]
        };
        let own = one("", 1.0);
        assert_eq!(own, Noise { slope: 4.0, background: 9.0 + ROUNDING, of_light: 16.0 });
        assert_eq!(one("", 0.5), Noise { slope: 2.0, of_light: 4.0, ..own });
        assert_eq!(one("render: (mode: expected)", 1.0), Noise { of_light: 0.0, ..own });
        // 4 counts per ray, 5 photons per count, quantum efficiency 0.5, 0.2 counts per electron: 10
        // electrons and 2 counts per ray.
        let camera = r#"sensor: (photons_per_count: 5, quantum_efficiency: 0.5, shot_noise: true, read_noise_e: 2,
            gain_counts_per_e: 0.2, vignetting: 0.5, background: Some("uneven.tif"))"#;
        // Background of 60 + 40 counts = 250 electrons, plus a read noise of 2^2 electrons^2, at 0.04
        // counts^2 each; 10 electrons per ray.
        for (c_int, slope, of_light) in [(1.0, 2.0, 4.0 + 0.4), (0.5, 1.0, 1.0 + 0.2)] {
            let camera = one(camera, c_int);
            let expected = Noise { slope, background: 0.04 * 254.0 + 9.0 + ROUNDING, of_light };
            for (a, b) in [
                (camera.slope, expected.slope),
                (camera.background, expected.background),
                (camera.of_light, expected.of_light),
            ] {
                assert!((a - b).abs() < 1e-12, "{camera:?}");
            }
        }
        // Read noise of variance 5, 15, ..., 75 counts^2: the bound follows from the average information, 15 %
        // below the one from the average variance.
        let header = format!("{:<117}\n", "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 4), }");
        let mut npy = [b"\x93NUMPY\x01\x00v\x00".as_slice(), header.as_bytes()].concat();
        npy.extend((0..8).flat_map(|i| (5.0 + 10.0 * f64::from(i)).to_le_bytes()));
        std::fs::write(dataset.path().join("variance.npy"), npy).unwrap();
        let maps = r#"sensor: (photons_per_count: 5, quantum_efficiency: 0.5, gain_counts_per_e: 0.2,
            maps: (variance: "variance.npy")), render: (mode: expected)"#;
        let all = noise(maps, 1.0);
        let of = |variance: f64| 4.0 / (variance + 9.0 + ROUNDING);
        let average = (0..8).map(|i| of(5.0 + 10.0 * f64::from(i))).sum::<f64>() / 8.0;
        assert!((weight(&all, 3.0) / average - 1.0).abs() < 1e-9, "{} {average}", weight(&all, 3.0));
        assert!((average / of(40.0)).sqrt() > 1.1);
    }

    /// By wave optics, nine tenths of the window in which a rod has light have less than a thousandth of the peak.
    #[test]
    fn faint_light_tells_little_about_a_rod() {
        let text = r#"(name: "rod", motion: flow(field: poiseuille()), timing: pairs(count: 1),
            particles: (number: count(1)), optics: (preset: setting1, lens: aplanatic, background_noise: 20),
            render: (mode: waves, wavelength_um: 0.52))"#;
        let scenario =
            resolve(parse(text, "s.ron").unwrap(), std::path::Path::new("."), &Context::default()).unwrap();
        let bounds = SpheroidBounds::new(&scenario, 1.4).unwrap();
        for z_um in [-20.0, -4.0] {
            let rod = Spheroid::from_axis(2.0, [0.7, 0.3, 0.6]);
            let [all, most] = [0.0, FAINT].map(|faint| bounds.above(faint, z_um, rod).unwrap().unwrap());
            let of = |b: SpheroidBound| [b.x_px, b.y_px, b.z_um, b.axis_deg, b.aspect, 1.0 / b.mirror_sd];
            for (most, all) in of(most).into_iter().zip(of(all)) {
                assert!((most / all - 1.0).abs() < 0.02, "{most} {all}");
            }
        }
    }

    #[test]
    fn what_an_image_does_not_determine_has_no_bound() {
        assert_eq!(bounds(&[[1.0, 1.0], [1.0, 1.0]]), None);
        assert_eq!(bounds(&[[0.0]]), None);
    }
}
