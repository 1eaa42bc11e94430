//! Images for an arbitrary pupil: a matrix Fourier transform over discs.
//!
//! The open part of the pupil is a sum of discs, one of which may be subtracted (an annulus), so that
//! quadrature follows the edges. Each disc is integrated row by row, along lines of constant phase with
//! respect to the image's Y. With a cylindrical lens rotated by chi, rows are rotated too, and the middle of
//! a row shifts along it in proportion to its distance from the center, which gives a phase factor for each
//! row and column. Values at opposite points are first added and subtracted, so that kernels are real and
//! one quadrant's serve the entire image.

use super::interpolation::{self, Around};
use super::matrix::{self, LANES, Panels};
use super::modes::Modes;
use super::pupil::{Pupil, Radii};
use super::zernike::Aberration;
use crate::quadrature::gauss_legendre_on;
use crate::render::instructions::InstructionSet;

/// A disc of the pupil, in units of the pupil's radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Disc {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) r: f64,
    /// Whether the disc is open (added) or closed (subtracted).
    pub(super) open: bool,
}

/// Mask, aberrations and rotated cylinder, which break the pupil's mirror symmetries.
#[derive(Debug, Clone)]
pub(super) struct Obstacles {
    pub(super) discs: Vec<Disc>,
    /// Optical path difference, um.
    pub(super) aberration: Aberration,
    /// Azimuth of the direction in which the cylindrical lens has power, rad.
    pub(super) turn: f64,
    /// The symmetric matrix by which vignetting narrows the pupil, along x and y.
    pub(super) squeeze: [[f64; 2]; 2],
}

/// One quadrature point of a disc.
#[derive(Debug, Clone)]
struct Node {
    around: Around,
    cosine: f64,
    sine: f64,
    /// Optical path added by a cylindrical lens and aberrations, um.
    extra: f64,
    /// Weight in an integral over the pupil; negative if the disc is subtracted.
    area: f64,
}

/// Kernels of one disc.
#[derive(Debug)]
struct Rows {
    /// Numbers of nodes of t in [0, pi/2] and of u in [0, 1].
    t: usize,
    u: usize,
    /// By t and u: the nodes at (t, u), (t, -u), (-t, u), (-t, -u).
    nodes: Vec<[Node; 4]>,
    /// Cosines and sines: for each t, [u x columns of the right half].
    along_x: [Vec<Panels<f32>>; 2],
    /// Cosines and sines: [rows of the lower half x t].
    along_y: [Vec<f32>; 2],
    /// Phase per column of the middle of the rows at t and -t, and per row of the center of the disc, rad.
    middle_x: Vec<[f64; 2]>,
    middle_y: f64,
}

/// Kernels of a pupil.
#[derive(Debug)]
pub(super) struct General {
    pub(super) radii: Radii,
    /// Weights of the radii in an integral over sigma d sigma.
    pub(super) weights: Vec<f64>,
    discs: Vec<Rows>,
    /// Columns and rows of the image from its middle outward, including the middle; kernels are padded to a
    /// multiple of [`LANES`] columns.
    half: [usize; 2],
    padded: usize,
    scale: f64,
}

impl General {
    /// `counts`: numbers of nodes of t and u for the full pupil; `half`: the image's columns and rows from
    /// its middle outward, at steps of `steps_um`.
    pub(super) fn new(
        pupil: &Pupil,
        k: f64,
        end: f64,
        obstacles: &Obstacles,
        counts: [usize; 2],
        (half, steps_um): ([usize; 2], [f64; 2]),
    ) -> General {
        let radii = interpolation::radii(pupil, end);
        let weights = interpolation::weights(&radii);
        let padded = half[0].next_multiple_of(LANES);
        let discs = obstacles.discs.iter().map(|disc| {
            // Small discs need fewer nodes.
            let fewer = |n: usize| libm::ceil((n as f64 - 44.0).max(0.0) * disc.r) as usize + 44;
            let setup = Setup { pupil, k, end, disc, obstacles, radii: &radii };
            setup.rows(counts.map(fewer), (half, padded), steps_um)
        });
        let [_, bx] = pupil.across();
        General {
            discs: discs.collect(),
            half,
            padded,
            scale: 1.0 / (2.0 * std::f64::consts::PI * libm::sqrt((bx * pupil.b()).abs())),
            weights,
            radii,
        }
    }

    /// Number of columns of an image.
    pub(super) fn columns(&self) -> usize {
        (2 * self.half[0] - 1).next_multiple_of(LANES)
    }

    /// Light per um^2 at all points of the image, row by row, of these modes at the wave number `k` (1/um).
    pub(super) fn light(&self, modes: &Modes, k: f64, instructions: InstructionSet) -> Vec<f64> {
        let mut light = vec![0.0; (2 * self.half[1] - 1) * self.columns()];
        self.each(modes, k, instructions, |mode, real, imaginary| {
            let count = modes.modes[mode].count();
            for ((light, re), im) in light.iter_mut().zip(real).zip(imaginary) {
                let (re, im) = (f64::from(*re), f64::from(*im));
                *light += count * (re * re + im * im);
            }
        });
        light
    }

    /// The light of each mode, without the padding of rows.
    pub(super) fn lights(&self, modes: &Modes, k: f64, instructions: InstructionSet) -> Vec<Vec<f64>> {
        let columns = 2 * self.half[0] - 1;
        let mut lights = Vec::with_capacity(modes.modes.len());
        self.each(modes, k, instructions, |_, real, imaginary| {
            let rows = real.chunks_exact(self.columns()).zip(imaginary.chunks_exact(self.columns()));
            let row = |(re, im): (&[f32], &[f32])| {
                let light = |(re, im): (&f32, &f32)| {
                    f64::from(*re) * f64::from(*re) + f64::from(*im) * f64::from(*im)
                };
                re[..columns].iter().zip(im).map(light).collect::<Vec<f64>>()
            };
            lights.push(rows.flat_map(row).collect());
        });
        lights
    }

    /// Calls `with` for the amplitude of each mode (real and imaginary parts), in their order.
    fn each(
        &self,
        modes: &Modes,
        k: f64,
        instructions: InstructionSet,
        mut with: impl FnMut(usize, &[f32], &[f32]),
    ) {
        let images: Vec<(usize, bool)> = modes
            .modes
            .iter()
            .enumerate()
            .flat_map(|(i, mode)| [false, true].map(|sine| (i, sine)).into_iter().take(1 + mode.order.min(1)))
            .collect();
        let transformed: Vec<_> =
            self.discs.iter().map(|disc| disc.across(self, modes, &images, k, instructions)).collect();
        let (wide, rows) = (self.columns(), 2 * self.half[1] - 1);
        let mut field = vec![0.0f32; 2 * rows * wide];
        let mut halves = [(); 2].map(|()| vec![0.0f32; self.half[1] * 2 * wide]);
        for (image, &(mode, _)) in images.iter().enumerate() {
            field.fill(0.0);
            for (disc, across) in self.discs.iter().zip(&transformed) {
                disc.down(self, across, image, instructions, &mut halves, &mut field);
            }
            let (real, imaginary) = field.split_at(rows * wide);
            with(mode, real, imaginary);
        }
    }
}

/// The transform of a disc's rows along x: for each image and t, real and imaginary part of a row of the sum
/// and of the difference of t and -t.
struct Across {
    sums: Vec<f32>,
    differences: Vec<f32>,
}

/// The input for a disc's kernels.
struct Setup<'a> {
    pupil: &'a Pupil,
    k: f64,
    end: f64,
    disc: &'a Disc,
    obstacles: &'a Obstacles,
    radii: &'a Radii,
}

impl Setup<'_> {
    fn rows(&self, [nt, nu]: [usize; 2], (half, padded): ([usize; 2], usize), steps_um: [f64; 2]) -> Rows {
        let Setup { pupil, k, disc, .. } = *self;
        let whole = pupil.radius();
        let [ax, bx] = pupil.across();
        let by = pupil.b();
        let (sin_turn, cos_turn) = libm::sincos(self.obstacles.turn);
        // Phases per um of image along X and Y are scalar products of sigma with these vectors, in the frame
        // of the cylindrical lens.
        let (x_direction, y_direction) = ([cos_turn / bx, -sin_turn / by], [sin_turn / bx, cos_turn / by]);
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        let turned = |x: f64, y: f64| [x * cos_turn + y * sin_turn, y * cos_turn - x * sin_turn];
        let back = |x: f64, y: f64| [x * cos_turn - y * sin_turn, y * cos_turn + x * sin_turn];
        let squeeze = self.obstacles.squeeze;
        // In the frame of the cylindrical lens.
        let squeezed = |v: [f64; 2]| {
            let v = back(v[0], v[1]);
            turned(dot(squeeze[0], v), dot(squeeze[1], v))
        };
        // Across rows and along them: conjugate radii of the squeezed disc, the second of constant phase with
        // respect to Y.
        let across = squeezed(y_direction);
        let length = libm::hypot(across[0], across[1]);
        let across = across.map(|v| v / length);
        let (down, along) = (squeezed(across), squeezed([across[1], -across[0]]));
        let determinant = squeeze[0][0] * squeeze[1][1] - squeeze[0][1] * squeeze[1][0];
        let center = squeezed(turned(disc.x * whole, disc.y * whole));
        let centered = disc.x == 0.0 && disc.y == 0.0;
        // A centered disc is limited to the part of the pupil that is used.
        let radius = if centered { (disc.r * whole).min(pupil.sigma(self.end)) } else { disc.r * whole };

        let (t, t_weight) = gauss_legendre_on(0.0, 0.5 * std::f64::consts::PI, nt);
        let (u, u_weight) = gauss_legendre_on(0.0, 1.0, nu);
        let sign = if disc.open { 1.0 } else { -1.0 };
        let power = ax / bx - 1.0 / by;
        let mut nodes = Vec::with_capacity(nt * nu);
        let mut along_x = [(); 2].map(|()| vec![Panels::zeros(nu, padded); nt]);
        let mut middle_x = Vec::with_capacity(nt);
        for (row, (t, t_weight)) in t.iter().zip(&t_weight).enumerate() {
            let (sine_t, cosine_t) = libm::sincos(*t);
            for (across, (u, u_weight)) in u.iter().zip(&u_weight).enumerate() {
                let area = determinant * sign * radius * radius * cosine_t * cosine_t * t_weight * u_weight;
                nodes.push([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(st, su)| {
                    let (v, w) = (radius * st * sine_t, radius * su * cosine_t * u);
                    let place =
                        [center[0] + v * down[0] + w * along[0], center[1] + v * down[1] + w * along[1]];
                    self.node(place, power, area)
                }));
                let step = k * radius * cosine_t * u * dot(x_direction, along) * steps_um[0];
                let [cosines, sines] = &mut along_x;
                set_multiples([&mut cosines[row], &mut sines[row]], across, step, padded);
            }
            let center_angle = dot(x_direction, center);
            let drift = radius * sine_t * dot(x_direction, down);
            middle_x.push([center_angle + drift, center_angle - drift].map(|angle| k * angle * steps_um[0]));
        }
        let mut along_y = [Vec::new(), Vec::new()];
        for row in 0..half[1] {
            for t in &t {
                let angle = k * radius * libm::sin(*t) * length * steps_um[1] * row as f64;
                let (sine, cosine) = libm::sincos(angle);
                along_y[0].push(cosine as f32);
                along_y[1].push(sine as f32);
            }
        }
        let middle_y = k * dot(y_direction, center) * steps_um[1];
        Rows { t: nt, u: nu, nodes, along_x, along_y, middle_x, middle_y }
    }

    /// The node at a point of the pupil, in the frame of the cylindrical lens.
    fn node(&self, place: [f64; 2], power: f64, area: f64) -> Node {
        let (sin_turn, cos_turn) = libm::sincos(self.obstacles.turn);
        let unit = self.pupil.sigma(self.end);
        let [x, y] = [place[0] * cos_turn - place[1] * sin_turn, place[1] * cos_turn + place[0] * sin_turn];
        let r = libm::hypot(x, y);
        let around = interpolation::around(r / unit);
        let curvature = around.value(&self.radii.curvature);
        let (cosine, sine) = if r > 0.0 { (x / r, y / r) } else { (1.0, 0.0) };
        let along_cylinder = if r > 0.0 { place[0] / r } else { 1.0 };
        let whole = self.pupil.radius();
        let extra = curvature * along_cylinder * along_cylinder * power
            + self.obstacles.aberration.at(x / whole, y / whole);
        Node { around, cosine, sine, extra, area }
    }
}

/// Writes cosines and sines of the multiples of an angle to a row of kernels.
fn set_multiples(kernels: [&mut Panels<f32>; 2], row: usize, angle: f64, count: usize) {
    let (sine, cosine) = libm::sincos(angle);
    let mut turn = [1.0, 0.0];
    let [cosines, sines] = kernels;
    for column in 0..count {
        cosines.set(row, column, turn[0] as f32);
        sines.set(row, column, turn[1] as f32);
        turn = [turn[0] * cosine - turn[1] * sine, turn[1] * cosine + turn[0] * sine];
    }
}

impl Rows {
    /// The first step of the transform of all images, along x.
    fn across(
        &self,
        general: &General,
        modes: &Modes,
        images: &[(usize, bool)],
        k: f64,
        instructions: InstructionSet,
    ) -> Across {
        let Rows { t: nt, u: nu, .. } = *self;
        let (n, padded) = (images.len(), general.padded);
        // For each t, image, sign of t, real and imaginary part: each u.
        let mut sums = vec![0.0; nt * 4 * n * nu];
        let mut differences = sums.clone();
        let out = [&mut sums[..], &mut differences[..]];
        instructions.dispatch(Fill { rows: self, general, modes, images, k, out });

        let row = 2 * general.columns();
        let mut plus = vec![0.0; n * nt * row];
        let mut minus = plus.clone();
        let (mut even, mut odd) = (vec![0.0; 4 * n * padded], vec![0.0; 4 * n * padded]);
        for t in 0..nt {
            let left = t * 4 * n * nu..(t + 1) * 4 * n * nu;
            let [cosines, sines] = &self.along_x;
            matrix::multiply(instructions, &sums[left.clone()], &cosines[t], &mut even);
            matrix::multiply(instructions, &differences[left], &sines[t], &mut odd);
            let turns = self.middle_x[t].map(|angle| PhaseFactors::new(angle, general.half[0]));
            for image in 0..n {
                let image_range = image * 4 * padded..(image + 1) * 4 * padded;
                let at = (image * nt + t) * row;
                let halves = [&even[image_range.clone()], &odd[image_range]];
                general.spread(halves, &turns, [&mut plus[at..][..row], &mut minus[at..][..row]]);
            }
        }
        Across { sums: plus, differences: minus }
    }

    /// The second step of the transform of an image, along y: adds the disc's contribution to its field.
    fn down(
        &self,
        general: &General,
        across: &Across,
        image: usize,
        instructions: InstructionSet,
        [even, odd]: &mut [Vec<f32>; 2],
        field: &mut [f32],
    ) {
        let wide = general.columns();
        let (rows, lower) = (2 * general.half[1] - 1, general.half[1]);
        let columns = 2 * wide;
        let image_range = image * self.t * columns..(image + 1) * self.t * columns;
        let [cosines, sines] = &self.along_y;
        let panels = |rows: &[f32]| Panels::from_rows(rows, columns);
        matrix::multiply(instructions, cosines, &panels(&across.sums[image_range.clone()]), even);
        matrix::multiply(instructions, sines, &panels(&across.differences[image_range]), odd);
        let turns = PhaseFactors::new(self.middle_y, lower);
        let (real, imaginary) = field.split_at_mut(rows * wide);
        for row in 0..lower {
            let (cos, sin) = (&even[row * columns..][..columns], &odd[row * columns..][..columns]);
            for column in 0..wide {
                let [cr, ci] = [cos[column], cos[wide + column]];
                let [sr, si] = [sin[column], sin[wide + column]];
                let below = turns.back(row, [cr + si, ci - sr]);
                let above = turns.forth(row, [cr - si, ci + sr]);
                let places = [(lower - 1 + row, below), (lower - 1 - row, above)];
                for (place, value) in places.into_iter().take(1 + row.min(1)) {
                    real[place * wide + column] += value[0];
                    imaginary[place * wide + column] += value[1];
                }
            }
        }
    }
}

impl General {
    /// Adds the products with cosines and sines of a row at t and of that at -t, for the columns from the
    /// middle to the right, to the columns of both halves of their sum and their difference.
    fn spread(&self, [even, odd]: [&[f32]; 2], turns: &[PhaseFactors; 2], [plus, minus]: [&mut [f32]; 2]) {
        let (wide, middle) = (self.columns(), self.half[0] - 1);
        for (sign, (turns, factor)) in turns.iter().zip([1.0, -1.0]).enumerate() {
            let part =
                |values: &[f32], part: usize, column: usize| values[(sign * 2 + part) * self.padded + column];
            for column in 0..self.half[0] {
                let [cr, ci] = [part(even, 0, column), part(even, 1, column)];
                let [sr, si] = [part(odd, 0, column), part(odd, 1, column)];
                // cos - i sin to the right, cos + i sin to the left; -i (sr + i si) = si - i sr.
                let right = turns.back(column, [cr + si, ci - sr]);
                let left = turns.forth(column, [cr - si, ci + sr]);
                let places = [(middle + column, right), (middle - column, left)];
                for (place, value) in places.into_iter().take(1 + column.min(1)) {
                    for part in 0..2 {
                        plus[part * wide + place] += value[part];
                        minus[part * wide + place] += factor * value[part];
                    }
                }
            }
        }
    }
}

/// Phase factors of the multiples of an angle.
struct PhaseFactors(Vec<[f32; 2]>);

impl PhaseFactors {
    fn new(angle: f64, count: usize) -> PhaseFactors {
        PhaseFactors(
            (0..count)
                .map(|i| libm::sincos(angle * i as f64))
                .map(|(sine, cosine)| [cosine as f32, sine as f32])
                .collect(),
        )
    }

    /// Multiplies a complex number by exp(-i angle).
    fn back(&self, i: usize, v: [f32; 2]) -> [f32; 2] {
        let [c, s] = self.0[i];
        [v[0] * c + v[1] * s, v[1] * c - v[0] * s]
    }

    /// Multiplies a complex number by exp(i angle).
    fn forth(&self, i: usize, v: [f32; 2]) -> [f32; 2] {
        let [c, s] = self.0[i];
        [v[0] * c - v[1] * s, v[1] * c + v[0] * s]
    }
}

/// Writes sums and differences of the pupil functions of all images at opposite points of each row.
struct Fill<'a> {
    rows: &'a Rows,
    general: &'a General,
    modes: &'a Modes,
    images: &'a [(usize, bool)],
    k: f64,
    out: [&'a mut [f32]; 2],
}

impl pulp::WithSimd for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Fill { rows, general, modes, images, k, out: [sums, differences] } = self;
        let known = interpolation::table(modes);
        let fields = known.len() / interpolation::RADII;
        let highest = modes.modes.iter().map(|mode| mode.order).max().unwrap_or(0);
        let mut turns = vec![[1.0, 0.0]; highest + 1];
        let mut here = vec![0.0; fields];
        let mut values = vec![[0.0; 2]; 4 * images.len()];
        for (place, four) in rows.nodes.iter().enumerate() {
            for (node, values) in four.iter().zip(values.chunks_exact_mut(images.len())) {
                interpolation::interpolate(&known, &node.around, &mut here);
                for m in 1..=highest {
                    let [x, y] = turns[m - 1];
                    turns[m] = [x * node.cosine - y * node.sine, x * node.sine + y * node.cosine];
                }
                let (sine, cosine) = libm::sincos(k * (here[0] + node.extra));
                let factor = k * general.scale * node.area;
                let carrier = [factor * cosine, factor * sine];
                for (value, &(mode, sine)) in values.iter_mut().zip(images) {
                    let (re, im) = (here[1 + 2 * mode], here[2 + 2 * mode]);
                    let azimuth = turns[modes.modes[mode].order][usize::from(sine)];
                    *value = [
                        azimuth * (re * carrier[0] - im * carrier[1]),
                        azimuth * (re * carrier[1] + im * carrier[0]),
                    ];
                }
            }
            let (t, u) = (place / rows.u, place % rows.u);
            for image in 0..images.len() {
                for sign in 0..2 {
                    let (a, b) = (
                        values[2 * sign * images.len() + image],
                        values[(2 * sign + 1) * images.len() + image],
                    );
                    for part in 0..2 {
                        let at = ((((t * images.len() + image) * 2 + sign) * 2) + part) * rows.u + u;
                        sums[at] = (a[part] + b[part]) as f32;
                        differences[at] = (a[part] - b[part]) as f32;
                    }
                }
            }
        }
    }
}
