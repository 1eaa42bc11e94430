//! GDPT: depth by correlation with the calibration stack.
//!
//! Images of the stack are templates. Maps of their zero-mean normalised cross-correlation C_m with a frame show where
//! particles may be; each candidate walks to the template and pixel of highest C_m, and parabolas through three values
//! refine place and depth (Barnkob, Kaehler & Rossi 2015, Lab Chip 15, 3556). What is accepted is taken out of the frame, so
//! that rings do not answer twice and overlapped particles show.

use rustfft::num_complex::Complex32;

use super::Found;
use super::fourier::{Plane, Way};
use super::picture::{Picture, Spline, three_points};
use super::recording::Step;

/// Templates whose whole maps are computed; the walk finds the ones between.
const COARSE: usize = 9;

/// Least correlation of a particle.
const LEAST_CM: f32 = 0.5;

/// A particle is this many standard deviations of the smoothed noise high.
const ABOVE_NOISE: f32 = 5.0;

/// Light of a window that must be left when what was accepted is taken out, as part of what was there.
const UNEXPLAINED: f32 = 0.3;

/// Smoothing of frames and templates, px.
const SMOOTH_PX: f32 = 1.0;

/// Steps of a walk before it is given up.
const LONGEST_WALK: usize = 100;

/// A particle image at one depth.
#[derive(Debug)]
struct Template {
    z_um: f64,
    /// Counts above the background, the particle in the middle.
    picture: Picture,
    spline: Spline,
    /// The image reaches so far from its middle, px.
    radius: usize,
    peak: f32,
}

/// The templates, by depth.
#[derive(Debug)]
pub(super) struct Stack {
    templates: Vec<Template>,
}

/// A template at a pixel of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Match {
    step: usize,
    x: isize,
    y: isize,
    cm: f32,
}

/// Where the walk to a particle begins.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    start: Match,
    /// The part of the window's sum of squares that the template accounts for.
    explained: f32,
}

/// How a window of a frame and a template agree.
#[derive(Debug, Clone, Copy)]
struct Agreement {
    cm: f32,
    /// Brightness of the particle in units of the template's.
    amplitude: f32,
    /// Sum of squares of the window about its mean.
    power: f32,
}

impl Stack {
    pub(super) fn new(steps: &[Step]) -> Self {
        Stack { templates: steps.iter().map(Template::new).collect() }
    }

    /// The particles of an image.
    pub(super) fn find(&self, picture: &Picture) -> Vec<Found> {
        let mut frame = picture.smoothed(SMOOTH_PX);
        let (level, noise) = (frame.median(), frame.noise());
        frame.counts.iter_mut().for_each(|c| *c -= level);
        let mut left = frame.clone();
        let mut found: Vec<Found> = Vec::new();
        for candidate in self.candidates(&frame) {
            let Some(best) = self.walk(&left, candidate.start) else { continue };
            let template = &self.templates[best.step];
            let here = template.agreement(&left, best.x, best.y, template.radius);
            let before = template.agreement(&frame, best.x, best.y, template.radius).power;
            let bright = here.amplitude * template.peak > ABOVE_NOISE * noise;
            if best.cm < LEAST_CM || !bright || here.power < UNEXPLAINED * before {
                continue;
            }
            let (particle, offset) = self.refined(&left, best);
            template.take_out(&mut left, here.amplitude, offset);
            found.push(particle);
        }
        found
    }

    /// Local maxima of the correlation maps of the coarse templates. First comes what explains most light: a small template
    /// may fit a piece of a ring well, but the ring's own explains all of it.
    fn candidates(&self, frame: &Picture) -> Vec<Candidate> {
        let step = self.templates.len().div_ceil(COARSE).max(1);
        let coarse: Vec<usize> = (step / 2..self.templates.len()).step_by(step).collect();
        let margin = coarse.iter().map(|&k| self.templates[k].radius).max().unwrap_or(0);
        let maps = Maps::new(frame, margin);
        let mut candidates = Vec::new();
        for k in coarse {
            let map = maps.correlation(&self.templates[k]);
            for y in 1..frame.height - 1 {
                for x in 1..frame.width - 1 {
                    let here = map.counts[y * frame.width + x];
                    let around =
                        |v: usize| map.counts[v * frame.width + x - 1..=v * frame.width + x + 1].iter();
                    if here > LEAST_CM && (y - 1..=y + 1).flat_map(around).all(|other| *other <= here) {
                        let start = Match { step: k, x: x as isize, y: y as isize, cm: here };
                        let explained = here * here * maps.power(x, y, self.templates[k].radius) as f32;
                        candidates.push(Candidate { start, explained });
                    }
                }
            }
        }
        let place = |c: &Candidate| (c.start.y, c.start.x, c.start.step);
        candidates.sort_by(|a, b| b.explained.total_cmp(&a.explained).then(place(a).cmp(&place(b))));
        candidates
    }

    /// Goes to neighbouring templates and pixels as long as the correlation grows.
    fn walk(&self, frame: &Picture, start: Match) -> Option<Match> {
        let mut at = start;
        for _ in 0..LONGEST_WALK {
            // Templates are compared over the same window: a smaller one would fit more easily.
            let steps = at.step.saturating_sub(1)..(at.step + 2).min(self.templates.len());
            let radius = steps.clone().map(|k| self.templates[k].radius).max()?;
            let cm = |step: usize, x: isize, y: isize| Match {
                step,
                x,
                y,
                cm: self.templates[step].agreement(frame, x, y, radius).cm,
            };
            let beside = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(dx, dy)| cm(at.step, at.x + dx, at.y + dy));
            let depths = steps.map(|k| cm(k, at.x, at.y));
            let best = depths.chain(beside).max_by(|a, b| a.cm.total_cmp(&b.cm))?;
            let here = cm(at.step, at.x, at.y);
            if best.cm <= here.cm {
                return Some(here);
            }
            at = best;
        }
        None
    }

    /// The particle to a fraction of pixel and step, and its place from the middle of the first pixel.
    fn refined(&self, frame: &Picture, at: Match) -> (Found, [f32; 2]) {
        let template = &self.templates[at.step];
        let cm = |dx: isize, dy: isize| template.agreement(frame, at.x + dx, at.y + dy, template.radius).cm;
        let x = at.x as f32 + three_points(cm(-1, 0), cm(0, 0), cm(1, 0));
        let y = at.y as f32 + three_points(cm(0, -1), cm(0, 0), cm(0, 1));
        let z_um = match (at.step.checked_sub(1), self.templates.get(at.step + 1)) {
            (Some(below), Some(above)) => {
                let below = &self.templates[below];
                let radius = below.radius.max(template.radius).max(above.radius);
                let [low, middle, high] =
                    [below, template, above].map(|t| f64::from(t.agreement(frame, at.x, at.y, radius).cm));
                let curvature = low - 2.0 * middle + high;
                let step =
                    if curvature < 0.0 { (0.5 * (low - high) / curvature).clamp(-0.5, 0.5) } else { 0.0 };
                template.z_um + step * 0.5 * (above.z_um - below.z_um)
            }
            // The first and the last image of the stack have a neighbour on one side only.
            _ => template.z_um,
        };
        (Found { x_px: f64::from(x) + 1.0, y_px: f64::from(y) + 1.0, z_um: Some(z_um) }, [x, y])
    }
}

impl Template {
    fn new(step: &Step) -> Self {
        let mut picture = step.picture.smoothed(SMOOTH_PX);
        let (level, noise) = (picture.median(), picture.noise());
        picture.counts.iter_mut().for_each(|c| *c -= level);
        let peak = picture.counts.iter().copied().fold(0.0, f32::max);
        let (cx, cy) = (step.at[0].round(), step.at[1].round());
        // Of the pixels that stand out, the farthest but a few, which may be noise.
        let threshold = (0.1 * peak).max(ABOVE_NOISE * noise);
        let mut reach: Vec<usize> = (0..picture.counts.len())
            .filter(|&i| picture.counts[i] > threshold)
            .map(|i| {
                let (dx, dy) = ((i % picture.width) as f64 - cx, (i / picture.width) as f64 - cy);
                dx.abs().max(dy.abs()) as usize
            })
            .collect();
        reach.sort_unstable();
        let farthest = reach.get(reach.len() * 99 / 100).copied().unwrap_or(0);
        let room = |c: f64, size: usize| (c as usize).min(size - 1 - (c as usize).min(size - 1));
        let room = room(cx, picture.width).min(room(cy, picture.height));
        let side = 2 * room + 1;
        let (left, top) = (cx as usize - room, cy as usize - room);
        let centred =
            Picture::from_fn((side, side), |x, y| picture.counts[(top + y) * picture.width + left + x]);
        let spline = Spline::new(&centred);
        Template { z_um: step.z_um, picture: centred, spline, radius: (farthest + 3).min(room), peak }
    }

    /// The template's pixel beside its middle.
    fn at(&self, dx: isize, dy: isize) -> f32 {
        let middle = (self.picture.width / 2) as isize;
        self.picture.counts[((middle + dy) * (2 * middle + 1) + middle + dx) as usize]
    }

    /// Compares the window of a frame around a pixel with the template; beyond the frame there is background.
    fn agreement(&self, frame: &Picture, x: isize, y: isize, radius: usize) -> Agreement {
        let r = radius.min(self.picture.width / 2) as isize;
        let (w, h) = (frame.width as isize, frame.height as isize);
        let (mut f, mut t, mut ff, mut tt, mut ft) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
        for dy in -r..=r {
            let inside = (0..h).contains(&(y + dy));
            for dx in -r..=r {
                let value = if inside && (0..w).contains(&(x + dx)) {
                    frame.counts[((y + dy) * w + x + dx) as usize]
                } else {
                    0.0
                };
                let own = self.at(dx, dy);
                f += value;
                t += own;
                ff += value * value;
                tt += own * own;
                ft += value * own;
            }
        }
        let n = ((2 * r + 1) * (2 * r + 1)) as f32;
        let (vf, vt, cov) = (ff - f * f / n, tt - t * t / n, ft - f * t / n);
        let cm = if vf > 0.0 && vt > 0.0 { cov / (vf * vt).sqrt() } else { 0.0 };
        Agreement { cm, amplitude: if vt > 0.0 { cov / vt } else { 0.0 }, power: vf }
    }

    /// Subtracts the particle image from a frame.
    fn take_out(&self, frame: &mut Picture, amplitude: f32, [x, y]: [f32; 2]) {
        let r = self.radius as f32;
        let middle = (self.picture.width / 2) as f32;
        let span = |c: f32, size: usize| {
            let from = (c - r).ceil().max(0.0) as usize;
            from..((c + r).floor() + 1.0).clamp(0.0, size as f32) as usize
        };
        for v in span(y, frame.height) {
            for u in span(x, frame.width) {
                let own = self.spline.at(u as f32 - x + middle, v as f32 - y + middle);
                frame.counts[v * frame.width + u] -= amplitude * own;
            }
        }
    }
}

/// What all correlation maps of a frame have in common.
struct Maps<'a> {
    frame: &'a Picture,
    width: usize,
    height: usize,
    margin: usize,
    fourier: Plane,
    /// Transform of the frame, with a margin of background around it.
    transformed: Vec<Complex32>,
    /// Sums of counts and of their squares over all pixels above and left, one more than pixels in each direction.
    sums: Vec<[f64; 2]>,
}

impl<'a> Maps<'a> {
    fn new(frame: &'a Picture, margin: usize) -> Self {
        let (width, height) = (frame.width + 2 * margin, frame.height + 2 * margin);
        let padded = Picture::from_fn((width, height), |x, y| {
            let (x, y) = (x.wrapping_sub(margin), y.wrapping_sub(margin));
            if x < frame.width && y < frame.height { frame.counts[y * frame.width + x] } else { 0.0 }
        });
        let fourier = Plane::new((width, height));
        let mut transformed: Vec<Complex32> = padded.counts.iter().map(|c| Complex32::new(*c, 0.0)).collect();
        fourier.transform(&mut transformed, Way::Forward, &mut fourier.scratch());
        let mut sums = vec![[0.0; 2]; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = [0.0; 2];
            for x in 0..width {
                let value = f64::from(padded.counts[y * width + x]);
                row = [row[0] + value, row[1] + value * value];
                let above = sums[y * (width + 1) + x + 1];
                sums[(y + 1) * (width + 1) + x + 1] = [above[0] + row[0], above[1] + row[1]];
            }
        }
        Maps { frame, width, height, margin, fourier, transformed, sums }
    }

    /// Sum of squares about its mean of the window around a pixel.
    fn power(&self, x: usize, y: usize, radius: usize) -> f64 {
        let (left, top) = (x + self.margin - radius, y + self.margin - radius);
        let (right, bottom) = (left + 2 * radius + 1, top + 2 * radius + 1);
        let at = |x: usize, y: usize| self.sums[y * (self.width + 1) + x];
        let corners = [at(right, bottom), at(left, bottom), at(right, top), at(left, top)];
        let [sum, squares] =
            std::array::from_fn(|i| corners[0][i] - corners[1][i] - corners[2][i] + corners[3][i]);
        squares - sum * sum / ((2 * radius + 1) * (2 * radius + 1)) as f64
    }

    /// C_m of a template at every pixel of the frame.
    fn correlation(&self, template: &Template) -> Picture {
        let r = template.radius as isize;
        let n = ((2 * r + 1) * (2 * r + 1)) as f64;
        let pixels = || (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| (dx, dy)));
        let mean = pixels().map(|(dx, dy)| f64::from(template.at(dx, dy))).sum::<f64>() / n;
        let power = pixels().map(|(dx, dy)| (f64::from(template.at(dx, dy)) - mean).powi(2)).sum::<f64>();
        let mut plane = vec![Complex32::default(); self.width * self.height];
        let wrap = |d: isize, size: usize| d.rem_euclid(size as isize) as usize;
        for (dx, dy) in pixels() {
            let value = (f64::from(template.at(dx, dy)) - mean) as f32;
            plane[wrap(dy, self.height) * self.width + wrap(dx, self.width)] = Complex32::new(value, 0.0);
        }
        let mut scratch = self.fourier.scratch();
        self.fourier.transform(&mut plane, Way::Forward, &mut scratch);
        for (p, f) in plane.iter_mut().zip(&self.transformed) {
            *p = p.conj() * f;
        }
        self.fourier.transform(&mut plane, Way::Backward, &mut scratch);
        let scale = 1.0 / (self.width * self.height) as f64;
        Picture::from_fn((self.frame.width, self.frame.height), |x, y| {
            let own = self.power(x, y, template.radius);
            let product = f64::from(plane[(y + self.margin) * self.width + x + self.margin].re) * scale;
            if own > 0.0 && power > 0.0 { (product / (own * power).sqrt()) as f32 } else { 0.0 }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring whose radius tells the depth.
    fn ring(picture: &mut Picture, [cx, cy]: [f64; 2], z_um: f64, brightness: f32) {
        let radius = 3.0 + 0.1 * z_um;
        for y in 0..picture.height {
            for x in 0..picture.width {
                let r = (x as f64 - cx).hypot(y as f64 - cy);
                picture.counts[y * picture.width + x] +=
                    brightness * (-0.5 * ((r - radius) / 1.5).powi(2)).exp() as f32;
            }
        }
    }

    fn noise(size: usize) -> Picture {
        Picture::from_fn((size, size), |x, y| 300.0 + ((x * 7 + y * 13 + x * y) % 9) as f32)
    }

    fn stack() -> Stack {
        let step = |k: i32| {
            let mut picture = noise(61);
            ring(&mut picture, [30.0, 30.0], 3.0 * f64::from(k), 200.0);
            Step { z_um: 3.0 * f64::from(k), at: [30.0, 30.0], picture }
        };
        Stack::new(&(0..40).map(step).collect::<Vec<_>>())
    }

    #[test]
    fn rings_are_found_once_and_at_their_depth() {
        let truth = [([40.3, 50.6], 22.0, 150.0), ([110.8, 42.1], 80.5, 260.0), ([75.0, 110.4], 51.3, 200.0)];
        let mut picture = noise(150);
        for (at, z, brightness) in truth {
            ring(&mut picture, at, z, brightness);
        }
        let found = stack().find(&picture);
        assert_eq!(found.len(), 3, "{found:?}");
        for ([x, y], z, _) in truth {
            let off = |f: &&Found| (f.x_px - 1.0 - x).hypot(f.y_px - 1.0 - y);
            let nearest = found.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
            assert!(off(&nearest) < 0.1, "{nearest:?}");
            assert!((nearest.z_um.unwrap() - z).abs() < 0.5, "{nearest:?} for {z}");
        }
    }

    #[test]
    fn rings_that_overlap_are_found_apart() {
        let mut picture = noise(120);
        ring(&mut picture, [50.0, 60.0], 60.0, 200.0);
        ring(&mut picture, [62.0, 60.0], 30.0, 250.0);
        assert_eq!(stack().find(&picture).len(), 2);
    }

    #[test]
    fn noise_holds_no_particles() {
        assert_eq!(stack().find(&noise(100)), []);
    }
}
