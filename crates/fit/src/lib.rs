//! Fits the settings of a real microscope to its calibration scan.
//!
//! A scan shows particles at rest at known stage positions. The background is estimated from the dark side of
//! the histogram (`background`), particles are found in the sum over planes (`particles`), and moments give
//! drift and the direction of the cylindrical lens (`moments`). Then traced rays are fitted to the widths of
//! images over depth, from many initial values (`curves`), and, from the best of these, expected images to
//! all pixels (`images`).
//!
//! According to Rossi 2020, the virtual focal lengths "must be found empirically"; this module does so.

mod background;
mod curves;
mod derivatives;
mod evidence;
mod field;
mod imager;
mod images;
mod intervals;
mod minimize;
mod moments;
mod noise;
mod normal;
mod optics;
mod outcome;
mod output;
mod particles;
mod rejection;
mod repeats;
mod scan;
mod search;
mod state;

use background::Background;
use curves::Known;
use derivatives::Derivatives;
use images::Problem;
use intervals::Covariance;
use moments::Shape;
use optics::Shared;
use state::State;

pub use evidence::{Evidence, MeasuredImage, Sample};
pub use field::{
    Coefficient, FieldFiles, FieldFit, FieldImages, FieldParticle, PlaneImages, WaveModel, WaveOptions,
    fit_waves,
};
pub use images::Watch;
pub use optics::{ExtraParameter, Given};
pub use outcome::{Correlations, Fitted, FittedParticle, Parameter, PlaneFit, Verdict};
pub use repeats::noise_of_repeats;
pub use scan::{Level, Scan, StagePositions, chosen_channel};
use storage::advice::option;
use storage::range::faults;
use storage::{Error, NumberRange, Result, advice};

/// Whether the fit has two focal planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Astigmatic {
    /// If the focal planes found from widths along and across differ.
    Auto,
    /// Given by the user.
    Known(bool),
}

/// Options of [`fit`].
#[derive(Debug, Clone)]
pub struct FitOptions {
    /// Given properties of the microscope.
    pub given: Given,
    /// Particle diameter, um; fitted if `None`.
    pub diameter_um: Option<f64>,
    /// +1: stage positions increase away from the lens; -1: toward it; fitted if `None`.
    pub direction: Option<f64>,
    /// Whether the fit has two focal planes.
    pub astigmatic: Astigmatic,
    /// Whether the brightness of each plane is fitted.
    pub free_flux: bool,
    /// Half width of the windows, px; from the size of the images if `None`.
    pub half_window: Option<usize>,
    /// Positions of the particles, px, with the first pixel's center at (1, 1); detected if `None`.
    pub places_px: Option<Vec<[f64; 2]>>,
    /// Fit by wave optics ([`fit_waves`]); `None`: by geometrical optics.
    pub waves: Option<WaveModel>,
    /// Additional quantities to fit, which scans of real objectives determine poorly.
    pub free: Vec<ExtraParameter>,
    /// Resamples of the particles for a second estimate of standard deviations; 0: none.
    pub bootstrap: usize,
    /// Seed of the resamples.
    pub seed: u64,
}

impl FitOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<()> {
        let Given { magnification, pixel_size_um, ri_medium, depth_factor, .. } = self.given;
        let layers = self.waves.and_then(|waves| waves.layers);
        let mut wrong = faults(&[
            (Some(magnification), Given::MAGNIFICATIONS),
            (Some(pixel_size_um), Given::PIXEL_SIZES_UM),
            (Some(ri_medium), Given::MEDIA),
            (Some(depth_factor), Given::DEPTH_FACTORS),
            (self.diameter_um, DIAMETERS_UM),
            (self.waves.map(|waves| waves.wavelength_um), WAVELENGTHS_UM),
            (layers.map(|layers| layers.n_s), FLUIDS),
            (layers.map(|layers| layers.focus_depth_um), FLUID_DEPTHS_UM),
        ]);
        // The same hint as for scenarios (`scenario::language::read`).
        let um = (pixel_size_um * 1e12).round() / 1e6;
        if !Given::PIXEL_SIZES_UM.allows(pixel_size_um) && Given::PIXEL_SIZES_UM.allows(um) {
            wrong.push(advice!(format!("a pixel size of {pixel_size_um:e} m is {um} um")));
        }
        if layers.is_some() && depth_factor != 1.0 {
            let what = ": expected 1, because depths are those in the fluid";
            let (factor, fluid) = (option("depth_factor").of(depth_factor), option("fluid"));
            wrong.push(advice!(factor, " with ", fluid, what));
        }
        if wrong.is_empty() { Ok(()) } else { Err(Error::Options(wrong)) }
    }

    /// What should be known about the positions of planes, if they are depths in a fluid.
    pub fn warning(&self) -> Option<String> {
        let fluid = self.waves.and_then(|waves| waves.layers).map(|layers| layers.n_s);
        let factor = self.given.depth_factor;
        let n = fluid.or((factor != 1.0).then_some(factor))?;
        let what =
            "depths in the fluid, not readings of the stage: under a dry objective, multiply those by about";
        Some(format!("positions of planes are taken as {what} {n}"))
    }
}

const DIAMETERS_UM: NumberRange = NumberRange { key: "diameter_um", least: 0.001, most: 100.0, unit: "um" };
const WAVELENGTHS_UM: NumberRange = NumberRange { key: "wavelength_um", least: 0.1, most: 2.0, unit: "um" };
const FLUIDS: NumberRange = NumberRange { key: "fluid", least: 1.0, most: 4.0, unit: "" };
const FLUID_DEPTHS_UM: NumberRange = NumberRange { key: "fluid_depth_um", least: 0.0, most: 1e5, unit: "um" };

/// A fit with the files that describe it.
#[derive(Debug)]
pub struct FitFiles {
    /// Result of the fit.
    pub fitted: Fitted,
    /// Images and curves for a report.
    pub evidence: Evidence,
    /// Names and contents of the files.
    pub files: Vec<(&'static str, Vec<u8>)>,
}

/// Fits the settings to a scan; `watch` receives progress messages.
///
/// # Errors
/// Options out of range; [`Error::Input`] if the scan has no usable particle or does not determine all
/// parameters.
pub fn fit(scan: &Scan, options: &FitOptions, watch: Watch<'_>) -> Result<FitFiles> {
    options.check()?;
    watch("background, particles and widths", None);
    let background = Background::of(&scan.planes);
    let candidates = match &options.places_px {
        Some(places) => particles::given(scan, places)?,
        None => particles::find(scan, background)?,
    };
    let half = options.half_window.unwrap_or_else(|| particles::half_width(scan, background, &candidates));
    let windows = particles::windows(scan, &candidates, half)?;
    let shape = Shape::of(scan, background, &windows);
    let astigmatic = match options.astigmatic {
        Astigmatic::Auto => shape.astigmatic,
        Astigmatic::Known(known) => known,
    };
    let both = [1.0, -1.0];
    let directions = options.direction.as_ref().map_or(&both[..], std::slice::from_ref);
    let known = Known {
        scan,
        background,
        windows: &windows,
        shape: &shape,
        given: options.given,
        diameter_um: options.diameter_um,
        directions,
        astigmatic,
    };
    let problem = Problem {
        scan,
        background,
        windows: &windows,
        shared: shared(options, astigmatic),
        free_flux: options.free_flux,
        rejected: vec![vec![false; scan.planes.len()]; windows.particles.len()],
        accuracy: search::COARSE,
        converged: search::ROUGHLY,
        watch,
        stage: String::new(),
    };
    files(by_rays(problem, &known, &options.free)?, options, astigmatic)
}

/// A converged fit.
struct Run<'a> {
    problem: Problem<'a>,
    state: State,
    /// Derivatives of the last step.
    derivatives: Option<Derivatives>,
    /// Difference of -2 ln(likelihood) from the other direction of the stage; `None` if that was not tried.
    direction_margin: Option<f64>,
}

/// The fit of geometrical optics; additional quantities are freed at the best fit without them, so that the
/// result is never worse than without them.
fn by_rays<'a>(mut problem: Problem<'a>, known: &Known, free: &[ExtraParameter]) -> Result<Run<'a>> {
    let (start, margin) = search::best_start(&mut problem, known.shape, &curves::starts(known))?;
    let mut derivatives = None;
    let mut state = search::converge(&mut problem, start, &mut derivatives)?;
    if !free.is_empty() {
        problem.shared.extend(free.iter().map(|key| key.shared()));
        derivatives = None;
        state = search::converge(&mut problem, state, &mut derivatives)?;
    }
    Ok(Run { problem, state, derivatives, direction_margin: margin })
}

fn files(mut run: Run, options: &FitOptions, astigmatic: bool) -> Result<FitFiles> {
    if run.state.microscope.slope <= optics::LEAST_SLOPE {
        let edge_px = 2 * run.problem.windows.half + 1;
        let what = format!(
            "the fit ended at the least numerical aperture, {:.2}: images wider than the windows of {edge_px} px do not determine it: give ",
            run.state.microscope.numerical_aperture()
        );
        return Err(Error::option(advice!(what, option("window_px"))));
    }
    let derivatives = run.derivatives.take();
    let particles = run.problem.windows.particles.len();
    let normal = run.problem.normal(&run.state, &run.problem.derivatives(derivatives, &run.state)?)?;
    let weighed = state::chi2(&run.problem.misfits(&run.state, None)?);
    let covariance = Covariance::of(&normal, particles, weighed).ok_or_else(|| {
        let what = "the scan does not determine all parameters: give ";
        Error::option(advice!(what, option("diameter_um"), ", or use a longer scan"))
    })?;
    let resampled = intervals::bootstrap(&normal, particles, options.bootstrap, options.seed);
    // From here on, only the noise counts, without the residuals attributed to errors of the model.
    run.state.noise = run.problem.noises(&run.state)?.pure;
    let Run { problem, state, .. } = &run;
    let misfits = problem.misfits(state, None)?;
    let fitted = Fitted::of(&run, &misfits, &covariance, &resampled, options);
    let mut files = vec![
        output::settings(&fitted.settings)?,
        output::parameters(&fitted)?,
        output::scenario(&fitted, options.given.depth_factor, &state.microscope),
    ];
    files.extend(output::images(problem, state)?);
    let evidence = Evidence::of(problem, state, astigmatic)?;
    Ok(FitFiles { fitted, evidence, files })
}

fn shared(options: &FitOptions, astigmatic: bool) -> Vec<Shared> {
    let mut shared = vec![Shared::NumericalAperture, Shared::FocalLength];
    if astigmatic {
        shared.extend([Shared::FocusShift, Shared::Angle]);
    }
    if options.diameter_um.is_none() {
        shared.push(Shared::Diameter);
    }
    shared
}

#[cfg(test)]
mod tests {
    use microsig_core::emission::SpheroidLaw;
    use microsig_core::random::{normal, poisson};
    use microsig_core::render::ExpectedRenderer;
    use microsig_core::stream::{Purpose, Streams};

    use super::*;

    /// A particle under a lens of 20x/0.4, in 26 planes whose images are up to twice as wide as the largest window: the
    /// darkest pixels of the scan have a count of light, which hides the rims of images. With one initial aperture and
    /// window, the search began at an NA of 0.53 and ended at 0.72 +- 0.04.
    fn wide_images() -> Scan {
        let (edge, background, noise, light) = (300usize, 350.0, 20.0, 2.27e6);
        let settings = microsig_core::Settings {
            magnification: 20.0,
            numerical_aperture: 0.4,
            pixel_dim_x: edge as u32,
            pixel_dim_y: edge as u32,
            ..microsig_core::Settings::setting1()
        };
        let renderer = ExpectedRenderer::new(&settings, SpheroidLaw::Original, 3e-4).unwrap();
        let places: Vec<[f64; 2]> =
            (0..edge * edge).map(|i| [(i % edge) as f64 - 149.3, (i / edge) as f64 - 148.8]).collect();
        let mut stream = Streams::new(1).stream(Purpose::Rays, 0, 0);
        let mut plane = |i: u32| -> Vec<u16> {
            let shares = renderer.shares(4.0 * f64::from(i) - 50.0, 2.0, &places);
            let mut count = |share: f64| {
                let light = poisson(&mut stream, (light * share).max(0.0)) as f64;
                (background + light + noise * normal(&mut stream)).round().max(0.0) as u16
            };
            shares.into_iter().map(&mut count).collect()
        };
        Scan {
            width: edge,
            height: edge,
            planes: (0..26).map(&mut plane).collect(),
            stage_um: (0..26).map(|i| 4.0 * f64::from(i)).collect(),
            full_scale: u16::MAX,
            warnings: Vec::new(),
        }
    }

    const TWENTYFOLD: Given =
        Given { magnification: 20.0, pixel_size_um: 6.45, ri_medium: 1.0, ri_lens: 1.5, depth_factor: 1.0 };

    #[test]
    fn a_start_is_near_the_aperture_of_images_wider_than_the_window() {
        let scan = wide_images();
        let background = Background::of(&scan.planes);
        let candidates = particles::find(&scan, background).unwrap();
        let half = particles::half_width(&scan, background, &candidates);
        let windows = particles::windows(&scan, &candidates, half).unwrap();
        let shape = Shape::of(&scan, background, &windows);
        let known = Known {
            scan: &scan,
            background,
            windows: &windows,
            shape: &shape,
            given: TWENTYFOLD,
            diameter_um: None,
            directions: &[1.0],
            astigmatic: false,
        };
        let starts: Vec<f64> =
            curves::starts(&known).iter().map(|start| start.microscope.numerical_aperture()).collect();
        assert!(starts.iter().any(|na| (na / 0.4 - 1.0).abs() < 0.1), "{starts:?}");
    }

    #[test]
    #[ignore = "slow: .ci/full"]
    fn images_wider_than_the_window_have_the_right_aperture() {
        let scan = wide_images();
        for half_window in [None, Some(30), Some(20)] {
            let options = FitOptions {
                given: TWENTYFOLD,
                diameter_um: None,
                direction: Some(1.0),
                astigmatic: Astigmatic::Known(false),
                free_flux: true,
                half_window,
                places_px: None,
                waves: None,
                free: Vec::new(),
                bootstrap: 0,
                seed: 0,
            };
            let fitted = match fit(&scan, &options, &|_, _| ()) {
                Ok(made) => made.fitted,
                // A window of a quarter of the widest images.
                Err(why) => {
                    assert!(
                        half_window == Some(20) && why.to_string().contains("the least numerical aperture"),
                        "{why}"
                    );
                    continue;
                }
            };
            let na = &fitted.parameters[0];
            // 95 % of intervals of 1.96 standard deviations; 99.7 % of three.
            assert!((na.value - 0.4).abs() < 3.0 * na.sd && na.sd < 0.004, "{half_window:?}: {na:?}");
            assert_eq!(fitted.verdict, Verdict::NoiseLimited, "{}", fitted.sentence());
            assert!(
                !fitted.warnings.iter().any(|text| text.contains("farther apart")),
                "{:?}",
                fitted.warnings
            );
        }
    }
}
