//! Computes the image of a sphere, from the pupil function to the coefficients of a spline.

use super::band::Line;
use super::bead::{self, Ring};
use super::general::{General, Obstacles};
use super::hankel::{Counts, Hankel, Profile};
use super::modes::{Bead, Modes};
use super::options::Emission;
use super::pixel::{self, Axis};
use super::pupil::{Pupil, Radii};
use super::quadrant::Quadrant;
use super::slices::{self, Convolution, Sphere};
use crate::bspline::{self, QUINTIC_TAPS as TAPS};
use crate::cancel::checkpoint;
use crate::render::instructions::InstructionSet;
use crate::render::node_layout::NodeLayout;
use crate::render::store::Kernels;

/// Margin beyond the edge that is computed but not rendered, px, because the Fourier series is periodic.
const MARGIN_PX: f64 = 4.0;

/// Radial samples of a round image per period of the highest frequency.
const PER_PERIOD: f64 = 8.0;

/// Grid points per period of the highest frequency: slightly more than two.
const GRID_PER_PERIOD: f64 = 2.1;

/// Standard deviations of blur by which images grow.
const BLURS: f64 = 3.0;

/// Parameters of images.
#[derive(Debug)]
pub(super) struct Model {
    pub(super) pupil: Pupil,
    /// Edge of a pixel, um.
    pub(super) pixel_um: f64,
    pub(super) emission: Emission,
    /// Center wavelength and width of the band (full width at half maximum), um.
    pub(super) wavelength_um: f64,
    pub(super) bandwidth_um: f64,
    /// Standard deviation of the blur by detector and relay optics, px.
    pub(super) blur_px: f64,
    /// Mask, aberrations and rotated cylinder, if they break the pupil's mirror symmetries.
    pub(super) obstacles: Option<Obstacles>,
    /// Radius in the lens plane inside which the pupil is closed, um.
    pub(super) inner_um: f64,
    /// The largest error of tables, as a fraction of an image's peak.
    pub(super) tolerance: f64,
    /// Fraction of the light in weak modes that are neglected; the kept modes are scaled up to compensate.
    pub(super) share: f64,
    /// Where kernels are shared with other optics; tables do not share them, as the nodes of kernels that are
    /// shared are others.
    pub(super) kernels: Option<Kernels>,
    pub(super) instructions: InstructionSet,
}

/// The range of images that a frame supports.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scope {
    /// Depths, um.
    pub(super) from_um: f64,
    pub(super) to_um: f64,
    /// Radius of the largest sphere, um.
    pub(super) radius_um: f64,
    /// Half width and half height, whole px.
    pub(super) edge_px: [usize; 2],
    /// Factor on the number of quadrature points in the pupil.
    pub(super) fineness: f64,
}

/// Transform kernels for images within a scope.
#[derive(Debug)]
pub(super) struct Frame {
    pub(super) scope: Scope,
    engine: Engine,
    /// Wavelengths with their fractions of the light.
    lines: Vec<Line>,
    /// Number of grid points on both axes, and their spacing at the center wavelength, px.
    grid: [usize; 2],
    steps_px: [f64; 2],
    /// Whether the pupil is truncated inside the aperture.
    tapered: bool,
    /// For a lens whose images do not depend on the distance from the axis: joins slices of particles.
    convolution: Option<Convolution>,
}

/// Light on a frame's grid: one grid for a round pupil, otherwise one for each wavelength.
#[derive(Debug, Clone)]
pub(super) struct Light {
    grids: Vec<Vec<f64>>,
    stride: usize,
}

/// Conversion of a frame's light to spline coefficients of the light on square pixels.
#[derive(Debug)]
pub(super) struct Exposure {
    pub(super) layout: NodeLayout,
    /// The two axes for each grid of the light.
    axes: Vec<[Axis; 2]>,
}

/// Conversion of a frame's light to the light on pixels at given positions.
#[derive(Debug)]
pub(super) struct Probes {
    axes: Vec<[Axis; 2]>,
}

impl Frame {
    /// Whether images are their own mirror images in x and y.
    pub(super) fn is_mirrored(&self) -> bool {
        !matches!(self.engine, Engine::General(_))
    }
}

#[derive(Debug)]
enum Engine {
    Round(Hankel),
    Quadrant(Quadrant),
    General(General),
}

impl Model {
    /// 2 pi over the center wavelength, 1/um.
    fn k(&self) -> f64 {
        2.0 * std::f64::consts::PI / self.wavelength_um
    }

    /// All parameters that determine images, as text with exact numbers.
    pub(super) fn parameters(&self) -> String {
        let Model {
            pupil,
            pixel_um,
            emission,
            wavelength_um,
            bandwidth_um,
            blur_px,
            obstacles,
            inner_um,
            tolerance,
            share,
            ..
        } = self;
        format!(
            "{pupil:?} {pixel_um:?} {emission:?} {wavelength_um:?} {bandwidth_um:?} {blur_px:?} {obstacles:?} {inner_um:?} {tolerance:?} {share:?}"
        )
    }

    pub(super) fn is_round(&self) -> bool {
        !self.pupil.has_cylinder() && self.obstacles.is_none()
    }

    /// Largest distance on the sensor from the particle's image within the edge, um.
    fn corner_um(&self, edge_px: [usize; 2]) -> f64 {
        let [x, y] = edge_px.map(|edge| (edge as f64 + MARGIN_PX) * self.pixel_um);
        libm::sqrt(x * x + y * y)
    }

    /// Band limits of the light on the sensor along x and y, cycles per px.
    pub(super) fn band_limits(&self, end_um: f64) -> [f64; 2] {
        let [_, bx] = self.pupil.across();
        let limit = |b: f64| 2.0 * self.pupil.sigma(end_um) / (self.wavelength_um * b.abs()) * self.pixel_um;
        let limits = [limit(bx), limit(self.pupil.b())];
        // With a rotated cylinder, both limits apply to both axes.
        let turned = self.obstacles.as_ref().is_some_and(|obstacles| obstacles.turn != 0.0);
        if turned { [libm::hypot(limits[0], limits[1]); 2] } else { limits }
    }

    /// The part of a band, up to `limit` (1/px), that blur leaves. Frequencies beyond the rest may be aliases.
    fn used(&self, limit: f64) -> f64 {
        let end =
            libm::sqrt(-2.0 * libm::log(1e-2 * self.tolerance)) / (2.0 * std::f64::consts::PI * self.blur_px);
        (end / limit).min(1.0)
    }

    /// Largest frequency in images along x and y, 1/px.
    pub(super) fn sharpest(&self) -> f64 {
        let limits = self.band_limits(self.pupil.aperture());
        limits.into_iter().map(|limit| limit * self.used(limit)).fold(0.0, f64::max)
    }

    /// Radius in the lens plane (um) at which the pupil ends for images of this scope, and whether that is
    /// inside the aperture.
    fn end(&self, scope: &Scope) -> (f64, bool) {
        let corner_um = self.corner_um(scope.edge_px);
        let useful = self.depths(scope).map(|z_um| self.pupil.useful(z_um, corner_um));
        let end = useful.into_iter().map(|useful| self.pupil.taper_end(useful)).fold(0.0, f64::max);
        (end, useful.iter().any(Option::is_some))
    }

    /// Depths that sample the range of the scope's particles, including their surfaces, um.
    fn depths(&self, scope: &Scope) -> [f64; 5] {
        let (low, high) = (scope.from_um - scope.radius_um, scope.to_um + scope.radius_um);
        std::array::from_fn(|i| low + (high - low) * i as f64 / 4.0)
    }

    pub(super) fn frame(&self, scope: Scope) -> Frame {
        let (end, tapered) = self.end(&scope);
        let (b, sigma_end) = (self.pupil.b(), self.pupil.sigma(end));
        let [_, bx] = self.pupil.across();
        let depths = self.depths(&scope);
        let mut far = [0.0f64; 2];
        for z_um in depths {
            let farthest = self.pupil.farthest(z_um, end);
            (0..2).for_each(|axis| far[axis] = far[axis].max(farthest[axis]));
        }
        let aberrated = self.aberrated_um();
        (0..2).for_each(|axis| far[axis] += aberrated[1 - axis]);
        // Radius of the geometric image of the bead, um.
        let bead_um = scope.radius_um * b / self.pupil.system.objective.object_distance_0;
        let lines = self.lines(&depths, end);
        let shortest = lines.iter().map(|line| line.wavelength_um).fold(f64::INFINITY, f64::min);
        let shrink = shortest / self.wavelength_um;

        let turned = self.obstacles.as_ref().is_some_and(|obstacles| obstacles.turn != 0.0);
        if turned {
            far = [far[0].max(far[1]); 2];
        }
        let limits = self.band_limits(end);
        let steps_px =
            limits.map(|limit| 1.0 / (GRID_PER_PERIOD.min(1.0 + 1.1 * self.used(limit)) * limit).max(1.0));
        let drawn = scope.edge_px.map(|edge| edge as f64 + MARGIN_PX);
        let orders = self.orders(scope.radius_um, &depths, end, shortest);
        let cycles =
            |far: f64, reach: f64, b: f64| (far + bead_um + reach) * sigma_end / (shortest * b.abs());
        if self.is_round() {
            // The grid is the same at all wavelengths.
            let steps_px = steps_px.map(|step| step * shrink);
            let grid = [0, 1].map(|axis| libm::ceil(drawn[axis] / steps_px[axis]) as usize + 1);
            let corner =
                libm::hypot(grid[0] as f64 * steps_px[0], grid[1] as f64 * steps_px[1]) * self.pixel_um;
            let step_um = self.pixel_um / (PER_PERIOD * limits[1]);
            let columns = libm::ceil(corner / (step_um * shrink)) as usize + TAPS;
            // Half as many per cycle, or none of the 40, give the same errors as twice as many.
            let count = libm::ceil((2.6 * cycles(far[1].max(far[0]), corner, b) + 40.0) * scope.fineness);
            let hankel = Hankel::new(
                &self.pupil,
                self.k(),
                [self.inner_um, end],
                Counts { nodes: count as usize, columns, orders },
                step_um,
                self.kernels.as_ref(),
                self.instructions,
            );
            return Frame {
                scope,
                engine: Engine::Round(hankel),
                lines,
                grid,
                steps_px,
                tapered,
                convolution: None,
            };
        }
        let convolved = !self.pupil.has_coma();
        let grid = [0, 1].map(|axis| {
            let points = libm::ceil(drawn[axis] / (steps_px[axis] * shrink)) as usize + 1;
            if convolved { slices::odd_and_smooth(2 * points - 1) / 2 + 1 } else { points }
        });
        let convolution = convolved.then(|| Convolution::new(grid.map(|points| 2 * points - 1)));
        let reach = [0, 1].map(|axis| grid[axis] as f64 * steps_px[axis] * self.pixel_um);
        let [along_x, along_y] =
            [(0, bx), (1, b)].map(|(axis, b): (usize, f64)| cycles(far[1 - axis], reach[axis], b));
        let count = |cycles: f64| libm::ceil((1.5 * cycles + 44.0) * scope.fineness) as usize;
        // Rows of nodes end at the edge of the pupil, so phases along x change from row to row too.
        let counts = [count(libm::hypot(along_x, along_y)), count(along_x)];
        let steps_um = steps_px.map(|step| step * self.pixel_um);
        if let Some(obstacles) = &self.obstacles {
            let general = General::new(&self.pupil, self.k(), end, obstacles, counts, (grid, steps_um));
            return Frame {
                scope,
                engine: Engine::General(general),
                lines,
                grid,
                steps_px,
                tapered,
                convolution,
            };
        }
        let shared = self.kernels.as_ref();
        let quadrant = Quadrant::new(&self.pupil, self.k(), end, counts, (grid, steps_um), shared);
        Frame { scope, engine: Engine::Quadrant(quadrant), lines, grid, steps_px, tapered, convolution }
    }

    /// The exposure of this frame's light on pixels, with `per_px` spline coefficients per px.
    pub(super) fn exposure(&self, frame: &Frame, per_px: usize) -> Exposure {
        // Counted from the particle's own node outward.
        let side = frame.scope.edge_px.map(|edge| (edge * per_px + TAPS).next_multiple_of(per_px) + 1);
        let mirrored = frame.is_mirrored();
        let axes = self.axes(frame, side[0] == side[1], |axis, step_px| {
            let make = if mirrored { Axis::even } else { Axis::both };
            make(frame.grid[axis], step_px, self.blur_px, side[axis], per_px)
        });
        let nodes = if mirrored { side } else { side.map(|side| 2 * side - 1) };
        Exposure { axes, layout: NodeLayout::new(per_px, nodes, mirrored) }
    }

    /// Probes of this frame's light on pixels at the given columns and rows, px from the particle.
    pub(super) fn probes(&self, frame: &Frame, places_px: [&[f64]; 2]) -> Probes {
        let axes = self.axes(frame, places_px[0] == places_px[1], |axis, step_px| {
            let make = if frame.is_mirrored() { Axis::even_at } else { Axis::both_at };
            make(frame.grid[axis], step_px, self.blur_px, places_px[axis])
        });
        Probes { axes }
    }

    /// The two axes for each grid of a frame's light; `make` is called with the axis and its grid spacing,
    /// px. `alike`: both axes have the same positions.
    fn axes(&self, frame: &Frame, alike: bool, make: impl Fn(usize, f64) -> Axis) -> Vec<[Axis; 2]> {
        let Frame { grid, steps_px, .. } = frame;
        let alike = alike && grid[0] == grid[1] && steps_px[0] == steps_px[1];
        let scaled = |scale: f64| {
            let across = make(0, steps_px[0] * scale);
            let down = if alike { across.clone() } else { make(1, steps_px[1] * scale) };
            [across, down]
        };
        match frame.engine {
            Engine::Round(_) => vec![scaled(1.0)],
            Engine::Quadrant(_) | Engine::General(_) => {
                let scales = frame.lines.iter().map(|line| line.wavelength_um / self.wavelength_um);
                scales.map(scaled).collect()
            }
        }
    }

    /// Spline coefficients on the exposure's nodes, row by row, of the light on a pixel as a fraction of that
    /// emitted into the half space.
    pub(super) fn plane(&self, light: &Light, exposure: &Exposure) -> Vec<f64> {
        self.seen(light, &exposure.axes)
    }

    /// Light on the pixels of the probes, row by row, as a fraction of that emitted into the half space.
    pub(super) fn probe(&self, light: &Light, probes: &Probes) -> Vec<f64> {
        self.seen(light, &probes.axes)
    }

    fn seen(&self, light: &Light, axes: &[[Axis; 2]]) -> Vec<f64> {
        let mut sum: Vec<f64> = Vec::new();
        for (grid, [across, down]) in light.grids.iter().zip(axes) {
            let seen = pixel::expose(grid, light.stride, [across, down], self.instructions);
            sum.resize(seen.len(), 0.0);
            sum.iter_mut().zip(&seen).for_each(|(sum, seen)| *sum += seen);
        }
        sum
    }

    /// A copy that neglects the fraction `share` of the light in weak modes and has `finer` times the
    /// tolerance, which gives more rings and wavelengths if below 1.
    pub(super) fn with_share(&self, share: f64, finer: f64) -> Model {
        let (pupil, obstacles) = (self.pupil.clone(), self.obstacles.clone());
        let (kernels, tolerance) = (self.kernels.clone(), finer * self.tolerance);
        Model { pupil, obstacles, tolerance, share, kernels, ..*self }
    }

    /// Largest displacement of light on the sensor due to aberrations, um, for the two axes; with a rotated
    /// cylinder, an upper bound for both.
    fn aberrated_um(&self) -> [f64; 2] {
        let Some(obstacles) = &self.obstacles else { return [0.0; 2] };
        let [_, bx] = self.pupil.across();
        let steepest = obstacles.aberration.steepest();
        let far = [bx.abs(), self.pupil.b()].map(|b| b / self.pupil.radius());
        if obstacles.turn == 0.0 {
            return [steepest[0] * far[0], steepest[1] * far[1]];
        }
        [steepest[0].max(steepest[1]) * far[0].max(far[1]); 2]
    }

    /// Half width and half height of the geometric image of a sphere, px.
    pub(super) fn rim_px(&self, z_um: f64, radius_um: f64) -> [f64; 2] {
        let bead = radius_um * self.pupil.widest() / self.pupil.system.objective.object_distance_0;
        let [down, across] = self.pupil.farthest(z_um, self.pupil.aperture());
        let aberrated = self.aberrated_um();
        [(across, aberrated[0]), (down, aberrated[1])]
            .map(|(rim, more)| (rim + more + bead) / self.pixel_um + BLURS * self.blur_px)
    }

    /// The fraction of a sphere's light emitted into the half space that the aperture accepts.
    pub(super) fn accepted(&self, z_um: f64, radius_um: f64) -> f64 {
        let rings = self.rings(radius_um, self.pupil.aperture());
        rings.iter().map(|ring| ring.weight * self.pupil.accepted(z_um + ring.depth_um)).sum()
    }

    /// Distances (px) at which the tails outside a rim (px) fall below `level`, a fraction of the light per
    /// px. The mean intensity diffracted by a hard edge of the pupil is A^2 2 sigma_a B / (pi k X (X -
    /// rim)^2); fringes are three times as bright.
    pub(super) fn tail_px(&self, z_um: f64, rim_px: [f64; 2], level: f64) -> [f64; 2] {
        let end = self.pupil.aperture();
        let radii = self.pupil.radii(vec![end], end);
        let amplitude = self.pupil.fan(z_um, &radii, None).amplitude[0];
        let [_, bx] = self.pupil.across();
        [(bx, rim_px[0]), (self.pupil.b(), rim_px[1])].map(|(b, rim)| {
            let along = b * b / self.pupil.b();
            let light =
                6.0 * amplitude * amplitude * radii.sigma[0] * along / (std::f64::consts::PI * self.k());
            // From light per um^2 to light per px, with lengths in px.
            let light = light / self.pixel_um;
            let (mut low, mut high) = (rim, rim + 1e6);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                let beyond = middle - rim;
                if light / (middle * beyond * beyond) > level { low = middle } else { high = middle }
            }
            high
        })
    }

    /// Number of orders of modes that a sphere may have.
    fn orders(&self, radius_um: f64, depths: &[f64], end: f64, shortest: f64) -> usize {
        let radii = self.pupil.radii(vec![end], end);
        let steepest = depths
            .iter()
            .map(|&z_um| self.pupil.fan(z_um, &radii, None).off_axis[0].abs())
            .fold(0.0, f64::max);
        let argument = 2.0 * std::f64::consts::PI / shortest * radius_um * steepest;
        libm::ceil(argument + 3.0 * libm::cbrt(argument)) as usize + 4
    }

    /// Wavelengths with their fractions of the light, as many as needed for the range of phases at these
    /// depths.
    fn lines(&self, depths: &[f64], end: f64) -> Vec<Line> {
        let spread = depths.iter().map(|&z_um| self.pupil.spread(z_um, end)).fold(0.0, f64::max);
        super::band::lines(self.wavelength_um, self.bandwidth_um, spread, self.tolerance)
    }

    fn rings(&self, radius_um: f64, end: f64) -> Vec<Ring> {
        let more = usize::from(self.tolerance < 1e-3);
        bead::rings(self.emission, radius_um, self.k_sine_within(end) * radius_um, more)
    }

    /// Largest wave number across the optical axis that the lens accepts, 1/um.
    pub(super) fn k_sine(&self) -> f64 {
        self.k_sine_within(self.pupil.aperture())
    }

    fn k_sine_within(&self, end: f64) -> f64 {
        self.k() * (self.pupil.sigma(end) / self.pupil.system.objective.object_distance_0)
    }

    /// The light of a sphere, per px, as a fraction of that emitted into the half space.
    pub(super) fn light(&self, frame: &Frame, z_um: f64, radius_um: f64) -> Light {
        checkpoint();
        let stride = match &frame.engine {
            Engine::General(_) if frame.convolution.is_some() => 2 * frame.grid[0] - 1,
            Engine::General(general) => general.columns(),
            Engine::Quadrant(quadrant) if frame.convolution.is_none() => quadrant.columns(),
            Engine::Quadrant(_) | Engine::Round(_) => frame.grid[0],
        };
        if !self.pupil.sees(z_um - radius_um) {
            // Behind the lens: such planes are only neighbors of those in use.
            return Light { grids: vec![vec![0.0; stride * 2 * frame.grid[1]]; frame.lines.len()], stride };
        }
        let useful =
            if frame.tapered { self.pupil.useful(z_um, self.corner_um(frame.scope.edge_px)) } else { None };
        let pixel = self.pixel_um * self.pixel_um;
        let line_grids = |line_grid: &dyn Fn(&Line) -> Vec<f64>| {
            frame.lines.iter().map(|line| times(line_grid(line), pixel * line.share)).collect()
        };
        let modes = |radii: &Radii, weights: &[f64], line: &Line| {
            self.modes(radii, weights, z_um, radius_um, line, useful)
        };
        if let Some(convolution) = &frame.convolution {
            let by_slices = |line: &Line| self.by_slices(frame, convolution, (z_um, radius_um), line, useful);
            return Light { grids: line_grids(&by_slices), stride };
        }
        let grids = match &frame.engine {
            Engine::Round(hankel) => {
                let profiles = frame.lines.iter().map(|line| {
                    let modes = modes(&hankel.radii, &hankel.weights, line);
                    (pixel * line.share, hankel.profile(&modes, line.k(), self.k(), self.instructions))
                });
                let profiles: Vec<_> = profiles.collect();
                vec![self.round_grid(frame, &profiles)]
            }
            Engine::Quadrant(quadrant) => line_grids(&|line| {
                let modes = modes(&quadrant.radii, &quadrant.weights, line);
                quadrant.light(&modes, line.k(), self.instructions)
            }),
            Engine::General(general) => line_grids(&|line| {
                let modes = modes(&general.radii, &general.weights, line);
                general.light(&modes, line.k(), self.instructions)
            }),
        };
        Light { grids, stride }
    }

    /// The light of a sphere per um^2 on the grid, as the sum of its slices'.
    fn by_slices(
        &self,
        frame: &Frame,
        convolution: &Convolution,
        (z_um, radius_um): (f64, f64),
        line: &Line,
        useful: Option<f64>,
    ) -> Vec<f64> {
        let end = useful.unwrap_or(self.pupil.aperture());
        let phases = line.k() * radius_um * self.pupil.sagitta(end);
        let depths_um = slices::depths(self.emission, radius_um, phases, self.tolerance);
        let points = |radii: &Radii, weights: &[f64]| {
            self.bead(radii, weights, z_um, &[], line, useful).points(&depths_um)
        };
        let mut lights = match &frame.engine {
            Engine::Round(_) => Vec::new(),
            Engine::Quadrant(engine) => {
                let points = points(&engine.radii, &engine.weights);
                let lights = engine.lights(&points, line.k(), self.instructions).into_iter();
                lights.map(|light| slices::whole(&light, engine.columns(), frame.grid)).collect()
            }
            Engine::General(general) => {
                general.lights(&points(&general.radii, &general.weights), line.k(), self.instructions)
            }
        };
        let drawn =
            |light: Vec<f64>| if frame.is_mirrored() { slices::quadrant(&light, frame.grid) } else { light };
        if radius_um == 0.0 {
            return drawn(lights.remove(0));
        }
        // Cycles per um of the sensor along the axes of the cylindrical lens, and of the particle's space.
        let scale = line.wavelength_um / self.wavelength_um * self.pixel_um;
        let periods = [0, 1].map(|axis| (2 * frame.grid[axis] - 1) as f64 * frame.steps_px[axis] * scale);
        let magnifications = self.pupil.magnifications();
        let turn = self.obstacles.as_ref().map_or(0.0, |obstacles| obstacles.turn);
        let (sine, cosine) = libm::sincos(turn);
        let frequency = |cycles: [f64; 2]| {
            let [x, y] = [0, 1].map(|axis| cycles[axis] / periods[axis]);
            libm::hypot(
                magnifications[0] * (x * cosine + y * sine),
                magnifications[1] * (y * cosine - x * sine),
            )
        };
        let sphere = Sphere { emission: self.emission, radius_um, depths_um: &depths_um };
        drawn(convolution.sum(&sphere, &lights, frequency))
    }

    /// Sums round images of all wavelengths on the grid.
    fn round_grid(&self, frame: &Frame, profiles: &[(f64, Profile)]) -> Vec<f64> {
        let [columns, rows] = frame.grid;
        let mut light = vec![0.0; columns * rows];
        for row in 0..rows {
            for column in 0..columns {
                // Symmetric, as both axes have the same spacing.
                if columns == rows && column < row {
                    light[row * columns + column] = light[column * columns + row];
                    continue;
                }
                let (x, y) = (column as f64 * frame.steps_px[0], row as f64 * frame.steps_px[1]);
                let radius = libm::sqrt(x * x + y * y) * self.pixel_um;
                let mut sum = 0.0;
                for (share, profile) in profiles {
                    sum += share * profile.at(radius);
                }
                light[row * columns + column] = sum;
            }
        }
        light
    }

    fn modes(
        &self,
        radii: &Radii,
        weights: &[f64],
        z_um: f64,
        radius_um: f64,
        line: &Line,
        useful: Option<f64>,
    ) -> Modes {
        let rings = self.rings(radius_um, useful.unwrap_or(self.pupil.aperture()));
        self.bead(radii, weights, z_um, &rings, line, useful).modes()
    }

    fn bead<'a>(
        &'a self,
        radii: &'a Radii,
        weights: &'a [f64],
        z_um: f64,
        rings: &'a [Ring],
        line: &Line,
        useful: Option<f64>,
    ) -> Bead<'a> {
        Bead { pupil: &self.pupil, radii, weights, z_um, rings, k: line.k(), useful, share: self.share }
    }
}

fn times(mut values: Vec<f64>, factor: f64) -> Vec<f64> {
    values.iter_mut().for_each(|value| *value *= factor);
    values
}

impl Exposure {
    /// The spline's value at a position relative to the particle (px) and its derivatives along x and y.
    pub(super) fn evaluate(&self, coefficients: &[f64], [x, y]: [f64; 2]) -> [f64; 3] {
        let per_px = self.layout.per_px as f64;
        let axis = |x: f64| {
            let place = x * per_px;
            let cell = libm::floor(place);
            (cell as isize - 2, bspline::quintic(place - cell))
        };
        let ((first_x, in_x), (first_y, in_y)) = (axis(x), axis(y));
        let columns: [Option<usize>; TAPS] =
            std::array::from_fn(|i| self.layout.column_of(first_x + i as isize));
        let mut sum = [0.0; 3];
        for j in 0..TAPS {
            let Some(row) = self.layout.row_of(first_y + j as isize) else { continue };
            let line = &coefficients[row * self.layout.columns..];
            let (mut value, mut slope) = (0.0, 0.0);
            for (i, column) in columns.iter().enumerate() {
                let Some(column) = *column else { continue };
                value += in_x.0[i] * line[column];
                slope += in_x.1[i] * line[column];
            }
            sum[0] += in_y.0[j] * value;
            sum[1] += in_y.0[j] * slope * per_px;
            sum[2] += in_y.1[j] * value * per_px;
        }
        sum
    }
}
