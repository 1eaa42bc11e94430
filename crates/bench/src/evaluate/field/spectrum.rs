//! What remains of every wavelength: spectra of the measured field, of the true one and of the error, and the amplitude
//! response between them.
//!
//! Along every complete line of the lattice: mean taken off, Hann's window, Fourier transform F. Power densities are
//! 2 |F|^2 step / sum w^2 (px^3: they integrate over 1 / wavelength to the variance), averaged over lines. The response is
//! w(lambda) = Re sum F_found conj F_true / sum |F_true|^2: 1 where the field is resolved, 0 where it is lost.

use realfft::RealFftPlanner;
use realfft::num_complex::Complex64;
use serde::Serialize;

use super::Compared;
use super::lattice::Lattice;

/// Spectra of a component along an axis.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Spectrum {
    pub component: &'static str,
    pub along: &'static str,
    /// Complete lines that were transformed.
    pub lines: usize,
    pub waves: Vec<Wave>,
    /// The wavelengths below which less than 80 % (50 %) of the amplitude remain; null if that is not seen.
    pub wavelength_80_px: Option<f64>,
    pub wavelength_50_px: Option<f64>,
}

/// One wavelength.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Wave {
    pub wavelength_px: f64,
    pub true_power_px3: f64,
    pub found_power_px3: f64,
    pub error_power_px3: f64,
    /// Null where the truth has too little to tell it from noise.
    pub response: Option<f64>,
}

/// Wavelengths of less than this share of the greatest true power have no response: rounding and window leak more.
const LEAST: f64 = 1e-6;
/// Greatest standard error of a response, from what of the measured wave is not the true one's.
const MOST_ERROR: f64 = 0.1;

/// Shortest line.
const POINTS: usize = 8;

/// Spectra of both components along both axes, as far as there are complete lines of equal steps.
pub(super) fn spectra(lattice: &Lattice, all: &[Compared]) -> Vec<Spectrum> {
    let (nx, ny) = (lattice.x_px.len(), lattice.y_px.len());
    let mut spectra = Vec::new();
    for (along, axis, others) in [("x", &lattice.x_px, ny), ("y", &lattice.y_px, nx)] {
        let Some(step) = equal_steps(axis).filter(|_| axis.len() >= POINTS) else { continue };
        let cell =
            |i: usize, line: usize| if along == "x" { lattice.cell(i, line) } else { lattice.cell(line, i) };
        let lines: Vec<Vec<&Compared>> = lattice
            .pairs
            .values()
            .flat_map(|cells| (0..others).map(move |line| (cells, line)))
            .filter_map(|(cells, line)| {
                (0..axis.len()).map(|i| cells[cell(i, line)].map(|k| &all[k])).collect()
            })
            .collect();
        for (k, component) in ["u", "v"].into_iter().enumerate() {
            spectra.extend(of_lines(&lines, k, step).map(|s| Spectrum { component, along, ..s }));
        }
    }
    spectra
}

/// The step of an axis whose steps are equal to a thousandth (text files round).
fn equal_steps(axis: &[f64]) -> Option<f64> {
    let step = (axis.last()? - axis.first()?) / (axis.len().checked_sub(1)?) as f64;
    axis.windows(2).all(|w| ((w[1] - w[0]) / step - 1.0).abs() < 1e-3).then_some(step)
}

fn of_lines(lines: &[Vec<&Compared>], k: usize, step: f64) -> Option<Spectrum> {
    let n = lines.first()?.len();
    let window: Vec<f64> = (0..n)
        .map(|i| 0.5 - 0.5 * (2.0 * std::f64::consts::PI * (i as f64 + 0.5) / n as f64).cos())
        .collect();
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(n);
    let (mut input, mut output) = (transform.make_input_vec(), transform.make_output_vec());
    let mut of = |values: &dyn Fn(&Compared) -> f64, line: &[&Compared]| -> Vec<Complex64> {
        let mean = line.iter().map(|c| values(c)).sum::<f64>() / n as f64;
        for ((slot, c), w) in input.iter_mut().zip(line).zip(&window) {
            *slot = w * (values(c) - mean);
        }
        // Lengths are the plan's own.
        let done = transform.process(&mut input, &mut output);
        debug_assert!(done.is_ok());
        output.clone()
    };
    let mut sums = vec![[0.0; 4]; n / 2 + 1];
    for line in lines {
        let (found, exact) = (of(&|c| c.found.moved[k], line), of(&|c| c.exact[k], line));
        for (sum, (f, t)) in sums.iter_mut().zip(found.iter().zip(&exact)) {
            let of_line = [t.norm_sqr(), f.norm_sqr(), (f - t).norm_sqr(), (f * t.conj()).re];
            sum.iter_mut().zip(of_line).for_each(|(s, v)| *s += v);
        }
    }
    // The mean is taken off, and the shortest wave of an even number of points is half of one.
    let greatest = sums.iter().skip(1).map(|s| s[0]).fold(0.0, f64::max);
    let scale = 2.0 * step / window.iter().map(|w| w * w).sum::<f64>() / lines.len() as f64;
    let waves: Vec<Wave> = sums
        .iter()
        .enumerate()
        .skip(1)
        .map(|(i, s)| Wave {
            wavelength_px: n as f64 * step / i as f64,
            true_power_px3: s[0] * scale,
            found_power_px3: s[1] * scale,
            error_power_px3: s[2] * scale,
            response: response(s, lines.len()).filter(|_| s[0] > LEAST * greatest && s[0] * scale > 1e-12),
        })
        .collect();
    let [wavelength_80_px, wavelength_50_px] = [0.8, 0.5].map(|level| crossing(&waves, level));
    Some(Spectrum { lines: lines.len(), waves, wavelength_80_px, wavelength_50_px, ..Spectrum::default() })
}

/// The response of a wave, if the lines tell it well enough.
fn response(&[exact, found, _, both]: &[f64; 4], lines: usize) -> Option<f64> {
    let w = both / exact;
    let strange = (found - w * both).max(0.0) / exact / lines as f64;
    (strange.sqrt() < MOST_ERROR).then_some(w)
}

/// The wavelength, coming from long ones, at which the response falls below a level; linear in 1 / wavelength.
fn crossing(waves: &[Wave], level: f64) -> Option<f64> {
    let known: Vec<(f64, f64)> =
        waves.iter().filter_map(|w| Some((1.0 / w.wavelength_px, w.response?))).collect();
    let pair = known.windows(2).find(|w| w[0].1 >= level && w[1].1 < level)?;
    let [(k0, a), (k1, b)] = [pair[0], pair[1]];
    Some(1.0 / (k0 + (k1 - k0) * (a - level) / (a - b)))
}
