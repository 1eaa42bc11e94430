//! The files of a fit: settings, parameters, a scenario, the model's images and the residuals.

use std::io::Cursor;
use std::path::Path;

use microsig_core::formats::settings_file;
use microsig_core::{KEYS, Settings};
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::{Gray16, Gray32Float};

use super::field::WaveModel;
use super::images::Problem;
use super::optics::Microscope;
use super::outcome::Fitted;
use super::state::State;
use storage::error::{Error, Result};

/// Minimum number of particles of the scenario; the largest displacement in a pair of its images (px) and the
/// time between them (s).
const FEWEST_PARTICLES: usize = 5;
const DISPLACEMENT_PX: f64 = 5.0;
const DT_S: f64 = 0.005;

/// Number of optical keys in a line of the scenario.
const IN_A_LINE: usize = 5;

/// A file of the folder.
pub(super) type NamedBytes = (&'static str, Vec<u8>);

/// MicroSIG's settings file.
pub(super) fn settings(settings: &Settings) -> Result<NamedBytes> {
    let mut bytes = Vec::new();
    settings_file::write(&mut bytes, settings).map_err(Error::write(Path::new("settings.txt")))?;
    Ok(("settings.txt", bytes))
}

/// The result of the fit as JSON.
pub(super) fn parameters(fitted: &Fitted) -> Result<NamedBytes> {
    let mut bytes = serde_json::to_vec_pretty(fitted).map_err(|e| Error::input(e.to_string()))?;
    bytes.push(b'\n');
    Ok(("fit.json", bytes))
}

/// A scenario with the fitted optics and the depth range of the scan.
pub(super) fn scenario(fitted: &Fitted, depth_factor: f64, microscope: &Microscope) -> NamedBytes {
    let depth = |stage: f64, z: f64| fitted.direction * stage + z * depth_factor;
    let depths = fitted
        .particles
        .iter()
        .flat_map(|p| fitted.planes.iter().map(move |plane| depth(plane.stage_um, p.z_um)));
    let (low, high) = depths.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), z| (l.min(z), h.max(z)));
    let twin = Twin {
        settings: &fitted.settings,
        depth_factor,
        diameter_um: microscope.diameter_um,
        depths_um: (low, high),
        px_um: microscope.pixel_size_um / microscope.magnification,
        particles: fitted.particles.len(),
        brightness_sd: 0.0,
        optics: (String::new(), String::new()),
        sensor: String::new(),
    };
    ("scenario.ron", twin.text().into_bytes())
}

/// The parts from which the scenario of a fit is made.
pub(super) struct Twin<'a> {
    pub(super) settings: &'a Settings,
    pub(super) depth_factor: f64,
    pub(super) diameter_um: f64,
    /// Physical depths of the scan, um.
    pub(super) depths_um: (f64, f64),
    /// Edge of a pixel in the object plane, um.
    pub(super) px_um: f64,
    /// Number of particles in the scan.
    pub(super) particles: usize,
    /// Standard deviation of the brightness of particles relative to its mean; 0 if all are alike.
    pub(super) brightness_sd: f64,
    /// Keys of wave optics for `optics`, and the line `render`.
    pub(super) optics: (String, String),
    /// The line `sensor`; empty for MicroSIG's own.
    pub(super) sensor: String,
}

/// The part of the depths of a scan (um) in which particles do not touch the cover slip of a model.
pub(super) fn in_fluid((low, high): (f64, f64), model: &WaveModel, diameter_um: f64) -> (f64, f64) {
    let touching_um = model.layers.map(|layers| 0.5 * diameter_um - layers.focus_depth_um);
    // Scenarios have two digits.
    let lowest_um = touching_um.map_or(low, |z_um| libm::ceil(100.0 * z_um) / 100.0);
    (low.max(lowest_um).min(high), high)
}

/// The key `layers`, if there are any.
pub(super) fn layers(model: &WaveModel) -> String {
    model.layers.map_or(String::new(), |l| {
        format!(
            ", layers: (n_s: {:?}, n_g: {:?}, t_g_um: {:?}, n_g_design: {:?}, t_g_design_um: {:?}, n_i: {:?}, n_i_design: {:?}, \
             t_i_design_um: {:?}, focus_depth_um: {:?})",
            l.n_s, l.n_g, l.t_g_um, l.n_g_design, l.t_g_design_um, l.n_i, l.n_i_design, l.t_i_design_um, l.focus_depth_um
        )
    })
}

pub(super) fn render_line(model: &WaveModel) -> String {
    let (wavelength_um, emission) = (model.wavelength_um, model.emission.name());
    format!("    render: (mode: waves, wavelength_um: {wavelength_um:?}, emission: {emission}),\n")
}

impl Twin<'_> {
    /// The scenario, complete without other files.
    pub(super) fn text(&self) -> String {
        let Twin { depth_factor, optics: (optics, render), sensor, .. } = self;
        let (low, high) = (round(self.depths_um.0, 2), round(self.depths_um.1, 2));
        let c_int = match round(self.brightness_sd, 3) {
            0.0 => String::new(),
            sd => format!(", c_int: normal(mean: 1.0, sd: {sd:?})"),
        };
        let mut settings = String::new();
        let values = KEYS.iter().zip(self.settings.values());
        // A focal length of 0, which would exclude `focal_planes_um`, is the default.
        for (k, (key, value)) in
            values.filter(|(key, value)| *value != 0.0 || !key.name.starts_with("cyl")).enumerate()
        {
            let separator = if k % IN_A_LINE == 0 { "\n        " } else { " " };
            let value = if key.is_whole { format!("{value}") } else { format!("{value:?}") };
            settings += &format!("{separator}{}: {value},", key.name);
        }
        let speed = round(DISPLACEMENT_PX * self.px_um / DT_S, 1);
        format!(
            "// Images as the scanned microscope would record them; written by `microsig fit`.\n\
             // Choose a flow (`microsig flows`), the depth range, the number of particles and the timing.\n\
             (\n    name: \"twin\",\n    description: \"Digital twin of a real microscope\",\n    \
             optics: ({settings}\n        depth_factor: {depth_factor:?}{optics},\n    ),\n    \
             motion: flow(field: poiseuille(max_speed_um_s: {speed:?})),\n    \
             particles: (number: count({}), diameter_um: constant({}){c_int}),\n    \
             boundaries: (z_um: ({low:?}, {high:?})),\n    timing: pairs(count: 10, dt_s: {DT_S:?}),\n{render}{sensor})\n",
            self.particles.max(FEWEST_PARTICLES),
            round(self.diameter_um, 4),
        )
    }
}

pub(super) fn round(value: f64, digits: i32) -> f64 {
    let scale = libm::pow(10.0, f64::from(digits));
    libm::round(value * scale) / scale
}

/// The model's images (16 bit) and the residuals in standard deviations (32-bit float), one page per plane;
/// outside the windows, images show the background and residuals are 0.
pub(super) fn images(problem: &Problem, state: &State) -> Result<[NamedBytes; 2]> {
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
    use microsig_core::render::Context;
    use microsig_core::render::waves::{Emission, Layers};

    fn twin(depth_factor: f64, diameter_um: f64, depths_um: (f64, f64), optics: (String, String)) -> String {
        let sensor = String::new();
        Twin {
            settings: &Settings::setting1(),
            depth_factor,
            diameter_um,
            depths_um,
            px_um: 0.65,
            particles: 5,
            brightness_sd: 0.2,
            optics,
            sensor,
        }
        .text()
    }

    #[test]
    fn the_twin_is_a_scenario() {
        let text = twin(1.33, 2.00004, (-60.123, 19.5), (String::new(), String::new()));
        let scenario =
            scenario::load_text(&text, ("scenario.ron", Path::new(".")), &[], None, &Context::default())
                .unwrap();
        assert_eq!(
            (scenario.spec.name.as_str(), scenario.spec.boundaries.z_um),
            ("twin", Some((-60.12, 19.5)))
        );
    }

    #[test]
    fn particles_do_not_touch_the_cover_slip() {
        let layers = Some(Layers::default());
        let model = WaveModel { wavelength_um: 0.52, emission: Emission::Volume, layers };
        // It is 100 um away.
        assert_eq!(in_fluid((-120.0, 3.0), &model, 0.2), (-99.9, 3.0));
    }
}
