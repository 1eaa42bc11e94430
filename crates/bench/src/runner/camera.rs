//! From particles to an image file.

use std::path::Path;

use microsig_core::Particle;
use microsig_core::formats::tiff::{self, PixelScale};
use microsig_core::render::Renderer;
use microsig_core::sensor::{Detector, Image, Sensor};
use microsig_core::stream::{Purpose, Streams};

use crate::error::{Error, Result};

/// Renderer, sensor and random streams: all that turns particles into an image.
#[derive(Debug, Clone)]
pub struct Camera {
    renderer: Renderer,
    sensor: Sensor,
    scale: PixelScale,
    streams: Streams,
    rays: Purpose,
    noise: Purpose,
}

impl Camera {
    /// The camera of a measurement; without a detector it is MicroSIG's own sensor.
    pub fn new(renderer: Renderer, detector: Option<&Detector>, streams: Streams) -> Result<Self> {
        let settings = renderer.settings();
        Ok(Camera {
            sensor: match detector {
                None => Sensor::new(settings),
                Some(detector) => Sensor::with_detector(settings, detector.clone(), &streams)?,
            },
            scale: PixelScale { um_per_px: settings.um_per_px(), frame_interval_s: None },
            renderer,
            streams,
            rays: Purpose::Rays,
            noise: Purpose::BackgroundNoise,
        })
    }

    /// The same camera with the random streams of a calibration.
    pub fn calibrating(self) -> Self {
        Camera { rays: Purpose::CalibrationRays, noise: Purpose::CalibrationNoise, ..self }
    }

    /// The same camera, taking frames at an interval, which its image files tell.
    pub fn every(self, interval_s: f64) -> Self {
        Camera { scale: PixelScale { frame_interval_s: Some(interval_s), ..self.scale }, ..self }
    }

    /// The renderer.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// The image of one frame; the particles are the rows of its data file, in their order.
    pub fn image(&self, particles: &[Particle], frame: u32) -> Image {
        let light = self.renderer.light(particles, &self.streams, self.rays, frame);
        self.sensor.expose(&light, &self.streams, self.noise, frame)
    }

    /// Writes an image as TIFF with its scale.
    pub fn save(&self, path: &Path, image: &Image) -> Result<()> {
        save(path, |writer| Ok(tiff::write(writer, image, &self.scale, &path.display().to_string())?))
    }
}

/// Writes a file so that it is there whole or not at all.
pub(crate) fn save(
    path: &Path,
    write: impl FnOnce(&mut std::io::BufWriter<&std::fs::File>) -> Result<()>,
) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    // A fixed prefix lets a later run recognise what an interrupted one left behind.
    let file = tempfile::Builder::new()
        .prefix(TEMPORARY)
        .tempfile_in(folder)
        .map_err(|e| Error::write(path)(bare(e)))?;
    let mut writer = std::io::BufWriter::with_capacity(1 << 20, file.as_file());
    write(&mut writer)?;
    std::io::Write::flush(&mut writer).map_err(Error::write(path))?;
    drop(writer);
    make_readable(file.as_file()).map_err(Error::write(path))?;
    file.persist(path).map_err(|e| Error::Write { path: path.to_owned(), source: e.error })?;
    Ok(())
}

/// The system's error in one of `tempfile`, whose text names a file that the user does not know.
fn bare(error: std::io::Error) -> std::io::Error {
    let inner = error.get_ref().and_then(|e| e.source()).and_then(|e| e.downcast_ref::<std::io::Error>());
    match inner.and_then(std::io::Error::raw_os_error) {
        Some(code) => std::io::Error::from_raw_os_error(code),
        None => error,
    }
}

/// What names of unfinished files begin with.
pub(crate) const TEMPORARY: &str = ".unfinished-";

/// Temporary files are made for their owner alone; results are for everybody, as if made by `File::create`.
#[cfg(unix)]
fn make_readable(file: &std::fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn make_readable(_: &std::fs::File) -> std::io::Result<()> {
    Ok(())
}
