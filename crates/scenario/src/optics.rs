//! Optics and camera of a scenario: MicroSIG's settings and the detector.

use microsig_core::Settings;
use microsig_core::formats::{settings_file, tiff};
use microsig_core::render::waves::Lens;
use microsig_core::sensor::{Detector, ImageFormat, NoiseRounding, PixelMaps, Response, Sensor};
use microsig_core::stream::Streams;

use super::findings::{Collect, Findings};
use super::maps;
use super::spec::{self, Preset};
use storage::error::Result;

/// Builds the settings and fills in the keys that are omitted. `in_photons`: light is measured in photons
/// instead of rays.
pub(super) fn optics(
    optics: &mut spec::Optics,
    in_photons: bool,
    found: &mut Findings<'_>,
) -> Option<Settings> {
    if optics.preset.is_some() && optics.settings.is_some() {
        found.problems.other("optics", "expected either `preset` or `settings`, not both");
    }
    let mut settings = match optics.settings.clone() {
        Some(file) => {
            let (path, bytes) = found.read("optics.settings", &file)?;
            let read = settings_file::read(&bytes[..], &path.display().to_string());
            let read = found.problems.of("optics.settings", read)?;
            found.warnings.extend(read.warnings);
            optics.settings = Some(found.keep("optics.settings", &path, bytes));
            read.settings
        }
        // Without a preset or a file, keys that are not given have the values of setting 1.
        None => match *optics.preset.get_or_insert(Preset::Setting1) {
            Preset::Setting1 => Settings::setting1(),
            Preset::Setting1a => Settings::setting1a(),
            Preset::Setting2 => Settings::setting2(),
        },
    };
    if optics.gaussian.is_some() || in_photons {
        // The presets' gains are counts per ray: they apply neither to Gaussian peaks, which are in counts,
        // nor to photons.
        settings.gain = 1.0;
    }
    optics.apply(&mut settings);
    let depth_factor = optics.depth_factor();
    optics.depth_factor = Some(depth_factor);
    let given = optics.focal_planes_um.is_some();
    if let Some(apart_um) = optics.focal_planes_um.take() {
        if optics.cyl_focal_length.is_some() {
            found
                .problems
                .other("optics", "expected either `cyl_focal_length` or `focal_planes_um`, not both");
        }
        let distance_um = settings.focal_length * (1.0 + 1.0 / settings.magnification);
        let lens = optics.lens.unwrap_or_default();
        let moved = lens.depth_of_equal_defocus(optics.layers.as_ref(), distance_um, apart_um / depth_factor);
        match moved.and_then(|moved_um| cylinder(&settings, moved_um)) {
            Some(focal_length) => settings.cyl_focal_length = focal_length,
            None => {
                let n_s = optics.layers.map_or(1.0, |layers| layers.n_s);
                let most_um = distance_um * depth_factor * n_s;
                let allowed = match lens {
                    Lens::Microsig => format!("more than {:.0}, the position of the lens", -most_um),
                    Lens::Aplanatic => {
                        format!("less than {most_um:.0}, as no cylindrical lens reaches this distance")
                    }
                };
                found.problems.value("optics.focal_planes_um", apart_um, &allowed);
            }
        }
    }
    if let Some(cylinder) = optics.cylinder {
        let virtual_lens =
            optics.cyl_focal_length.is_some_and(|f| f != 0.0) || settings.cyl_focal_length != 0.0 && given;
        if virtual_lens {
            found.problems.other("optics.cylinder", "expected either `cylinder` or MicroSIG's virtual lens (`cyl_focal_length`, `focal_planes_um`), not both");
        }
        // A preset's virtual lens is replaced.
        settings.cyl_focal_length = 0.0;
        optics.fill(&settings);
        if let (None, spec::Cylinder::Planes { apart_um, growth }) = (optics.cylinder_lens(), cylinder) {
            found.problems.value(
                "optics.cylinder.planes",
                format!("(apart_um: {apart_um}, growth: {growth})"),
                "a growth below 1 with a negative apart_um (converging lens), or above 1 with a positive one",
            );
        }
    }
    optics.fill(&settings);
    if settings.ri_lens <= settings.ri_medium {
        let allowed = format!("a number > ri_medium = {}", settings.ri_medium);
        found.problems.value("optics.ri_lens", settings.ri_lens, &allowed);
        return None;
    }
    let largest = optics.lens.unwrap_or_default().largest_aperture(optics.layers.as_ref());
    found.problems.of("optics", settings.validate_immersed(largest)).map(|()| settings)
}

/// Focal length (um; 0: no lens) of the cylindrical lens that shifts the plane in focus along x by
/// `moved_um`, a depth as in MicroSIG's data files. In paraxial optics, the objective alone images that plane
/// at a distance b' behind it; the cylindrical lens, at b/3, moves this image to the sensor at b.
fn cylinder(settings: &Settings, moved_um: f64) -> Option<f64> {
    if moved_um == 0.0 {
        return Some(0.0);
    }
    let Settings { focal_length: f, magnification, .. } = *settings;
    let (object, image) = (f * (1.0 + 1.0 / magnification) + moved_um, f * (magnification + 1.0));
    let beyond = 1.0 / (1.0 / f - 1.0 / object) - image / 3.0;
    let focal_length = 1.0 / (1.5 / image - 1.0 / beyond);
    (object > 0.0 && focal_length.is_finite() && focal_length != 0.0).then_some(focal_length)
}

/// Response of the camera, or of MicroSIG's own sensor, to light at the image center, without fixed-pattern
/// noise; a background image and the maps of pixels are replaced by their means.
pub(super) fn response(settings: &Settings, detector: Option<&Detector>) -> Result<Response> {
    let pixel = Settings { pixel_dim_x: 1, pixel_dim_y: 1, ..settings.clone() };
    let uniform = detector.map(|detector| {
        let mean = |counts: &Vec<f64>| vec![counts.iter().sum::<f64>() / counts.len() as f64];
        let background = detector.background.as_ref().map(mean);
        Detector {
            prnu: 0.0,
            dsnu_e: 0.0,
            hot_pixels: None,
            background,
            maps: PixelMaps::default(),
            ..detector.clone()
        }
    });
    Ok(sensor(&pixel, uniform.as_ref(), ImageFormat::Integer, &Streams::new(0))?.response(0))
}

/// The sensor of a dataset. Without a detector it is MicroSIG's own, except that counts are rounded only
/// once, after adding noise, so that faint light is not lost.
pub fn sensor(
    settings: &Settings,
    detector: Option<&Detector>,
    format: ImageFormat,
    streams: &Streams,
) -> Result<Sensor> {
    let sensor = match detector {
        None => Sensor::new(settings),
        Some(detector) => Sensor::with_detector(settings, detector.clone(), streams)?,
    };
    Ok(sensor.with_rounding(NoiseRounding::AfterSum).with_format(format))
}

/// Sets MicroSIG's background noise to 0 if there is a camera, which has its own noise, unless the scenario
/// sets both; then a warning is added.
pub(super) fn default_background_noise(
    optics: &mut spec::Optics,
    sensor: Option<&spec::Sensor>,
    warnings: &mut Vec<String>,
) {
    let Some(sensor) = sensor else { return };
    let noise = *optics.background_noise.get_or_insert(0.0);
    let reads = sensor.read_noise_e > 0.0 || sensor.maps.as_ref().is_some_and(|maps| maps.variance.is_some());
    if noise > 0.0 && (sensor.shot_noise || reads) {
        warnings.push(format!(
            "optics.background_noise = {noise} counts is added to the noise of the camera in `sensor`; omit \
             it to use the camera's noise only"
        ));
    }
}

/// A warning if the background is outside the range of counts.
pub(super) fn clipped(response: &Response, detector: Option<&Detector>) -> Option<String> {
    let most = f64::from((1u32 << detector.map_or(16, |detector| detector.bits)) - 1);
    let Response { background, background_noise, .. } = response;
    let what = match background {
        b if *b >= most => "saturated even without particles",
        b if *b < 0.0 => "black in dim regions",
        _ => return None,
    };
    let noise = if *background_noise > 0.0 {
        format!(" with a noise of {background_noise:.3}")
    } else {
        String::new()
    };
    Some(format!(
        "the background is {background:.3} counts{noise}, but the range is 0 to {most}: images are {what}"
    ))
}

/// Builds the camera and reads its background image and maps.
pub(super) fn detector(
    sensor: &mut spec::Sensor,
    settings: Option<&Settings>,
    found: &mut Findings<'_>,
) -> Option<Detector> {
    let background = match (sensor.background.clone(), settings) {
        // Without settings, only values that do not depend on them are checked.
        (None, _) | (_, None) => None,
        (Some(file), Some(settings)) => {
            let (path, bytes) = found.read("sensor.background", &file)?;
            let size = (settings.pixel_dim_x, settings.pixel_dim_y);
            let read = tiff::read(std::io::Cursor::new(&bytes), &path.display().to_string(), size);
            let counts = found.problems.of("sensor.background", read)?;
            sensor.background = Some(found.keep("sensor.background", &path, bytes));
            Some(counts)
        }
    };
    let maps = match settings {
        Some(settings) => maps::read(sensor, settings, found)?,
        None => PixelMaps::default(),
    };
    let detector = sensor.detector(background, maps);
    let checked = detector.validate(settings.unwrap_or(&Settings::setting1()));
    found.problems.of("sensor", checked).map(|()| detector)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computed by hand: b = 3850 um. The image is 2 b/3 behind the cylindrical lens; without the lens it
    /// would be 7163 um behind that point, which is 8446 um behind the objective. The object is then at 365.1
    /// um instead of 385 um.
    #[test]
    fn a_cylinder_of_4000_um_moves_the_focal_plane_of_setting_1_by_20_um() {
        let focal_length = cylinder(&Settings::setting1(), -19.87).unwrap();
        assert!((focal_length / 4000.0 - 1.0).abs() < 0.002, "{focal_length}");
        let diverging = cylinder(&Settings::setting1(), 20.0).unwrap();
        // Object at 405 um: image 2577 um behind the objective, 1294 um behind the cylindrical lens.
        assert!((diverging / -2609.4 - 1.0).abs() < 0.001, "{diverging}");
        assert_eq!(cylinder(&Settings::setting1(), 0.0), Some(0.0));
        assert_eq!(cylinder(&Settings::setting1(), -400.0), None);
    }

    /// The images of an aplanatic lens in a layer of water are narrowest where the scenario asks for.
    #[test]
    fn focal_planes_are_where_they_are_asked_for() {
        use microsig_core::render::waves::{Layers, WaveOptics, WavesRenderer};
        let layers = Layers { focus_depth_um: 60.0, ..Layers::default() };
        for (lens, layers) in
            [(Lens::Aplanatic, None), (Lens::Aplanatic, Some(layers)), (Lens::Microsig, Some(layers))]
        {
            let distance_um = 350.0 * (1.0 + 1.0 / 10.0);
            let moved = lens.depth_of_equal_defocus(layers.as_ref(), distance_um, -30.0).unwrap();
            let settings = Settings {
                numerical_aperture: 0.2,
                cyl_focal_length: cylinder(&Settings::setting1(), moved).unwrap(),
                ..Settings::setting1()
            };
            let optics = WaveOptics { lens, layers, ..WaveOptics::new(0.52) };
            let renderer = WavesRenderer::new(&settings, &optics, 0.003).unwrap();
            // Light 2 px from the center, along each axis: least where images are narrowest along it.
            let halo = |z_um: f64, at: [f64; 2]| {
                renderer.share_at(z_um, 0.5, &[at])[0] / renderer.share_at(z_um, 0.5, &[[0.0, 0.0]])[0]
            };
            let narrowest = |at: [f64; 2]| {
                let depths = (-50..=10).map(f64::from);
                depths.min_by(|a, b| halo(*a, at).total_cmp(&halo(*b, at))).unwrap()
            };
            let (x, y) = (narrowest([2.0, 0.0]), narrowest([0.0, 2.0]));
            assert!((x - y + 30.0).abs() <= 2.0, "{lens:?}: {x} and {y} um");
        }
    }
}
