//! The files of a fit: settings, parameters, a scenario, the model's images and the residuals.

use std::io::Cursor;
use std::path::Path;

use microsig_core::formats::settings_file;
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::{Gray16, Gray32Float};

use super::images::Problem;
use super::outcome::Fitted;
use super::state::State;
use storage::error::{Error, Result};

/// A file of the folder.
pub(super) type OutputFile = (&'static str, Vec<u8>);

/// MicroSIG's settings file.
pub(super) fn settings(fitted: &Fitted) -> Result<OutputFile> {
    let mut bytes = Vec::new();
    settings_file::write(&mut bytes, &fitted.settings).map_err(Error::write(Path::new("settings.txt")))?;
    Ok(("settings.txt", bytes))
}

/// The result of the fit as JSON.
pub(super) fn parameters(fitted: &Fitted) -> Result<OutputFile> {
    let mut bytes = serde_json::to_vec_pretty(fitted).map_err(|e| Error::input(e.to_string()))?;
    bytes.push(b'\n');
    Ok(("fit.json", bytes))
}

/// A scenario with the fitted optics and the depth range of the scan.
pub(super) fn scenario(fitted: &Fitted, depth_factor: f64, diameter_um: f64) -> OutputFile {
    let depth = |stage: f64, z: f64| fitted.direction * stage + z * depth_factor;
    let depths = fitted
        .particles
        .iter()
        .flat_map(|p| fitted.planes.iter().map(move |plane| depth(plane.stage_um, p.z_um)));
    let (low, high) = depths.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), z| (l.min(z), h.max(z)));
    ("scenario.ron", twin(depth_factor, diameter_um, (low, high)).into_bytes())
}

/// Text of a scenario with the optics of `settings.txt` beside it; depths in physical um.
fn twin(depth_factor: f64, diameter_um: f64, (low, high): (f64, f64)) -> String {
    format!(
        "// Images as the scanned microscope would take them; made by `microsig fit`.\n\
         // Choose a flow (`microsig flows`), a number of particles and a timing of your own.\n\
         (\n    name: \"twin\",\n    description: \"Twin of a real microscope\",\n    optics: (settings: \"settings.txt\", depth_factor: {depth_factor}),\n    \
         motion: flow(field: poiseuille()),\n    particles: (number: n_s(0.1), diameter_um: constant({})),\n    \
         boundaries: (z_um: ({}, {})),\n    timing: pairs(count: 10),\n)\n",
        round(diameter_um, 4),
        round(low, 2),
        round(high, 2),
    )
}

fn round(value: f64, digits: i32) -> f64 {
    let scale = libm::pow(10.0, f64::from(digits));
    libm::round(value * scale) / scale
}

/// The model's images (16 bit) and the residuals in standard deviations (32-bit float): one page per plane;
/// outside the windows, background and 0.
pub(super) fn images(problem: &Problem, state: &State) -> Result<[OutputFile; 2]> {
    let (width, height) = (problem.scan.width as u32, problem.scan.height as u32);
    let failed = |e: tiff::TiffError| Error::input(format!("image of the model: {e}"));
    let (mut model, mut residual) = (Cursor::new(Vec::new()), Cursor::new(Vec::new()));
    {
        let mut model = TiffEncoder::new(&mut model).map_err(failed)?;
        let mut residual = TiffEncoder::new(&mut residual).map_err(failed)?;
        let dark = problem.background.mean.clamp(0.0, 65_535.0).round() as u16;
        problem.each_plane(state, |windows| {
            let mut counts = vec![dark; width as usize * height as usize];
            let mut left = vec![0.0f32; counts.len()];
            for (at, mean, residual) in windows {
                counts[at] = mean.clamp(0.0, 65_535.0).round() as u16;
                left[at] = residual as f32;
            }
            model.write_image::<Gray16>(width, height, &counts).map_err(failed)?;
            residual.write_image::<Gray32Float>(width, height, &left).map_err(failed)
        })?;
    }
    Ok([("model.tif", model.into_inner()), ("residual.tif", residual.into_inner())])
}

#[cfg(test)]
mod tests {
    use super::*;
    use microsig_core::Settings;

    #[test]
    fn the_twin_is_a_scenario() {
        let folder = tempfile::tempdir().unwrap();
        let mut settings = Vec::new();
        settings_file::write(&mut settings, &Settings::setting1()).unwrap();
        std::fs::write(folder.path().join("settings.txt"), settings).unwrap();
        let text = twin(1.33, 2.00004, (-60.123, 19.5));
        let scenario = scenario::load_text(&text, ("scenario.ron", folder.path()), &[], None).unwrap();
        assert_eq!(
            (scenario.spec.name.as_str(), scenario.spec.boundaries.z_um),
            ("twin", Some((-60.12, 19.5)))
        );
    }
}
