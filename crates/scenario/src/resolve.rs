//! Resolves a scenario: fills in defaults and checks the constraints between keys.
//!
//! A [`Scenario`] exists only if it is valid. Its `spec` contains all defaults, so that writing, reading and
//! resolving it gives the same scenario.

use std::path::Path;
use std::sync::Arc;

use flows::{Diameters, FluidFractionCache, FluidRegion, Illumination, Seeding, Shutter, VelocityField};
use microsig_core::Settings;
use microsig_core::formats::data_file::Layout;
use microsig_core::problem::Problems;
use microsig_core::render::Context;
use microsig_core::sensor::Detector;
use microsig_core::stream::Streams;

use super::brightness::PhotonScale;
use super::drawing;
use super::findings::{Collect, Findings};
use super::flow_checks;
use super::focal_planes;
use super::imaging::{Imaging, scan};
use super::license::{LICENSES, License};
use super::motion::MotionSource;
use super::optics::{default_background_noise, detector, optics};
use super::particles::Cloud;
use super::recorded::check_tracks;
use super::recordings::Recordings;
use super::resolved::Scenario;
use super::spec::{self, Intensities, Motion, PairSeeding, Particles, Placement, Spec, Timing};
use super::truth_grid::TruthGrid;
use super::volume;
use storage::error::{Error, Result};

/// Fills in defaults and checks a scenario; the paths of files in it are relative to `folder`, and its
/// renderers work with `context`. Errors: [`Error::Problems`] with all problems at once, each with the path
/// of its key.
pub fn resolve(mut spec: Spec, folder: &Path, context: &Context) -> Result<Scenario> {
    let mut found = Findings::new(folder, context);
    name(&spec.name, &mut found.problems);
    if spec.scoring.as_ref().is_some_and(|rules| rules.dims == Some(2) && rules.gate_z_um.is_some()) {
        found.problems.other("scoring.gate_z_um", "has no meaning with `dims: 2`, in the image plane");
    }
    let combined = Sections::resolve(&mut spec, &mut found).and_then(|s| s.combine(spec, &mut found));
    let Findings { inputs, problems, mut warnings, .. } = found;
    let Some(mut scenario) = combined.filter(|_| !problems.any()) else {
        return Err(Error::Problems(problems.sorted()));
    };
    warnings.dedup();
    warnings.extend(scenario.single_stack_warning());
    (scenario.inputs, scenario.warnings) = (inputs, warnings);
    Ok(scenario)
}

/// The sections of a scenario, each valid on its own.
struct Sections {
    settings: Settings,
    detector: Option<Detector>,
    recordings: Recordings,
    z_um: (f64, f64),
    diameters: Diameters,
    cloud: Cloud,
    illumination: Illumination,
    /// `None` for recorded tracks.
    field: Option<Arc<dyn VelocityField>>,
}

impl Sections {
    /// Fills in defaults and checks each section on its own; the problems of all are reported together.
    fn resolve(spec: &mut Spec, found: &mut Findings<'_>) -> Option<Self> {
        default_background_noise(&mut spec.optics, spec.sensor.as_ref(), &mut found.warnings);
        let in_photons = spec.particles.photons.is_some();
        let settings = optics(&mut spec.optics, in_photons, found);
        let camera = spec.sensor.as_mut();
        let detector = camera.and_then(|camera| detector(camera, settings.as_ref(), found));
        let in_focus = spec.optics.gaussian.is_some();
        spec.calibration.get_or_insert(if in_focus {
            spec::Calibration::None
        } else {
            spec::Calibration::Stack
        });
        let recordings = Recordings::checked(spec.timing, &mut found.problems);
        focal_planes::center(&mut spec.boundaries, settings.as_ref(), &spec.optics, &mut found.problems);
        let z_um = volume::depths_um(&mut spec.boundaries, &mut found.problems);
        let diameters = spec.particles.diameters(&mut found.problems);
        let cloud = spec.particles.cloud(&spec.boundaries.bodies, &mut found.problems);
        let illumination = match &mut spec.illumination {
            Some(light) => {
                light.fill_center((0.0, 0.0, 0.5 * (z_um.0 + z_um.1)));
                found.problems.of("illumination", light.clone().checked())
            }
            None => Some(Illumination::default()),
        };
        // The inner `Option` is `None` for recorded tracks.
        let field = match &mut spec.motion {
            Motion::Flow(flow) => flow.build(z_um, found).map(|field| Some(Arc::from(field))),
            Motion::Own(field) => Some(Some(Arc::clone(&field.0))),
            Motion::Tracks(_) => {
                refuse_flow_keys(spec, &mut found.problems);
                Some(None)
            }
        };
        let problems = &mut found.problems;
        if spec.walls_slow() && spec.particles.spheroids.is_some() {
            let message = "expected free: the laws of hindered motion are those of spheres";
            problems.other("motion.flow.walls", message);
        }
        let steady = is_steady(&spec.motion, field.as_ref().and_then(Option::as_deref));
        let size_px = settings.as_ref().map_or((1, 1), |s| (s.pixel_dim_x, s.pixel_dim_y));
        spec.truth_grid.get_or_insert_with(|| TruthGrid::of(steady)).fill(steady, size_px, problems);
        drawing::mode(spec, problems);
        drawing::calibration(spec, z_um, problems);
        drawing::photons(spec, settings.as_ref(), problems);
        Some(Sections {
            settings: settings?,
            detector,
            recordings,
            z_um,
            diameters: diameters?,
            cloud: cloud?,
            illumination: illumination?,
            field: field?,
        })
    }

    /// Fills in what depends on several sections and checks that they fit together. The scenario does not have
    /// its inputs and warnings yet.
    fn combine(self, mut spec: Spec, found: &mut Findings<'_>) -> Option<Scenario> {
        let Sections { settings, detector, recordings, z_um, diameters, mut cloud, illumination, field } =
            self;
        let imaging = Imaging::resolve(&spec, (settings, detector), found)?;
        let motion = match field {
            Some(field) => MotionSource::Field(field),
            None => tracks(&mut spec.motion, &imaging, found)?,
        };
        if let Some(photons) = &mut spec.particles.photons {
            let reference_um = *photons.reference_um.get_or_insert(motion.diameters_um(&diameters)[1]);
            let grow_with = photons.grow_with;
            cloud.photons =
                Some(PhotonScale::new(grow_with, reference_um, &spec.renderer(), &imaging.settings));
        }
        let longest_um = diameters.max() * spec.particles.spheroids.map_or(1.0, |s| s.e_p.max(1.0));
        let has_field = matches!(motion, MotionSource::Field(_));
        let margin_px = volume::margin_px(&mut spec, &imaging, (z_um, longest_um), has_field, found);
        let depth_range_um = volume::illuminated_depths(z_um, &illumination, &mut found.problems);
        let mut seeding = match &motion {
            MotionSource::Field(_) => {
                imaging.check_depths(&spec, z_um, &diameters, found);
                found.warnings.extend(spacing_warning(&spec));
                let mean_um = diameters.mean();
                // Taken out temporarily, because the scan needs the rest of the scenario.
                let mut particles = std::mem::take(&mut spec.particles);
                let optics = (&imaging.settings, imaging.scale.depth_factor());
                let stack = || scan(&spec, optics, mean_um, depth_range_um, found.context);
                let optics = (&imaging.scale, &imaging.settings);
                let seeding = particles.seeding(diameters, optics, z_um, stack, found);
                spec.particles = particles;
                seeding?
            }
            MotionSource::Tracks(tracks) => {
                let optics = (&diameters, &imaging.renderer, &imaging.scale);
                check_tracks(tracks, &cloud, optics, (&recordings, z_um), found);
                found.problems.of("particles", Seeding::list(Vec::new(), diameters))?
            }
        };
        let domain = volume::domain(&mut spec.boundaries, &imaging, z_um, margin_px, &mut found.problems)?;
        let fluid_shares = FluidFractionCache::default();
        if let MotionSource::Field(field) = &motion {
            let fluid =
                FluidRegion::new(field.as_ref(), &domain, &spec.boundaries.bodies).keeping(&fluid_shares);
            let view = found.problems.of("boundaries", imaging.scale.view(z_um.0, z_um.1, 0.0))?;
            let (field, seeded) = ((field.as_ref(), &fluid), (&seeding, &view));
            let warnings = flow_checks::check(field, seeded, &recordings, &mut found.problems);
            found.warnings.extend(warnings);
            seeding = spec.particles.within_walls(seeding, &fluid, &view);
        }
        Some(Scenario {
            license: License::find(&spec.license).unwrap_or(LICENSES[0]),
            streams: Streams::new(spec.seed),
            layout: layout(&spec, &motion, imaging.shutter),
            spec,
            settings: imaging.settings,
            renderer: imaging.renderer,
            context: found.context.clone(),
            detector: imaging.detector,
            inputs: Vec::new(),
            warnings: Vec::new(),
            motion,
            scale: imaging.scale,
            domain,
            depth_range_um,
            fluid_shares,
            seeding,
            cloud,
            recordings,
            shutter: imaging.shutter,
            illumination,
        })
    }
}

/// Recorded tracks; `None` without them or if they are invalid.
fn tracks(motion: &mut Motion, imaging: &Imaging, found: &mut Findings<'_>) -> Option<MotionSource> {
    let Motion::Tracks(tracks) = motion else { return None };
    tracks.build(&imaging.scale, found).map(MotionSource::Tracks)
}

/// Whether the flow is steady; `None` for recorded tracks.
fn is_steady(motion: &Motion, field: Option<&dyn VelocityField>) -> Option<bool> {
    match (motion, field) {
        (Motion::Flow(_) | Motion::Own(_), Some(field)) => Some(field.is_steady()),
        (Motion::Flow(_) | Motion::Own(_), None) => Some(true),
        (Motion::Tracks(_), _) => None,
    }
}

/// The columns that the data files need.
fn layout(spec: &Spec, motion: &MotionSource, shutter: Option<Shutter>) -> Layout {
    let rows = match motion {
        MotionSource::Field(_) => &[],
        MotionSource::Tracks(tracks) => tracks.rows(),
    };
    let spheroids = rows.iter().any(|row| row.aspect.is_some_and(|e_p| e_p != 1.0));
    let c_int = rows.iter().any(|row| row.c_int.is_some_and(|c_int| c_int != 1.0));
    let light = spec.illumination.is_some() || shutter.is_some();
    let Particles { spheroids: drawn, c_int: factor, photons, .. } = &spec.particles;
    Layout {
        spheroids: spheroids || drawn.is_some(),
        c_int: c_int || light || photons.is_some() || *factor != Intensities::default(),
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

/// A warning that minimum distances apply only to the first frame, if recordings have further frames.
fn spacing_warning(spec: &Spec) -> Option<String> {
    let goes_on = match spec.timing {
        Timing::Pairs(p) => p.seeding == PairSeeding::Continuing,
        Timing::Sequence(s) => s.frames > 1,
        Timing::FourPulse(_) => true,
    };
    let what = "particles.seeding applies to the first frame of a recording; the flow then changes the distances between particles, \
                and particles that enter through open boundaries are placed independently of the others";
    (goes_on && spec.particles.seeding != Placement::Uniform).then(|| what.to_owned())
}

/// Checks the name, which becomes a folder name and the identifier of a data package.
fn name(name: &str, problems: &mut Problems) {
    let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "._-".contains(c);
    if name.is_empty() || name.len() > 100 || name.starts_with('.') || !name.chars().all(fits) {
        let allowed = "1 to 100 lower-case letters, digits, `.`, `_`, `-`, not starting with a dot";
        problems.value("name", format!("`{name}`"), allowed);
    }
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
        resolve(parse(text, "s.ron").unwrap(), Path::new("."), &Context::default())
    }

    #[test]
    fn a_few_lines_are_enough_and_the_filled_form_is_a_fixed_point() {
        let scenario = resolved(FIVE_LINES).unwrap();
        assert_eq!(scenario.settings, Settings::setting1());
        assert_eq!(scenario.depth_range_um, (-80.0, 20.0));
        // What was measured of the fluid is not measured again.
        assert!(format!("{:?}", scenario.fluid_shares).contains("Region"));
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
    fn the_key_of_an_input_leads_to_its_path() {
        let folder = tempfile::tempdir().unwrap();
        let grid = "x_um,y_um,z_um,u_um_s,v_um_s,w_um_s\n";
        let nodes = |x: u32| format!("{x},0,0,1,0,0\n{x},9,0,1,0,0\n{x},0,9,1,0,0\n{x},9,9,1,0,0\n");
        std::fs::write(folder.path().join("grid.csv"), format!("{grid}{}{}", nodes(0), nodes(9))).unwrap();
        std::fs::write(folder.path().join("some.txt"), "10 10 0 2\n").unwrap();
        let gridded = "gridded(file: \"grid.csv\", interpolation: trilinear)";
        let text = FIVE_LINES
            .replace(
                "poiseuille()",
                &format!("sum([uniform(), translated(field: {gridded}, by: ()), {gridded}])"),
            )
            .replace("timing", "particles: (number: file(\"some.txt\")), timing");
        let scenario = resolve(parse(&text, "s.ron").unwrap(), folder.path(), &Context::default()).unwrap();
        let spec = serde_json::to_value(&scenario.spec).unwrap();
        assert_eq!(scenario.inputs.len(), 3);
        for input in &scenario.inputs {
            let pointer = format!("/{}", input.key.replace('.', "/"));
            assert_eq!(spec.pointer(&pointer), Some(&input.path.as_str().into()), "{pointer}");
        }
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
