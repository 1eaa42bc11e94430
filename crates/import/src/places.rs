//! Places of calibration stacks in the field of view: the centers of equal rectangles, and which particles
//! belong to which.

/// A grid of places over the images.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Places {
    /// Places along each side.
    pub(crate) side: usize,
    /// Width and height of the images, px.
    pub(crate) size: (usize, usize),
}

impl Places {
    /// Number of places.
    pub(crate) fn len(&self) -> usize {
        self.side * self.side
    }

    /// Center of a place, px from 0.
    pub(crate) fn center(&self, place: usize) -> [f64; 2] {
        let along = |i: usize, size: usize| size as f64 * (i as f64 + 0.5) / self.side as f64 - 0.5;
        [along(place % self.side, self.size.0), along(place / self.side, self.size.1)]
    }

    /// The place whose rectangle contains a position.
    pub(crate) fn of(&self, at: [f64; 2]) -> usize {
        let along = |v: f64, size: usize| {
            (((v + 0.5) / size as f64 * self.side as f64).max(0.0) as usize).min(self.side - 1)
        };
        along(at[1], self.size.1) * self.side + along(at[0], self.size.0)
    }

    /// Indices of positions in the rectangle of a place, nearest to its center first.
    pub(crate) fn nearest(&self, place: usize, positions: &[[f64; 2]]) -> Vec<usize> {
        let center = self.center(place);
        let away = |i: &usize| (positions[*i][0] - center[0]).hypot(positions[*i][1] - center[1]);
        let mut inside: Vec<usize> =
            (0..positions.len()).filter(|i| self.of(positions[*i]) == place).collect();
        inside.sort_by(|a, b| away(a).total_cmp(&away(b)));
        inside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_belong_to_the_place_around_them() {
        let places = Places { side: 3, size: (300, 150) };
        assert_eq!(places.center(4), [149.5, 74.5]);
        for place in 0..places.len() {
            assert_eq!(places.of(places.center(place)), place);
        }
        assert_eq!((places.of([-0.5, -0.5]), places.of([299.4, 149.4])), (0, 8));
        assert_eq!(places.nearest(0, &[[10.0, 10.0], [40.0, 30.0], [200.0, 10.0]]), [1, 0]);
    }
}
