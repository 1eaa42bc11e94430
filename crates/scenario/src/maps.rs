use std::path::Path;

use microsig_core::Settings;
use microsig_core::formats::{npy, tiff};
use microsig_core::sensor::{PixelMap, PixelMaps, PixelQuantity};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::findings::{Collect, Findings};
use super::spec::Sensor;

/// Files with offset, gain and read noise of every pixel, in the conventions of Huang et al. 2013.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Maps {
    /// The mean of dark frames, -65535 to 65535 counts; in place of `offset_counts`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-unit" = "counts"), example = &"offset.tif")]
    pub offset: Option<String>,
    /// Counts per electron, > 0, from the photon transfer of flat frames; in place of `gain_counts_per_e`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-unit" = "counts/e"), example = &"gain.tif")]
    pub gain: Option<String>,
    /// The variance of dark frames, >= 0; in place of `read_noise_e`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-unit" = "counts^2"), example = &"variance.tif")]
    pub variance: Option<String>,
}

/// Reads the maps of a sensor; `None` if there are problems. Keys that a map replaces must not be given.
pub(super) fn read(sensor: &mut Sensor, settings: &Settings, found: &mut Findings<'_>) -> Option<PixelMaps> {
    let none = Sensor::default();
    let Some(maps) = &mut sensor.maps else { return Some(PixelMaps::default()) };
    let mut read =
        |key: &str, file: &mut Option<String>, quantity, (replaced, value, default): (&str, f64, f64)| {
            let Some(name) = file.clone() else { return Some(None) };
            if value != default {
                let allowed = format!("{default}, its default, as `maps.{key}` replaces it");
                found.problems.value(&format!("sensor.{replaced}"), value, &allowed);
            }
            let path = format!("sensor.maps.{key}");
            let (map, kept) = map(&path, &name, (settings, quantity), found)?;
            *file = Some(kept);
            Some(Some(map))
        };
    let offset = ("offset_counts", sensor.offset_counts, none.offset_counts);
    let gain = ("gain_counts_per_e", sensor.gain_counts_per_e, none.gain_counts_per_e);
    let noise = ("read_noise_e", sensor.read_noise_e, none.read_noise_e);
    // Each is read even if another cannot be, so that all problems are reported at once.
    let offset_counts = read("offset", &mut maps.offset, PixelQuantity::Offset, offset);
    let gain_counts_per_e = read("gain", &mut maps.gain, PixelQuantity::Gain, gain);
    let variance_counts2 = read("variance", &mut maps.variance, PixelQuantity::Variance, noise);
    Some(PixelMaps {
        offset_counts: offset_counts?,
        gain_counts_per_e: gain_counts_per_e?,
        variance_counts2: variance_counts2?,
    })
}

/// The map in a file, and the path of the file in the dataset.
fn map(
    key: &str,
    file: &str,
    (settings, quantity): (&Settings, PixelQuantity),
    found: &mut Findings<'_>,
) -> Option<(PixelMap, String)> {
    let size = (settings.pixel_dim_x, settings.pixel_dim_y);
    let extension = Path::new(file).extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if !["tif", "tiff", "npy"].contains(&extension.as_str()) {
        found.problems.value(key, file, "a .tif, .tiff or .npy file");
        return None;
    }
    let (path, bytes) = found.read(key, file)?;
    let name = path.display().to_string();
    let read = match extension.as_str() {
        "npy" => npy::read(&bytes[..], &name, size),
        _ => tiff::read(std::io::Cursor::new(&bytes), &name, size),
    };
    let values = found.problems.of(key, read)?;
    found.problems.of(key, quantity.check(&values, settings.pixel_dim_x, &name))?;
    Some((values.into(), found.keep(key, &path, bytes)))
}
