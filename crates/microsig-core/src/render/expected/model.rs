//! Direct computation of the image of a sphere at any depth at given nodes; depth tables are built from such
//! images.

use super::accumulator::Grid;
use super::aperture_integral::{self, ApertureIntegral, Fineness, PupilPart};
use super::encircled;
use super::pixel_integral::{self, AZIMUTHS};
use super::pupil::Pupil;
use super::radial_layout::RadialLayout;
use super::subaperture::Buffers;
use super::surface::EmittingSurface;
use crate::render::instructions::InstructionSet;
use crate::render::refinement::peak;
use crate::render::spline::{self, SplineDegree};

/// Maximum number of refinements of the resolution.
const FINER: usize = 2;
/// Number of source points of a sphere, before [`Fineness::scaled`].
const POINTS: usize = 2048;

/// Nodes per px at which round images are computed before they are interpolated to the nodes of their plane.
const FIXED_PER_PX: usize = 16;

/// Optics, tolerance and working data for the computation of images.
#[derive(Debug)]
pub(super) struct Model {
    pub(super) pupil: Pupil,
    /// Allowed error, relative to the peak of an image.
    pub(super) tolerance: f64,
    /// Largest relevant distances of pixels from the center of a particle image along the two axes, px.
    pub(super) farthest_px: [f64; 2],
    pub(super) instructions: InstructionSet,
    /// Factor on the number of meridians of round images.
    pub(super) meridians: f64,
    /// Number of steps from the axis to the rim in which the extent of images is found.
    pub(super) reach_steps: u32,
    pub(super) buffers: Buffers,
}

/// A grid of nodes over a quadrant.
#[derive(Debug, Clone, Copy)]
pub(super) struct QuadrantGrid {
    pub(super) per_px: usize,
    pub(super) columns: usize,
    pub(super) rows: usize,
}

/// The nodes at which an image is computed; in a quadrant, twice as many per axis as are stored.
#[derive(Debug, Clone, Copy)]
pub(super) enum SampleNodes {
    /// By azimuth and radius.
    Radial(RadialLayout),
    Quadrant(QuadrantGrid),
}

impl QuadrantGrid {
    /// Twice as many nodes per axis.
    pub(super) fn computed(self) -> QuadrantGrid {
        QuadrantGrid { per_px: 2 * self.per_px, columns: 2 * self.columns, rows: 2 * self.rows }
    }
}

impl SampleNodes {
    pub(super) fn finer(self) -> SampleNodes {
        match self {
            SampleNodes::Radial(rings) => SampleNodes::Radial(rings.finer()),
            SampleNodes::Quadrant(quadrant) => SampleNodes::Quadrant(quadrant.computed()),
        }
    }

    /// Positions of the nodes relative to the particle, px.
    pub(super) fn places(self, z_um: f64) -> Vec<[f64; 2]> {
        match self {
            SampleNodes::Radial(rings) => (0..AZIMUTHS)
                .flat_map(|azimuth| {
                    (0..rings.columns).map(move |k| (pixel_integral::direction(azimuth), k as f64))
                })
                .map(|(direction, k)| direction.map(|d| d * k / rings.per_px(z_um)))
                .collect(),
            SampleNodes::Quadrant(QuadrantGrid { per_px, columns, rows }) => (0..rows)
                .flat_map(|row| (0..columns).map(move |column| [column, row]))
                .map(|node| node.map(|n| n as f64 / per_px as f64))
                .collect(),
        }
    }
}

impl Model {
    /// All that images follow from, in words that say each number to the last digit.
    pub(super) fn parameters(&self) -> String {
        let Model { pupil, tolerance, farthest_px, .. } = self;
        format!("{pupil:?} {tolerance:?} {farthest_px:?}")
    }

    pub(super) fn is_round(&self) -> bool {
        self.pupil.system.cylinder.is_none()
    }

    /// Half width and half height of an image, px.
    pub(super) fn reach(&self, z_um: f64, radius_um: f64) -> [f64; 2] {
        // Half a pixel plus a margin; half its diagonal if the image is round.
        let pixel = if self.is_round() { 0.75 } else { 0.6 };
        self.pupil.reach(z_um, radius_um, self.reach_steps).map(|r| r + pixel)
    }

    /// Motion of the edge of an image with depth, px/um. With a large aperture, light from near the rim lands
    /// far outside; it does not count.
    pub(super) fn edge_px_per_um(&self) -> f64 {
        let objective = &self.pupil.system.objective;
        self.px_per_um() * (objective.aperture_radius / objective.object_distance_0).min(0.3)
    }

    /// Magnification at depth 0, px/um.
    pub(super) fn px_per_um(&self) -> f64 {
        let objective = &self.pupil.system.objective;
        objective.image_distance / objective.object_distance_0 / self.pupil.pixel_size
    }

    pub(super) fn quadrant(&self, reach_px: [f64; 2], per_px: usize) -> QuadrantGrid {
        let nodes = |axis: usize| {
            let seen = reach_px[axis].min(self.farthest_px[axis]);
            // Additional nodes for the decay of the spline.
            libm::ceil(seen * per_px as f64) as usize + 3
        };
        QuadrantGrid { per_px, columns: nodes(0), rows: nodes(1) }
    }

    /// The image of a sphere at these nodes, as fractions of the light emitted toward the lens side.
    pub(super) fn sample(
        &self,
        z_um: f64,
        radius_um: f64,
        nodes: SampleNodes,
        fineness: Fineness,
    ) -> Vec<f64> {
        // A plane behind the lens, needed only as a neighbor of those in use, is zero.
        let beyond = self.pupil.distance(z_um) <= radius_um;
        match nodes {
            SampleNodes::Radial(rings) if beyond => vec![0.0; rings.columns * AZIMUTHS],
            SampleNodes::Radial(rings) => {
                let step_px = 1.0 / rings.per_px(z_um);
                let reach_px = rings.columns as f64 * step_px;
                let azimuths = self.azimuths(z_um, radius_um, reach_px, fineness);
                let places = (0..rings.columns).map(|k| k as f64 * step_px * FIXED_PER_PX as f64);
                azimuths
                    .iter()
                    .flat_map(|azimuth| places.clone().map(|place| spline::evaluate(azimuth, place)))
                    .collect()
            }
            SampleNodes::Quadrant(QuadrantGrid { columns, rows, .. }) if beyond => vec![0.0; columns * rows],
            SampleNodes::Quadrant(quadrant) if self.is_round() => {
                self.round_quadrant(z_um, radius_um, quadrant, fineness)
            }
            SampleNodes::Quadrant(QuadrantGrid { per_px, columns, rows }) => {
                let surface = EmittingSurface::sphere(radius_um, fineness.scaled(POINTS));
                let grid = Grid::about(per_px, columns, rows);
                let integral = self.integral(z_um, &surface, grid);
                let values = integral.light(PupilPart::Quadrant, fineness, self.instructions);
                aperture_integral::fold(&values, columns, rows)
            }
        }
    }

    /// The integral over the aperture of the light of a surface.
    pub(super) fn integral<'a>(
        &'a self,
        z_um: f64,
        surface: &'a EmittingSurface,
        grid: Grid,
    ) -> ApertureIntegral<'a> {
        ApertureIntegral { pupil: &self.pupil, z_um, surface, grid, buffers: &self.buffers }
    }

    /// A round image along the radius at each sampled azimuth, as cubic splines on [`FIXED_PER_PX`] nodes per
    /// px.
    fn azimuths(&self, z_um: f64, radius_um: f64, reach_px: f64, fineness: Fineness) -> Vec<Vec<f64>> {
        let nodes = libm::ceil(reach_px * FIXED_PER_PX as f64) as usize + 2;
        let annuli = (nodes / FIXED_PER_PX + 2) * encircled::ANNULI_PER_PX;
        let fineness = (fineness, self.meridians);
        let encircled =
            encircled::encircled(&self.pupil, z_um, radius_um, annuli, fineness, self.instructions);
        let values = pixel_integral::integrate(&encircled, FIXED_PER_PX, nodes);
        let spline = |azimuth: &[f64]| {
            let mut azimuth = azimuth.to_vec();
            spline::even_spline(&mut azimuth, SplineDegree::Three);
            azimuth
        };
        values.chunks(nodes).map(spline).collect()
    }

    /// A round image at the nodes of a quadrant.
    fn round_quadrant(
        &self,
        z_um: f64,
        radius_um: f64,
        quadrant: QuadrantGrid,
        fineness: Fineness,
    ) -> Vec<f64> {
        let QuadrantGrid { per_px, columns, rows } = quadrant;
        let step_px = 1.0 / per_px as f64;
        let reach_px = step_px * libm::hypot(columns as f64, rows as f64);
        let orders = pixel_integral::orders(&self.azimuths(z_um, radius_um, reach_px, fineness));
        let at = |column: usize, row: usize| {
            let (x, y) = (column as f64 * step_px, row as f64 * step_px);
            let r2 = x * x + y * y;
            let place = libm::sqrt(r2) * FIXED_PER_PX as f64;
            let cross = if r2 > 0.0 { x * y / r2 } else { 0.0 };
            let cos4 = 1.0 - 8.0 * cross * cross;
            // Clenshaw summation of the orders.
            let (low, sum) = orders.iter().rev().fold((0.0, 0.0), |(after, next), order| {
                (next, spline::evaluate(order, place) + 2.0 * cos4 * next - after)
            });
            sum - cos4 * low
        };
        (0..rows)
            .flat_map(|row| {
                (0..columns).map({
                    let at = &at;
                    move |column| at(column, row)
                })
            })
            .collect()
    }

    /// Number of aperture cells needed for the image of a sphere at one node per px; 0 for a spherical lens,
    /// whose images are computed along the radius.
    pub(super) fn cells(&self, z_um: f64, radius_um: f64) -> f64 {
        if self.is_round() || self.pupil.distance(z_um) <= radius_um {
            return 0.0;
        }
        let QuadrantGrid { per_px, columns, rows } = self.quadrant(self.reach(z_um, radius_um), 1).computed();
        let surface = EmittingSurface::sphere(radius_um, 1);
        let grid = Grid::about(per_px, columns, rows);
        let integral = self.integral(z_um, &surface, grid);
        integral.cells(PupilPart::Quadrant, self.first_fineness())
    }

    /// The resolution from which [`Self::fineness`] starts; for round images it is sufficient.
    pub(super) fn first_fineness(&self) -> Fineness {
        if self.is_round() {
            Fineness(2.0 * (1e-3 / self.tolerance).clamp(0.3, 4.0))
        } else {
            Fineness::first(self.tolerance)
        }
    }

    /// The resolution at which images near this depth are computed, whatever their nodes: increased until a
    /// factor of 1.5 changes little.
    pub(super) fn fineness(&self, z_um: f64, radius_um: f64) -> Fineness {
        let Fineness(mut fineness) = self.first_fineness();
        if self.is_round() {
            return Fineness(fineness);
        }
        let nodes = SampleNodes::Quadrant(self.quadrant(self.reach(z_um, radius_um), 1).computed());
        let mut image = self.sample(z_um, radius_um, nodes, Fineness(fineness));
        for _ in 0..FINER {
            let finer = self.sample(z_um, radius_um, nodes, Fineness(1.5 * fineness));
            if deviation(&image, &finer) <= 0.4 * self.tolerance {
                break;
            }
            fineness *= 1.5;
            image = finer;
        }
        Fineness(fineness)
    }
}

/// The error of values relative to the peak. Dark pixels around the image do not reduce it.
pub(super) fn deviation(ours: &[f64], truth: &[f64]) -> f64 {
    let peak = peak(truth);
    let lit = ours.iter().zip(truth).filter(|(a, b)| a.abs().max(b.abs()) > 1e-9 * peak);
    measure(lit.map(|(a, b)| a - b)) / peak
}

/// The error measure: the root mean square, or a quarter of the largest error if that is larger. Images have
/// kinks where the edge of a pixel touches the edge of a ring, near which interpolation is less accurate than
/// elsewhere.
pub(super) fn measure(errors: impl Iterator<Item = f64>) -> f64 {
    let (mut largest, mut squares, mut n) = (0.0f64, 0.0, 0);
    for error in errors {
        largest = largest.max(error.abs());
        squares += error * error;
        n += 1;
    }
    libm::sqrt(squares / f64::from(n.max(1))).max(0.25 * largest)
}
