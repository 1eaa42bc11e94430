//! Spatial resolution: spectra of the measured field, the true field and the error, and the amplitude
//! response between them.
//!
//! Along every complete line of the grid: subtract the mean, apply a Hann window w, Fourier transform to F.
//! Power densities are 2 |F|^2 step / sum w^2 (px^3: they integrate over 1 / wavelength to the variance),
//! averaged over lines. The amplitude response is Re sum F_found conj F_true / sum |F_true|^2: 1 where the
//! field is resolved, 0 where it is not.

use numeric::fourier::{Complex64, LineFft};

use super::vectors::{ComparedVector, VectorGrid};

scores! {
    /// Spectra of one component along one axis.
    pub struct Spectrum {
        /// Component of the displacement: u or v.
        pub component: String,
        /// Axis of the transform: x or y.
        pub along: String,
        /// Number of complete rows or columns that were transformed.
        pub lines: usize,
        /// One entry per wavelength, longest first.
        pub waves: Vec<SpectralPoint>,
        /// Wavelength at which the amplitude response falls below 0.8, coming from long wavelengths.
        not_negative wavelength_80_px: Option<f64>,
        /// Wavelength at which the amplitude response falls below 0.5, coming from long wavelengths.
        not_negative wavelength_50_px: Option<f64>,
    }

    /// One wavelength; power densities integrate over 1 / wavelength to the variance.
    pub struct SpectralPoint {
        /// Wavelength.
        not_negative wavelength_px: f64,
        /// Power density of the truth.
        not_negative true_power_px3: f64,
        /// Power density of the result.
        not_negative found_power_px3: f64,
        /// Power density of the error.
        not_negative error_power_px3: f64,
        /// Re sum F_result conj F_true / sum |F_true|^2; null where its standard error exceeds 0.1.
        pub response: Option<f64>,
    }
}

/// The response is undefined where the true power is below this fraction of its maximum: rounding and
/// spectral leakage dominate.
const LEAST: f64 = 1e-6;
/// Largest standard error of a reported response, estimated from the part of the measured spectrum that is
/// not coherent with the truth.
const MOST_ERROR: f64 = 0.1;

/// Smallest number of vectors in a line.
const POINTS: usize = 8;

/// Spectra of both components along both axes, where there are complete, equally spaced lines.
pub(super) fn spectra(grid: &VectorGrid, all: &[ComparedVector]) -> Vec<Spectrum> {
    let (nx, ny) = (grid.x_px.len(), grid.y_px.len());
    let mut spectra = Vec::new();
    for (along, axis, others) in [("x", &grid.x_px, ny), ("y", &grid.y_px, nx)] {
        let Some(step) = equal_steps(axis).filter(|_| axis.len() >= POINTS) else { continue };
        let cell = |i: usize, line: usize| if along == "x" { grid.cell(i, line) } else { grid.cell(line, i) };
        let lines: Vec<Vec<&ComparedVector>> = grid
            .pairs
            .values()
            .flat_map(|cells| (0..others).map(move |line| (cells, line)))
            .filter_map(|(cells, line)| {
                (0..axis.len()).map(|i| cells[cell(i, line)].map(|k| &all[k])).collect()
            })
            .collect();
        for (k, component) in ["u", "v"].into_iter().enumerate() {
            spectra.extend(from_lines(&lines, k, step).map(|s| Spectrum {
                component: component.to_owned(),
                along: along.to_owned(),
                ..s
            }));
        }
    }
    spectra
}

/// The spacing of an axis, px, if it is uniform to 0.1 % (text files are rounded).
fn equal_steps(axis: &[f64]) -> Option<f64> {
    let step = (axis.last()? - axis.first()?) / (axis.len().checked_sub(1)?) as f64;
    axis.windows(2).all(|w| ((w[1] - w[0]) / step - 1.0).abs() < 1e-3).then_some(step)
}

fn from_lines(lines: &[Vec<&ComparedVector>], k: usize, step: f64) -> Option<Spectrum> {
    let n = lines.first()?.len();
    let window: Vec<f64> = (0..n)
        .map(|i| 0.5 - 0.5 * (2.0 * std::f64::consts::PI * (i as f64 + 0.5) / n as f64).cos())
        .collect();
    let transform = LineFft::new(n);
    let of = |values: &dyn Fn(&ComparedVector) -> f64, line: &[&ComparedVector]| -> Vec<Complex64> {
        let mean = line.iter().map(|c| values(c)).sum::<f64>() / n as f64;
        let windowed: Vec<f64> = line.iter().zip(&window).map(|(c, w)| w * (values(c) - mean)).collect();
        transform.forward(&windowed)
    };
    let mut sums = vec![[0.0; 4]; n / 2 + 1];
    for line in lines {
        let (found, exact) = (of(&|c| c.measured.moved[k], line), of(&|c| c.truth[k], line));
        for (sum, (f, t)) in sums.iter_mut().zip(found.iter().zip(&exact)) {
            let of_line = [t.norm_sqr(), f.norm_sqr(), (f - t).norm_sqr(), (f * t.conj()).re];
            sum.iter_mut().zip(of_line).for_each(|(s, v)| *s += v);
        }
    }
    // Index 0 is the mean, which was subtracted.
    let greatest = sums.iter().skip(1).map(|s| s[0]).fold(0.0, f64::max);
    let scale = 2.0 * step / window.iter().map(|w| w * w).sum::<f64>() / lines.len() as f64;
    let waves: Vec<SpectralPoint> = sums
        .iter()
        .enumerate()
        .skip(1)
        .map(|(i, s)| SpectralPoint {
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

/// The amplitude response, if its standard error is small enough.
fn response(&[exact, found, _, both]: &[f64; 4], lines: usize) -> Option<f64> {
    let w = both / exact;
    let strange = (found - w * both).max(0.0) / exact / lines as f64;
    (strange.sqrt() < MOST_ERROR).then_some(w)
}

/// The wavelength at which the response, coming from long wavelengths, falls below a level; interpolated
/// linearly in 1 / wavelength.
fn crossing(waves: &[SpectralPoint], level: f64) -> Option<f64> {
    let known: Vec<(f64, f64)> =
        waves.iter().filter_map(|w| Some((1.0 / w.wavelength_px, w.response?))).collect();
    let pair = known.windows(2).find(|w| w[0].1 >= level && w[1].1 < level)?;
    let [(k0, a), (k1, b)] = [pair[0], pair[1]];
    Some(1.0 / (k0 + (k1 - k0) * (a - level) / (a - b)))
}
