//! Noise-free images of one particle as a function of depth.
//!
//! The particle is a sphere centered on a pixel.

use crate::render::Renderer;
use crate::{Error, Particle, Settings};
use rayon::prelude::*;

/// Number of equally spaced depths, as required by the definition of A_pi.
const DEPTHS: usize = 51;

/// A pixel belongs to a particle image if its light exceeds this fraction of the peak.
pub(super) const AREA_SHARE: f64 = 0.1;

/// Images are cropped where they remain below this fraction of their peak.
const CUT_SHARE: f64 = 0.005;

/// Best focus is resolved where the peaks on both sides exceed this fraction of the highest: their maximum is
/// then at most 0.5 % higher.
const RESOLVED: f64 = 0.98;

/// Maximum number of times that the spacing of depths around best focus is halved.
const HALVINGS: usize = 8;

/// Maximum half width of an image, px; light farther away is far below a tenth of the peak.
const LONGEST_HALF_PX: usize = 400;

/// Noise-free images of one particle, centered on a pixel, at equally spaced depths over a range.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthScan {
    /// Physical depths, um.
    pub depths_um: Vec<f64>,
    /// The image at each depth.
    pub images: Vec<ScanImage>,
    /// Depth (um) and image of the highest peak, also between these depths; `None` if all peaks are equal
    /// (all depths in focus).
    pub focus: Option<(f64, ScanImage)>,
}

/// A noise-free image of a particle with brightness factor 1.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanImage {
    /// Maximum light of a pixel, in the unit of [`crate::sensor::Light`].
    pub peak: f64,
    /// Sum of the light of all rendered pixels.
    pub total: f64,
    /// Sum of the light of the pixels on the sensor when the particle is at its center.
    pub on_sensor: f64,
    /// Area above a tenth of the peak, px^2.
    pub area_px: f64,
    /// Sum over pixels of the squared slope, light^2/px^2: the curvature of the autocorrelation's peak.
    pub curvature: f64,
    /// Mean squares of the distances of light from the center along x and y, px^2.
    pub squares_px: [f64; 2],
    /// Number of pixels on each side of the central one.
    pub half_px: usize,
    /// Light, row by row, `2 half_px + 1` rows and columns.
    pub light: Vec<f64>,
}

impl DepthScan {
    /// Scans a sphere of diameter `d_um` through a range of physical depths (um); `draw` builds the renderer
    /// for a sensor.
    pub fn measure(
        draw: impl Fn(&Settings) -> Result<Renderer, Error>,
        settings: &Settings,
        d_um: f64,
        range_um: (f64, f64),
        depth_factor: f64,
    ) -> Result<Self, Error> {
        let last = (DEPTHS - 1) as f64;
        let depths_um: Vec<f64> =
            (0..DEPTHS).map(|k| range_um.0 + (range_um.1 - range_um.0) * k as f64 / last).collect();
        let whole = draw(settings)?;
        let reach = depths_um
            .iter()
            .map(|z| whole.image_extent(&Particle::sphere(1.0, 1.0, z / depth_factor, d_um)))
            .fold(0.0f64, |most, (x, y)| most.max(x).max(y));
        let half_px = (reach.ceil() as usize).min(LONGEST_HALF_PX);
        let side = 2 * half_px as u32 + 1;
        let sensor = [settings.pixel_dim_x, settings.pixel_dim_y];
        let settings = Settings { pixel_dim_x: side, pixel_dim_y: side, ..settings.clone() };
        let renderer = draw(&settings)?;
        let middle = (half_px + 1) as f64;
        let at = |z: &f64| Particle::sphere(middle, middle, z / depth_factor, d_um);
        renderer.prepare(&[&depths_um.iter().map(at).collect::<Vec<_>>()]);
        let image = |z: &f64| ScanImage::new(half_px, renderer.mean_light(&at(z)).values, sensor);
        let images: Vec<ScanImage> = depths_um.par_iter().map(image).collect();
        let focus = sharpest(depths_um.iter().copied().zip(images.iter().map(|spot| spot.peak)), image);
        Ok(DepthScan { depths_um, images, focus })
    }

    /// A_pi: the area of a particle image averaged over depth, px^2.
    pub fn area_px(&self) -> f64 {
        self.images.iter().map(|spot| spot.area_px).sum::<f64>() / self.images.len() as f64
    }

    /// Depth of the image with the highest peak, um; `None` if all peaks are equal (all depths in focus).
    pub fn focus_um(&self) -> Option<f64> {
        self.focus.as_ref().map(|(z_um, _)| *z_um)
    }

    /// Depths at which images are narrowest along x and along y, um: the two focal planes of a cylindrical
    /// lens. Widths are root mean squares of all light, whose squares are parabolas over depth in ray optics.
    pub fn focal_planes_um(&self) -> [f64; 2] {
        self.least_um(|image| image.squares_px)
    }

    /// The same for the part of an image above a tenth of its peak, without a faint halo.
    pub fn least_sizes_um(&self) -> [f64; 2] {
        self.least_um(|image| image.size_px().map(|px| px * px))
    }

    /// The depths of the minima along x and along y, um.
    fn least_um(&self, of: impl Fn(&ScanImage) -> [f64; 2]) -> [f64; 2] {
        let values: Vec<[f64; 2]> = self.images.iter().map(of).collect();
        [0, 1].map(|axis| {
            let value = |i: usize| values[i][axis];
            let last = values.len() - 1;
            let least = (0..=last).min_by(|a, b| value(*a).total_cmp(&value(*b))).unwrap_or_default();
            let shift = match (1..last).contains(&least) {
                true => vertex([least - 1, least, least + 1].map(|i| -value(i))).0,
                false => 0.0,
            };
            self.depths_um[least] + shift * (self.depths_um[1] - self.depths_um[0])
        })
    }

    /// The image nearest to a physical depth (um), and the peak there, interpolated linearly and constant
    /// beyond the ends.
    pub fn at(&self, z_um: f64) -> (&ScanImage, f64) {
        let last = self.images.len() - 1;
        let (first, end) = (self.depths_um[0], self.depths_um[last]);
        let place = ((z_um - first) / (end - first) * last as f64).clamp(0.0, last as f64);
        let below = (place as usize).min(last - 1);
        let share = place - below as f64;
        let peak = (1.0 - share) * self.images[below].peak + share * self.images[below + 1].peak;
        (&self.images[below + usize::from(share >= 0.5)], peak)
    }
}

/// Position of the maximum of the parabola through values at -1, 0 and 1, and its value; at most a step from the
/// middle, and there if it has none.
pub fn vertex([low, middle, high]: [f64; 3]) -> (f64, f64) {
    let (slope, curvature) = (0.5 * (high - low), low - 2.0 * middle + high);
    let at = if curvature < 0.0 { (-slope / curvature).clamp(-1.0, 1.0) } else { 0.0 };
    (at, middle + slope * at + 0.5 * curvature * at * at)
}

/// The depth (um) and the image of the highest peak. `known`: peaks at equally spaced depths.
fn sharpest(
    known: impl Iterator<Item = (f64, f64)>,
    image: impl Fn(&f64) -> ScanImage + Sync,
) -> Option<(f64, ScanImage)> {
    let mut known: Vec<(f64, f64)> = known.collect();
    if known.iter().all(|(_, peak)| *peak == known[0].1) {
        return None;
    }
    let highest = |known: &[(f64, f64)]| {
        (0..known.len()).max_by(|a, b| known[*a].1.total_cmp(&known[*b].1)).unwrap_or_default()
    };
    for halving in 0..HALVINGS {
        let best = highest(&known);
        // A sharp peak may lie beside a depth that is not the best of a coarse scan.
        let near = |depths: usize| best.saturating_sub(depths)..(best + depths + 1).min(known.len());
        if known[near(1)].iter().all(|(_, peak)| *peak >= RESOLVED * known[best].1) {
            break;
        }
        let between = known[near(if halving == 0 { 2 } else { 1 })].par_windows(2).map(|pair| {
            let z_um = 0.5 * (pair[0].0 + pair[1].0);
            (z_um, image(&z_um).peak)
        });
        let between: Vec<(f64, f64)> = between.collect();
        known.extend(between);
        known.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    }
    let best = highest(&known);
    let (z_um, peak) = known[best];
    if best > 0 && best + 1 < known.len() {
        let shift = vertex([best - 1, best, best + 1].map(|i| known[i].1)).0;
        let step_um = known[best + 1].0 - z_um;
        let at_vertex = image(&(z_um + shift * step_um));
        if at_vertex.peak >= peak {
            return Some((z_um + shift * step_um, at_vertex));
        }
    }
    Some((z_um, image(&z_um)))
}

impl ScanImage {
    /// Measures a square image of `2 half_px + 1` rows for a sensor with this number of columns and rows, and
    /// crops its dark margin.
    pub fn new(half_px: usize, light: Vec<f64>, sensor: [u32; 2]) -> Self {
        let side = 2 * half_px + 1;
        let peak = light.iter().copied().fold(0.0, f64::max);
        let total: f64 = light.iter().sum();
        let area = light.iter().filter(|v| **v > AREA_SHARE * peak).count();
        let square = |a: f64, b: f64| (b - a) * (b - a);
        let rows = light.chunks(side);
        let along: f64 =
            rows.clone().flat_map(|row| row.windows(2)).map(|pair| square(pair[0], pair[1])).sum();
        let across: f64 =
            light.iter().zip(&light[side.min(light.len())..]).map(|(a, b)| square(*a, *b)).sum();
        let (mut squares_px, mut on_sensor) = ([0.0; 2], 0.0);
        let half_sensor = sensor.map(|pixels| 0.5 * f64::from(pixels));
        for (k, light) in light.iter().enumerate() {
            let place = [k % side, k / side].map(|at| at as f64 - half_px as f64);
            squares_px.iter_mut().zip(place).for_each(|(sum, distance)| *sum += light * distance * distance);
            if place.iter().zip(half_sensor).all(|(distance, half)| distance.abs() <= half) {
                on_sensor += light;
            }
        }
        let squares_px = squares_px.map(|sum| if total > 0.0 { sum / total } else { 0.0 });
        let cut = rows
            .enumerate()
            .flat_map(|(y, row)| {
                row.iter().enumerate().map(move |(x, v)| (x.abs_diff(half_px).max(y.abs_diff(half_px)), *v))
            })
            .filter(|(_, v)| *v > CUT_SHARE * peak)
            .fold(0, |cut, (distance, _)| cut.max(distance));
        let kept = light.chunks(side).skip(half_px - cut).take(2 * cut + 1);
        let cropped = kept.flat_map(|row| row[half_px - cut..=half_px + cut].iter().copied()).collect();
        ScanImage {
            peak,
            total,
            on_sensor,
            area_px: area as f64,
            curvature: along + across,
            squares_px,
            half_px: cut,
            light: cropped,
        }
    }
}

impl ScanImage {
    /// Width and height of the part above a tenth of the peak (the definition of its area), px: between the
    /// outermost crossings of that level, interpolated linearly between pixels, of the maximum over each
    /// column and each row.
    pub fn size_px(&self) -> [f64; 2] {
        let side = 2 * self.half_px + 1;
        let mut brightest = [vec![0.0f64; side], vec![0.0f64; side]];
        for (k, light) in self.light.iter().enumerate() {
            for (profile, at) in brightest.iter_mut().zip([k % side, k / side]) {
                profile[at] = profile[at].max(*light);
            }
        }
        brightest.map(|profile| extent(&profile, AREA_SHARE * self.peak))
    }
}

/// The distance between the outermost crossings of a level by a profile, which is dark beyond its ends.
fn extent(profile: &[f64], level: f64) -> f64 {
    let above = |value: &f64| *value > level;
    let Some((first, last)) = profile.iter().position(above).zip(profile.iter().rposition(above)) else {
        return 0.0;
    };
    let beyond = |inner: f64, outer: Option<&f64>| {
        let outer = outer.copied().unwrap_or(0.0);
        (inner - level) / (inner - outer)
    };
    let before = first.checked_sub(1).and_then(|i| profile.get(i));
    (last - first) as f64 + beyond(profile[first], before) + beyond(profile[last], profile.get(last + 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emission::SpheroidLaw;
    use crate::render::RayRenderer;
    use crate::render::waves::{Lens, WaveOptics, WavesRenderer};

    #[test]
    fn a_spot_is_measured_by_hand() {
        let spot = ScanImage::new(1, vec![0.0, 1.0, 0.0, 2.0, 20.0, 3.0, 0.0, 2.0, 0.0], [3, 1]);
        assert_eq!((spot.peak, spot.area_px, spot.half_px), (20.0, 2.0, 1));
        assert_eq!((spot.total, spot.on_sensor), (28.0, 25.0));
        // Rows: 1 + 1, 18^2 + 17^2, 4 + 4; columns: 4 + 4, 19^2 + 18^2, 9 + 9.
        assert_eq!(spot.curvature, 2.0 + 613.0 + 8.0 + 8.0 + 685.0 + 18.0);
        let dark_margin = ScanImage::new(1, vec![0.0, 0.01, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0], [3, 3]);
        assert_eq!((dark_margin.half_px, dark_margin.light), (0, vec![20.0]));
    }

    /// Areas and peaks of images by the original MicroSIG (means of 50, `set1` of the reference data):
    /// setting 1, 2 um. Its peaks are maxima over noisy pixels, up to 6 % too high for faint images.
    #[test]
    fn images_over_depth_are_those_of_the_original() {
        let draw = |settings: &Settings| Ok(RayRenderer::new(settings, SpheroidLaw::Original)?.into());
        let stack = DepthScan::measure(draw, &Settings::setting1(), 2.0, (-80.0, 20.0), 1.0).unwrap();
        for (z, area_px, peak) in [
            (-80.0, 2335.0, 49.5),
            (-70.0, 1575.0, 58.9),
            (-60.0, 998.0, 72.5),
            (-40.0, 333.0, 130.2),
            (-20.0, 69.0, 794.0),
            (-10.0, 25.0, 1052.1),
            (0.0, 66.0, 584.2),
            (20.0, 899.0, 83.7),
        ] {
            let (spot, at) = stack.at(z);
            assert!((spot.area_px / area_px - 1.0).abs() < 0.06, "{z}: {}", spot.area_px);
            assert!((at / peak - 0.975).abs() < 0.045, "{z}: {at}");
        }
        assert!((stack.focus_um().unwrap() + 12.0).abs() < 1.0, "{:?}", stack.focus_um());
        // Linear in between.
        let (half, a, b) = (stack.at(-11.0).1, stack.at(-12.0).1, stack.at(-10.0).1);
        assert!((half - 0.5 * (a + b)).abs() < 1e-9 && stack.at(99.0).1 == stack.at(20.0).1);
    }

    /// The depth of field is comparable to the spacing of the scan: the highest of its peaks is
    /// several per cent too low.
    #[test]
    fn best_focus_lies_between_the_depths_of_a_scan() {
        let settings = Settings {
            magnification: 20.0,
            numerical_aperture: 0.5,
            pixel_size: 6.5,
            pixel_dim_x: 64,
            pixel_dim_y: 64,
            ..Settings::setting1()
        };
        let optics = WaveOptics { lens: Lens::Aplanatic, ..WaveOptics::new(0.52) };
        let draw = |settings: &Settings| Ok(WavesRenderer::new(settings, &optics, 0.02)?.into());
        let coarse = DepthScan::measure(draw, &settings, 0.5, (-40.0, 41.7), 1.0).unwrap();
        let fine = DepthScan::measure(draw, &settings, 0.5, (-1.0, 1.5), 1.0).unwrap();
        let highest = |scan: &DepthScan| scan.images.iter().map(|image| image.peak).fold(0.0, f64::max);
        let (z_um, image) = coarse.focus.clone().unwrap();
        assert!((image.peak / highest(&fine) - 1.0).abs() < 0.01, "{} not {}", image.peak, highest(&fine));
        assert!((z_um - fine.focus_um().unwrap()).abs() < 0.1, "{z_um} not {:?}", fine.focus_um());
        assert!(highest(&coarse) < 0.96 * image.peak, "{}", highest(&coarse));
    }

    #[test]
    fn an_extent_ends_where_the_level_is_crossed() {
        assert_eq!(extent(&[0.0, 0.5, 1.0, 0.5, 0.0], 0.25), 3.0);
        assert_eq!(extent(&[1.0, 1.0], 0.5), 2.0);
        assert_eq!(extent(&[0.0, 0.1], 0.5), 0.0);
    }

    #[test]
    fn widths_are_those_of_a_disk_and_of_a_cone() {
        let image = |of: &dyn Fn(f64, f64) -> f64| {
            let light = (0..81 * 81).map(|k| of((k % 81) as f64 - 40.0, (k / 81) as f64 - 40.0));
            ScanImage::new(40, light.collect(), [81, 81]).size_px()
        };
        // An ellipse of 61 x 31 pixels: its edge lies between a lit and a dark pixel.
        let [width, height] = image(&|x, y| f64::from(u8::from(libm::hypot(x / 30.0, y / 15.0) <= 1.0)));
        assert!((width - 61.8).abs() < 1e-9 && (height - 31.8).abs() < 1e-9, "{width} {height}");
        // A cone falls linearly, so a tenth of its peak is crossed between pixels.
        let [width, _] = image(&|x, y| (1.0 - libm::hypot(x, y) / 23.0).max(0.0));
        assert!((width - 2.0 * 0.9 * 23.0).abs() < 1e-9, "{width}");
        assert_eq!(ScanImage::new(1, vec![0.0; 9], [3, 3]).size_px(), [0.0, 0.0]);
    }
}
