//! Direct computation of the image of a particle: light on square pixels at the nodes of a grid, as an
//! integral over the aperture.
//!
//! The aperture is divided into the cells of a polar grid. Each cell contributes a subaperture image
//! (`subaperture`) of the particle surface, centered where the cell images the centroid of that surface.
//! Caustics, where adjacent cells land on the same position and the irradiance is infinite, are thus
//! integrated correctly, and the surface, whose images overlap, need not be traced point by point. A
//! subaperture image includes the spread of a point by its cell, so that adjacent cells join without gaps.
//! Subaperture images are computed for some points of the aperture and interpolated between them.

use super::pupil::{Pupil, PupilView, density};
use super::subaperture::SubapertureImage;
use super::surface::EmittingSurface;
use crate::render::image_sum::LANES;
use crate::render::instructions::InstructionSet;

/// Resolution of the computation of an image: at 1 the error is about 1/1000 of the peak; it is inversely
/// proportional to the fineness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fineness(pub(super) f64);

/// A grid of nodes with equal spacing along columns and rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    /// Nodes per px.
    pub(super) per_px: usize,
    /// Position of the first node relative to the particle, px.
    pub(super) first_px: [f64; 2],
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl Grid {
    /// The grid symmetric about the particle whose quadrant, axes included, has these numbers of columns and
    /// rows.
    pub(super) fn about(per_px: usize, columns: usize, rows: usize) -> Grid {
        let first = |n: usize| -((n - 1) as f64) / per_px as f64;
        Grid { per_px, first_px: [first(columns), first(rows)], columns: 2 * columns - 1, rows: 2 * rows - 1 }
    }

    /// Distance of the farthest node from the particle along columns and along rows, px.
    fn sides_px(&self) -> [f64; 2] {
        let side = |axis: usize, n: usize| {
            let first = self.first_px[axis];
            first.abs().max((first + (n - 1) as f64 / self.per_px as f64).abs())
        };
        [side(0, self.columns), side(1, self.rows)]
    }
}

/// The part of the aperture over which the integral is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum PupilPart {
    /// Azimuths of the first quadrant, for images that are folded afterwards.
    Quadrant,
    Whole,
}

/// A particle surface, its depth (um), the optics, and the grid on which the image is computed.
pub(super) struct ApertureIntegral<'a> {
    pub(super) pupil: &'a Pupil,
    pub(super) z_um: f64,
    pub(super) surface: &'a EmittingSurface,
    pub(super) grid: Grid,
}

impl ApertureIntegral<'_> {
    /// Number of aperture cells that contribute light to the grid, to within a few percent.
    pub(super) fn cells(&self, part: PupilPart, fineness: Fineness) -> f64 {
        const RINGS: usize = 64;
        let ApertureIntegral { pupil, z_um, surface, grid } = *self;
        let steps = PupilSampling::new(pupil, z_um, surface, &grid, part, fineness);
        let per_ring: f64 = (0..RINGS)
            .filter_map(|i| {
                let q = (i as f64 + 0.5) * steps.reach_um / RINGS as f64;
                let ring = PupilRing::new(pupil, z_um, surface, q)?;
                let ring_cells = steps.cells_in_ring(&ring);
                let (first, last) =
                    ring.cells_within(grid.sides_px(), steps.turn / ring_cells as f64, ring_cells);
                Some(last.saturating_sub(first) as f64)
            })
            .sum();
        per_ring / RINGS as f64 * steps.cells as f64
    }

    /// Light on a pixel at each node, row by row, as a fraction of the light that the particle emits toward
    /// the lens side.
    pub(super) fn light(
        &self,
        part: PupilPart,
        fineness: Fineness,
        instructions: InstructionSet,
    ) -> Vec<f32> {
        let ApertureIntegral { pupil, z_um, surface, grid } = *self;
        let steps = PupilSampling::new(pupil, z_um, surface, &grid, part, fineness);
        let subimages = SubapertureImages::new(pupil, z_um, surface, &grid, &steps);
        let accumulator = Accumulator::new(grid, steps.fine, subimages.size);
        instructions
            .dispatch(SumSubapertures {
                pupil,
                z_um,
                surface,
                steps: &steps,
                subimages: &subimages,
                accumulator,
            })
            .nodes()
    }
}

/// The loop over aperture cells, compiled for every instruction set.
struct SumSubapertures<'a> {
    pupil: &'a Pupil,
    z_um: f64,
    surface: &'a EmittingSurface,
    steps: &'a PupilSampling,
    subimages: &'a SubapertureImages,
    accumulator: Accumulator,
}

impl pulp::WithSimd for SumSubapertures<'_> {
    type Output = Accumulator;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Accumulator {
        let SumSubapertures { pupil, z_um, surface, steps, subimages, mut accumulator } = self;
        let distance = pupil.distance(z_um) + surface.centroid[0];
        let width = steps.reach_um / steps.cells as f64;
        for cell in 0..steps.cells {
            let q = (cell as f64 + 0.5) * width;
            let Some(ring) = PupilRing::new(pupil, z_um, surface, q) else { continue };
            let ring_cells = steps.cells_in_ring(&ring);
            let angle = steps.turn / ring_cells as f64;
            let area = width * q * angle;
            let zone = q / steps.reach_um * steps.zones as f64;
            let (mut sine, mut cosine) = libm::sincos(0.5 * angle);
            let (step_sine, step_cosine) = libm::sincos(angle);
            let (first, last) = if steps.quarters == 1 {
                ring.cells_within(accumulator.reach_px(), angle, ring_cells)
            } else {
                (0, ring_cells)
            };
            if first > 0 {
                (sine, cosine) = libm::sincos((first as f64 + 0.5) * angle);
            }
            for part in first..last {
                let sector = (part as f64 + 0.5) * steps.sectors as f64 / ring_cells as f64;
                let place = ring.place(pupil, z_um, surface, [cosine, sine]);
                if let (Some(subimages), Some(place)) = (subimages.around(zone, sector), place) {
                    let light = density(distance, surface.offset2(q, [cosine, sine])) * area;
                    accumulator.add(subimages, place, light);
                }
                (cosine, sine) =
                    (cosine * step_cosine - sine * step_sine, sine * step_cosine + cosine * step_sine);
            }
        }
        accumulator
    }
}

/// Discretization of the aperture.
struct PupilSampling {
    /// Radius in the lens plane beyond which no light lands on the grid, um.
    reach_um: f64,
    /// Number of quadrants used; `turn` is their range of azimuths, rad.
    quarters: usize,
    turn: f64,
    /// Number of subaperture images along the radius (0 to `reach_um`) and along the azimuth (`turn`).
    zones: usize,
    sectors: usize,
    /// Number of cells along the radius.
    cells: usize,
    /// Distance between landing positions along a ring, px.
    part_px: f64,
    /// Fine steps of subaperture images per px.
    fine: usize,
}

/// Distance between landing positions at fineness 1, in diameters of the geometric image of the particle.
const PART: f64 = 0.12;
/// Subaperture images along the radius and a quadrant's azimuth at fineness 1.
const ZONES: f64 = 3.0;

impl PupilSampling {
    fn new(
        pupil: &Pupil,
        z_um: f64,
        surface: &EmittingSurface,
        grid: &Grid,
        part: PupilPart,
        Fineness(finer): Fineness,
    ) -> PupilSampling {
        let [x, y] = grid.sides_px();
        let farthest_px = if pupil.system.cylinder.is_some() {
            [x + 1.0, y + 1.0]
        } else {
            [libm::sqrt(x * x + y * y) + 1.0; 2]
        };
        // For a slender particle the smaller extent is relevant.
        let image_px = pupil.image_px(z_um, surface.least_radius_um);
        let reach_um = pupil.useful_radius(z_um, surface.radius_um, farthest_px);
        let part_px = PART * image_px.clamp(0.3, 12.0) / finer;
        const STOPS: usize = 64;
        let rings =
            (0..=STOPS).map(|i| PupilRing::new(pupil, z_um, surface, reach_um * i as f64 / STOPS as f64));
        let axes: Vec<[f64; 2]> = rings.flatten().map(|ring| ring.axes).collect();
        let fastest = axes.windows(2).fold(0.0f64, |fastest, pair| {
            fastest.max((pair[1][0] - pair[0][0]).abs()).max((pair[1][1] - pair[0][1]).abs())
        });
        let cells = libm::ceil(fastest * STOPS as f64 / part_px);
        let zones = libm::ceil(ZONES * libm::sqrt(finer)).clamp(2.0, 12.0) as usize;
        let quarters = if part == PupilPart::Quadrant { 1 } else { 4 };
        // Images of small particles have sharp edges.
        let fine = if image_px > 8.0 { 8 } else { 16 };
        PupilSampling {
            reach_um,
            quarters,
            turn: 0.5 * std::f64::consts::PI * quarters as f64,
            zones,
            sectors: zones * quarters,
            cells: cells.max(zones as f64) as usize,
            part_px,
            fine: fine.max(2 * grid.per_px),
        }
    }

    /// Number of cells in a ring.
    fn cells_in_ring(&self, ring: &PupilRing) -> usize {
        let ring_cells = libm::ceil(ring.radius_px() * self.turn / self.part_px) as usize;
        ring_cells.max(2 * self.sectors)
    }
}

/// Subaperture images at the nodes of a polar grid in the aperture.
struct SubapertureImages {
    subimages: Vec<Option<SubapertureImage>>,
    sectors: usize,
    /// Columns and rows, the same for all images.
    size: [usize; 2],
}

impl SubapertureImages {
    fn new(
        pupil: &Pupil,
        z_um: f64,
        surface: &EmittingSurface,
        grid: &Grid,
        steps: &PupilSampling,
    ) -> SubapertureImages {
        let seen: Vec<Option<SubapertureView>> = (0..=steps.zones)
            .flat_map(|zone| (0..=steps.sectors).map(move |sector| (zone, sector)))
            .map(|(zone, sector)| {
                let q = zone as f64 * steps.reach_um / steps.zones as f64;
                let (sine, cosine) = libm::sincos(sector as f64 * steps.turn / steps.sectors as f64);
                let view = pupil.view(z_um, surface.radius_um, [q * cosine, q * sine])?;
                // The area over which a cell spreads the image of a point.
                let ring = PupilRing::new(pupil, z_um, surface, q)?;
                let width = steps.reach_um / steps.cells as f64;
                let inner = PupilRing::new(pupil, z_um, surface, (q - width).max(0.0))?;
                let along = width / (q - inner.q).max(width);
                let angle = steps.turn / steps.cells_in_ring(&ring) as f64;
                let footprint = [
                    [
                        (ring.axes[0] - inner.axes[0]) * along * cosine,
                        (ring.axes[1] - inner.axes[1]) * along * sine,
                    ],
                    [-ring.axes[0] * sine * angle, ring.axes[1] * cosine * angle],
                ];
                Some(SubapertureView { q: [q * cosine, q * sine], view, footprint })
            })
            .collect();
        let half = seen.iter().flatten().fold([0; 2], |half: [i64; 2], seen| {
            let more = SubapertureImage::half(surface, &seen.view, seen.footprint, steps.fine);
            [half[0].max(more[0]), half[1].max(more[1])]
        });
        let distance = pupil.distance(z_um);
        let scale = (grid.per_px, steps.fine);
        let subimage = |seen: &SubapertureView| {
            SubapertureImage::new(surface, &seen.view, distance, seen.q, scale, seen.footprint, half)
        };
        let subimages: Vec<Option<SubapertureImage>> =
            seen.iter().map(|seen| seen.as_ref().map(subimage)).collect();
        let size =
            subimages.iter().flatten().next().map_or([0; 2], |subimage| [subimage.columns, subimage.rows]);
        SubapertureImages { subimages, sectors: steps.sectors, size }
    }

    /// The four subaperture images around a point of the aperture, in units of zones and sectors, and their
    /// weights in bilinear interpolation.
    #[inline(always)]
    fn around(&self, zone: f64, sector: f64) -> Option<[(&SubapertureImage, f64); 4]> {
        let k = (sector as usize).min(self.sectors - 1);
        let (u, v) = (zone - libm::floor(zone), sector - k as f64);
        let inner = &self.subimages[zone as usize * (self.sectors + 1) + k..];
        let [a, b] = [inner[0].as_ref()?, inner[1].as_ref()?];
        let outer = &inner[self.sectors + 1..];
        let [c, d] = [outer[0].as_ref()?, outer[1].as_ref()?];
        Some([(a, (1.0 - u) * (1.0 - v)), (b, (1.0 - u) * v), (c, u * (1.0 - v)), (d, u * v)])
    }
}

/// The view of the particle through one point of the lens.
struct SubapertureView {
    q: [f64; 2],
    view: PupilView,
    /// Two sides of the parallelogram over which a cell spreads the light of a point, px.
    footprint: [[f64; 2]; 2],
}

/// The aperture cells at one distance from the axis.
struct PupilRing {
    q: f64,
    /// Landing positions (px) of the centroid through the cells on the two axes, if the centroid is on the
    /// optical axis: for spherical and cylindrical lenses all others follow from these two.
    axes: [f64; 2],
}

impl PupilRing {
    fn new(pupil: &Pupil, z_um: f64, surface: &EmittingSurface, q: f64) -> Option<PupilRing> {
        let center = [surface.centroid[0], 0.0, 0.0];
        let x = pupil.landing(z_um, center, [q, 0.0])?[0];
        let y = pupil.landing(z_um, center, [0.0, q])?[1];
        Some(PupilRing { q, axes: [x, y] })
    }

    /// Range of the cells of the first quadrant (`cells` cells of this angle, rad) that may land within the
    /// distances `[x, y]` (px) along the two axes.
    fn cells_within(&self, [x, y]: [f64; 2], angle: f64, cells: usize) -> (usize, usize) {
        let share = |reach: f64, axis: f64| reach / axis.abs().max(reach);
        let (low, high) = (libm::acos(share(x, self.axes[0])), libm::asin(share(y, self.axes[1])));
        let first = (low / angle) as usize;
        (first.min(cells), ((high / angle) as usize + 1).min(cells))
    }

    fn radius_px(&self) -> f64 {
        self.axes[0].abs().max(self.axes[1].abs())
    }

    /// Landing position (px) of the centroid through the cell at this azimuth (cosine, sine).
    #[inline(always)]
    fn place(
        &self,
        pupil: &Pupil,
        z_um: f64,
        surface: &EmittingSurface,
        azimuth: [f64; 2],
    ) -> Option<[f64; 2]> {
        if surface.mirrored {
            return Some([self.axes[0] * azimuth[0], self.axes[1] * azimuth[1]]);
        }
        pupil.landing(z_um, surface.centroid, azimuth.map(|a| a * self.q))
    }
}

/// The sums at the nodes, with a margin for subaperture images at the edge.
struct Accumulator {
    grid: Grid,
    /// Fine steps per px.
    fine: usize,
    margin: usize,
    stride: usize,
    height: usize,
    values: Vec<f32>,
}

impl Accumulator {
    fn new(grid: Grid, fine: usize, subimage: [usize; 2]) -> Accumulator {
        let margin = subimage[0].max(subimage[1]) + 1;
        let (stride, height) = (grid.columns + 2 * margin, grid.rows + 2 * margin);
        Accumulator { grid, fine, margin, stride, height, values: vec![0.0; stride * height] }
    }

    /// Distances (px) from the particle along the two axes beyond which light contributes to no node.
    fn reach_px(&self) -> [f64; 2] {
        self.grid.sides_px().map(|side| side + self.margin as f64 / self.grid.per_px as f64)
    }

    /// Adds an interpolated subaperture image centered on `place` (px, relative to the particle).
    #[inline(always)]
    fn add(&mut self, subimages: [(&SubapertureImage, f64); 4], place: [f64; 2], light: f64) {
        let subimage = subimages[0].0;
        let phases = subimage.phases as i64;
        // Fine steps from the first node of the margin to the first position of the subaperture image.
        let first = [0, 1].map(|axis| {
            let steps = (place[axis] - self.grid.first_px[axis]) * self.fine as f64;
            libm::floor(steps + 0.5) as i64 - subimage.half[axis] + self.margin as i64 * phases
        });
        if first[0] < 0 || first[1] < 0 {
            return;
        }
        let node = first.map(|f| (f + phases - 1) / phases);
        let phase = [0, 1].map(|axis| (node[axis] * phases - first[axis]) as usize);
        let [column, row] = node.map(|n| n as usize);
        if column + subimage.columns > self.stride || row + subimage.rows > self.height {
            return;
        }
        let weights = subimages.map(|(_, weight)| (weight * light) as f32);
        let images = subimages.map(|(subimage, _)| subimage.image(phase[0], phase[1]));
        for k in 0..subimage.rows {
            let out = &mut self.values[(row + k) * self.stride + column..][..subimage.columns];
            let [a, b, c, d] =
                images.map(|image| image[k * subimage.columns..][..subimage.columns].as_chunks::<LANES>().0);
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

/// The quadrant, axes first, of a grid symmetric about the particle, with the light of all four mirror
/// images.
pub(super) fn fold(values: &[f32], columns: usize, rows: usize) -> Vec<f64> {
    let wide = 2 * columns - 1;
    let at = |row: usize, column: usize| f64::from(values[row * wide + column]);
    let (cx, cy) = (columns - 1, rows - 1);
    (0..rows)
        .flat_map(|j| (0..columns).map(move |i| (i, j)))
        .map(|(i, j)| at(cy - j, cx - i) + at(cy - j, cx + i) + at(cy + j, cx - i) + at(cy + j, cx + i))
        .collect()
}
