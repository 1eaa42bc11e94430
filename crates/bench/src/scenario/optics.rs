//! The lens and what stands behind it, as scenarios write them: MicroSIG's settings, the camera.

use microsig_core::Settings;
use microsig_core::formats::{settings_file, tiff};
use microsig_core::sensor::{Detector, Response, Sensor};
use microsig_core::stream::Streams;

use super::files::Files;
use super::problems::Problems;
use super::spec::{self, Preset};
use crate::error::Result;

/// The settings; what the scenario left out is filled in.
pub(super) fn optics(
    optics: &mut spec::Optics,
    files: &mut Files<'_>,
    warnings: &mut Vec<String>,
    problems: &mut Problems,
) -> Option<Settings> {
    if optics.preset.is_some() && optics.settings.is_some() {
        problems.0.push("optics: expected either `preset` or `settings`, not both".to_owned());
    }
    let mut settings = match optics.settings.clone() {
        Some(file) => {
            let (path, bytes) = files.read("optics.settings", &file, problems)?;
            let read = settings_file::read(&bytes[..], &path.display().to_string());
            let read = problems.of("optics.settings", read)?;
            warnings.extend(read.warnings);
            optics.settings = Some(files.keep(&path, bytes));
            read.settings
        }
        // Without preset and file the keys may be all there; what is missing is taken from setting 1.
        None => match *optics.preset.get_or_insert(Preset::Setting1) {
            Preset::Setting1 => Settings::setting1(),
            Preset::Setting1a => Settings::setting1a(),
            Preset::Setting2 => Settings::setting2(),
        },
    };
    if optics.gaussian.is_some() {
        // Peaks are counts already; the presets' gains are counts per ray.
        settings.gain = 1.0;
    }
    optics.apply(&mut settings);
    optics.fill(&settings);
    let depth_factor = *optics.depth_factor.get_or_insert(1.0);
    problems.range("optics.depth_factor", depth_factor, 0.1, 10.0, "0.1 to 10");
    match settings.validate() {
        Ok(()) => Some(settings),
        Err(microsig_core::Error::Malformed(faults)) => {
            problems.0.extend(faults.into_iter().map(|f| format!("optics.{}", f.message)));
            None
        }
        Err(other) => problems.of("optics", Err(other)),
    }
}

/// How a camera, or MicroSIG's own sensor, shows light in the middle of the image; a fixed pattern is left out, a
/// background image counts with its mean.
pub(super) fn response(settings: &Settings, detector: Option<&Detector>) -> Result<Response> {
    let pixel = Settings { pixel_dim_x: 1, pixel_dim_y: 1, ..settings.clone() };
    let sensor = match detector {
        None => Sensor::new(&pixel),
        Some(detector) => {
            let mean = |counts: &Vec<f64>| vec![counts.iter().sum::<f64>() / counts.len() as f64];
            let background = detector.background.as_ref().map(mean);
            let even = Detector { prnu: 0.0, dsnu_e: 0.0, hot_pixels: None, background, ..detector.clone() };
            Sensor::with_detector(&pixel, even, &Streams::new(0))?
        }
    };
    Ok(sensor.response(0))
}

/// What to say of a background beyond the ends of the scale.
pub(super) fn clipped(response: &Response, detector: Option<&Detector>) -> Option<String> {
    let most = f64::from((1u32 << detector.map_or(16, |detector| detector.bits)) - 1);
    let Response { background, background_noise, .. } = response;
    let what = match background {
        b if *b >= most => "saturated without any particle",
        b if *b < 0.0 => "black where there is little light",
        _ => return None,
    };
    let noise = if *background_noise > 0.0 {
        format!(" with a noise of {background_noise:.3}")
    } else {
        String::new()
    };
    Some(format!("the background is {background:.3} counts{noise}, of 0 to {most}: images are {what}"))
}

/// The camera, with its background image.
pub(super) fn detector(
    sensor: &mut spec::Sensor,
    settings: Option<&Settings>,
    files: &mut Files<'_>,
    problems: &mut Problems,
) -> Option<Detector> {
    let background = match (sensor.background.clone(), settings) {
        // Without settings only what does not depend on them is checked.
        (None, _) | (_, None) => None,
        (Some(file), Some(settings)) => {
            let (path, bytes) = files.read("sensor.background", &file, problems)?;
            let size = (settings.pixel_dim_x, settings.pixel_dim_y);
            let read = tiff::read(std::io::Cursor::new(&bytes), &path.display().to_string(), size);
            let counts = problems.of("sensor.background", read)?;
            sensor.background = Some(files.keep(&path, bytes));
            Some(counts)
        }
    };
    let detector = sensor.detector(background);
    match detector.validate(settings.unwrap_or(&Settings::setting1())) {
        Ok(()) => Some(detector),
        Err(microsig_core::Error::Malformed(faults)) => {
            problems.0.extend(faults.into_iter().map(|f| format!("sensor.{}", f.message)));
            None
        }
        Err(other) => problems.of("sensor", Err(other)),
    }
}
