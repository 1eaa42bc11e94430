//! Accumulation of ray counts.
//!
//! A border of one pixel around the window of a particle collects the rays that land outside, so that every
//! ray has a pixel and a window that is too small is detected.

use crate::render::patch::{Patch, Window};

/// Number of copies of the counts, which are used in turn: successive rays often hit the same pixel, and a
/// count must be stored before it can be read again.
pub(super) const PLANES: usize = 4;

/// The grid of counters: window and border, numbered row by row from the upper left corner of the border, and
/// one more counter for lost rays.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CountGrid {
    /// Position of the particle center, px; the first column and row of the border are 0.
    pub(super) x: f32,
    pub(super) y: f32,
    /// Last column and row, border included.
    pub(super) right: f32,
    pub(super) bottom: f32,
    /// Number of counters per row.
    pub(super) stride: u32,
    /// The counter of lost rays.
    pub(super) lost: u32,
}

/// Ray counts of one particle.
#[derive(Debug, Clone, Default)]
pub(super) struct RayCounter {
    window: Window,
    grid: CountGrid,
    planes: [Vec<u32>; PLANES],
}

impl RayCounter {
    /// Starts a new particle with its window and its position, px.
    pub(super) fn begin(&mut self, window: Window, x_px: f64, y_px: f64) {
        let (stride, rows) = (window.width as u32 + 2, window.height as u32 + 2);
        self.window = window;
        self.grid = CountGrid {
            x: (x_px - (window.x0 - 1) as f64) as f32,
            y: (y_px - (window.y0 - 1) as f64) as f32,
            right: (stride - 1) as f32,
            bottom: (rows - 1) as f32,
            stride,
            lost: stride * rows,
        };
        for plane in &mut self.planes {
            plane.clear();
            plane.resize((stride * rows) as usize + 1, 0);
        }
    }

    pub(super) fn grid(&self) -> CountGrid {
        self.grid
    }

    /// The copies of the counts, to be filled by [`count`].
    pub(super) fn planes(&mut self) -> [&mut [u32]; PLANES] {
        self.planes.each_mut().map(Vec::as_mut_slice)
    }

    /// The counts of the window, summed over the copies.
    pub(super) fn patch(&self) -> Patch {
        let Window { width, height, .. } = self.window;
        let mut counts = Vec::with_capacity(width * height);
        for row in 1..=height {
            let first = row * (width + 2) + 1;
            let [a, b, c, d] = self.planes.each_ref().map(|plane| &plane[first..first + width]);
            counts.extend((0..width).map(|i| a[i] + b[i] + c[i] + d[i]));
        }
        Patch { window: self.window, counts }
    }

    /// Whether rays landed outside the window but inside the sensor.
    pub(super) fn overflows(&self, sensor: (u32, u32)) -> bool {
        let Window { x0, y0, width, height } = self.window;
        let stride = width + 2;
        let row = |row: usize| {
            let places = row * stride..(row + 1) * stride;
            self.planes.iter().any(|plane| plane[places.clone()].iter().any(|&count| count > 0))
        };
        let column = |column: usize| {
            self.planes.iter().any(|plane| (0..height + 2).any(|row| plane[row * stride + column] > 0))
        };
        (x0 > 1 && column(0))
            || (x0 + (width as i64) <= i64::from(sensor.0) && column(width + 1))
            || (y0 > 1 && row(0))
            || (y0 + (height as i64) <= i64::from(sensor.1) && row(height + 1))
    }
}

/// Counts one ray at each of `places`, whose number is a multiple of [`PLANES`].
#[inline(always)]
pub(super) fn count([a, b, c, d]: &mut [&mut [u32]; PLANES], places: &[u32]) {
    for &[i, j, k, l] in places.as_chunks::<PLANES>().0 {
        a[i as usize] += 1;
        b[j as usize] += 1;
        c[k as usize] += 1;
        d[l as usize] += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_beyond_the_window_show_unless_the_sensor_ends_there() {
        let sensor = (10, 8);
        let window = Window { x0: 3, y0: 1, width: 4, height: 8 };
        let overflows = |place: u32| {
            let mut counter = RayCounter::default();
            counter.begin(window, 5.0, 4.0);
            assert_eq!((counter.grid.stride, counter.grid.lost), (6, 60));
            count(&mut counter.planes(), &[place, 60, 60, 60]);
            (counter.overflows(sensor), counter.patch().total())
        };
        // Corner, above, below: the sensor ends above and below, but not left and right.
        assert_eq!([0, 1, 56].map(overflows), [(true, 0), (false, 0), (false, 0)]);
        // Left, right, inside, lost.
        assert_eq!([12, 17, 13, 60].map(overflows), [(true, 0), (true, 0), (false, 1), (false, 0)]);
    }

    #[test]
    fn counts_of_all_planes_add_up() {
        let mut counter = RayCounter::default();
        counter.begin(Window { x0: 1, y0: 1, width: 2, height: 1 }, 1.0, 1.0);
        count(&mut counter.planes(), &[5, 5, 5, 5, 6, 5, 12, 12]);
        assert_eq!(counter.patch().counts, [5, 1]);
    }
}
