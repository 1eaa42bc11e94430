//! Direct computation of the image of a particle: light on square pixels at the nodes of a grid, as an
//! integral over the aperture.
//!
//! The aperture is divided into the cells of a polar grid. Each cell contributes a subaperture image
//! (`subaperture`) of the particle surface, centered where the cell images the centroid of that surface.
//! Caustics, where adjacent cells land on the same position and the irradiance is infinite, are thus
//! integrated correctly, and the surface, whose images overlap, need not be traced point by point. A
//! subaperture image includes the spread of a point by its cell, so that adjacent cells join without gaps.
//! Subaperture images are computed for some points of the aperture and interpolated between them.

use super::accumulator::{self, Accumulator, Cell, Grid};
use super::pupil::{Pupil, PupilView, density};
use super::subaperture::{Buffers, SeenPoints, SubapertureImage, SubapertureLayout};
use super::surface::EmittingSurface;
use crate::render::instructions::InstructionSet;

/// Resolution of the computation of an image: at 1 the error is about 1/1000 of the peak; it is inversely
/// proportional to the fineness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fineness(pub(super) f64);

impl Fineness {
    /// The resolution of a sum over the aperture from which refinement starts for a tolerance relative to the
    /// peak.
    pub(super) fn first(tolerance: f64) -> Fineness {
        Fineness(libm::sqrt(1e-3 / tolerance).clamp(0.5, 4.0))
    }

    /// The resolution of the image of a spheroid: finer than where refinement starts, as nothing refines it.
    pub(super) fn for_spheroid(tolerance: f64) -> Fineness {
        Fineness(1.5 * libm::sqrt(1e-3 / tolerance).clamp(0.2, 4.0))
    }

    /// Whether an image is coarser than any from which refinement starts: a draft for a fit.
    pub(super) fn is_coarse(self) -> bool {
        self.0 < 0.5
    }

    /// The number of fine steps or source points, given that for images of moderate accuracy.
    pub(super) fn scaled(self, number: usize) -> usize {
        match self.0 {
            _ if self.is_coarse() => number / 2,
            fineness if fineness < 1.4 => number,
            _ => 2 * number,
        }
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
    pub(super) buffers: &'a Buffers,
}

impl ApertureIntegral<'_> {
    /// Number of aperture cells that contribute light to the grid, to within a few percent.
    pub(super) fn cells(&self, part: PupilPart, fineness: Fineness) -> f64 {
        const RINGS: usize = 64;
        let ApertureIntegral { pupil, z_um, surface, grid, .. } = *self;
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
        let ApertureIntegral { pupil, z_um, surface, grid, .. } = *self;
        let steps = PupilSampling::new(pupil, z_um, surface, &grid, part, fineness);
        instructions.dispatch(SumSubapertures { integral: self, steps: &steps })
    }
}

/// Number of cells in memory, apart from one ring.
const CELLS: usize = 1 << 16;

/// Subaperture images and the sum over aperture cells, compiled for every instruction set.
struct SumSubapertures<'a> {
    integral: &'a ApertureIntegral<'a>,
    steps: &'a PupilSampling,
}

impl pulp::WithSimd for SumSubapertures<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Vec<f32> {
        let SumSubapertures { integral, steps } = self;
        let ApertureIntegral { pupil, z_um, surface, grid, buffers } = *integral;
        let subimages = SubapertureImages::new(integral, steps);
        let sections = [steps.zones, steps.sectors];
        let mut accumulator = Accumulator::new(grid, subimages.layout, sections, buffers);
        let mut cells = Vec::new();
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
            if cells.len() >= CELLS {
                subimages.add_all(&mut accumulator, &mut cells);
            }
            let mut dither = Dither::for_ring(cell);
            for part in first..last {
                let sector = (part as f64 + 0.5) * steps.sectors as f64 / ring_cells as f64;
                if let Some(place) = ring.place(pupil, z_um, surface, [cosine, sine]) {
                    let light = density(distance, surface.offset2(q, [cosine, sine])) * area;
                    cells.extend(accumulator.cell([zone, sector], place, light, dither.next()));
                }
                (cosine, sine) =
                    (cosine * step_cosine - sine * step_sine, sine * step_cosine + cosine * step_sine);
            }
        }
        subimages.add_all(&mut accumulator, &mut cells);
        accumulator.nodes()
    }
}

/// Positions of subaperture images are rounded to whole fine steps up or down by low-discrepancy sequences
/// over rings and over the cells of a ring, so that on average they are right. Rounded to nearest, regularly
/// spaced cells would beat with the steps.
struct Dither([f64; 2]);

impl Dither {
    /// Strides from ring to ring and from cell to cell, along columns and along rows: inverse powers of the
    /// real root of x^3 = x + 1, the golden ratio and sqrt(2) - 1.
    const RINGS: [f64; 2] = [0.754_877_666_246_692_8, 0.618_033_988_749_894_9];
    const CELLS: [f64; 2] = [0.569_840_290_998_053_3, 0.414_213_562_373_095_1];

    /// The sequence of a ring.
    fn for_ring(number: usize) -> Dither {
        let [x, y] = Self::RINGS.map(|stride| number as f64 * stride);
        Dither([x - libm::floor(x), y - libm::floor(y)])
    }

    #[inline(always)]
    fn next(&mut self) -> [f64; 2] {
        for (at, stride) in self.0.iter_mut().zip(Self::CELLS) {
            *at += stride;
            *at -= if *at >= 1.0 { 1.0 } else { 0.0 };
        }
        self.0
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
const ZONES: f64 = 4.8;

impl PupilSampling {
    fn new(
        pupil: &Pupil,
        z_um: f64,
        surface: &EmittingSurface,
        grid: &Grid,
        part: PupilPart,
        fineness: Fineness,
    ) -> PupilSampling {
        let Fineness(finer) = fineness;
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
        let fine = fineness.scaled(if image_px > 8.0 { 8 } else { 16 });
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

    fn cells_in_ring(&self, ring: &PupilRing) -> usize {
        let ring_cells = libm::ceil(ring.radius_px() * self.turn / self.part_px) as usize;
        ring_cells.max(2 * self.sectors)
    }
}

/// Subaperture images at the nodes of a polar grid in the aperture.
struct SubapertureImages<'b> {
    subimages: Vec<Option<SubapertureImage<'b>>>,
    sectors: usize,
    layout: SubapertureLayout,
}

impl<'b> SubapertureImages<'b> {
    #[inline(always)]
    fn new(integral: &ApertureIntegral<'b>, steps: &PupilSampling) -> SubapertureImages<'b> {
        let ApertureIntegral { pupil, z_um, surface, grid, buffers } = *integral;
        let distance = pupil.distance(z_um);
        let mut views = Vec::with_capacity((steps.zones + 1) * (steps.sectors + 1));
        // Loops, as adapters of iterators would not be compiled for the instruction set.
        for zone in 0..=steps.zones {
            for sector in 0..=steps.sectors {
                views.push(match SubapertureView::at(pupil, z_um, surface, steps, (zone, sector)) {
                    Some((view, footprint)) => {
                        let points = SeenPoints::new(surface, &view, distance, buffers);
                        Some(SubapertureView { points, footprint })
                    }
                    None => None,
                });
            }
        }
        let half = views.iter().flatten().fold([0; 2], |half: [i64; 2], view| {
            let more = view.points.half(view.footprint, steps.fine);
            [half[0].max(more[0]), half[1].max(more[1])]
        });
        let layout = SubapertureLayout::new(half, grid.per_px, steps.fine);
        let mut subimages = Vec::with_capacity(views.len());
        for view in &views {
            let mut image = None;
            if let Some(SubapertureView { points, footprint }) = view {
                image = Some(SubapertureImage::new(points, *footprint, layout, buffers));
            }
            subimages.push(image);
        }
        SubapertureImages { subimages, sectors: steps.sectors, layout }
    }

    /// Adds the images of all cells, and removes the cells.
    #[inline(always)]
    fn add_all(&self, accumulator: &mut Accumulator<'_>, cells: &mut Vec<Cell>) {
        for cells in accumulator::sorted(cells).chunk_by(|a, b| a.images == b.images) {
            let [zone, sector, phase_y, phase_x] = cells[0].images.map(usize::from);
            let Some(four) = self.around(zone, sector) else { continue };
            accumulator.add(four.map(|subimage| subimage.image(phase_x, phase_y)), cells);
        }
        cells.clear();
    }

    /// The four subaperture images at the corners of a sector of a zone; `None` if rays of one are lost.
    fn around(&self, zone: usize, sector: usize) -> Option<[&SubapertureImage<'b>; 4]> {
        let inner = &self.subimages[zone * (self.sectors + 1) + sector..];
        let outer = &inner[self.sectors + 1..];
        Some([inner[0].as_ref()?, inner[1].as_ref()?, outer[0].as_ref()?, outer[1].as_ref()?])
    }
}

/// The view of the particle through one point of the lens.
struct SubapertureView<'b> {
    points: SeenPoints<'b>,
    /// Two sides of the parallelogram over which a cell spreads the light of a point, px.
    footprint: [[f64; 2]; 2],
}

impl SubapertureView<'_> {
    /// View and footprint at a node of the polar grid. `None`: the ray is lost.
    fn at(
        pupil: &Pupil,
        z_um: f64,
        surface: &EmittingSurface,
        steps: &PupilSampling,
        (zone, sector): (usize, usize),
    ) -> Option<(PupilView, [[f64; 2]; 2])> {
        let q = zone as f64 * steps.reach_um / steps.zones as f64;
        let (sine, cosine) = libm::sincos(sector as f64 * steps.turn / steps.sectors as f64);
        let view = pupil.view(z_um, surface.radius_um, [q * cosine, q * sine])?;
        let ring = PupilRing::new(pupil, z_um, surface, q)?;
        let width = steps.reach_um / steps.cells as f64;
        let inner = PupilRing::new(pupil, z_um, surface, (q - width).max(0.0))?;
        let along = width / (q - inner.q).max(width);
        let angle = steps.turn / steps.cells_in_ring(&ring) as f64;
        let footprint = [
            [(ring.axes[0] - inner.axes[0]) * along * cosine, (ring.axes[1] - inner.axes[1]) * along * sine],
            [-ring.axes[0] * sine * angle, ring.axes[1] * cosine * angle],
        ];
        Some((view, footprint))
    }
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
