//! Correlation maps: the reduction of chi^2 of a frame by a template centered at each pixel.
//!
//! With weights w, frame f and template t it is (sum w f t)^2 / (sum w t^2): the squared normalized
//! cross-correlation times sum w f^2. Both sums are cross-correlations, computed by FFT.

use std::sync::OnceLock;

use numeric::fourier::{Complex32, Direction, ImageFft, fast_length};

use super::fit::Residual;
use super::templates::{Template, Templates};

/// Memory for spectra of the templates of all places, which are kept from frame to frame.
pub(super) const KEPT_BYTES: usize = 1 << 28;

/// The templates of each size of particles at a place, and the spectra of those whose maps are computed.
pub(super) struct MapTemplates {
    pub(super) sizes: Vec<Templates>,
    /// Size and template of each map.
    pub(super) coarse: Vec<(usize, usize)>,
    /// Largest half width of these templates, px.
    pub(super) margin: usize,
    /// The most memory of spectra that are kept.
    most_bytes: usize,
    kept: OnceLock<Spectra>,
}

/// Spectra of the templates of maps for images of one size: of the image plus i times its square.
struct Spectra {
    padded: (usize, usize),
    all: Vec<OnceLock<Vec<Complex32>>>,
}

impl MapTemplates {
    /// Of the templates of each size, at most `most` have maps; their spectra are kept if they need at most `most_bytes`.
    pub(super) fn new(sizes: Vec<Templates>, most: usize, most_bytes: usize) -> Self {
        let coarse: Vec<(usize, usize)> = (sizes.iter().enumerate())
            .flat_map(|(size, templates)| {
                let stride = templates.len().div_ceil(most).max(1);
                (stride / 2..templates.len()).step_by(stride).map(move |template| (size, template))
            })
            .collect();
        let margin = coarse.iter().map(|&(size, k)| sizes[size].get(k).radius).max().unwrap_or(0);
        MapTemplates { sizes, coarse, margin, most_bytes, kept: OnceLock::new() }
    }
}

/// Transforms shared by all correlation maps of a frame.
pub(super) struct CorrelationMaps<'a> {
    templates: &'a MapTemplates,
    /// Size of the maps: the frame with a margin on each side for particles beyond the edge.
    pub(super) size: (usize, usize),
    /// Size of the FFT planes, which both margins together keep from circular wrap-around.
    padded: (usize, usize),
    fourier: ImageFft,
    /// Transforms of the weighted counts and of the weights.
    frame: Vec<[Complex32; 2]>,
}

impl<'a> CorrelationMaps<'a> {
    pub(super) fn new(templates: &'a MapTemplates, residual: &Residual) -> Self {
        let (frame, margin) = (residual.size(), templates.margin);
        let size = (frame.0 + 2 * margin, frame.1 + 2 * margin);
        let padded = (fast_length(size.0), fast_length(size.1));
        let fourier = ImageFft::new(padded);
        let mut plane = vec![Complex32::default(); padded.0 * padded.1];
        for y in 0..frame.1 {
            for x in 0..frame.0 {
                let i = y * frame.0 + x;
                let weight = residual.weight[i];
                plane[(y + margin) * padded.0 + x + margin] =
                    Complex32::new(weight * residual.image.counts[i], weight);
            }
        }
        fourier.transform(&mut plane, Direction::Forward, &mut fourier.scratch());
        let mut frame = vec![[Complex32::default(); 2]; plane.len()];
        fourier.combine(&mut plane, |k, both| {
            frame[k] = both;
            both[0]
        });
        CorrelationMaps { templates, size, padded, fourier, frame }
    }

    /// The reduction of chi^2 by a template at every pixel of the map.
    pub(super) fn chi2_reduction(&self, map: usize) -> Vec<f32> {
        let mut plane = self.spectrum(map);
        let i = Complex32::new(0.0, 1.0);
        self.fourier.combine(&mut plane, |k, [light, square]| {
            let [weighted, weights] = self.frame[k];
            light.conj() * weighted + i * square.conj() * weights
        });
        self.fourier.transform(&mut plane, Direction::Backward, &mut self.fourier.scratch());
        let scale = 1.0 / plane.len() as f32;
        let reduction =
            |p: &Complex32| if p.re > 0.0 && p.im > 0.0 { p.re * p.re / p.im * scale } else { 0.0 };
        let mut map = Vec::with_capacity(self.size.0 * self.size.1);
        let rows = plane.chunks(self.padded.0).take(self.size.1);
        rows.for_each(|row| map.extend(row[..self.size.0].iter().map(reduction)));
        map
    }

    /// The spectrum of the template of a map, kept for other frames of this size.
    fn spectrum(&self, map: usize) -> Vec<Complex32> {
        let MapTemplates { sizes, coarse, kept, most_bytes, .. } = self.templates;
        let (size, template) = coarse[map];
        let made = || self.transformed(sizes[size].get(template));
        if coarse.len() * self.frame.len() * size_of::<Complex32>() > *most_bytes {
            return made();
        }
        let empty = || Spectra { padded: self.padded, all: coarse.iter().map(|_| OnceLock::new()).collect() };
        let kept = kept.get_or_init(empty);
        if kept.padded == self.padded { kept.all[map].get_or_init(made).clone() } else { made() }
    }

    fn transformed(&self, template: &Template) -> Vec<Complex32> {
        let r = template.radius as isize;
        let (w, h) = self.padded;
        let mut plane = vec![Complex32::default(); w * h];
        for dy in -r..=r {
            let first = dy.rem_euclid(h as isize) as usize * w;
            for (dx, light) in (-r..=r).zip(template.row(dy, -r..r + 1)) {
                plane[first + dx.rem_euclid(w as isize) as usize] = Complex32::new(*light, light * light);
            }
        }
        self.fourier.transform(&mut plane, Direction::Forward, &mut self.fourier.scratch());
        plane
    }
}

#[cfg(test)]
mod tests {
    use super::super::denoise::PixelNoise;
    use super::super::gray_image::{GrayImage, normal};
    use super::*;

    /// Sums over pixels, at places inside the frame, at its edges and beyond, for a frame whose size is a prime number; the
    /// second frame uses the spectra of the first.
    #[test]
    fn maps_are_sums_over_pixels_at_lengths_of_small_factors() {
        let image = |depth: usize| {
            let spot =
                |x: f32, y: f32| 1e3 * (-(((x - 10.0).powi(2) + 2.0 * (y - 10.0).powi(2)) / 20.0)).exp();
            GrayImage::from_fn((21, 21), |x, y| spot(x as f32 + depth as f32, y as f32))
        };
        let depths_um = (0..5).map(f64::from).collect();
        let noise = PixelNoise::new(1.0, 0.0);
        let templates = MapTemplates::new(
            vec![Templates::new(depths_um, (0..5).map(image).collect(), noise)],
            2,
            KEPT_BYTES,
        );
        assert_eq!(templates.coarse, [(0, 1), (0, 4)]);
        for seed in [0, 10_000] {
            let frame = GrayImage::from_fn((131, 67), |x, y| 100.0 * normal(seed + y * 131 + x).abs());
            let weight = frame.counts.iter().map(|count| 1.0 / (1.0 + count)).collect();
            let residual = Residual { image: frame, weight };
            let maps = CorrelationMaps::new(&templates, &residual);
            let is_smooth = |n: usize| fast_length(n) == n;
            assert!(is_smooth(maps.padded.0) && is_smooth(maps.padded.1) && !is_smooth(131));
            let margin = templates.margin as isize;
            for (k, &(_, template)) in templates.coarse.iter().enumerate() {
                let map = maps.chi2_reduction(k);
                let kept = templates.kept.get().and_then(|kept| kept.all[k].get());
                assert!(kept.is_some_and(|kept| *kept == maps.transformed(templates.sizes[0].get(template))));
                let template = templates.sizes[0].get(template);
                let r = template.radius as isize;
                for (x, y) in [(60, 30), (0, 0), (130, 66), (-3, 40), (133, -2), (70, 65)] {
                    let (mut both, mut own) = (0.0f64, 0.0f64);
                    for (u, v) in (y - r..=y + r).flat_map(|v| (x - r..=x + r).map(move |u| (u, v))) {
                        if (0..131).contains(&u) && (0..67).contains(&v) {
                            let (i, light) =
                                ((v * 131 + u) as usize, f64::from(template.row(v - y, u - x..u - x + 1)[0]));
                            let weight = f64::from(residual.weight[i]);
                            both += weight * f64::from(residual.image.counts[i]) * light;
                            own += weight * light * light;
                        }
                    }
                    let found = map[(y + margin) as usize * maps.size.0 + (x + margin) as usize];
                    let expected = if both > 0.0 { both * both / own } else { 0.0 };
                    // Sums in f32; beyond the edge, few pixels are left of them.
                    assert!((f64::from(found) / expected - 1.0).abs() < 3e-3, "{x} {y}: {found} {expected}");
                }
            }
        }
    }
}
