//! Result of a fit: parameters with confidence intervals, goodness of fit, conclusion.

use microsig_core::{Settings, emission};
use serde::Serialize;

use super::FitOptions;
use super::Run;
use super::images::Problem;
use super::intervals::Covariance;
use super::noise::ROUNDING;
use super::optics::Shared;
use super::particles::Window;
use super::state::{Misfit, State, chi2, r2};

/// Half width of the 95 % interval of a normal distribution, standard deviations.
const NORMAL_95: f64 = 1.959_964;

/// Source points per pixel in the written settings, and the range of rays per point.
const POINTS_PER_PIXEL: f64 = 18.0;
const RAYS: (f64, f64) = (100.0, 500.0);

/// Variance of MicroSIG's ray counts divided by their mean. It is less than 1 where many rays of one source
/// point fall on one pixel; over a scan, of which most images are out of focus, it is 0.95 to 0.99.
const FANO: f64 = 0.97;

/// Excess of chi2, in standard deviations, from which residuals are more than noise.
const MORE_THAN_NOISE: f64 = 3.0;

/// Minimum difference of -2 ln(likelihood) between the two directions of the stage for the direction to be
/// considered known.
const KNOWN_DIRECTION: f64 = 20.0;

/// A fitted or given quantity.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// Name: the key in MicroSIG's settings, if there is one.
    pub name: String,
    /// Unit; empty if dimensionless.
    pub unit: &'static str,
    /// The value.
    pub value: f64,
    /// Standard deviation; 0 if given.
    pub sd: f64,
    /// Lower end of the 95 % interval.
    pub low_95: f64,
    /// Upper end of the 95 % interval.
    pub high_95: f64,
    /// Standard deviation over resampled particles, if requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bootstrap_sd: Option<f64>,
    /// Whether it was fitted.
    pub free: bool,
    /// The fitted quantity with the strongest correlation, and the correlation coefficient.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub correlates_with: Option<(String, f64)>,
}

/// One particle.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FittedParticle {
    /// x at the mean stage position, px, with the first pixel's center at 1.
    pub x_px: f64,
    /// y at the mean stage position, px, with the first pixel's center at 1.
    pub y_px: f64,
    /// Depth at stage position 0, um of the model.
    pub z_um: f64,
    /// Standard deviations of x (px), y (px) and z (um of the model).
    pub sd: [f64; 3],
    /// Counts that would be recorded if all light emitted into the half space toward the lens arrived.
    pub light_counts: f64,
    /// Background, counts.
    pub background_counts: f64,
}

/// Correlations of the fitted quantities that are common to all particles.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Correlations {
    /// Names of the quantities.
    pub names: Vec<String>,
    /// Correlation coefficients, row by row.
    pub matrix: Vec<Vec<f64>>,
}

/// Goodness of fit of one plane.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlaneFit {
    /// Stage position, um.
    pub stage_um: f64,
    /// Sum of squared residuals over variance, per pixel.
    pub chi2: f64,
    /// Brightness relative to the mean over planes.
    pub flux: f64,
}

/// Assessment of a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Residuals are within the noise.
    NoiseLimited,
    /// Residuals exceed the noise, but the model explains the images.
    Good,
    /// The model explains most of the light.
    Fair,
    /// The model is not valid.
    NotDescribed,
}

/// A fit of a scan.
#[derive(Debug, Clone, Serialize)]
pub struct Fitted {
    /// Version of the program.
    pub version: &'static str,
    /// Quantities that are common to all particles.
    pub parameters: Vec<Parameter>,
    /// Their correlations.
    pub correlations: Correlations,
    /// +1: stage positions increase away from the lens; -1: toward it.
    pub direction: f64,
    /// Difference of -2 ln(likelihood) to the other direction; `None` if the direction was given.
    pub direction_margin: Option<f64>,
    /// Direction in which the cylindrical lens has power, degrees from the image's x axis toward y, in (-90,
    /// 90]; 0 without a cylindrical lens.
    pub rotation_deg: f64,
    /// Lateral drift, px per um of stage position.
    pub drift_px_per_um: [f64; 2],
    /// Particles.
    pub particles: Vec<FittedParticle>,
    /// Planes.
    pub planes: Vec<PlaneFit>,
    /// Rejected windows: particle and plane, from 0.
    pub rejected: Vec<(usize, usize)>,
    /// Sum of squared residuals over variance, per pixel.
    pub chi2: f64,
    /// Excess of chi2 over 1, in standard deviations of the chi2 of noise on as many pixels.
    pub excess_sd: f64,
    /// Fraction of the squared signal above the noise that the model explains.
    pub r2: f64,
    /// Assessment of the fit.
    pub verdict: Verdict,
    /// MicroSIG's settings.
    #[serde(skip)]
    pub settings: Settings,
    /// Variance per count of light, counts.
    pub variance_per_count: f64,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Direction in which the cylindrical lens has power, from the x axis, -90 to 90 degrees; 0 without one.
fn rotation_deg(state: &State) -> f64 {
    if state.microscope.focus_shift_um == 0.0 {
        return 0.0;
    }
    let degrees = state.microscope.angle.to_degrees().rem_euclid(180.0);
    if degrees > 90.0 { degrees - 180.0 } else { degrees }
}

impl Fitted {
    pub(super) fn of(
        run: &Run,
        misfits: &[(usize, usize, Misfit)],
        covariance: &Covariance,
        resampled: &[Vec<f64>],
        options: &FitOptions,
    ) -> Fitted {
        let Run { problem, state, .. } = run;
        let (chi2, r2) = (chi2(misfits), r2(misfits));
        let pixels: usize = misfits.iter().map(|(_, _, m)| m.pixels).sum();
        let excess_sd = excess_sd(chi2, pixels as f64);
        let verdict = verdict(chi2, excess_sd, r2);
        let planes = (0..problem.scan.planes.len())
            .map(|i| {
                let own = misfits.iter().filter(|(_, plane, _)| *plane == i);
                let (chi2, n) = own.fold((0.0, 0.0), |(c, n), (_, _, m)| (c + m.chi2, n + m.pixels as f64));
                PlaneFit {
                    stage_um: problem.scan.stage_um[i],
                    chi2: chi2 / f64::max(n, 1.0),
                    flux: state.flux[i],
                }
            })
            .collect();
        let particles = state
            .beads
            .iter()
            .zip(&problem.windows.particles)
            .enumerate()
            .map(|(k, (bead, window))| {
                let first = problem.bead_parameter(k);
                FittedParticle {
                    x_px: window.column as f64 + bead.x + 1.0,
                    y_px: window.row as f64 + bead.y + 1.0,
                    z_um: bead.z_um,
                    sd: [0, 1, 2].map(|i| covariance.sd(&[(first + i, 1.0)])),
                    light_counts: bead.light,
                    background_counts: bead.background,
                }
            })
            .collect();
        let rejected = problem.rejected.iter().enumerate();
        let rejected = rejected
            .flat_map(|(k, planes)| planes.iter().enumerate().filter(|(_, r)| **r).map(move |(i, _)| (k, i)))
            .collect();
        let rotation_deg = rotation_deg(state);
        let (settings, clamped) = settings(problem, state);
        let mut warnings = problem.scan.warnings.clone();
        if clamped {
            warnings.push(format!(
                "rays cannot reproduce noise of {:.3} counts^2 per count of light: render with `render: (mode: expected)` and a \
                 sensor of gain_counts_per_e {:.3} with shot noise",
                state.noise.per_count, state.noise.per_count
            ));
        }
        if rotation_deg.abs() > 1.0 {
            warnings.push(format!(
                "the cylindrical lens has power at {rotation_deg:.1} degrees from the x axis; the settings are in the frame of the lens: rotate \
                 images by {:.1} degrees before comparing them with rendered ones",
                -rotation_deg
            ));
        }
        let half = problem.windows.half;
        let (width, height) = (problem.scan.width, problem.scan.height);
        if problem.windows.particles.iter().any(|w| {
            w.column == half || w.row == half || w.column + half + 1 == width || w.row + half + 1 == height
        }) {
            warnings.push(
                "a window ends at the edge of the image: light beyond the edge is not fitted".to_owned(),
            );
        }
        if verdict != Verdict::NoiseLimited {
            warnings.extend(halos(problem, state));
        }
        if run.direction_margin.is_some_and(|margin| margin < KNOWN_DIRECTION) {
            warnings.push(
                "the scan does not determine whether stage positions increase away from the lens or toward it: give its direction"
                    .to_owned(),
            );
        }
        Fitted {
            version: storage::VERSION,
            parameters: parameters(problem, state, covariance, resampled, options),
            correlations: correlations(problem, covariance),
            direction: state.direction,
            direction_margin: run.direction_margin,
            rotation_deg,
            drift_px_per_um: state.drift,
            particles,
            planes,
            rejected,
            chi2,
            excess_sd,
            r2,
            verdict,
            settings,
            variance_per_count: state.noise.per_count,
            warnings,
        }
    }

    /// The conclusion as a sentence.
    pub fn sentence(&self) -> String {
        let unlike = "geometrical optics does not describe this scan: images this close to focus, or particles this small, are \
                      shaped by diffraction; use the wave model";
        sentence(unlike, self.verdict, [self.chi2, self.excess_sd, self.r2])
    }
}

/// The conclusion from chi2 per pixel, its excess in standard deviations and R2; `unlike` if the model does not describe the scan.
pub(super) fn sentence(unlike: &str, verdict: Verdict, [chi2, excess_sd, r2]: [f64; 3]) -> String {
    let numbers = format!(
        "chi2 per pixel {chi2:.3}, {excess_sd:+.0} standard deviations from noise; {:.1} % of the light explained",
        100.0 * r2
    );
    match verdict {
        Verdict::NoiseLimited => format!("the model describes the scan to within its noise ({numbers})"),
        Verdict::Good => {
            format!(
                "the model describes the scan well, with residuals beyond its noise ({numbers}); inspect them"
            )
        }
        Verdict::Fair => format!("the model describes the scan roughly ({numbers}); inspect the residuals"),
        Verdict::NotDescribed => format!("{unlike} ({numbers})"),
    }
}

/// Share of a particle's light by which a wrong background over a window may differ from the scan's: 1.7 %
/// for overlapping halos that give an NA of 0.66 instead of 0.4, below 0.1 % for isolated images at NA 0.3.
const HALO: f64 = 0.01;

/// See [`halo`].
fn halos(problem: &Problem, state: &State) -> Option<String> {
    let light = state.beads.iter().map(|bead| bead.light).sum::<f64>() / state.beads.len() as f64;
    let (edge, windows) = (problem.edge_px(), &problem.windows.particles);
    let overlap = |a: &Window, b: &Window| a.column.abs_diff(b.column).max(a.row.abs_diff(b.row)) < edge;
    let is_crowded = windows.iter().enumerate().any(|(i, window)| {
        window.pixels.len() < edge * edge || windows[..i].iter().any(|other| overlap(window, other))
    });
    halo([state.background(), problem.background.mean], light, edge, is_crowded)
}

/// A warning if the fitted background (counts) differs from the scan's darkest pixels: a background and a halo
/// that fills a window of this edge (px) can stand in for each other, at another numerical aperture.
fn halo([fitted, dark]: [f64; 2], light: f64, edge: usize, is_crowded: bool) -> Option<String> {
    let share = (dark - fitted).abs() * (edge * edge) as f64 / light;
    let advice = if is_crowded {
        "use particles farther apart"
    } else {
        "omit the planes with the largest images, set a smaller window"
    };
    (share > HALO).then(|| {
        format!(
            "the fitted background is {fitted:.1} counts, that of the dark pixels of the scan {dark:.1}: over a window of {edge} px, \
             the difference is {:.1} % of the light of a particle. Particle images that are wider than the window or overlap cause \
             this; numerical aperture and focal length are then perhaps wrong: {advice} or, for a corrected objective, use the \
             wave model",
            100.0 * share
        )
    })
}

/// The chi2 per pixel of noise has a mean of 1 and a variance of 2 over the number of pixels.
pub(super) fn excess_sd(chi2: f64, pixels: f64) -> f64 {
    (chi2 - 1.0) * libm::sqrt(0.5 * pixels)
}

/// Fraction of the light that a model of the scan explains at least.
const LEAST_R2: f64 = 0.9;

/// With many pixels, a small excess of chi2 shows errors of the model: 1.09 over 430,000 is 42 standard deviations.
pub(super) fn verdict(chi2: f64, excess_sd: f64, r2: f64) -> Verdict {
    match (chi2, r2) {
        (_, r2) if r2 < LEAST_R2 => Verdict::NotDescribed,
        _ if excess_sd < MORE_THAN_NOISE => Verdict::NoiseLimited,
        (chi2, r2) if chi2 < 1.5 || r2 > 0.97 => Verdict::Good,
        _ => Verdict::Fair,
    }
}

/// MicroSIG's settings with the brightness and noise of the scan, and whether the noise is outside the range
/// that the number of rays can reproduce.
fn settings(problem: &Problem, state: &State) -> (Settings, bool) {
    let mut settings = state.microscope.settings(2 * problem.windows.half + 1);
    settings.pixel_dim_x = problem.scan.width as u32;
    settings.pixel_dim_y = problem.scan.height as u32;
    settings.points_per_pixel = POINTS_PER_PIXEL;
    let light = state.beads.iter().map(|b| b.light).sum::<f64>() / state.beads.len() as f64;
    let points = (emission::sphere_points(&settings, state.microscope.diameter_um) as f64).max(1.0);
    let rays = light / (state.noise.per_count.max(1e-9) / FANO * points) - 1.0;
    let clamped = !(RAYS.0..=RAYS.1).contains(&rays);
    settings.n_rays = rays.clamp(RAYS.0, RAYS.1).round() as u32;
    settings.gain = light / (points * (f64::from(settings.n_rays) + 1.0));
    // From the fit, which separates the light; the histogram of the scan counts faint light as background.
    settings.background_mean = state.background();
    settings.background_noise = libm::sqrt((state.noise.background2 - ROUNDING).max(0.0));
    (settings, clamped)
}

fn parameters(
    problem: &Problem,
    state: &State,
    covariance: &Covariance,
    resampled: &[Vec<f64>],
    options: &FitOptions,
) -> Vec<Parameter> {
    let at = |shared: Shared| problem.shared.iter().position(|s| *s == shared);
    let microscope = &state.microscope;
    let entry = |name: &str, unit, value: f64, own: Option<usize>, combination: Vec<(usize, f64)>| {
        let sd = covariance.sd(&combination);
        let strongest = own.and_then(|i| {
            (0..problem.shared.len())
                .filter(|j| *j != i)
                .map(|j| (problem.shared[j].name().to_owned(), covariance.correlation(i, j)))
                .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
        });
        Parameter {
            name: name.to_owned(),
            unit,
            value,
            sd,
            low_95: value - NORMAL_95 * sd,
            high_95: value + NORMAL_95 * sd,
            bootstrap_sd: spread(resampled, &combination),
            free: !combination.is_empty(),
            correlates_with: strongest,
        }
    };
    let one = |shared: Shared, factor: f64| at(shared).map(|i| (i, factor)).into_iter().collect::<Vec<_>>();
    let slope = microscope.slope;
    let by_slope = slope / libm::pow(1.0 + slope * slope, 1.5);
    let (f, d) = (microscope.focal_length_um, microscope.diameter_um);
    let mut all = vec![
        entry(
            "numerical_aperture",
            "",
            microscope.numerical_aperture(),
            at(Shared::NumericalAperture),
            one(Shared::NumericalAperture, by_slope),
        ),
        entry("focal_length", "um", f, at(Shared::FocalLength), one(Shared::FocalLength, f)),
        entry("particle_diameter_um", "um", d, at(Shared::Diameter), one(Shared::Diameter, d)),
    ];
    if let Some(shift) = at(Shared::FocusShift) {
        let (cylinder, delta) = (microscope.cylinder_um(), microscope.focus_shift_um);
        let mut combination = one(Shared::FocalLength, 2.0 * cylinder);
        combination.push((shift, -cylinder / delta));
        all.push(entry("cyl_focal_length", "um", cylinder, None, combination));
        all.push(entry("focus_shift_um", "um", delta, Some(shift), vec![(shift, 1.0)]));
        all.push(entry(
            "rotation_deg",
            "deg",
            microscope.angle.to_degrees(),
            at(Shared::Angle),
            one(Shared::Angle, 180.0 / std::f64::consts::PI),
        ));
    }
    let given = options.given;
    for (shared, unit, value) in [
        (Shared::RiLens, "", microscope.ri_lens),
        (Shared::PixelSize, "um", microscope.pixel_size_um),
        (Shared::DepthFactor, "", microscope.depth_factor),
    ] {
        all.push(entry(shared.name(), unit, value, at(shared), one(shared, value)));
    }
    let beads = 0..state.beads.len();
    let share = 1.0 / beads.len() as f64;
    let backgrounds = beads.map(|k| (problem.bead_parameter(k) + 4, share)).collect();
    all.push(entry("background_mean", "counts", state.background(), None, backgrounds));
    all.push(entry("magnification", "", given.magnification, None, Vec::new()));
    all.push(entry("ri_medium", "", given.ri_medium, None, Vec::new()));
    all
}

fn correlations(problem: &Problem, covariance: &Covariance) -> Correlations {
    let n = problem.shared.len();
    let row = |i: usize| (0..n).map(|j| covariance.correlation(i, j)).collect();
    Correlations {
        names: problem.shared.iter().map(|shared| shared.name().to_owned()).collect(),
        matrix: (0..n).map(row).collect(),
    }
}

/// Standard deviation of a linear combination of parameters over resampled fits; `None` if it is fixed or
/// there are fewer than two fits.
fn spread(resampled: &[Vec<f64>], combination: &[(usize, f64)]) -> Option<f64> {
    if combination.is_empty() || resampled.len() < 2 {
        return None;
    }
    let values: Vec<f64> = resampled
        .iter()
        .map(|steps| combination.iter().map(|&(i, factor)| factor * steps[i]).sum())
        .collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    Some(libm::sqrt(values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_background_in_place_of_halos_is_named() {
        // The difference of 7.4 counts over 129 x 129 px is 1.8 % of the light.
        let warning = |is_crowded| halo([346.2, 353.6], 7e6, 129, is_crowded).unwrap();
        assert!(warning(true).contains("the difference is 1.8 %") && warning(true).contains("farther apart"));
        assert!(!warning(false).contains("farther apart"));
        assert_eq!(halo([350.02, 350.0], 1.7e6, 59, true), None);
    }

    #[test]
    fn a_small_excess_over_many_pixels_is_more_than_noise() {
        let of = |chi2: f64, pixels: f64| verdict(chi2, excess_sd(chi2, pixels), 0.99);
        assert_eq!(of(1.09, 432_666.0), Verdict::Good);
        assert_eq!(of(1.09, 1000.0), Verdict::NoiseLimited);
    }
}
