//! Images for a pupil with mirror symmetry in x and y: a matrix Fourier transform of one quadrant.
//!
//! The pupil is integrated row by row, sigma_y = sigma_a sin t with Gauss-Legendre nodes t, and along each
//! row sigma_x = sigma_a cos t u with Gauss-Legendre nodes u in [0, 1], so that the nodes follow the edge. A
//! mode of order m gives two pupil functions, with cos m psi and sin m psi, each even or odd in x and in y,
//! so kernels are real: cosines or sines. They do not depend on depth. At another wavelength, they apply to
//! scaled positions in the image.

use std::sync::Arc;

use super::interpolation::{self, Around};
use super::matrix::{self, LANES, Panels};
use super::modes::{Mode, Modes};
use super::pupil::{Pupil, Radii};
use crate::quadrature::gauss_legendre_on;
use crate::render::instructions::InstructionSet;
use crate::render::store::{self, Kernels};

/// Number of parities: even and odd.
const PARITIES: usize = 2;

/// One quadrature point of the quadrant.
#[derive(Debug, Clone)]
struct Node {
    around: Around,
    cosine: f64,
    sine: f64,
    /// K cos^2 psi (Ax/Bx - 1/b): the optical path that a cylindrical lens adds, um.
    cylinder: f64,
    /// Weight in an integral over the full pupil.
    area: f64,
}

#[derive(Debug)]
pub(super) struct Quadrant {
    pub(super) radii: Radii,
    /// Weights of the radii in an integral over sigma d sigma.
    pub(super) weights: Vec<f64>,
    /// Numbers of nodes of t and of u.
    rows: usize,
    across: usize,
    nodes: Vec<Node>,
    /// Points of the image: columns (a multiple of [`LANES`]) and rows.
    columns: usize,
    lines: usize,
    transform: Arc<Transform>,
    /// 1 / (2 pi sqrt(|Bx By|)): factor of the field, besides k.
    scale: f64,
}

/// What does not depend on the optics but for two angles.
#[derive(Debug)]
struct Transform {
    /// By parity: for each t, [u x columns].
    along_x: [Vec<Panels<f32>>; PARITIES],
    /// By parity: [lines x t].
    along_y: [Vec<f32>; PARITIES],
}

impl Transform {
    /// For nodes t and u, and columns and lines. Along x and y, the angle from one column or line to the next of
    /// light from the edge of the pupil is the product of the first two factors over the third.
    fn new([t, u]: [&[f64]; 2], [columns, lines]: [usize; 2], [x, y]: [[f64; 3]; 2]) -> Transform {
        let mut along_x = [(); PARITIES].map(|()| vec![Panels::zeros(u.len(), columns); t.len()]);
        let mut along_y = [Vec::with_capacity(lines * t.len()), Vec::with_capacity(lines * t.len())];
        for (row, t) in t.iter().enumerate() {
            let cosine_t = libm::cos(*t);
            for (across, u) in u.iter().enumerate() {
                let (sine, cosine) = libm::sincos(x[0] * cosine_t * u * x[1] / x[2]);
                let mut turn = [1.0, 0.0];
                for column in 0..columns {
                    along_x[0][row].set(across, column, turn[0] as f32);
                    along_x[1][row].set(across, column, turn[1] as f32);
                    turn = [turn[0] * cosine - turn[1] * sine, turn[1] * cosine + turn[0] * sine];
                }
            }
        }
        for line in 0..lines {
            for t in t {
                let (sine, cosine) = libm::sincos(y[0] * libm::sin(*t) * y[1] * line as f64 / y[2]);
                along_y[0].push(cosine as f32);
                along_y[1].push(sine as f32);
            }
        }
        Transform { along_x, along_y }
    }
}

impl Quadrant {
    /// `end`: radius in the lens plane where the pupil ends, um; `counts`: numbers of nodes of t and u; then the
    /// image's columns and rows, at steps of `steps_um`; `shared`: where kernels are shared with other optics.
    pub(super) fn new(
        pupil: &Pupil,
        k: f64,
        end: f64,
        counts: [usize; 2],
        (places, steps_um): ([usize; 2], [f64; 2]),
        shared: Option<&Kernels>,
    ) -> Quadrant {
        let sigma_end = pupil.sigma(end);
        let radii = interpolation::radii(pupil, end);
        let weights = interpolation::weights(&radii);
        let counts = if shared.is_some() { counts.map(|count| store::rounded(count, 8)) } else { counts };

        let [ax, bx] = pupil.across();
        let power = ax / bx - 1.0 / pupil.b();
        let (t, t_weight) = gauss_legendre_on(0.0, 0.5 * std::f64::consts::PI, counts[0]);
        let (u, u_weight) = gauss_legendre_on(0.0, 1.0, counts[1]);
        let mut nodes = Vec::with_capacity(t.len() * u.len());
        for (t, t_weight) in t.iter().zip(&t_weight) {
            let (sine_t, cosine_t) = libm::sincos(*t);
            for (u, u_weight) in u.iter().zip(&u_weight) {
                let (x, y) = (cosine_t * u, sine_t);
                let r = libm::sqrt(x * x + y * y);
                let around = interpolation::around(r);
                let curvature = around.value(&radii.curvature);
                let (cosine, sine) = (x / r, y / r);
                nodes.push(Node {
                    around,
                    cosine,
                    sine,
                    cylinder: curvature * cosine * cosine * power,
                    area: 4.0 * sigma_end * sigma_end * cosine_t * cosine_t * t_weight * u_weight,
                });
            }
        }
        let (columns, lines) = (places[0].next_multiple_of(LANES), places[1]);
        let b = [bx, pupil.b()];
        let factors = [0, 1].map(|axis| [k * sigma_end, steps_um[axis], b[axis]]);
        let transform = match shared {
            None => Arc::new(Transform::new([&t, &u], [columns, lines], factors)),
            Some(shared) => {
                let billionths = factors.map(|[edge, step, b]| libm::rint(1e9 * edge * step / b));
                let factors = billionths.map(|angle| [angle, 1e-9, 1.0]);
                let counts = [t.len(), u.len(), columns, lines].map(|count| count as u64);
                let key = [&counts[..], &billionths.map(f64::to_bits)].concat();
                let bytes = PARITIES * t.len() * (u.len() * columns + lines) * size_of::<f32>();
                shared.get(&key, || (Transform::new([&t, &u], [columns, lines], factors), bytes))
            }
        };
        Quadrant {
            radii,
            weights,
            rows: counts[0],
            across: counts[1],
            nodes,
            columns,
            lines,
            transform,
            scale: 1.0 / (2.0 * std::f64::consts::PI * libm::sqrt((bx * pupil.b()).abs())),
        }
    }

    /// Number of columns of an image, a multiple of [`LANES`].
    pub(super) fn columns(&self) -> usize {
        self.columns
    }

    /// [`Quadrant::light`] of each mode.
    pub(super) fn lights(&self, modes: &Modes, k: f64, instructions: InstructionSet) -> Vec<Vec<f64>> {
        let single = |mode: &Mode| {
            let modes = Modes { phase: modes.phase.clone(), modes: vec![mode.clone()] };
            self.light(&modes, k, instructions)
        };
        modes.modes.iter().map(single).collect()
    }

    /// Light per um^2 at all points of the image, row by row, of these modes at the wave number `k` (1/um).
    pub(super) fn light(&self, modes: &Modes, k: f64, instructions: InstructionSet) -> Vec<f64> {
        let images = images(modes);
        let mut pupil_functions: Vec<Vec<f32>> =
            images.iter().map(|class| vec![0.0; 2 * class.len() * self.nodes.len()]).collect();
        instructions.dispatch(Fill { quadrant: self, modes, k, images: &images, out: &mut pupil_functions });
        let mut light = vec![0.0; self.lines * self.columns];
        for (class, (images, functions)) in images.iter().zip(&pupil_functions).enumerate() {
            if images.is_empty() {
                continue;
            }
            let (x_kernel, y_kernel) =
                (&self.transform.along_x[class % PARITIES], &self.transform.along_y[class / PARITIES]);
            let parts = 2 * images.len();
            let wide = parts * self.columns;
            let mut half = Panels::zeros(self.rows, wide);
            let functions = functions.chunks_exact(parts * self.across);
            for (row, (kernel, functions)) in x_kernel.iter().zip(functions).enumerate() {
                matrix::multiply_to_row(instructions, functions, kernel, &mut half, row);
            }
            let mut field = vec![0.0; self.lines * wide];
            matrix::multiply(instructions, y_kernel, &half, &mut field);
            for (light, field) in light.chunks_exact_mut(self.columns).zip(field.chunks_exact(wide)) {
                for (image, parts) in images.iter().zip(field.chunks_exact(2 * self.columns)) {
                    let (real, imaginary) = parts.split_at(self.columns);
                    for ((light, re), im) in light.iter_mut().zip(real).zip(imaginary) {
                        *light += image.count * f64::from(re * re + im * im);
                    }
                }
            }
        }
        light
    }
}

#[derive(Debug, Clone, Copy)]
struct Image {
    mode: usize,
    order: usize,
    /// Whether it is the image with sin m psi instead of cos m psi.
    sine: bool,
    /// Multiplicity of its light.
    count: f64,
}

/// The images of modes by parity: even or odd in x, plus [`PARITIES`] if odd in y.
fn images(modes: &Modes) -> [Vec<Image>; PARITIES * PARITIES] {
    let mut images = [const { Vec::new() }; PARITIES * PARITIES];
    for (mode, of_mode) in modes.modes.iter().enumerate() {
        let (order, count) = (of_mode.order, of_mode.count());
        // cos m psi is even in y and has the parity of m in x; sin m psi is odd in y and has the opposite
        // parity in x.
        images[order % 2].push(Image { mode, order, sine: false, count });
        if order > 0 {
            images[PARITIES + (order + 1) % 2].push(Image { mode, order, sine: true, count });
        }
    }
    images
}

/// Writes the pupil functions of all images. Order: parity, t, image, real and imaginary part, u.
struct Fill<'a> {
    quadrant: &'a Quadrant,
    modes: &'a Modes,
    k: f64,
    images: &'a [Vec<Image>; PARITIES * PARITIES],
    out: &'a mut [Vec<f32>],
}

impl pulp::WithSimd for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Fill { quadrant, modes, k, images, out } = self;
        let known = interpolation::table(modes);
        let fields = known.len() / interpolation::RADII;
        let highest = modes.modes.iter().map(|mode| mode.order).max().unwrap_or(0);
        let mut turns = vec![[1.0, 0.0]; highest + 1];
        let mut here = vec![0.0; fields];
        for (place, node) in quadrant.nodes.iter().enumerate() {
            interpolation::interpolate(&known, &node.around, &mut here);
            for m in 1..=highest {
                let [x, y] = turns[m - 1];
                turns[m] = [x * node.cosine - y * node.sine, x * node.sine + y * node.cosine];
            }
            let (sine, cosine) = libm::sincos(k * (here[0] + node.cylinder));
            let factor = k * quadrant.scale * node.area;
            let carrier = [factor * cosine, factor * sine];
            let (t, u) = (place / quadrant.across, place % quadrant.across);
            for (images, out) in images.iter().zip(out.iter_mut()) {
                let first = t * 2 * images.len() * quadrant.across + u;
                for (i, image) in images.iter().enumerate() {
                    let (re, im) = (here[1 + 2 * image.mode], here[2 + 2 * image.mode]);
                    let azimuth = turns[image.order][usize::from(image.sine)];
                    let at = first + 2 * i * quadrant.across;
                    out[at] = (azimuth * (re * carrier[0] - im * carrier[1])) as f32;
                    out[at + quadrant.across] = (azimuth * (re * carrier[1] + im * carrier[0])) as f32;
                }
            }
        }
    }
}
