//! What a fit of a field found, with the files that describe it.

use std::ops::RangeInclusive;

use microsig_core::optics::FieldOptics;
use serde::Serialize;

use super::dependence::{Coefficient, FEWEST, FEWEST_OF_FOCUS, FieldDependence, LIGHT, SCATTER};
use super::frames::Frames;
use super::local::{DIAMETER, FOCUS, LARGEST_NA, NA, QUANTITIES, X, Y};
use super::particle::{Fit, Subject};
use super::{WaveOptions, evenly, median, output};
use crate::outcome::{Verdict, excess_sd, sentence, verdict};
use crate::particles::Candidate;
use crate::scan::Scan;
use storage::error::{Error, Result};

/// One particle of a field.
#[derive(Debug, Clone, Serialize)]
pub struct FieldParticle {
    /// Position in focus, px, with the first pixel's center at (1, 1).
    pub x_px: f64,
    /// See `x_px`.
    pub y_px: f64,
    /// Place in the field, mm from its center in the particles' space.
    pub place_mm: [f64; 2],
    /// Whether its images show one clean particle rather than two, or a dirty one.
    pub is_single: bool,
    /// Mean square of residuals over the variance of the mean of repeated frames, with values of its own.
    pub chi2: f64,
    /// Explained part of the images' variance, with values of its own.
    pub r2: f64,
    /// The same with the optics of the field; only position, focus, light and background are its own.
    pub chi2_of_field: f64,
    /// See `chi2_of_field`.
    pub r2_of_field: f64,
    /// Stage position in focus with the optics of the field for everything else, um.
    pub refitted_focus_um: f64,
    /// Mean light, counts.
    pub light: f64,
    /// Values of its own, by quantity.
    pub measured: Vec<f64>,
    /// Their standard deviations.
    pub sd: Vec<f64>,
    /// Values of the field dependence at its place.
    pub of_field: Vec<f64>,
}

/// The images of a particle at some planes, for a report.
#[derive(Debug, Clone)]
pub struct FieldImages {
    /// Index of the particle.
    pub particle: usize,
    /// Edge of an image, px.
    pub edge: usize,
    /// The planes.
    pub planes: Vec<PlaneImages>,
}

/// Data and model of a plane; pixels that are lit by neighbors are NaN.
#[derive(Debug, Clone)]
pub struct PlaneImages {
    /// Stage position, um.
    pub stage_um: f64,
    /// Counts above the background.
    pub data: Vec<f32>,
    /// The same by the field dependence.
    pub model: Vec<f32>,
    /// Data less model in standard deviations of the noise.
    pub residual: Vec<f32>,
}

/// The result of a fit of a whole field.
#[derive(Debug, Clone, Serialize)]
pub struct FieldFit {
    /// Coefficients of the field dependence.
    pub coefficients: Vec<Coefficient>,
    /// The optics as in a scenario.
    pub field: FieldOptics,
    /// Numerical aperture.
    pub numerical_aperture: f64,
    /// Standard deviation of the blur, um; 0 if it is contained in the diameter.
    pub blur_um: f64,
    /// Diameter of the particles, um.
    pub particle_diameter_um: f64,
    /// Stage position in focus at the center of the field, um.
    pub focus_um: f64,
    /// Depth range of the scan, um.
    pub depths_um: [f64; 2],
    /// Variance of a count: background (counts^2), per count of light (counts), per squared count.
    pub noise: [f64; 3],
    /// Whether that is the noise between repeated frames; otherwise the part of residuals that neighboring pixels do not share.
    pub is_noise_measured: bool,
    /// Background, counts.
    pub background: f64,
    /// Names of the quantities of each particle.
    pub quantities: Vec<&'static str>,
    /// All particles, nearest to the center first.
    pub particles: Vec<FieldParticle>,
    /// Mean over single particles, by the field dependence.
    pub r2_of_field: f64,
    /// Median over single particles, by the field dependence, in units of the variance of one frame.
    pub chi2_of_field: f64,
    /// Excess of chi2 over 1, in standard deviations of the chi2 of noise on as many pixels.
    pub excess_sd: f64,
    /// Fraction of the images' variance without noise that the field dependence explains.
    pub r2_of_signal: f64,
    /// Assessment of the fit.
    pub verdict: Verdict,
    /// What to know about the result.
    pub warnings: Vec<String>,
}

impl FieldFit {
    /// The conclusion, and what the model may lack if it does not describe the scan.
    pub fn sentence(&self) -> String {
        let conclusion = sentence(
            "wave optics does not describe this scan: inspect the residuals",
            self.verdict,
            [self.chi2_of_field, self.excess_sd, self.r2_of_signal],
        );
        if self.verdict == Verdict::NotDescribed { conclusion + ASSUMPTIONS } else { conclusion }
    }
}

const ASSUMPTIONS: &str = ". The fit assumes light of a single wavelength (no bandwidth), the medium and cover slip that the \
    objective is designed for unless a fluid is given (--fluid), and optics that are the same over the field of view unless \
    their variation is fitted (--field). Wavelength, emission and diameter may be wrong, too";

/// A fit with the files that describe it.
#[derive(Debug)]
pub struct FieldFiles {
    /// Result of the fit.
    pub fitted: FieldFit,
    /// Images from the center to the corner.
    pub images: Vec<FieldImages>,
    /// Names and contents of the files.
    pub files: Vec<(&'static str, Vec<u8>)>,
}

/// Transmissions at the rim of the pupil less that at its center that objectives may have.
const PLAUSIBLE_TRANSMISSION: RangeInclusive<f64> = -0.6..=0.5;

/// The parts of a result.
pub(super) struct Outcome<'a> {
    pub(super) scan: &'a Scan,
    pub(super) options: &'a WaveOptions,
    pub(super) frames: &'a Frames,
    pub(super) subjects: &'a [Subject<'a>],
    pub(super) candidates: &'a [Candidate],
    pub(super) found: usize,
}

impl Outcome<'_> {
    /// How much the foci of single particles scatter about the field's, and its standard deviation, um.
    fn scatter(&self, singles: &[usize], of_field: &[Fit], dependence: &FieldDependence) -> (f64, f64) {
        let residual = |&k: &usize| {
            let local = &of_field[k].local;
            let focus = dependence.at(self.subjects[k].place_of(local), local)[FOCUS];
            let variance = of_field[k].quadratic.matrix.inverse().map_or(f64::NAN, |c| c.at(0, 0));
            (local[FOCUS] - focus, of_field[k].chi2() * variance)
        };
        focus_scatter(&singles.iter().map(residual).collect::<Vec<_>>())
    }

    fn particles(
        &self,
        fits: &[Fit],
        is_single: &[bool],
        dependence: &FieldDependence,
        of_field: &[Fit],
    ) -> Vec<FieldParticle> {
        let subjects = self.subjects;
        (0..fits.len())
            .map(|k| {
                let window = &subjects[k].window;
                let Fit { local, free, .. } = &fits[k];
                let place_mm = subjects[k].place_of(local);
                let of_place = dependence.at(place_mm, local);
                let covariance = fits[k].quadratic.matrix.inverse();
                let sd = |i: usize| {
                    covariance.as_ref().map_or(f64::NAN, |c| libm::sqrt(fits[k].chi2() * c.at(i, i).max(0.0)))
                };
                FieldParticle {
                    x_px: window.column as f64 + 1.0 + local[X],
                    y_px: window.row as f64 + 1.0 + local[Y],
                    place_mm,
                    is_single: is_single[k],
                    chi2: fits[k].chi2(),
                    r2: fits[k].r2(),
                    chi2_of_field: of_field[k].chi2(),
                    r2_of_field: of_field[k].r2(),
                    refitted_focus_um: of_field[k].local[FOCUS],
                    light: of_field[k].light(),
                    measured: free.iter().map(|q| local[*q]).collect(),
                    sd: (0..free.len()).map(sd).collect(),
                    of_field: free.iter().map(|q| of_place[*q]).collect(),
                }
            })
            .collect()
    }

    pub(super) fn files(
        &self,
        fits: &[Fit],
        is_single: &[bool],
        dependence: &FieldDependence,
        of_field: &[Fit],
    ) -> Result<FieldFiles> {
        let Outcome { scan, options, frames, subjects, candidates, .. } = self;
        let repeats = frames.repeats.iter().sum::<usize>() as f64 / frames.repeats.len() as f64;
        let singles: Vec<usize> = (0..fits.len()).filter(|k| is_single[*k]).collect();
        let places = |k: usize| subjects[k].place_of(&fits[k].local);
        let light: Vec<([f64; 2], f64)> = singles.iter().map(|&k| (places(k), of_field[k].light())).collect();
        let mut dependence = dependence.clone();
        if options.is_field && singles.len() >= FEWEST {
            let (value, sd) = light_dependence(&light);
            dependence.coefficients.push(Coefficient { key: LIGHT, value, sd, unit: "1/mm^2" });
        }
        if options.is_field && singles.len() >= FEWEST_OF_FOCUS {
            let (value, sd) = self.scatter(&singles, of_field, &dependence);
            dependence.coefficients.push(Coefficient { key: SCATTER, value, sd, unit: "um" });
        }
        let (field, unresolved) = dependence.field(options.direction);
        let free = fits.first().map_or(&[][..], |fit| &fit.free);
        let quantities: Vec<&'static str> = free.iter().map(|q| QUANTITIES[*q].0).collect();
        let particles = self.particles(fits, is_single, &dependence, of_field);
        let mean_r2 = singles.iter().map(|&k| of_field[k].r2()).sum::<f64>() / singles.len() as f64;
        let chi2 = median(singles.iter().map(|&k| of_frame(of_field[k].chi2(), repeats)).collect());
        let mut warnings = self.warnings(fits.len(), singles.len(), dependence.coefficient("transmission"));
        if !unresolved.is_empty() {
            warnings.push(format!(
                "not resolved (the 95 % interval contains 0), and therefore 0 in scenario.ron: {}",
                unresolved.join(", ")
            ));
        }
        let is_bounded = |k: &&usize| fits[**k].local[NA] >= 0.999 * LARGEST_NA;
        let bounded = singles.iter().filter(is_bounded).count();
        if bounded > 0 {
            warnings.push(format!(
                "the numerical aperture of {bounded} of {} single particles is the largest that is tried, {LARGEST_NA}: check \
                 magnification, pixel size and steps of the stage, or set a larger window",
                singles.len()
            ));
        }
        let stage = |f: fn(f64, f64) -> f64, start: f64| {
            frames.stage_um.iter().map(|s| options.direction * (s - dependence.focus_um())).fold(start, f)
        };
        let (excess_sd, r2_of_signal) = quality(&singles.iter().map(|&k| &of_field[k]).collect::<Vec<_>>());
        let noise = subjects[0].noise;
        let fitted = FieldFit {
            particle_diameter_um: of_field[0].local[DIAMETER],
            excess_sd,
            r2_of_signal,
            verdict: verdict(chi2, excess_sd, r2_of_signal),
            field,
            numerical_aperture: dependence.numerical_aperture(),
            blur_um: dependence.blur_um(),
            focus_um: dependence.focus_um(),
            depths_um: [stage(f64::min, f64::INFINITY), stage(f64::max, f64::NEG_INFINITY)],
            noise: [noise.background2, noise.per_count, noise.per_count2],
            is_noise_measured: frames.is_noise_measured,
            // The histogram of the scan counts faint light as background.
            background: median(singles.iter().map(|&k| of_field[k].background()).collect()),
            quantities,
            particles,
            r2_of_field: mean_r2,
            chi2_of_field: chi2,
            warnings,
            coefficients: dependence.coefficients.clone(),
        };
        let shown = center_to_corner(&fitted.particles);
        let images = shown.into_iter().map(|k| images(k, &subjects[k], &of_field[k])).collect();
        let files = output::Files {
            fitted: &fitted,
            options,
            spherical: dependence.spherical(),
            transmission: dependence.transmission(),
            size_px: [scan.width, scan.height],
            light: brightness(&light, fitted.field.light_per_mm2),
            particles: candidates.len(),
        };
        let mut json = serde_json::to_vec_pretty(&fitted).map_err(|e| Error::input(e.to_string()))?;
        json.push(b'\n');
        let written = vec![
            crate::output::settings(&files.settings())?,
            ("field.json", json),
            ("scenario.ron", files.scenario().into_bytes()),
            ("particles.csv", output::table(&fitted)),
        ];
        Ok(FieldFiles { fitted, images, files: written })
    }

    fn warnings(&self, particles: usize, singles: usize, transmission: Option<&Coefficient>) -> Vec<String> {
        let mut warnings = self.scan.warnings.clone();
        if !self.frames.is_noise_measured {
            warnings.push(
                "the scan has no repeated frames: what neighboring pixels of the residuals do not share is taken as noise"
                    .to_owned(),
            );
        }
        let doubtful = particles - singles;
        if doubtful > 0 {
            warnings.push(format!(
                "{doubtful} of {} particles are not described as single ones (two, or dirty) and are left out",
                particles
            ));
        }
        if self.options.is_field && singles < FEWEST {
            let (focus, least) = match singles {
                FEWEST_OF_FOCUS.. => ("but for tilt and curvature of the focus, ", FEWEST),
                _ => ("", FEWEST_OF_FOCUS),
            };
            warnings.push(format!(
                "only {singles} single particles: {focus}the optics are taken as the same over the field; a fit of {} needs at least \
                 {least}, spread over the field (a smaller window may find more)",
                if focus.is_empty() { "tilt and curvature of the focus" } else { "their whole field dependence" }
            ));
        }
        warnings.extend(transmission.and_then(implausible));
        if self.found > particles {
            warnings.push(format!("{particles} of {} particles are used, spread over the field", self.found));
        }
        warnings.push(format!(
            "the direction of the stage ({} the lens) is taken as given: the reverse scan fits \
             equally well, with the opposite signs of focus, chief rays, spherical aberration and astigmatism",
            if self.options.direction > 0.0 { "away from" } else { "toward" }
        ));
        warnings
    }
}

/// Excess of chi2 over 1, in standard deviations of the chi2 of noise, and R2 without noise.
fn quality(fits: &[&Fit]) -> (f64, f64) {
    let pixels = fits.iter().map(|fit| fit.pixels()).sum::<usize>() as f64;
    let chi2 = fits.iter().map(|fit| fit.chi2() * fit.pixels() as f64).sum::<f64>() / pixels.max(1.0);
    let r2 = fits.iter().map(|fit| fit.r2_of_signal()).sum::<f64>() / fits.len() as f64;
    (excess_sd(chi2, pixels), r2)
}

/// A warning if the interval of the transmission at the rim of the pupil less that at its center is outside the
/// range of real objectives.
fn implausible(transmission: &Coefficient) -> Option<String> {
    let Coefficient { value, sd, .. } = *transmission;
    let (low, high) = (value - 1.96 * sd, value + 1.96 * sd);
    let is_plausible = high >= *PLAUSIBLE_TRANSMISSION.start() && low <= *PLAUSIBLE_TRANSMISSION.end();
    (!is_plausible).then(|| {
        format!(
            "the transmission at the rim of the pupil is {:.2} times that at its center, outside the range of real objectives \
             ({:.1} to {:.1}): the fit is probably wrong, depths included (a short range of depths, windows of the wrong size, or \
             a wrong diameter, wavelength or emission)",
            1.0 + value,
            1.0 + PLAUSIBLE_TRANSMISSION.start(),
            1.0 + PLAUSIBLE_TRANSMISSION.end()
        )
    })
}

/// Chi-squared of single frames, from chi-squared of means of `repeats` frames: their residuals share the errors of
/// the model and have less noise.
fn of_frame(chi2: f64, repeats: f64) -> f64 {
    1.0 + (chi2 - 1.0) / repeats
}

/// Mean and standard deviation of the light of particles, each as it would be in the middle of the field.
fn brightness(light: &[([f64; 2], f64)], light_per_mm2: f64) -> (f64, f64) {
    let of = |([x, y], light): &([f64; 2], f64)| light / (1.0 + light_per_mm2 * (x * x + y * y));
    let n = light.len() as f64;
    let mean = light.iter().map(of).sum::<f64>() / n;
    let variance = light.iter().map(|particle| (of(particle) - mean).powi(2)).sum::<f64>() / n;
    (mean, libm::sqrt(variance))
}

/// Number of coefficients of the surface in focus.
const FOCUS_TERMS: usize = 4;

/// Standard deviation of the focus of particles about the surface in focus beyond the variances of their fits, from
/// pairs of residual (um) and variance, with its own standard deviation; 0 if the variances explain the residuals (97.5 %
/// level), with half the largest scatter that would not show.
fn focus_scatter(residuals: &[(f64, f64)]) -> (f64, f64) {
    let left = residuals.len().saturating_sub(FOCUS_TERMS).max(1) as f64;
    let variance = residuals.iter().map(|(residual, _)| residual * residual).sum::<f64>() / left;
    let explained = residuals.iter().map(|(_, variance)| variance).sum::<f64>() / residuals.len() as f64;
    let relative_sd = libm::sqrt(2.0 / left);
    if variance - explained > 1.96 * relative_sd * explained {
        let scatter = libm::sqrt(variance - explained);
        (scatter, relative_sd * variance / (2.0 * scatter))
    } else {
        (0.0, libm::sqrt(1.96 * relative_sd * explained) / 1.96)
    }
}

/// Relative change of light per squared distance from the center, and its standard deviation: a straight line
/// through the light of particles, without those far off.
fn light_dependence(light: &[([f64; 2], f64)]) -> (f64, f64) {
    let middle = median(light.iter().map(|(_, light)| *light).collect());
    let points: Vec<(f64, f64)> = light
        .iter()
        .map(|([x, y], light)| (x * x + y * y, light / middle))
        .filter(|(_, light)| (0.5..2.0).contains(light))
        .collect();
    let n = points.len() as f64;
    let (mean_r2, mean) = points.iter().fold((0.0, 0.0), |(a, b), (r2, light)| (a + r2 / n, b + light / n));
    let spread: f64 = points.iter().map(|(r2, _)| (r2 - mean_r2) * (r2 - mean_r2)).sum();
    if points.len() < 4 || spread == 0.0 {
        return (0.0, f64::INFINITY);
    }
    let slope = points.iter().map(|(r2, light)| (r2 - mean_r2) * (light - mean)).sum::<f64>() / spread;
    let left = |(r2, light): &(f64, f64)| light - mean - slope * (r2 - mean_r2);
    let variance = points.iter().map(|point| left(point) * left(point)).sum::<f64>() / (n - 2.0);
    let center = mean - slope * mean_r2;
    (slope / center, libm::sqrt(variance / spread) / center)
}

/// Number of planes of a particle in a report.
const SHOWN_PLANES: usize = 11;

/// Three single particles: near the center, halfway, and far out.
fn center_to_corner(particles: &[FieldParticle]) -> Vec<usize> {
    let singles: Vec<usize> = (0..particles.len()).filter(|k| particles[*k].is_single).collect();
    let mut shown: Vec<usize> = evenly(singles.len(), 3).into_iter().map(|i| singles[i]).collect();
    shown.dedup();
    shown
}

fn images(particle: usize, subject: &Subject, fit: &Fit) -> FieldImages {
    let edge = 2 * subject.half + 1;
    let planes = evenly(subject.planes.len(), SHOWN_PLANES).into_iter().map(|i| {
        let plane = subject.planes[i];
        let seen = &fit.seen[i];
        let mut images = PlaneImages {
            stage_um: subject.frames.stage_um[plane],
            data: vec![f32::NAN; edge * edge],
            model: vec![f32::NAN; edge * edge],
            residual: vec![f32::NAN; edge * edge],
        };
        for (pixel, ((at, [dx, dy]), value)) in subject.window.pixels.iter().zip(&seen.model).enumerate() {
            if !subject.masks.get(i).is_none_or(|mask| mask[pixel]) {
                continue;
            }
            let place = (dy + subject.half as f64) as usize * edge + (dx + subject.half as f64) as usize;
            let count = subject.frames.planes[plane][*at];
            images.data[place] = (count - seen.background) as f32;
            images.model[place] = (value - seen.background) as f32;
            images.residual[place] = ((count - value) * seen.roots[pixel]) as f32;
        }
        images
    });
    FieldImages { particle, edge, planes: planes.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transmission_that_no_objective_has_is_named() {
        let warning =
            |value: f64, sd: f64| implausible(&Coefficient { key: "transmission", value, sd, unit: "" });
        assert!(warning(1.2, 0.1).unwrap().contains("is 2.20 times"));
        assert!(warning(-0.8, 0.05).is_some());
        for (value, sd) in [(-0.1, 0.02), (0.6, 1.0), (-0.65, 0.1)] {
            assert_eq!(warning(value, sd), None);
        }
    }
}
