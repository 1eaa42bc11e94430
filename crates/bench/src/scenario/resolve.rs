//! From a scenario as written to one that can be run: defaults filled in, every rule checked.
//!
//! A [`Scenario`] exists only if it is valid. Its `spec` has every default written out, so that resolving the written
//! form of it gives the very same scenario.

use std::path::Path;
use std::sync::Arc;

use flows::scale::Scale;
use flows::tracks::Kind;
use flows::{Boundary, Domain, Illumination, Scene, Seeding, Shutter, Tracks, VelocityField};
use microsig_core::formats::data_file::Layout;
use microsig_core::render::Renderer;
use microsig_core::render::expected::{DEFAULT_TOLERANCE, TOLERANCES};
use microsig_core::sensor::{Detector, Response, Sensor};
use microsig_core::stream::Streams;
use microsig_core::{Particle, Settings, Spheroid};

use super::files::{Files, Input};
use super::license::{LICENSES, License};
use super::motion::Mover;
use super::optics::{clipped, detector, optics, response};
use super::particles::Cloud;
use super::problems::Problems;
use super::recorded::recorded;
use super::spec::{self, Motion, PairSeeding, Placement, Spec, Timing};
use super::timing::Recordings;
use super::truth_grid::{Nodes, TruthGrid};
use crate::error::{Error, Result};
use crate::light::{NoiseFree, Stack};

/// Depth range of the default channel, um: 100 um deep, inside the range that Rossi 2020 scans.
const DEFAULT_Z_UM: (f64, f64) = (-80.0, 20.0);

/// A scenario that can be run.
#[derive(Debug)]
pub struct Scenario {
    /// The scenario with every default written out.
    pub spec: Spec,
    /// The licence of the dataset.
    pub license: License,
    /// All random numbers: the public streams of `spec.seed`, or secret ones.
    pub streams: Streams,
    /// MicroSIG's settings.
    pub settings: Settings,
    /// What draws the particles.
    pub renderer: Renderer,
    /// The camera; `None` is MicroSIG's own sensor.
    pub detector: Option<Detector>,
    /// Files that the scenario names, copied to `inputs/` of the dataset; `spec` names the copies.
    pub inputs: Vec<Input>,
    /// What should be known before running it.
    pub warnings: Vec<String>,
    /// What moves the particles.
    pub mover: Mover,
    /// From px to um and back.
    pub scale: Scale,
    /// The box that holds the particles.
    pub domain: Domain,
    /// The depth range of the measurement, um.
    pub depth_range_um: (f64, f64),
    /// How the box is filled.
    pub seeding: Seeding,
    /// What particles are besides places and sizes, and what moves them besides the flow.
    pub cloud: Cloud,
    /// When frames are taken.
    pub recordings: Recordings,
    /// The shutter, unless frames are instantaneous.
    pub shutter: Option<Shutter>,
    /// Light on the particles.
    pub illumination: Illumination,
    /// The columns of the data files.
    pub layout: Layout,
}

impl Scenario {
    /// The velocity field; `None` if tracks are given.
    pub fn field(&self) -> Option<&dyn VelocityField> {
        match &self.mover {
            Mover::Field(field) => Some(field.as_ref()),
            Mover::Tracks(_) => None,
        }
    }

    /// The tracks; `None` if a field moves the particles.
    pub fn tracks(&self) -> Option<&Tracks> {
        match &self.mover {
            Mover::Field(_) => None,
            Mover::Tracks(tracks) => Some(tracks),
        }
    }

    /// What the recordings of a field are taken of.
    pub fn scene<'a>(&'a self, field: &'a dyn VelocityField) -> Result<Scene<'a>> {
        let scene = Scene::new(field, &self.domain, &self.seeding)?;
        let cloud = &self.cloud;
        let scene = scene.with_bodies(&cloud.bodies).with_intensities(cloud.intensities);
        let scene = cloud.spheroids.into_iter().fold(scene, Scene::with_spheroids);
        let scene = cloud.brownian.into_iter().fold(scene, Scene::with_brownian);
        let scene = cloud.settling.into_iter().fold(scene, Scene::with_settling);
        let scene = self.shutter.into_iter().fold(scene, Scene::with_shutter);
        Ok(if self.spec.boundaries.keep_ids { scene.keeping_ids() } else { scene })
    }

    /// What particles of recorded tracks are where the file does not say.
    pub fn kind(&self) -> Kind<'_> {
        Kind {
            diameters: self.seeding.diameters(),
            intensities: self.cloud.intensities,
            spheroids: self.cloud.spheroids,
        }
    }

    /// Noise-free images of a sphere of the mean diameter through the depth range; they may be among those of all particles.
    ///
    /// # Errors
    /// None for a scenario that could be resolved.
    pub fn stack(&self, noise_free: &NoiseFree) -> Result<Arc<Stack>> {
        let depth_factor = self.spec.optics.depth_factor.unwrap_or(1.0);
        let (d_um, range_um) = (self.seeding.diameters().mean(), self.depth_range_um);
        if let Some(stack) = noise_free.stack(d_um, range_um) {
            return Ok(stack);
        }
        let draw = |settings: &Settings| Ok(self.spec.single_renderer(settings)?);
        Ok(Arc::new(Stack::measure(draw, &self.settings, d_um, range_um, depth_factor)?))
    }

    /// Noise-free images of all particles.
    ///
    /// # Errors
    /// None for a scenario that could be resolved.
    pub fn noise_free(&self) -> Result<NoiseFree> {
        let (depth_factor, sizes) = (self.spec.optics.depth_factor.unwrap_or(1.0), self.seeding.diameters());
        let box_um = (self.domain.region().min().z, self.domain.region().max().z);
        let draw = |settings: &Settings| Ok(self.spec.single_renderer(settings)?);
        let law =
            (!matches!(self.renderer, Renderer::Gaussian(_))).then(|| self.spec.render.spheroids.into());
        NoiseFree::new(draw, &self.settings, law, (sizes.min(), sizes.max()), box_um, depth_factor)
    }

    /// The sensor with its fixed pattern.
    ///
    /// # Errors
    /// None for a scenario that could be resolved.
    pub fn sensor(&self) -> Result<Sensor> {
        Ok(match &self.detector {
            None => Sensor::new(&self.settings),
            Some(detector) => Sensor::with_detector(&self.settings, detector.clone(), &self.streams)?,
        })
    }

    /// How the camera shows light in the middle of the image, without its fixed pattern.
    ///
    /// # Errors
    /// None for a scenario that could be resolved.
    pub fn response(&self) -> Result<Response> {
        response(&self.settings, self.detector.as_ref())
    }

    /// The nodes of the displacement field, if it is written.
    pub fn truth_grid(&self) -> Option<Nodes> {
        let size_px = (self.settings.pixel_dim_x, self.settings.pixel_dim_y);
        self.spec.truth_grid.as_ref()?.nodes(size_px, self.depth_range_um)
    }
}

/// Fills and checks a scenario; files it names are found from `folder`.
///
/// # Errors
/// [`Error::Input`] with all problems at once, each with the path of its key.
pub fn resolve(mut spec: Spec, folder: &Path) -> Result<Scenario> {
    let mut problems = Problems::new();
    let mut warnings = Vec::new();
    let mut files = Files { folder, inputs: Vec::new() };
    name(&spec.name, &mut problems);
    let license = License::find(&spec.license).unwrap_or_else(|| {
        let ids = LICENSES.map(|license| license.id).join(", ");
        problems.add("license", format!("{:?}", spec.license), &format!("one of {ids}"));
        LICENSES[0]
    });
    let settings = optics(&mut spec.optics, &mut files, &mut warnings, &mut problems);
    let camera = spec.sensor.as_mut();
    let detector = camera.and_then(|camera| detector(camera, settings.as_ref(), &mut files, &mut problems));
    let in_focus = spec.optics.gaussian.is_some();
    spec.calibration.get_or_insert(if in_focus { spec::Calibration::None } else { spec::Calibration::Stack });
    let recordings = spec.timing.recordings(&mut problems);
    let (z_um, boundary) = depth(&mut spec.boundaries, &mut problems);
    let diameters = spec.particles.diameters(&mut problems);
    let cloud = spec.particles.cloud(&spec.boundaries.bodies, &mut problems);
    let illumination = match &mut spec.illumination {
        Some(light) => light.build(z_um, &mut problems),
        None => Some(Illumination::default()),
    };
    let field = match &mut spec.motion {
        Motion::Flow(flow) => flow.build(z_um, &mut files, &mut problems).map(Some),
        Motion::Tracks(_) => {
            without_a_flow(&spec, &mut problems);
            Some(None)
        }
    };

    if let Some(margin_px) = spec.boundaries.margin_px {
        problems.range("boundaries.margin_px", margin_px, 0.0, 1e5, "0 to 100000 px");
    }
    let steady = match (&spec.motion, &field) {
        (Motion::Flow(_), Some(Some(field))) => Some(field.is_steady()),
        (Motion::Flow(_), _) => Some(true),
        (Motion::Tracks(_), _) => None,
    };
    let size_px = settings.as_ref().map_or((1, 1), |s| (s.pixel_dim_x, s.pixel_dim_y));
    spec.truth_grid.get_or_insert_with(|| TruthGrid::of(steady)).fill(steady, size_px, &mut problems);
    mode(&mut spec, &mut problems);

    // What follows needs all of the above.
    let (Some(settings), Some(field), Some(diameters), Some(cloud), Some(illumination)) =
        (settings, field, diameters, cloud, illumination)
    else {
        return Err(Error::Input(problems.0));
    };
    let depth_factor = spec.optics.depth_factor.unwrap_or(1.0);
    let scale = Scale::new(settings.um_per_px(), settings.pixel_dim_x, settings.pixel_dim_y, depth_factor);
    let Some(scale) = problems.of("optics", scale) else { return Err(Error::Input(problems.0)) };
    let shutter = spec.timing.shutter(scale.um_per_px(), &mut problems);
    let Some(renderer) = problems.of("optics", spec.renderer(&settings)) else {
        return Err(Error::Input(problems.0));
    };
    warnings.extend(renderer.warning());
    warnings.extend(clipped(&response(&settings, detector.as_ref())?, detector.as_ref()));
    let mover = match (field, &mut spec.motion) {
        (Some(field), _) => Some(Mover::Field(field)),
        (None, Motion::Tracks(tracks)) => {
            tracks.build(&scale, &mut files, &mut warnings, &mut problems).map(Mover::Tracks)
        }
        (None, Motion::Flow(_)) => None,
    };
    let Some(mover) = mover else { return Err(Error::Input(problems.0)) };
    let longest = diameters.max() * spec.particles.spheroids.map_or(1.0, |s| s.e_p.max(1.0));
    let margin_px = *spec.boundaries.margin_px.get_or_insert_with(|| {
        let largest = largest_image(&renderer, (z_um.0 / depth_factor, z_um.1 / depth_factor), longest);
        // With a high NA a little light of each particle lands thousands of px away. Following it would take many
        // times more particles than there are in view, so it is left to those who ask for it.
        let most = f64::from(settings.pixel_dim_x.max(settings.pixel_dim_y)).max(100.0) / 2.0;
        if largest > most && matches!(mover, Mover::Field(_)) {
            warnings.push(format!(
                "particles beyond {most} px from the image are left out, though a little of their light would reach it; \
                 boundaries: (margin_px: {largest}) includes them all"
            ));
        }
        largest.min(most)
    });
    let depth_range_um = lit(z_um, &illumination, &mut problems);
    let seeding = match &mover {
        Mover::Field(_) => {
            let e_p = spec.particles.spheroids.map_or(1.0, |s| s.e_p);
            for (z, d_um) in [(z_um.0, diameters.max()), (z_um.1, diameters.min())] {
                // Along the optical axis a spheroid reaches farthest toward the lens.
                let spheroid = (e_p != 1.0).then(|| Spheroid::from_axis(e_p, [0.0, 0.0, 1.0]));
                let extreme = Particle { spheroid, ..Particle::sphere(1.0, 1.0, z / depth_factor, d_um) };
                let drawn = renderer.check(&extreme);
                warnings.extend(problems.of("particles", drawn).flatten());
            }
            crowding(&spec, &mut warnings);
            let mean_um = diameters.mean();
            // Taken out for a moment, because the rest of the scenario says how they are drawn.
            let mut particles = std::mem::take(&mut spec.particles);
            let draw = |settings: &Settings| Ok(spec.single_renderer(settings)?);
            let stack = || Stack::measure(draw, &settings, mean_um, depth_range_um, depth_factor);
            let seeding =
                particles.seeding(diameters, (&scale, &settings), z_um, stack, &mut files, &mut problems);
            spec.particles = particles;
            seeding
        }
        Mover::Tracks(tracks) => {
            recorded(tracks, &diameters, &renderer, &scale, &recordings, z_um, &mut warnings, &mut problems);
            problems.of("particles", Seeding::list(Vec::new(), diameters))
        }
    };
    warnings.dedup();
    let Some(seeding) = seeding else { return Err(Error::Input(problems.0)) };
    let faces = [face(spec.boundaries.x), face(spec.boundaries.y), boundary];
    let domain = scale.view(z_um.0, z_um.1, margin_px).map(|region| Domain::new(region, faces));
    let domain = domain.and_then(|domain| seeding.density(&domain).map(|_| domain));
    let domain = problems.of("particles and boundaries", domain);
    let layout = layout(&spec, &mover, &cloud, shutter);
    let Some(domain) = domain else { return Err(Error::Input(problems.0)) };
    problems.finish()?;
    Ok(Scenario {
        license,
        streams: Streams::new(spec.seed),
        spec,
        settings,
        renderer,
        detector,
        inputs: files.inputs,
        warnings,
        mover,
        scale,
        domain,
        depth_range_um,
        seeding,
        cloud,
        recordings,
        shutter,
        illumination,
        layout,
    })
}

/// Checks how particles are drawn.
fn mode(spec: &mut Spec, problems: &mut Problems) {
    match (spec.render.mode, spec.render.tolerance) {
        (spec::Mode::Rays, None) => {}
        (spec::Mode::Rays, Some(tolerance)) => {
            let allowed = "nothing: rays have no tolerance, only mode: expected has";
            problems.add("render.tolerance", tolerance, allowed);
        }
        (spec::Mode::Expected, tolerance) => {
            let tolerance = spec.render.tolerance.insert(tolerance.unwrap_or(DEFAULT_TOLERANCE));
            let (least, most) = (*TOLERANCES.start(), *TOLERANCES.end());
            let allowed = "0.0001 to 0.1, a share of an image's peak";
            if problems.range("render.tolerance", *tolerance, least, most, allowed)
                != tolerance.clamp(least, most)
            {
                // What follows from it need not be said as well.
                *tolerance = DEFAULT_TOLERANCE;
            }
            if spec.optics.gaussian.is_some() {
                problems.add("render.mode", "expected", "nothing: Gaussian spots are not the limit of rays");
            }
        }
    }
}

/// The depths that are measured: those of the boundaries as far as a light sheet across the optical axis shines on them.
fn lit(z_um: (f64, f64), light: &Illumination, problems: &mut Problems) -> (f64, f64) {
    let Some(sheet) = light.depths() else { return z_um };
    let lit = (z_um.0.max(sheet.0), z_um.1.min(sheet.1));
    if lit.0 >= lit.1 {
        let allowed = format!("a sheet that crosses the depth range, {} to {} um", z_um.0, z_um.1);
        problems.add("illumination.shape.sheet", format!("{} to {} um", sheet.0, sheet.1), &allowed);
        return z_um;
    }
    lit
}

/// The columns that the data files need.
fn layout(spec: &Spec, mover: &Mover, cloud: &Cloud, shutter: Option<Shutter>) -> Layout {
    let rows = match mover {
        Mover::Field(_) => &[],
        Mover::Tracks(tracks) => tracks.rows(),
    };
    let spheroids = rows.iter().any(|row| row.aspect.is_some_and(|e_p| e_p != 1.0));
    let c_int = rows.iter().any(|row| row.c_int.is_some_and(|c_int| c_int != 1.0));
    let light = spec.illumination.is_some() || shutter.is_some();
    Layout {
        spheroids: spheroids || cloud.spheroids.is_some(),
        c_int: c_int || light || cloud.has_intensities,
    }
}

/// Keys that mean nothing where tracks are given.
fn without_a_flow(spec: &Spec, problems: &mut Problems) {
    let (particles, boundaries) = (&spec.particles, &spec.boundaries);
    for (path, given) in [
        ("particles.number", particles.number.is_some()),
        ("particles.seeding", particles.seeding != Placement::Uniform),
        ("particles.brownian", particles.brownian.is_some()),
        ("particles.settling", particles.settling.is_some()),
        ("boundaries.bodies", !boundaries.bodies.is_empty()),
        ("boundaries.keep_ids", boundaries.keep_ids),
    ] {
        if given {
            problems.0.push(format!("{path}: expected nothing, as motion.tracks says where particles are"));
        }
    }
}

/// Least distances hold at first only: say so where there is a later.
fn crowding(spec: &Spec, warnings: &mut Vec<String>) {
    let goes_on = match spec.timing {
        Timing::Pairs(p) => p.seeding == PairSeeding::Continuing,
        Timing::Sequence(s) => s.frames > 1,
        Timing::FourPulse(_) => true,
    };
    if goes_on && spec.particles.seeding != Placement::Uniform {
        let what = "particles.seeding holds in the first frame of a recording; the flow then moves particles together and apart, \
                    and those that come in through open boundaries are independent of the others";
        warnings.push(what.to_owned());
    }
}

/// Names become folder names and identifiers of data packages.
fn name(name: &str, problems: &mut Problems) {
    let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "._-".contains(c);
    if name.is_empty() || name.len() > 100 || name.starts_with('.') || !name.chars().all(fits) {
        let allowed = "1 to 100 lower-case letters, digits, `.`, `_`, `-`, not starting with a dot";
        problems.add("name", format!("`{name}`"), allowed);
    }
}

fn depth(boundaries: &mut spec::Boundaries, problems: &mut Problems) -> ((f64, f64), Boundary) {
    let mut z_um = *boundaries.z_um.get_or_insert(DEFAULT_Z_UM);
    if !(z_um.0.is_finite() && z_um.1.is_finite() && z_um.0 < z_um.1) {
        problems.add(
            "boundaries.z_um",
            format!("({}, {})", z_um.0, z_um.1),
            "two depths in um, the lower one first",
        );
        // What follows from it need not be said as well.
        z_um = DEFAULT_Z_UM;
    }
    (z_um, face(*boundaries.z.get_or_insert(spec::Boundary::Wall)))
}

fn face(boundary: spec::Boundary) -> Boundary {
    match boundary {
        spec::Boundary::Open => Boundary::Open,
        spec::Boundary::Wall => Boundary::Wall,
        spec::Boundary::Periodic => Boundary::Periodic,
    }
}

/// Half the side of the largest particle image within the depth range of the data files, px, rounded up.
fn largest_image(renderer: &Renderer, z_um: (f64, f64), d_um: f64) -> f64 {
    /// The image grows smoothly away from focus: the ends of the range matter, and a few planes between them.
    const PLANES: i32 = 20;
    (0..=PLANES)
        .map(|i| z_um.0 + (z_um.1 - z_um.0) * f64::from(i) / f64::from(PLANES))
        .map(|z| renderer.image_extent(&Particle::sphere(1.0, 1.0, z, d_um)))
        .fold(0.0f64, |largest, (x, y)| largest.max(x).max(y))
        .ceil()
}

#[cfg(test)]
mod tests {
    use super::super::{parse, write};
    use super::*;

    const FIVE_LINES: &str = r#"(
        name: "five",
        motion: flow(field: poiseuille()),
        timing: pairs(count: 10),
    )"#;

    fn resolved(text: &str) -> Result<Scenario> {
        resolve(parse(text, "s.ron").unwrap(), Path::new("."))
    }

    #[test]
    fn a_few_lines_are_enough_and_the_filled_form_is_a_fixed_point() {
        let scenario = resolved(FIVE_LINES).unwrap();
        assert_eq!(scenario.settings, Settings::setting1());
        assert_eq!(scenario.depth_range_um, (-80.0, 20.0));
        let text = write(&scenario.spec).unwrap();
        assert_eq!(write(&resolved(&text).unwrap().spec).unwrap(), text);
    }

    #[test]
    fn keys_replace_single_values_of_a_preset() {
        let text = FIVE_LINES.replace("motion", "optics: (preset: setting1a, background_noise: 50), motion");
        let scenario = resolved(&text).unwrap();
        assert_eq!(scenario.settings, Settings { background_noise: 50.0, ..Settings::setting1a() });
    }

    #[test]
    fn all_problems_are_named_at_once() {
        let text = FIVE_LINES
            .replace("five", "Not A Name")
            .replace("poiseuille()", "poiseuille(max_speed_um_s: inf)")
            .replace("count: 10", "count: 0, dt_s: -1")
            .replace(
                "motion",
                "optics: (magnification: -1, n_rays: 0), particles: (diameter_um: constant(-2)), motion",
            );
        let message = resolved(&text).unwrap_err().to_string();
        for expected in [
            "name = `Not A Name`",
            "optics.magnification = -1: expected a number > 0",
            "optics.n_rays = 0: expected a whole number",
            "timing.pairs.count = 0",
            "timing.pairs.dt_s = -1",
            "particles.diameter_um: diameters: diameter_um = -2",
            "motion.flow.field: poiseuille: max_speed_um_s = inf",
        ] {
            assert!(message.contains(expected), "{expected} is not in\n{message}");
        }
        assert_eq!(message.lines().count(), 7, "{message}");
    }

    #[test]
    fn gaussian_spots_have_a_gain_of_1_and_no_calibration_unless_told_otherwise() {
        let with =
            |optics: &str| resolved(&FIVE_LINES.replace("motion", &format!("optics: ({optics}), motion")));
        let scenario = with("gaussian: (diameter_px: 3)").unwrap();
        assert_eq!((scenario.renderer.name(), scenario.settings.gain), ("gaussian", 1.0));
        assert_eq!(scenario.spec.calibration, Some(spec::Calibration::None));
        let text = write(&scenario.spec).unwrap();
        assert_eq!(write(&resolved(&text).unwrap().spec).unwrap(), text);
        assert_eq!(with("preset: setting2, gaussian: (), gain: 2").unwrap().settings.gain, 2.0);
        let message = with("gaussian: (diameter_px: -1, peak_counts: inf)").unwrap_err().to_string();
        assert!(
            message.contains("diameter_px = -1: expected") && message.contains("peak_counts = inf"),
            "{message}"
        );
        let rods =
            FIVE_LINES.replace("motion", "optics: (gaussian: ()), particles: (spheroids: (e_p: 2)), motion");
        assert!(resolved(&rods).unwrap_err().to_string().contains("round"));
    }

    #[test]
    fn particles_that_cannot_be_drawn_are_refused() {
        let text = FIVE_LINES.replace("motion", "boundaries: (z_um: (-500, 0)), motion");
        assert!(resolved(&text).unwrap_err().to_string().contains("reaches the lens"));
        let text = FIVE_LINES.replace("motion", "particles: (diameter_um: constant(0.01)), motion");
        assert!(resolved(&text).unwrap_err().to_string().contains("no source point"));
    }
}
