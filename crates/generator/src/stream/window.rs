//! Windows of images at random positions: samples smaller than the images of the scenario.

use super::distribution::Distribution;
use super::labels::Sample;

/// A part of an image, in pixels counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Window {
    /// The window of (columns, rows) in an image of (columns, rows), at a position determined by the seed of
    /// a sample; all positions are equally likely.
    pub(super) fn draw(seed: u64, (width, height): (u32, u32), image: (u32, u32)) -> Self {
        let place = |path, room: u32| {
            let distribution = Distribution::Integers { low: 0, high: i64::from(room) };
            distribution.draw(seed, path).number.map_or(0, |number| number as usize)
        };
        Window {
            left: place("window.left", image.0.saturating_sub(width)),
            top: place("window.top", image.1.saturating_sub(height)),
            width: width as usize,
            height: height as usize,
        }
    }

    /// Cuts a sample whose images have this width and height; particles are those with their center inside.
    pub(super) fn cut(&self, sample: &mut Sample, image: (u32, u32)) {
        let image = (image.0 as usize, image.1 as usize);
        self.planes(&mut sample.images, image);
        self.planes(&mut sample.clean, image);
        self.planes(&mut sample.instances, image);
        self.planes(&mut sample.depth, image);
        self.planes(&mut sample.heatmap, image);
        self.planes(&mut sample.flow, image);

        // The first pixel's center is at 1, a pixel k covers [k - 0.5, k + 0.5).
        let (left, top) = (self.left as f32, self.top as f32);
        let inside = |at: f32, size: usize| (0.5..size as f32 + 0.5).contains(&at);
        let mut numbers = vec![0];
        let (mut particles, mut boxes, mut shapes) = (Vec::new(), Vec::new(), Vec::new());
        for (k, mut particle) in std::mem::take(&mut sample.particles).into_iter().enumerate() {
            (particle[0], particle[1]) = (particle[0] - left, particle[1] - top);
            let is_inside = inside(particle[0], self.width) && inside(particle[1], self.height);
            numbers.push(if is_inside { particles.len() as i32 + 1 } else { 0 });
            if is_inside {
                boxes.extend(sample.boxes.get(k).map(|bounds| self.bounds(*bounds, &particle)));
                shapes.extend(sample.shapes.get(k));
                particles.push(particle);
            }
        }
        (sample.particles, sample.boxes, sample.shapes) = (particles, boxes, shapes);
        for (pixel, owner) in sample.instances.iter_mut().enumerate() {
            *owner = numbers.get(*owner as usize).copied().unwrap_or(0);
            if *owner == 0
                && let Some(depth) = sample.depth.get_mut(pixel)
            {
                *depth = f32::NAN;
            }
        }
    }

    /// Cuts consecutive planes of rows.
    fn planes<T: Copy>(&self, values: &mut Vec<T>, (width, height): (usize, usize)) {
        let mut cut = Vec::with_capacity(values.len() / (width * height) * self.width * self.height);
        for plane in values.chunks_exact(width * height) {
            for row in self.top..self.top + self.height {
                let first = row * width + self.left;
                cut.extend_from_slice(&plane[first..first + self.width]);
            }
        }
        *values = cut;
    }

    /// The part of a box inside the window; a box of size 0 at the particle if there is none.
    fn bounds(&self, [x, y, w, h, z, class]: [f32; 6], particle: &[f32; 8]) -> [f32; 6] {
        let side = |middle: f32, size: f32, first: usize, count: usize| {
            let low = (middle - 0.5 * size - first as f32).max(0.5);
            let high = (middle + 0.5 * size - first as f32).min(count as f32 + 0.5);
            (0.5 * (low + high), high - low)
        };
        let (x, w) = side(x, w, self.left, self.width);
        let (y, h) = side(y, h, self.top, self.height);
        if w > 0.0 && h > 0.0 {
            [x, y, w, h, z, class]
        } else {
            [particle[0], particle[1], 0.0, 0.0, z, class]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_all_of_those_that_fit() {
        let mut seen = [[0; 3]; 2];
        for seed in 0..3000 {
            let window = Window::draw(seed, (6, 3), (8, 4));
            assert_eq!((window.width, window.height), (6, 3));
            seen[window.top][window.left] += 1;
        }
        assert!(seen.iter().flatten().all(|n| (400..600).contains(n)), "{seen:?}");
        assert_eq!(Window::draw(1, (8, 4), (8, 4)), Window { left: 0, top: 0, width: 8, height: 4 });
    }

    #[test]
    fn what_is_cut_is_what_was_there() {
        let window = Window { left: 1, top: 2, width: 2, height: 1 };
        let mut sample = Sample {
            images: (0..24).collect(),
            instances: vec![0, 1, 2, 0, 1, 2, 0, 2, 2, 0, 0, 1],
            depth: vec![5.0; 12],
            particles: vec![
                [3.0, 1.0, 5.0, 1.0, 1.0, 0.0, 0.0, 0.0],
                [3.0, 3.0, 5.0, 1.0, 1.0, 0.0, 0.0, 0.0],
            ],
            shapes: vec![[1.0, 0.0, 0.0, 2.0], [0.0, 1.0, 0.0, 3.0]],
            boxes: vec![[3.0, 1.0, 1.0, 1.0, 5.0, 0.0], [2.5, 2.5, 4.0, 2.0, 5.0, 0.0]],
            ..Sample::default()
        };
        // Images of 4 x 3, two frames.
        window.cut(&mut sample, (4, 3));
        assert_eq!(sample.images, [9, 10, 21, 22]);
        assert_eq!(sample.instances, [0, 0]);
        assert!(sample.depth.iter().all(|z| z.is_nan()));
        assert_eq!(sample.particles.iter().map(|p| (p[0], p[1])).collect::<Vec<_>>(), [(2.0, 1.0)]);
        assert_eq!(sample.shapes, [[0.0, 1.0, 0.0, 3.0]]);
        assert_eq!(sample.boxes, [[1.5, 1.0, 2.0, 1.0, 5.0, 0.0]]);
    }
}
