//! Counts in the making.
//!
//! A frame of one pixel around a particle's window takes the rays that land beyond it, so that every ray has a place, and
//! a window that is too small shows.

use super::patch::{Patch, Window};

/// Copies of all counts that are filled in turn: neighbouring rays often meet in a pixel, and a count must be written
/// before it can be read again.
pub(super) const PLANES: usize = 4;

/// Places of rays, numbered row by row from the frame's first corner; one more is for those that are lost.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Frame {
    /// Where the particle's centre is, px; the frame's first column and row are 0.
    pub(super) x: f32,
    pub(super) y: f32,
    /// Last column and row.
    pub(super) right: f32,
    pub(super) bottom: f32,
    /// Length of a row.
    pub(super) stride: u32,
    /// The place of lost rays.
    pub(super) lost: u32,
}

/// Counts of one particle's rays.
#[derive(Debug, Clone, Default)]
pub(super) struct Tally {
    window: Window,
    frame: Frame,
    planes: [Vec<u32>; PLANES],
}

impl Tally {
    /// Begins anew, with the particle's place in px.
    pub(super) fn begin(&mut self, window: Window, x_px: f64, y_px: f64) {
        let (stride, rows) = (window.width as u32 + 2, window.height as u32 + 2);
        self.window = window;
        self.frame = Frame {
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

    pub(super) fn frame(&self) -> Frame {
        self.frame
    }

    /// The copies of all counts, to be filled by [`count`].
    pub(super) fn planes(&mut self) -> [&mut [u32]; PLANES] {
        self.planes.each_mut().map(Vec::as_mut_slice)
    }

    /// The counts of the window.
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

    /// Whether rays landed beyond the window where the sensor goes on.
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

/// Counts one ray at each of these places, whose number is a multiple of that of the planes.
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
            let mut tally = Tally::default();
            tally.begin(window, 5.0, 4.0);
            assert_eq!((tally.frame.stride, tally.frame.lost), (6, 60));
            count(&mut tally.planes(), &[place, 60, 60, 60]);
            (tally.overflows(sensor), tally.patch().total())
        };
        // Corner, above, below: the sensor ends above and below, but not left and right.
        assert_eq!([0, 1, 56].map(overflows), [(true, 0), (false, 0), (false, 0)]);
        // Left, right, inside, lost.
        assert_eq!([12, 17, 13, 60].map(overflows), [(true, 0), (true, 0), (false, 1), (false, 0)]);
    }

    #[test]
    fn counts_of_all_planes_add_up() {
        let mut tally = Tally::default();
        tally.begin(Window { x0: 1, y0: 1, width: 2, height: 1 }, 1.0, 1.0);
        count(&mut tally.planes(), &[5, 5, 5, 5, 6, 5, 12, 12]);
        assert_eq!(tally.patch().counts, [5, 1]);
    }
}
