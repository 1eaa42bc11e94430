//! The calibration stack: one particle, scanned through the depth range.
//!
//! The particle sits on the central pixel of a sensor just large enough for its largest image; settings and noise are
//! those of the dataset, the random streams are its own. Depths run from below the range to above it.

use std::path::Path;

use microsig_core::formats::{data_file, settings_file};
use microsig_core::sensor::Detector;
use microsig_core::{Particle, Settings};
use rayon::prelude::*;

use super::save;
use super::table::{Table, TableFile, column};
use crate::error::{Error, Result};
use crate::runner::Camera;
use crate::scenario::Scenario;

/// One row per image of the stack.
pub static CALIBRATION: Table = Table::new(
    "calibration/calibration.csv",
    "One row per image of the calibration stack: a single particle, scanned through the depth range.",
    &[
        column("step", "integer", "", "number of the step, from 0"),
        column("z_um", "number", "um", "physical depth of the particle, growing away from the lens"),
        column("x_px", "number", "px", "column of its centre"),
        column("y_px", "number", "px", "row of its centre"),
        column("image", "string", "", "path of the image"),
        column("particles", "string", "", "path of the MicroSIG data file"),
    ],
);

/// Distance between the depths of the stack, um.
pub const STEP_UM: f64 = 2.0;

/// Depths of the stack, um: steps of 2 um that begin at the range's lower end and reach its upper end.
pub fn depths_um((low, high): (f64, f64)) -> Vec<f64> {
    let steps = ((high - low) / STEP_UM).ceil() as u32;
    (0..=steps).map(|k| low + STEP_UM * f64::from(k)).collect()
}

/// The settings of the stack: the dataset's, with a sensor of odd size around the largest image.
pub fn settings(scenario: &Scenario, camera: &Camera) -> Settings {
    let largest = depths_um(scenario.depth_range_um)
        .into_iter()
        .map(|z_um| camera.renderer().image_extent(&particle(scenario, z_um, 1.0)))
        .fold(0.0f64, |largest, (x, y)| largest.max(x).max(y));
    let odd = 2 * largest.ceil() as u32 + 1;
    // A sensor larger than the dataset's would show what no frame can.
    let side = |dataset: u32| if odd <= dataset { odd } else { dataset - (dataset + 1) % 2 };
    Settings {
        pixel_dim_x: side(scenario.settings.pixel_dim_x).max(1),
        pixel_dim_y: side(scenario.settings.pixel_dim_y).max(1),
        ..scenario.settings.clone()
    }
}

fn particle(scenario: &Scenario, z_um: f64, centre: f64) -> Particle {
    let depth_factor = scenario.spec.optics.depth_factor.unwrap_or(1.0);
    Particle::sphere(centre, centre, z_um / depth_factor, scenario.seeding.diameters().mean())
}

/// The detector with the middle of its background image, as large as the stack's sensor.
fn cropped(detector: &Detector, whole: &Settings, part: &Settings) -> Detector {
    let background = detector.background.as_ref().map(|counts| {
        let (left, top) =
            ((whole.pixel_dim_x - part.pixel_dim_x) / 2, (whole.pixel_dim_y - part.pixel_dim_y) / 2);
        let rows =
            counts.chunks(whole.pixel_dim_x as usize).skip(top as usize).take(part.pixel_dim_y as usize);
        rows.flat_map(|row| row[left as usize..(left + part.pixel_dim_x) as usize].iter().copied()).collect()
    });
    Detector { background, ..detector.clone() }
}

/// Writes the stack below the dataset's folder.
pub fn write(folder: &Path, scenario: &Scenario, camera: &Camera) -> Result<()> {
    let settings = settings(scenario, camera);
    let detector =
        scenario.detector.as_ref().map(|detector| cropped(detector, &scenario.settings, &settings));
    let renderer = scenario.spec.renderer(&settings)?;
    let camera = Camera::new(renderer, detector.as_ref(), scenario.streams)?.calibrating();
    for part in ["calibration/particles", "calibration/images"] {
        let path = folder.join(part);
        std::fs::create_dir_all(&path).map_err(Error::write(&path))?;
    }
    let path = folder.join("calibration/settings.txt");
    save(&path, |w| settings_file::write(w, &settings).map_err(Error::write(&path)))?;

    let depths = depths_um(scenario.depth_range_um);
    let place = |k: usize| {
        let mut p = particle(scenario, depths[k], 0.0);
        p.x_px = f64::from(settings.pixel_dim_x / 2 + 1);
        p.y_px = f64::from(settings.pixel_dim_y / 2 + 1);
        (p, format!("calibration/images/step_{k:04}.tif"), format!("calibration/particles/step_{k:04}.txt"))
    };
    (0..depths.len()).into_par_iter().try_for_each(|k| {
        let (particle, image, data) = place(k);
        let path = folder.join(data);
        save(&path, |w| {
            data_file::write(w, &[particle], data_file::Layout::of(&[])).map_err(Error::write(&path))
        })?;
        camera.save(&folder.join(image), &camera.image(&[particle], k as u32)).map(drop)
    })?;

    let mut table = TableFile::create(folder, &CALIBRATION)?;
    for (k, z_um) in depths.iter().enumerate() {
        let (p, image, data) = place(k);
        table.row(&[&k, z_um, &p.x_px, &p.y_px, &image, &data])?;
    }
    table.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_cover_the_range() {
        assert_eq!(depths_um((-80.0, 20.0)).len(), 51);
        assert_eq!(depths_um((-80.0, 20.0))[50], 20.0);
        assert_eq!(depths_um((0.0, 3.0)), [0.0, 2.0, 4.0]);
    }
}
