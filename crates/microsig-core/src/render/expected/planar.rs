//! Light on the pixels of one quadrant: the image of a sphere behind a spherical and a cylindrical lens, which is the
//! same in all four.
//!
//! A small piece of the lens and a small piece of the particle's surface make a bundle of rays that fills a small patch
//! of the sensor. Each bundle is spread evenly over a rectangle with the patch's variances along columns and rows, so
//! that caustics are integrated and nothing depends on where single rays fall.

use super::encircled::Fineness;
use super::pupil::{Pupil, View, density};

/// Cells of the sensor's quadrant about the particle's image, and the nodes of pixel centres on their corners.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Quadrant {
    /// Cells per px, even.
    pub(super) per_px: usize,
    /// Pixel centres at the columns k / per_px.
    pub(super) columns: usize,
    /// Likewise rows.
    pub(super) rows: usize,
}

/// Light on a pixel at each node of the quadrant, row by row, as a share of all light that the particle sends toward the
/// lens side.
pub(super) fn pixels(
    pupil: &Pupil,
    z_um: f64,
    radius_um: f64,
    quadrant: Quadrant,
    fineness: Fineness,
) -> Vec<f64> {
    let mut cells = Cells::new(quadrant);
    let bundles = Bundles::new(pupil, z_um, radius_um, quadrant, fineness);
    let sources = surface(radius_um, bundles.sources);
    let part = radius_um * libm::sqrt(2.0 * std::f64::consts::PI / sources.len() as f64);
    let scale = quadrant.per_px as f64;
    for piece in &bundles.pieces {
        let View { landing, by_e1, by_e2, by_e3 } = piece.view;
        let width = [0, 1].map(|axis| {
            let slope2 = by_e1[axis] * by_e1[axis] + by_e2[axis] * by_e2[axis] + by_e3[axis] * by_e3[axis];
            // Of a piece of surface, two thirds of its extent squared lie along any one direction, on average.
            libm::sqrt(piece.width2[axis] + slope2 * part * part * (2.0 / 3.0)) * scale
        });
        for &[e1, e2, e3] in &sources {
            let place = [0, 1]
                .map(|axis| (landing[axis] + by_e1[axis] * e1 + by_e2[axis] * e2 + by_e3[axis] * e3) * scale);
            let offset2 = (piece.q[0] - e2) * (piece.q[0] - e2) + (piece.q[1] - e3) * (piece.q[1] - e3);
            let light = density(bundles.distance + e1, offset2) * piece.area / sources.len() as f64;
            cells.spread(place, width, light);
        }
    }
    cells.pixels()
}

/// Points even in area over the hemisphere toward the lens, in internal axes, um.
fn surface(radius_um: f64, n: usize) -> Vec<[f64; 3]> {
    // A point has no size.
    let n = if radius_um == 0.0 { 1 } else { n };
    (0..n)
        .map(|k| {
            let depth = (k as f64 + 0.5) / n as f64;
            let (sine, cosine) = libm::sincos(crate::emission::golden_azimuth(k));
            let offset = radius_um * libm::sqrt(1.0 - depth * depth);
            [-radius_um * depth, offset * cosine, offset * sine]
        })
        .collect()
}

/// A piece of the lens.
struct Piece {
    q: [f64; 2],
    /// All four quadrants' area, um^2.
    area: f64,
    view: View,
    /// Extent of its image of a point along columns and rows, squared, px^2.
    width2: [f64; 2],
}

struct Bundles {
    pieces: Vec<Piece>,
    sources: usize,
    distance: f64,
}

impl Bundles {
    fn new(pupil: &Pupil, z_um: f64, radius_um: f64, quadrant: Quadrant, fineness: Fineness) -> Self {
        let Fineness(fine) = fineness;
        let reach = quadrant.columns.max(quadrant.rows) as f64 / quadrant.per_px as f64;
        // Patches of about half a pixel.
        let finer = libm::sqrt(fine as f64);
        let radii = libm::ceil(finer * (12.0 + 1.2 * reach.min(500.0))) as usize;
        let angles = libm::ceil(finer * (8.0 + 0.8 * reach.min(500.0))) as usize;
        let image_radius = radius_um * pupil.system.objective.image_distance
            / pupil.distance(z_um).max(1.0)
            / pupil.pixel_size;
        let sources = fine * (48.0 + 24.0 * image_radius * image_radius).min(1024.0) as usize;

        let step = pupil.aperture() / radii as f64;
        let turn = std::f64::consts::FRAC_PI_2 / angles as f64;
        let at = |i: f64, j: f64| {
            let (sine, cosine) = libm::sincos(j * turn);
            [i * step * cosine, i * step * sine]
        };
        let corner = |i: usize, j: usize| pupil.view(z_um, 0.0, at(i as f64, j as f64)).map(|v| v.landing);
        let corners: Vec<Option<[f64; 2]>> =
            (0..=radii).flat_map(|i| (0..=angles).map(move |j| (i, j))).map(|(i, j)| corner(i, j)).collect();
        let mut pieces = Vec::with_capacity(radii * angles);
        for i in 0..radii {
            for j in 0..angles {
                let ends = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)];
                let [Some(a), Some(b), Some(c), Some(d)] = ends.map(|(i, j)| corners[i * (angles + 1) + j])
                else {
                    continue;
                };
                let q = at(i as f64 + 0.5, j as f64 + 0.5);
                let Some(view) = pupil.view(z_um, radius_um, q) else { continue };
                let width2 = [0, 1].map(|axis| {
                    let along = 0.5 * (b[axis] + d[axis] - a[axis] - c[axis]);
                    let around = 0.5 * (c[axis] + d[axis] - a[axis] - b[axis]);
                    along * along + around * around
                });
                let area = 4.0 * (i as f64 + 0.5) * step * step * turn;
                pieces.push(Piece { q, area, view, width2 });
            }
        }
        Bundles { pieces, sources, distance: pupil.distance(z_um) }
    }
}

/// Light in the cells of a quadrant; what falls in the other three is mirrored into it.
struct Cells {
    quadrant: Quadrant,
    width: usize,
    height: usize,
    light: Vec<f64>,
}

impl Cells {
    fn new(quadrant: Quadrant) -> Self {
        let (width, height) = (quadrant.columns + quadrant.per_px, quadrant.rows + quadrant.per_px);
        Cells { quadrant, width, height, light: vec![0.0; width * height] }
    }

    /// Spreads light evenly over a rectangle, in cells.
    fn spread(&mut self, place: [f64; 2], width: [f64; 2], light: f64) {
        // As it is mirrored anyway, let it begin on the positive side.
        let [x, y] = place.map(f64::abs);
        let [wide, high] = width.map(|w| w.max(1e-3));
        let (x0, x1) = (x - 0.5 * wide, x + 0.5 * wide);
        let (y0, y1) = (y - 0.5 * high, y + 0.5 * high);
        if !(x0 < self.width as f64 && y0 < self.height as f64) {
            return;
        }
        let cells = |low: f64, high: f64| libm::floor(low) as isize..=libm::floor(high) as isize;
        let density = light / (wide * high);
        for row in cells(y0, y1) {
            let inside = y1.min(row as f64 + 1.0) - y0.max(row as f64);
            let row = mirrored(row);
            if row >= self.height {
                continue;
            }
            let line = &mut self.light[row * self.width..][..self.width];
            for column in cells(x0, x1) {
                let part = (x1.min(column as f64 + 1.0) - x0.max(column as f64)) * inside;
                if let Some(cell) = line.get_mut(mirrored(column)) {
                    *cell += density * part;
                }
            }
        }
    }

    /// Sums over the square pixels about the nodes.
    fn pixels(self) -> Vec<f64> {
        let Quadrant { per_px, columns, rows } = self.quadrant;
        let half = (per_px / 2) as isize;
        // A cell holds what fell in four; a pixel's share is the quarter.
        let rowwise: Vec<f64> = self
            .light
            .chunks(self.width)
            .flat_map(|line| {
                (0..columns as isize)
                    .map(move |k| (k - half..k + half).map(|c| line[mirrored(c)]).sum::<f64>() * 0.25)
            })
            .collect();
        (0..rows as isize)
            .flat_map(|k| (0..columns).map(move |column| (k, column)))
            .map(|(k, column)| (k - half..k + half).map(|c| rowwise[mirrored(c) * columns + column]).sum())
            .collect()
    }
}

fn mirrored(cell: isize) -> usize {
    (if cell < 0 { -1 - cell } else { cell }) as usize
}
