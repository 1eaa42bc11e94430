//! The part of the sensor illuminated by one particle.

/// A rectangle of pixels, numbered from 1; may be empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Window {
    /// Leftmost pixel column.
    pub x0: i64,
    /// Topmost pixel row.
    pub y0: i64,
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
}

impl Window {
    /// The part of a sensor (width, height in px) within `extent` (px, along x and y) of a position (px).
    #[inline]
    pub(super) fn around(x_px: f64, y_px: f64, extent: (f64, f64), sensor: (u32, u32)) -> Self {
        let side = |center: f64, reach: f64, size: u32| {
            // Saturating conversions handle positions far outside the sensor.
            let low = ((center - reach + 0.5).floor() as i64).max(1);
            let high = ((center + reach + 0.5).floor() as i64).min(i64::from(size));
            (low, if high >= low { (high - low + 1) as usize } else { 0 })
        };
        let (x0, width) = side(x_px, extent.0, sensor.0);
        let (y0, height) = side(y_px, extent.1, sensor.1);
        if width == 0 || height == 0 { Window::default() } else { Window { x0, y0, width, height } }
    }

    /// Whether [`Window::around`] contains pixels, without rounding.
    #[inline]
    pub(super) fn is_lit(x_px: f64, y_px: f64, extent: (f64, f64), sensor: (u32, u32)) -> bool {
        let side = |center: f64, reach: f64, size: u32| {
            size > 0 && center - reach + 0.5 < f64::from(size) + 1.0 && center + reach + 0.5 >= 1.0
        };
        side(x_px, extent.0, sensor.0) && side(y_px, extent.1, sensor.1)
    }

    /// The window with a margin, which may extend beyond the sensor.
    pub(super) fn grown(self, margin: usize) -> Window {
        let Window { x0, y0, width, height } = self;
        let by = margin as i64;
        Window { x0: x0 - by, y0: y0 - by, width: width + 2 * margin, height: height + 2 * margin }
    }

    /// The smallest window that contains both.
    pub(crate) fn joined(self, other: Window) -> Window {
        if self.area() == 0 {
            return other;
        }
        if other.area() == 0 {
            return self;
        }
        let side = |a: i64, a_size: usize, b: i64, b_size: usize| {
            let first = a.min(b);
            (first, ((a + a_size as i64).max(b + b_size as i64) - first) as usize)
        };
        let (x0, width) = side(self.x0, self.width, other.x0, other.width);
        let (y0, height) = side(self.y0, self.height, other.y0, other.height);
        Window { x0, y0, width, height }
    }

    /// Number of pixels.
    pub fn area(&self) -> usize {
        self.width * self.height
    }

    /// Its rows, from 0, if it is on the sensor.
    pub(crate) fn rows(&self) -> std::ops::Range<usize> {
        let first = (self.y0.max(1) - 1) as usize;
        first..first + self.height
    }
}

/// Ray counts of one particle on the sensor pixels it can reach.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Patch {
    /// The pixels of the patch.
    pub window: Window,
    /// Counts, row by row.
    pub counts: Vec<u32>,
}

impl Patch {
    /// Adds the patch times `factor` to a band of rows of a sensor of `width` px; `first_row` is the number
    /// (from 0) of its first row.
    pub(super) fn add(&self, first_row: usize, factor: f64, band: &mut [f64], width: usize) {
        let Window { x0, y0, width: columns, height } = self.window;
        let (left, top) = ((x0 - 1) as usize, (y0 - 1) as usize);
        let last_row = first_row + band.len() / width;
        for row in top.max(first_row)..(top + height).min(last_row) {
            let counts = &self.counts[(row - top) * columns..][..columns];
            let pixels = &mut band[(row - first_row) * width + left..][..columns];
            for (pixel, &count) in pixels.iter_mut().zip(counts) {
                *pixel += factor * f64::from(count);
            }
        }
    }

    /// The sum of all counts.
    pub fn total(&self) -> u64 {
        self.counts.iter().map(|&c| u64::from(c)).sum()
    }
}

/// Expected light of one particle on the sensor pixels it can reach.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpectedPatch {
    /// Where on the sensor.
    pub window: Window,
    /// Light in rays, row by row.
    pub counts: Vec<f64>,
}

impl ExpectedPatch {
    /// The same light for another brightness.
    pub(super) fn scaled(mut self, factor: f64) -> Self {
        self.counts.iter_mut().for_each(|light| *light *= factor);
        self
    }

    /// The light on the pixels of another window, row by row: 0 outside the patch.
    pub fn on(&self, window: Window) -> Vec<f64> {
        let mut light = vec![0.0; window.area()];
        for (i, counts) in self.counts.iter().enumerate() {
            let x = self.window.x0 + (i % self.window.width) as i64 - window.x0;
            let y = self.window.y0 + (i / self.window.width) as i64 - window.y0;
            if (0..window.width as i64).contains(&x) && (0..window.height as i64).contains(&y) {
                light[y as usize * window.width + x as usize] = *counts;
            }
        }
        light
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_end_at_the_sensor() {
        let window = |x, y| Window::around(x, y, (2.2, 1.2), (10, 8));
        assert_eq!(window(5.0, 5.0), Window { x0: 3, y0: 4, width: 5, height: 3 });
        assert_eq!(window(0.0, 9.0), Window { x0: 1, y0: 8, width: 2, height: 1 });
        assert_eq!(window(-5.0, 5.0).area(), 0);
        assert_eq!(window(1e300, -1e300).area(), 0);
    }

    #[test]
    fn light_on_another_window_is_that_of_the_same_pixels() {
        let window = Window { x0: 3, y0: 4, width: 2, height: 2 };
        let patch = ExpectedPatch { window, counts: vec![1.0, 2.0, 3.0, 4.0] };
        assert_eq!(patch.on(Window { x0: 4, y0: 3, width: 2, height: 2 }), [0.0, 0.0, 2.0, 0.0]);
        assert_eq!(patch.on(window), patch.counts);
    }

    #[test]
    fn what_is_lit_has_a_window() {
        let edges = [f64::NAN, -f64::INFINITY, f64::INFINITY, -1e300, 1e300];
        let places: Vec<f64> = edges.into_iter().chain((-40..=140).map(|i| f64::from(i) * 0.1)).collect();
        for reach in [0.0, 0.1, 0.5, 2.2, 1e30, f64::NAN] {
            for &at in &places {
                for (x, y, sensor) in [(at, 5.0, (10, 8)), (5.0, at, (10, 8)), (at, 1.0, (1, 1))] {
                    let window = Window::around(x, y, (reach, 1.2), sensor);
                    let lit = Window::is_lit(x, y, (reach, 1.2), sensor);
                    assert_eq!(lit, window.area() > 0, "{x}, {y}, {reach}");
                }
            }
        }
    }
}
