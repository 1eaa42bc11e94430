//! Search for nearby points.

/// A grid of cells over the bounding box of points in a plane; cells are at least as wide as the search radius.
#[derive(Debug)]
pub struct CellGrid<'a> {
    points: &'a [[f64; 2]],
    least: [f64; 2],
    cell: f64,
    columns: usize,
    rows: usize,
    order: Vec<u32>,
    starts: Vec<u32>,
}

impl<'a> CellGrid<'a> {
    /// A grid for searches within a radius of `reach`.
    pub fn new(points: &'a [[f64; 2]], reach: f64) -> Self {
        let bounds = |axis: usize| {
            points
                .iter()
                .map(|p| p[axis])
                .fold((f64::INFINITY, f64::NEG_INFINITY), |b, v| (b.0.min(v), b.1.max(v)))
        };
        let ((x0, x1), (y0, y1)) = (bounds(0), bounds(1));
        let (mut cell, mut columns, mut rows) = (reach, 1, 1);
        if !points.is_empty() {
            // At most about four cells per point, so that a few points far apart do not need much memory.
            let size = |cell: f64| (((x1 - x0) / cell).floor() + 1.0, ((y1 - y0) / cell).floor() + 1.0);
            while size(cell).0 * size(cell).1 > 4.0 * points.len() as f64 + 16.0 {
                cell *= 2.0;
            }
            (columns, rows) = (size(cell).0 as usize, size(cell).1 as usize);
        }
        let (order, starts) = (vec![0; points.len()], vec![0u32; columns * rows + 1]);
        let mut grid = CellGrid { points, least: [x0, y0], cell, columns, rows, order, starts };
        let cells: Vec<u32> = points.iter().map(|p| grid.cell_of(*p) as u32).collect();
        cells.iter().for_each(|&c| grid.starts[c as usize + 1] += 1);
        for i in 0..columns * rows {
            grid.starts[i + 1] += grid.starts[i];
        }
        let mut next = grid.starts.clone();
        for (i, &c) in cells.iter().enumerate() {
            grid.order[next[c as usize] as usize] = i as u32;
            next[c as usize] += 1;
        }
        grid
    }

    fn cell_of(&self, [x, y]: [f64; 2]) -> usize {
        let side = |v: f64, v0: f64, n: usize| (((v - v0) / self.cell) as usize).min(n - 1);
        side(y, self.least[1], self.rows) * self.columns + side(x, self.least[0], self.columns)
    }

    /// Calls `found` with the index of every point in the cells around a position: at least all points within the
    /// reach.
    pub fn around(&self, [x, y]: [f64; 2], mut found: impl FnMut(u32)) {
        let side = |v: f64, v0: f64, n: usize| {
            let at = (v - v0) / self.cell;
            // Positions just outside the grid may be within reach of its border cells.
            (at > -1.000_001 && at < n as f64 + 1.000_001).then(|| {
                let at = at.floor();
                ((at - 1.0).max(0.0) as usize, ((at + 1.0).max(0.0) as usize).min(n - 1))
            })
        };
        let (Some((c0, c1)), Some((r0, r1))) =
            (side(x, self.least[0], self.columns), side(y, self.least[1], self.rows))
        else {
            return;
        };
        for row in r0..=r1 {
            if c0 <= c1 {
                let (from, to) = (row * self.columns + c0, row * self.columns + c1 + 1);
                self.order[self.starts[from] as usize..self.starts[to] as usize]
                    .iter()
                    .for_each(|&i| found(i));
            }
        }
    }

    /// Distance of a point to the nearest other one; `None` if none is within the reach.
    pub fn nearest_other(&self, index: usize, reach: f64) -> Option<f64> {
        let [x, y] = self.points[index];
        let mut best = reach * reach;
        let mut any = false;
        self.around([x, y], |i| {
            let [u, v] = self.points[i as usize];
            let squared = (u - x).powi(2) + (v - y).powi(2);
            if i as usize != index && squared <= best {
                (best, any) = (squared, true);
            }
        });
        any.then(|| best.sqrt())
    }
}
