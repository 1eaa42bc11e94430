//! The image of a particle, computed directly: light on square pixels at the nodes of a grid.
//!
//! The lens is cut into small parts; each throws a stamp (`stamp`) of the particle's surface to the place where it sends
//! the centroid of that surface. So a caustic, where neighbouring parts land on one place and the density of light is
//! infinite, is integrated as it should be, and the surface, whose images overlap, need not be traced point by point.
//! The parts are the cells of a polar grid. A stamp contains what one part spreads a point over, so that neighbouring parts
//! join without gaps. Stamps are made for some points of the lens and interpolated between them.

use super::layout::LANES;
use super::pupil::{Pupil, View, density};
use super::stamp::Stamp;
use super::surface::Surface;
use crate::render::instructions::InstructionSet;

/// How finely an image is computed: errors are about 1/1000 of the peak at 1, and fall in inverse proportion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fineness(pub(super) f64);

/// Nodes at equal steps along columns and rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    /// Nodes per px.
    pub(super) per_px: usize,
    /// Place of the first node relative to the particle, px.
    pub(super) first_px: [f64; 2],
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl Grid {
    /// The grid symmetric about the particle whose quadrant has so many columns and rows, the axes included.
    pub(super) fn about(per_px: usize, columns: usize, rows: usize) -> Grid {
        let first = |n: usize| -((n - 1) as f64) / per_px as f64;
        Grid { per_px, first_px: [first(columns), first(rows)], columns: 2 * columns - 1, rows: 2 * rows - 1 }
    }

    fn farthest_px(&self) -> f64 {
        let side = |axis: usize, n: usize| {
            let first = self.first_px[axis];
            first.abs().max((first + (n - 1) as f64 / self.per_px as f64).abs())
        };
        let (x, y) = (side(0, self.columns), side(1, self.rows));
        libm::sqrt(x * x + y * y)
    }
}

/// The part of the lens that is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Part {
    /// Azimuths of the first quadrant: for what is folded afterwards.
    Quadrant,
    Whole,
}

/// A particle's surface and where its image is computed.
pub(super) struct Exposed<'a> {
    pub(super) pupil: &'a Pupil,
    pub(super) z_um: f64,
    pub(super) surface: &'a Surface,
    pub(super) grid: Grid,
}

impl Exposed<'_> {
    /// Light on a pixel at each node, row by row, as a share of all light that the particle sends toward the lens side.
    pub(super) fn light(&self, part: Part, fineness: Fineness, instructions: InstructionSet) -> Vec<f32> {
        let Exposed { pupil, z_um, surface, grid } = *self;
        let steps = Steps::new(pupil, z_um, surface, &grid, part, fineness);
        let stamps = Stamps::new(pupil, z_um, surface, &grid, &steps);
        let plate = Plate::new(grid, steps.fine, stamps.size);
        instructions
            .dispatch(Exposure { pupil, z_um, surface, steps: &steps, stamps: &stamps, plate })
            .nodes()
    }
}

/// The loop over parts of the lens, compiled for every instruction set.
struct Exposure<'a> {
    pupil: &'a Pupil,
    z_um: f64,
    surface: &'a Surface,
    steps: &'a Steps,
    stamps: &'a Stamps,
    plate: Plate,
}

impl pulp::WithSimd for Exposure<'_> {
    type Output = Plate;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Plate {
        let Exposure { pupil, z_um, surface, steps, stamps, mut plate } = self;
        let distance = pupil.distance(z_um) + surface.centroid[0];
        let width = steps.reach_um / steps.cells as f64;
        for cell in 0..steps.cells {
            let q = (cell as f64 + 0.5) * width;
            let Some(ring) = Ring::new(pupil, z_um, surface, q) else { continue };
            let parts = steps.parts(&ring);
            let angle = steps.turn / parts as f64;
            let area = width * q * angle;
            let zone = q / steps.reach_um * steps.zones as f64;
            let (mut sine, mut cosine) = libm::sincos(0.5 * angle);
            let (step_sine, step_cosine) = libm::sincos(angle);
            for part in 0..parts {
                let sector = (part as f64 + 0.5) * steps.sectors as f64 / parts as f64;
                let place = ring.place(pupil, z_um, surface, [cosine, sine]);
                if let (Some(stamps), Some(place)) = (stamps.around(zone, sector), place) {
                    let light = density(distance, surface.offset2(q, [cosine, sine])) * area;
                    plate.put(stamps, place, light);
                }
                (cosine, sine) =
                    (cosine * step_cosine - sine * step_sine, sine * step_cosine + cosine * step_sine);
            }
        }
        plate
    }
}

/// How the lens is cut.
struct Steps {
    /// Radius in the lens plane beyond which nothing lands on the grid, um.
    reach_um: f64,
    /// The azimuths that are used, rad.
    turn: f64,
    /// Stamps between the axis and `reach_um`, and around `turn`.
    zones: usize,
    sectors: usize,
    /// Cells along the radius.
    cells: usize,
    /// Distance of landing places along a ring, px.
    part_px: f64,
    /// Fine steps of stamps per px.
    fine: usize,
}

/// Distance of landing places at fineness 1, in diameters of the particle's own image.
const PART: f64 = 0.12;
/// Stamps along the radius and a quadrant's azimuth at fineness 1.
const ZONES: f64 = 3.0;

impl Steps {
    fn new(
        pupil: &Pupil,
        z_um: f64,
        surface: &Surface,
        grid: &Grid,
        part: Part,
        Fineness(finer): Fineness,
    ) -> Steps {
        // Of a slender particle the smaller extent counts.
        let image_px = pupil.image_px(z_um, surface.least_radius_um);
        let reach_um = pupil.useful_radius(z_um, surface.radius_um, grid.farthest_px() + 1.0);
        let part_px = PART * image_px.clamp(0.3, 12.0) / finer;
        const STOPS: usize = 64;
        let rings = (0..=STOPS).map(|i| Ring::new(pupil, z_um, surface, reach_um * i as f64 / STOPS as f64));
        let axes: Vec<[f64; 2]> = rings.flatten().map(|ring| ring.axes).collect();
        let fastest = axes.windows(2).fold(0.0f64, |fastest, pair| {
            fastest.max((pair[1][0] - pair[0][0]).abs()).max((pair[1][1] - pair[0][1]).abs())
        });
        let cells = libm::ceil(fastest * STOPS as f64 / part_px);
        let zones = libm::ceil(ZONES * libm::sqrt(finer)).clamp(2.0, 12.0) as usize;
        let quarters = if part == Part::Quadrant { 1 } else { 4 };
        // Images of small particles have sharp edges.
        let fine = if image_px > 8.0 { 8 } else { 16 };
        Steps {
            reach_um,
            turn: 0.5 * std::f64::consts::PI * quarters as f64,
            zones,
            sectors: zones * quarters,
            cells: cells.max(zones as f64) as usize,
            part_px,
            fine: fine.max(2 * grid.per_px),
        }
    }

    /// Parts of a ring.
    fn parts(&self, ring: &Ring) -> usize {
        let parts = libm::ceil(ring.radius_px() * self.turn / self.part_px) as usize;
        parts.max(2 * self.sectors)
    }
}

/// Stamps at the nodes of a polar grid of the lens.
struct Stamps {
    stamps: Vec<Option<Stamp>>,
    sectors: usize,
    /// Columns and rows of all of them.
    size: [usize; 2],
}

impl Stamps {
    fn new(pupil: &Pupil, z_um: f64, surface: &Surface, grid: &Grid, steps: &Steps) -> Stamps {
        let seen: Vec<Option<Seen>> = (0..=steps.zones)
            .flat_map(|zone| (0..=steps.sectors).map(move |sector| (zone, sector)))
            .map(|(zone, sector)| {
                let q = zone as f64 * steps.reach_um / steps.zones as f64;
                let (sine, cosine) = libm::sincos(sector as f64 * steps.turn / steps.sectors as f64);
                let view = pupil.view(z_um, surface.radius_um, [q * cosine, q * sine])?;
                // What a part of the lens spreads a point over.
                let ring = Ring::new(pupil, z_um, surface, q)?;
                let width = steps.reach_um / steps.cells as f64;
                let inner = Ring::new(pupil, z_um, surface, (q - width).max(0.0))?;
                let along = width / (q - inner.q).max(width);
                let angle = steps.turn / steps.parts(&ring) as f64;
                let footprint = [
                    [
                        (ring.axes[0] - inner.axes[0]) * along * cosine,
                        (ring.axes[1] - inner.axes[1]) * along * sine,
                    ],
                    [-ring.axes[0] * sine * angle, ring.axes[1] * cosine * angle],
                ];
                Some(Seen { q: [q * cosine, q * sine], view, footprint })
            })
            .collect();
        let half = seen.iter().flatten().fold([0; 2], |half: [i64; 2], seen| {
            let more = Stamp::half(surface, &seen.view, seen.footprint, steps.fine);
            [half[0].max(more[0]), half[1].max(more[1])]
        });
        let distance = pupil.distance(z_um);
        let scale = (grid.per_px, steps.fine);
        let stamp =
            |seen: &Seen| Stamp::new(surface, &seen.view, distance, seen.q, scale, seen.footprint, half);
        let stamps: Vec<Option<Stamp>> = seen.iter().map(|seen| seen.as_ref().map(stamp)).collect();
        let size = stamps.iter().flatten().next().map_or([0; 2], |stamp| [stamp.columns, stamp.rows]);
        Stamps { stamps, sectors: steps.sectors, size }
    }

    /// The four stamps around a place of the lens, in zones and sectors, and their weights in bilinear interpolation.
    #[inline(always)]
    fn around(&self, zone: f64, sector: f64) -> Option<[(&Stamp, f64); 4]> {
        let k = (sector as usize).min(self.sectors - 1);
        let (u, v) = (zone - libm::floor(zone), sector - k as f64);
        let inner = &self.stamps[zone as usize * (self.sectors + 1) + k..];
        let [a, b] = [inner[0].as_ref()?, inner[1].as_ref()?];
        let outer = &inner[self.sectors + 1..];
        let [c, d] = [outer[0].as_ref()?, outer[1].as_ref()?];
        Some([(a, (1.0 - u) * (1.0 - v)), (b, (1.0 - u) * v), (c, u * (1.0 - v)), (d, u * v)])
    }
}

/// The particle seen through one point of the lens.
struct Seen {
    q: [f64; 2],
    view: View,
    /// Two sides of the parallelogram over which a part of the lens spreads the light of a point, px.
    footprint: [[f64; 2]; 2],
}

/// The parts of the lens at one distance from its middle.
struct Ring {
    q: f64,
    /// Where the parts on the two axes throw the centroid, if that lies on the optical axis, px: behind round lenses and
    /// cylinders all others follow from these two.
    axes: [f64; 2],
}

impl Ring {
    fn new(pupil: &Pupil, z_um: f64, surface: &Surface, q: f64) -> Option<Ring> {
        let centre = [surface.centroid[0], 0.0, 0.0];
        let x = pupil.landing(z_um, centre, [q, 0.0])?[0];
        let y = pupil.landing(z_um, centre, [0.0, q])?[1];
        Some(Ring { q, axes: [x, y] })
    }

    fn radius_px(&self) -> f64 {
        self.axes[0].abs().max(self.axes[1].abs())
    }

    /// Where the part at this azimuth (cosine, sine) throws the centroid, px.
    #[inline(always)]
    fn place(&self, pupil: &Pupil, z_um: f64, surface: &Surface, azimuth: [f64; 2]) -> Option<[f64; 2]> {
        if surface.mirrored {
            return Some([self.axes[0] * azimuth[0], self.axes[1] * azimuth[1]]);
        }
        pupil.landing(z_um, surface.centroid, azimuth.map(|a| a * self.q))
    }
}

/// Nodes with a margin in which stamps at the edge find room.
struct Plate {
    grid: Grid,
    /// Fine steps per px.
    fine: usize,
    margin: usize,
    stride: usize,
    height: usize,
    values: Vec<f32>,
}

impl Plate {
    fn new(grid: Grid, fine: usize, stamp: [usize; 2]) -> Plate {
        let margin = stamp[0].max(stamp[1]) + 1;
        let (stride, height) = (grid.columns + 2 * margin, grid.rows + 2 * margin);
        Plate { grid, fine, margin, stride, height, values: vec![0.0; stride * height] }
    }

    /// Adds a blend of stamps about a place, px from the particle.
    #[inline(always)]
    fn put(&mut self, stamps: [(&Stamp, f64); 4], place: [f64; 2], light: f64) {
        let stamp = stamps[0].0;
        let phases = stamp.phases as i64;
        // Fine steps from the first node of the margin to the stamp's first place.
        let first = [0, 1].map(|axis| {
            let steps = (place[axis] - self.grid.first_px[axis]) * self.fine as f64;
            libm::floor(steps + 0.5) as i64 - stamp.half[axis] + self.margin as i64 * phases
        });
        if first[0] < 0 || first[1] < 0 {
            return;
        }
        let node = first.map(|f| (f + phases - 1) / phases);
        let phase = [0, 1].map(|axis| (node[axis] * phases - first[axis]) as usize);
        let [column, row] = node.map(|n| n as usize);
        if column + stamp.columns > self.stride || row + stamp.rows > self.height {
            return;
        }
        let weights = stamps.map(|(_, weight)| (weight * light) as f32);
        let images = stamps.map(|(stamp, _)| stamp.image(phase[0], phase[1]));
        for k in 0..stamp.rows {
            let out = &mut self.values[(row + k) * self.stride + column..][..stamp.columns];
            let [a, b, c, d] =
                images.map(|image| image[k * stamp.columns..][..stamp.columns].as_chunks::<LANES>().0);
            let out = out.as_chunks_mut::<LANES>().0;
            for ((((out, a), b), c), d) in out.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                let mut sum = *out;
                for i in 0..LANES {
                    sum[i] +=
                        (weights[0] * a[i] + weights[1] * b[i]) + (weights[2] * c[i] + weights[3] * d[i]);
                }
                *out = sum;
            }
        }
    }

    fn nodes(self) -> Vec<f32> {
        let Grid { columns, rows, .. } = self.grid;
        let line = |row: usize| &self.values[(row + self.margin) * self.stride + self.margin..][..columns];
        (0..rows).flat_map(|row| line(row).iter().copied()).collect()
    }
}

/// The quadrant, axes first, of a grid symmetric about the particle, with the light of all four mirror images.
pub(super) fn fold(values: &[f32], columns: usize, rows: usize) -> Vec<f64> {
    let wide = 2 * columns - 1;
    let at = |row: usize, column: usize| f64::from(values[row * wide + column]);
    let (cx, cy) = (columns - 1, rows - 1);
    (0..rows)
        .flat_map(|j| (0..columns).map(move |i| (i, j)))
        .map(|(i, j)| at(cy - j, cx - i) + at(cy - j, cx + i) + at(cy + j, cx - i) + at(cy + j, cx + i))
        .collect()
}
