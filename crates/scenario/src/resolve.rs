//! Resolves a scenario: fills in defaults and checks the constraints between keys.
//!
//! A [`Scenario`] exists only if it is valid. Its `spec` contains all defaults, so that writing, reading and
//! resolving it gives the same scenario.

use std::path::Path;
use std::sync::Arc;

use flows::scale::Scale;
use flows::{Boundary, Domain, FluidRegion, Illumination, KeptShares, Seeding, Shutter, VelocityField};
use microsig_core::formats::data_file::Layout;
use microsig_core::render::Renderer;
use microsig_core::sensor::{Detector, ImageFormat};
use microsig_core::stream::Streams;
use microsig_core::{Particle, Settings, Spheroid};

use super::brightness::PhotonScale;
use super::drawing;
use super::field_of_view::{corners, lost_focus};
use super::files::Files;
use super::flow_checks;
use super::focal_planes;
use super::language::problems::Problems;
use super::license::{LICENSES, License};
use super::motion::MotionSource;
use super::optics::{clipped, default_background_noise, detector, optics, response};
use super::particles::Cloud;
use super::recorded::check_tracks;
use super::recordings::Recordings;
use super::resolved::Scenario;
use super::spec::{self, Motion, PairSeeding, Placement, Spec, Timing};

use super::truth_grid::TruthGrid;
use storage::error::{Error, Result};
use storage::table_cache::context;
use visibility::DepthScan;

/// Depth range of the default channel, um: 100 um deep, within the range scanned in Rossi 2020.
const DEFAULT_Z_UM: (f64, f64) = (-80.0, 20.0);

/// Fills in defaults and checks a scenario; the paths of files in it are relative to `folder`.
///
/// # Errors
/// [`Error::Problems`] with all problems at once, each with the path of its key.
pub fn resolve(mut spec: Spec, folder: &Path) -> Result<Scenario> {
    let mut problems = Problems::among(|path| spec::schema().find(path).is_some());
    let mut warnings = Vec::new();
    let mut files = Files { folder, inputs: Vec::new() };
    name(&spec.name, &mut problems);
    let license = License::find(&spec.license).unwrap_or(LICENSES[0]);
    let Sections { settings, detector, recordings, z_um, boundary, diameters, cloud, illumination, field } =
        sections(&mut spec, &mut files, &mut warnings, &mut problems);
    // The rest needs all sections.
    let (Some(settings), Some(field), Some(diameters), Some(mut cloud), Some(illumination)) =
        (settings, field, diameters, cloud, illumination)
    else {
        return Err(Error::Problems(problems.0));
    };
    if !drawing::check(&spec, &settings, &mut problems) {
        return Err(Error::Problems(problems.0));
    }
    cloud.photons = spec
        .particles
        .photons
        .map(|photons| PhotonScale::new(&photons, &spec.renderer(), &settings, diameters.mean()));
    let depth_factor = spec.optics.depth_factor.unwrap_or(1.0);
    let Some(scale) = problems.of("optics", scale_of(&spec, &settings, depth_factor)) else {
        return Err(Error::Problems(problems.0));
    };
    let shutter = spec.timing.shutter(scale.um_per_px(), &mut problems);
    let Some(renderer) = problems.of("optics", spec.renderer().build(&settings, &context())) else {
        return Err(Error::Problems(problems.0));
    };
    warnings.extend(camera_warnings(&spec, &settings, &renderer, detector.as_ref())?);
    let motion = match field {
        Some(field) => Some(MotionSource::Field(field)),
        None => tracks(&mut spec.motion, &scale, &mut files, &mut warnings, &mut problems),
    };
    let Some(motion) = motion else { return Err(Error::Problems(problems.0)) };
    let longest = diameters.max() * spec.particles.spheroids.map_or(1.0, |s| s.e_p.max(1.0));
    let depths = (z_um.0 / depth_factor, z_um.1 / depth_factor);
    let margin_px = margin_px(&mut spec, (&settings, &renderer), depths, longest, &motion, &mut warnings);
    let depth_range_um = illuminated_depths(z_um, &illumination, &mut problems);
    let seeding = match &motion {
        MotionSource::Field(_) => {
            check_depths(&spec, (z_um, depth_factor), &diameters, &renderer, &mut warnings, &mut problems);
            warn_spacing(&spec, &mut warnings);
            let mean_um = diameters.mean();
            // Taken out temporarily, because `draw` borrows the rest of the scenario.
            let mut particles = std::mem::take(&mut spec.particles);
            let renderer = spec.renderer().for_depth_scans();
            let draw = |settings: &Settings| Ok(renderer.clone().build(settings, &context())?);
            let stack = || DepthScan::measure(draw, &settings, mean_um, depth_range_um, depth_factor);
            let seeding =
                particles.seeding(diameters, (&scale, &settings), z_um, stack, &mut files, &mut problems);
            spec.particles = particles;
            seeding
        }
        MotionSource::Tracks(tracks) => {
            let optics = (&diameters, &renderer, &scale);
            check_tracks(tracks, &cloud, optics, (&recordings, z_um), &mut warnings, &mut problems);
            problems.of("particles", Seeding::list(Vec::new(), diameters))
        }
    };
    warnings.dedup();
    let Some(mut seeding) = seeding else { return Err(Error::Problems(problems.0)) };
    let faces = [face(spec.boundaries.x), face(spec.boundaries.y), boundary];
    let domain = scale.view(z_um.0, z_um.1, margin_px).map(|region| Domain::new(region, faces));
    let Some(domain) = problems.of("particles and boundaries", domain) else {
        return Err(Error::Problems(problems.0));
    };
    let layout = layout(&spec, &motion, &cloud, shutter);
    if let MotionSource::Field(field) = &motion {
        let fluid = FluidRegion::new(field.as_ref(), &domain, &cloud.bodies);
        let view = scale.view(z_um.0, z_um.1, 0.0)?;
        let checked =
            flow_checks::check((field.as_ref(), &fluid), (&seeding, &view), &recordings, &mut problems);
        warnings.extend(checked);
        seeding = spec.particles.within_walls(seeding, &fluid, &view);
    }
    problems.finish()?;
    let mut scenario = Scenario {
        license,
        streams: Streams::new(spec.seed),
        spec,
        settings,
        renderer,
        detector,
        inputs: files.inputs,
        warnings,
        motion,
        scale,
        domain,
        depth_range_um,
        fluid_shares: KeptShares::default(),
        seeding,
        cloud,
        recordings,
        shutter,
        illumination,
        layout,
    };
    scenario.warnings.extend(scenario.few_stacks());
    Ok(scenario)
}

/// The margin around the image, px, for particles up to this diameter at these depths of the model; warns of
/// corners of the field whose focus is not among them.
fn margin_px(
    spec: &mut Spec,
    (settings, renderer): (&Settings, &Renderer),
    depths: (f64, f64),
    longest_um: f64,
    motion: &MotionSource,
    warnings: &mut Vec<String>,
) -> f64 {
    let field = spec.optics.field.as_ref();
    let margin_px = *spec.boundaries.margin_px.get_or_insert_with(|| {
        let corners = corners(field, settings);
        let images = corners.iter().map(|at| largest_image(renderer, *at, depths, longest_um));
        default_margin_px(images.fold(0.0, f64::max), settings, motion, warnings)
    });
    if let Some(field) = field {
        warnings.extend(lost_focus(field, settings, depths).filter(|_| renderer.depends_on_depth()));
    }
    margin_px
}

/// Warnings about the renderer, and about noise that the range of counts clips.
fn camera_warnings(
    spec: &Spec,
    settings: &Settings,
    renderer: &Renderer,
    detector: Option<&Detector>,
) -> Result<Vec<String>> {
    let mut warnings: Vec<String> = renderer.warning().into_iter().collect();
    if spec.image_format() == ImageFormat::Integer {
        warnings.extend(clipped(&response(settings, detector)?, detector));
    }
    Ok(warnings)
}

/// Recorded tracks; `None` without them or if they are invalid.
fn tracks(
    motion: &mut Motion,
    scale: &Scale,
    files: &mut Files<'_>,
    warnings: &mut Vec<String>,
    problems: &mut Problems,
) -> Option<MotionSource> {
    let Motion::Tracks(tracks) = motion else { return None };
    tracks.build(scale, files, warnings, problems).map(MotionSource::Tracks)
}

/// The sections of a scenario, each checked on its own; `None` where there are problems.
struct Sections {
    settings: Option<Settings>,
    detector: Option<Detector>,
    recordings: Recordings,
    z_um: (f64, f64),
    boundary: Boundary,
    diameters: Option<flows::Diameters>,
    cloud: Option<Cloud>,
    illumination: Option<Illumination>,
    /// The inner `Option` is `None` for recorded tracks.
    field: Option<Option<Arc<dyn VelocityField>>>,
}

/// Fills in defaults and checks each section on its own.
fn sections(
    spec: &mut Spec,
    files: &mut Files<'_>,
    warnings: &mut Vec<String>,
    problems: &mut Problems,
) -> Sections {
    default_background_noise(&mut spec.optics, spec.sensor.as_ref(), warnings);
    let in_photons = spec.particles.photons.is_some();
    let settings = optics(&mut spec.optics, in_photons, files, warnings, problems);
    let camera = spec.sensor.as_mut();
    let detector = camera.and_then(|camera| detector(camera, settings.as_ref(), files, problems));
    let in_focus = spec.optics.gaussian.is_some();
    spec.calibration.get_or_insert(if in_focus { spec::Calibration::None } else { spec::Calibration::Stack });
    let recordings = Recordings::checked(spec.timing, problems);
    focal_planes::center(&mut spec.boundaries, settings.as_ref(), &spec.optics, problems);
    let (z_um, boundary) = depth(&mut spec.boundaries, problems);
    let diameters = spec.particles.diameters(problems);
    let cloud = spec.particles.cloud(&spec.boundaries.bodies, problems);
    let illumination = match &mut spec.illumination {
        Some(light) => light.build(z_um, problems),
        None => Some(Illumination::default()),
    };
    let field = match &mut spec.motion {
        Motion::Flow(flow) => flow.build(z_um, files, problems).map(|field| Some(Arc::from(field))),
        Motion::Own(field) => Some(Some(Arc::clone(&field.0))),
        Motion::Tracks(_) => {
            refuse_flow_keys(spec, problems);
            Some(None)
        }
    };

    if spec.walls_slow() && spec.particles.spheroids.is_some() {
        problems
            .other("motion.flow.walls", "expected free: the laws of hindered motion are those of spheres");
    }
    let steady = is_steady(&spec.motion, field.as_ref().and_then(Option::as_deref));
    let size_px = settings.as_ref().map_or((1, 1), |s| (s.pixel_dim_x, s.pixel_dim_y));
    spec.truth_grid.get_or_insert_with(|| TruthGrid::of(steady)).fill(steady, size_px, problems);
    drawing::mode(spec, problems);
    drawing::calibration(spec, z_um, problems);
    let mean_um = diameters.as_ref().map(flows::Diameters::mean);
    drawing::photons(spec, settings.as_ref(), mean_um, problems);
    Sections { settings, detector, recordings, z_um, boundary, diameters, cloud, illumination, field }
}

/// Whether the flow is steady; `None` for recorded tracks.
fn is_steady(motion: &Motion, field: Option<&dyn VelocityField>) -> Option<bool> {
    match (motion, field) {
        (Motion::Flow(_) | Motion::Own(_), Some(field)) => Some(field.is_steady()),
        (Motion::Flow(_) | Motion::Own(_), None) => Some(true),
        (Motion::Tracks(_), _) => None,
    }
}

/// Default margin around the image, px: the largest distance from which the light of a particle reaches the
/// image, up to a limit.
fn default_margin_px(
    largest: f64,
    settings: &Settings,
    motion: &MotionSource,
    warnings: &mut Vec<String>,
) -> f64 {
    // At high NA, a small part of a particle's light lands thousands of px away. Including it would require
    // many times more particles than are in view, so this needs an explicit `margin_px`.
    let most = f64::from(settings.pixel_dim_x.max(settings.pixel_dim_y)).max(100.0) / 2.0;
    if largest > most && matches!(motion, MotionSource::Field(_)) {
        warnings.push(format!(
            "particles more than {most} px away from the image are omitted, although some of their light would reach it; \
             boundaries: (margin_px: {largest}) includes them all"
        ));
    }
    largest.min(most)
}

/// Checks that the particles nearest to the lens and farthest from it can be rendered.
fn check_depths(
    spec: &Spec,
    (z_um, depth_factor): ((f64, f64), f64),
    diameters: &flows::Diameters,
    renderer: &Renderer,
    warnings: &mut Vec<String>,
    problems: &mut Problems,
) {
    let e_p = spec.particles.spheroids.map_or(1.0, |s| s.e_p);
    // A spheroid aligned with the optical axis extends farthest toward the lens.
    let spheroid = (e_p != 1.0).then(|| Spheroid::from_axis(e_p, [0.0, 0.0, 1.0]));
    let calibrated =
        spec.calibration.as_ref().and_then(spec::Calibration::given_diameters_um).unwrap_or_default();
    let of_field = matches!(spec.calibration, Some(spec::Calibration::Field { .. }));
    let key = if of_field { "calibration.field.diameters_um" } else { "calibration.sizes.diameters_um" };
    let calibrated = calibrated.iter().map(|d_um| (key, z_um.0, *d_um, None));
    let extremes =
        [("particles", z_um.0, diameters.max(), spheroid), ("particles", z_um.1, diameters.min(), spheroid)];
    let corners = corners(spec.optics.field.as_ref(), renderer.settings());
    for (path, z, d_um, spheroid) in extremes.into_iter().chain(calibrated) {
        for [x, y] in &corners {
            let extreme = Particle { spheroid, ..Particle::sphere(*x, *y, z / depth_factor, d_um) };
            warnings.extend(problems.of(path, renderer.check(&extreme)).flatten());
        }
    }
}

/// The conversion between px and um of the sensor, stretched by a cylindrical lens before the camera.
fn scale_of(spec: &Spec, settings: &Settings, depth_factor: f64) -> flows::Result<Scale> {
    let scale = Scale::new(settings.um_per_px(), settings.pixel_dim_x, settings.pixel_dim_y, depth_factor)?;
    Ok(match spec.stretch() {
        Some((growth, angle_deg)) => scale.stretched(growth, angle_deg),
        None => scale,
    })
}

/// The measured depth range, um: that of the boundaries, restricted to a light sheet that is perpendicular to
/// the optical axis.
fn illuminated_depths(z_um: (f64, f64), light: &Illumination, problems: &mut Problems) -> (f64, f64) {
    let Some(sheet) = light.depths() else { return z_um };
    let lit = (z_um.0.max(sheet.0), z_um.1.min(sheet.1));
    if lit.0 >= lit.1 {
        let allowed = format!("a sheet that crosses the depth range, {} to {} um", z_um.0, z_um.1);
        problems.value("illumination.shape.sheet", format!("{} to {} um", sheet.0, sheet.1), &allowed);
        return z_um;
    }
    lit
}

/// The columns that the data files need.
fn layout(spec: &Spec, motion: &MotionSource, cloud: &Cloud, shutter: Option<Shutter>) -> Layout {
    let rows = match motion {
        MotionSource::Field(_) => &[],
        MotionSource::Tracks(tracks) => tracks.rows(),
    };
    let spheroids = rows.iter().any(|row| row.aspect.is_some_and(|e_p| e_p != 1.0));
    let c_int = rows.iter().any(|row| row.c_int.is_some_and(|c_int| c_int != 1.0));
    let light = spec.illumination.is_some() || shutter.is_some();
    Layout {
        spheroids: spheroids || cloud.spheroids.is_some(),
        c_int: c_int || light || cloud.has_intensities,
    }
}

/// Refuses keys that have no effect with recorded tracks.
fn refuse_flow_keys(spec: &Spec, problems: &mut Problems) {
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
            problems.other(path, "expected nothing, as motion.tracks gives the positions of particles");
        }
    }
}

/// Warns that minimum distances apply only to the first frame, if recordings have further frames.
fn warn_spacing(spec: &Spec, warnings: &mut Vec<String>) {
    let goes_on = match spec.timing {
        Timing::Pairs(p) => p.seeding == PairSeeding::Continuing,
        Timing::Sequence(s) => s.frames > 1,
        Timing::FourPulse(_) => true,
    };
    if goes_on && spec.particles.seeding != Placement::Uniform {
        let what = "particles.seeding applies to the first frame of a recording; the flow then changes the distances between particles, \
                    and particles that enter through open boundaries are placed independently of the others";
        warnings.push(what.to_owned());
    }
}

/// Checks the name, which becomes a folder name and the identifier of a data package.
fn name(name: &str, problems: &mut Problems) {
    let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "._-".contains(c);
    if name.is_empty() || name.len() > 100 || name.starts_with('.') || !name.chars().all(fits) {
        let allowed = "1 to 100 lower-case letters, digits, `.`, `_`, `-`, not starting with a dot";
        problems.value("name", format!("`{name}`"), allowed);
    }
}

fn depth(boundaries: &mut spec::Boundaries, problems: &mut Problems) -> ((f64, f64), Boundary) {
    let mut z_um = *boundaries.z_um.get_or_insert(DEFAULT_Z_UM);
    if z_um.0 >= z_um.1 {
        problems.value(
            "boundaries.z_um",
            format!("({}, {})", z_um.0, z_um.1),
            "two depths in um, the lower one first",
        );
        // Avoids consequential problems: other depths probably fit the intended range.
        z_um = if z_um.0 > z_um.1 { (z_um.1, z_um.0) } else { DEFAULT_Z_UM };
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

/// Half the side of the largest particle image at a place of the sensor (px) within `z_um`, a depth range in
/// MicroSIG's data files; px, rounded up.
fn largest_image(renderer: &Renderer, [x, y]: [f64; 2], z_um: (f64, f64), d_um: f64) -> f64 {
    /// The image grows smoothly away from focus, so the ends of the range and a few planes between them are
    /// enough.
    const PLANES: i32 = 20;
    (0..=PLANES)
        .map(|i| z_um.0 + (z_um.1 - z_um.0) * f64::from(i) / f64::from(PLANES))
        .map(|z| renderer.image_extent(&Particle::sphere(x, y, z, d_um)))
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
    fn walls_slow_spheres_only_and_are_not_written_unless_given() {
        assert!(!write(&resolved(FIVE_LINES).unwrap().spec).unwrap().contains(" walls: "));
        let hindered = FIVE_LINES.replace("poiseuille()", "poiseuille(), walls: hindered");
        assert!(write(&resolved(&hindered).unwrap().spec).unwrap().contains("walls: hindered"));
        let rods = hindered.replace("timing", "particles: (spheroids: (e_p: 3)), timing");
        let message = resolved(&rods).unwrap_err().to_string();
        assert!(message.contains("motion.flow.walls: expected free"), "{message}");
    }

    #[test]
    fn keys_replace_single_values_of_a_preset() {
        let text = FIVE_LINES.replace("motion", "optics: (preset: setting1a, background_noise: 50), motion");
        let scenario = resolved(&text).unwrap();
        assert_eq!(scenario.settings, Settings { background_noise: 50.0, ..Settings::setting1a() });
    }

    #[test]
    fn all_violated_rules_are_reported_at_once() {
        let text = FIVE_LINES
            .replace("five", "Not A Name")
            .replace("poiseuille()", "sum([hill(), stokes_cylinder(cell_radius_um: 1)])")
            .replace("count: 10", "count: 2, exposure_s: 1, jitter_s: 0.1")
            .replace(
                "motion",
                "optics: (ri_lens: 0.5), particles: (diameter_um: uniform(min: 2, max: 1)), \
                 boundaries: (z_um: (20, -80)), motion",
            );
        let message = resolved(&text).unwrap_err().to_string();
        for expected in [
            "name = `Not A Name`",
            "optics.ri_lens = 0.5: expected a number > ri_medium = 1",
            "timing.pairs.exposure_s = 1",
            "timing.pairs.jitter_s = 0.1",
            "boundaries.z_um = (20, -80): expected two depths in um, the lower one first",
            "particles.diameter_um: diameters: max_um = 1",
            "motion.flow.field.sum.1.stokes_cylinder.cell_radius_um = 1: expected",
        ] {
            assert!(message.contains(expected), "{expected} is not in\n{message}");
        }
        assert_eq!(message.lines().count(), 7, "{message}");
    }

    #[test]
    fn gaussian_spots_have_a_gain_of_1_and_no_calibration_by_default() {
        let with =
            |optics: &str| resolved(&FIVE_LINES.replace("motion", &format!("optics: ({optics}), motion")));
        let scenario = with("gaussian: (diameter_px: 3)").unwrap();
        assert_eq!((scenario.renderer.name(), scenario.settings.gain), ("gaussian", 1.0));
        assert_eq!(scenario.spec.calibration, Some(spec::Calibration::None));
        let text = write(&scenario.spec).unwrap();
        assert_eq!(write(&resolved(&text).unwrap().spec).unwrap(), text);
        assert_eq!(with("preset: setting2, gaussian: (), gain: 2").unwrap().settings.gain, 2.0);
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
