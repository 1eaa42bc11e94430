//! Rendering of a scenario's particles: fills in and checks renderer, light and objective.

use microsig_core::Settings;
use microsig_core::problem::Problems;
use microsig_core::render::expected::DEFAULT_TOLERANCE;
use microsig_core::render::waves::Lens;

use super::findings::Collect;
use super::spec::{Calibration, Intensities, RenderMode, Spec};

/// Fills in defaults of the renderer and checks its keys.
pub(super) fn mode(spec: &mut Spec, problems: &mut Problems) {
    match spec.render.mode {
        RenderMode::Rays => {
            if let Some(tolerance) = spec.render.tolerance {
                let allowed = "nothing: mode: rays has no tolerance, only mode: expected and mode: waves";
                problems.value("render.tolerance", tolerance, allowed);
            }
        }
        RenderMode::Expected => {
            spec.render.tolerance.get_or_insert(DEFAULT_TOLERANCE);
        }
        RenderMode::Waves => {
            let render = &mut spec.render;
            if render.wavelength_um.is_none() {
                problems.other(
                    "render",
                    "`wavelength_um` is missing: mode: waves needs the wavelength in vacuum",
                );
            }
            render.tolerance.get_or_insert(DEFAULT_TOLERANCE);
            render.bandwidth_um.get_or_insert(0.0);
            render.emission.get_or_insert_default();
            spec.optics.lens.get_or_insert_default();
            if let Some(factor) =
                spec.optics.depth_factor.filter(|f| *f != 1.0 && spec.optics.layers.is_some())
            {
                problems.value("optics.depth_factor", factor, "1: with `layers` depths are physical");
            }
        }
    }
    if spec.optics.gaussian.is_some() {
        let refuse = |mode, why: &str| Some((mode, format!("nothing: Gaussian spots {why}")));
        let refused = match spec.render.mode {
            RenderMode::Rays => None,
            RenderMode::Expected => refuse("expected", "are not the limit of rays"),
            RenderMode::Waves => refuse("waves", "are not diffracted"),
        };
        refused.into_iter().for_each(|(mode, allowed)| problems.value("render.mode", mode, &allowed));
    }
    if spec.render.mode != RenderMode::Waves {
        refuse_wave_keys(spec, problems);
    }
}

/// Refuses keys that only wave optics uses.
fn refuse_wave_keys(spec: &Spec, problems: &mut Problems) {
    let (render, optics) = (&spec.render, &spec.optics);
    let lens = optics.lens.filter(|lens| *lens != Lens::Microsig);
    let field = optics.field.unwrap_or_default();
    for (path, given) in [
        ("render.wavelength_um", render.wavelength_um.is_some()),
        ("render.bandwidth_um", render.bandwidth_um.is_some()),
        ("render.emission", render.emission.is_some()),
        ("optics.lens", lens.is_some()),
        ("optics.pupil", optics.pupil.is_some()),
        ("optics.cylinder", optics.cylinder.is_some()),
        ("optics.cyl_angle_deg", optics.cyl_angle_deg.is_some()),
        ("optics.layers", optics.layers.is_some()),
        ("optics.field.coma", field.coma != Default::default()),
        ("optics.field.astigmatism", field.astigmatism != Default::default()),
        ("optics.field.vignetting", field.vignetting != Default::default()),
    ] {
        if given {
            problems.other(path, "expected nothing, or render: (mode: waves): only wave optics uses it");
        }
    }
}

/// Maximum number of images in a calibration stack.
const MAX_IMAGES: f64 = 100_000.0;

/// Checks steps and sizes of the calibration stacks.
pub(super) fn calibration(spec: &Spec, (low, high): (f64, f64), problems: &mut Problems) {
    let Some(calibration) = &spec.calibration else { return };
    let within = match calibration {
        Calibration::Sizes { .. } => "calibration.sizes",
        Calibration::Field { .. } => "calibration.field",
        _ => "calibration",
    };
    let diameters_um = calibration.given_diameters_um().unwrap_or_default();
    for (k, d_um) in diameters_um.iter().enumerate() {
        let path = format!("{within}.diameters_um.{k}");
        if diameters_um[..k].contains(d_um) {
            problems.value(&path, d_um, "each diameter once");
        }
    }
    let (path, step_um) = (&format!("{within}.every_um"), calibration.given_step_um());
    if let Some(step_um) = step_um.filter(|step_um| (high - low) / step_um > MAX_IMAGES) {
        let least = (high - low) / MAX_IMAGES;
        problems.value(path, step_um, &format!("at least {least}: a stack has at most {MAX_IMAGES} images"));
    }
}

/// Checks light and objective for wave optics and adds each problem at its key; `None` if there is one.
pub(super) fn check(spec: &Spec, settings: &Settings, problems: &mut Problems) -> Option<()> {
    let renderer = spec.renderer();
    let checked = match renderer.wave_optics() {
        None => renderer.field().validate(settings),
        // `mode` has reported that it is missing.
        Some(_) if spec.render.wavelength_um.is_none() => return None,
        Some(optics) => optics.validate(settings),
    };
    problems.of("optics", checked)
}

/// Checks the keys that conflict with `particles.photons`.
pub(super) fn photons(spec: &mut Spec, settings: Option<&Settings>, problems: &mut Problems) {
    if spec.particles.photons.is_none() {
        return;
    }
    if spec.particles.c_int != Intensities::default() {
        problems
            .other("particles.c_int", "expected nothing: particles.photons says how bright particles are");
    }
    if let Some(spot) = spec.optics.gaussian.filter(|spot| spot.peak_counts == 0.0) {
        problems.value(
            "optics.gaussian.peak_counts",
            spot.peak_counts,
            "a number > 0 with particles.photons",
        );
    }
    if let Some(sensor) = &spec.sensor {
        let why = "1: with particles.photons the light is in photons, and sensor.gain_counts_per_e converts it to counts";
        if sensor.photons_per_count != 1.0 {
            problems.value("sensor.photons_per_count", sensor.photons_per_count, why);
        }
        if let Some(settings) = settings.filter(|settings| settings.gain != 1.0) {
            problems.value("optics.gain", settings.gain, why);
        }
    }
}
