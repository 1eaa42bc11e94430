//! Wave optics in a fit: light, lens and aberrations. Astigmatism is an aberration of the pupil here, not a
//! cylindrical lens.

use microsig_core::render::waves::{Emission, Layers, Lens, PupilFunction, WaveOptics};

/// Fitted aberrations: Noll's index and name.
pub(super) const TERMS: [(u32, &str); 5] =
    [(11, "spherical_aberration"), (6, "astigmatism"), (5, "astigmatism_45"), (8, "coma_x"), (7, "coma_y")];

/// Largest absolute value of an aberration in a fit, waves rms.
const LARGEST_WAVES: f64 = 0.9;

/// Given properties of light and objective.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WaveModel {
    /// Wavelength in vacuum, um.
    pub wavelength_um: f64,
    /// The part of a particle that emits light.
    pub emission: Emission,
    /// The model of the objective.
    pub lens: Lens,
    /// Layers between particles and objective; their depth is fitted. `None`: the layers for which the
    /// objective was designed.
    pub layers: Option<Layers>,
}

/// Light and objective with its aberrations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Waves {
    pub(super) model: WaveModel,
    /// Coefficients of [`TERMS`], waves rms.
    pub(super) aberrations: [f64; TERMS.len()],
}

impl Waves {
    /// Light and objective without aberrations.
    pub(super) fn new(model: WaveModel) -> Waves {
        Waves { model, aberrations: [0.0; TERMS.len()] }
    }

    /// Noll's indices and coefficients, waves rms.
    pub(super) fn zernike(&self) -> Vec<(u32, f64)> {
        TERMS.iter().zip(self.aberrations).map(|((j, _), waves)| (*j, waves)).collect()
    }

    /// Options of the renderer.
    pub(super) fn optics(&self) -> WaveOptics {
        WaveOptics {
            lens: self.model.lens,
            pupil: PupilFunction { zernike: self.zernike(), ..PupilFunction::default() },
            layers: self.model.layers,
            emission: self.model.emission,
            ..WaveOptics::new(self.model.wavelength_um)
        }
    }

    /// Depth of the plane in focus below the cover slip, um; 0 without layers.
    pub(super) fn focus_depth_um(&self) -> f64 {
        self.model.layers.map_or(0.0, |layers| layers.focus_depth_um)
    }

    pub(super) fn move_focus(&mut self, by_um: f64) {
        if let Some(layers) = &mut self.model.layers {
            layers.focus_depth_um += by_um;
        }
    }

    /// Clamps aberrations and depth to values that can be rendered.
    pub(super) fn bound(&mut self) {
        self.aberrations = self.aberrations.map(|waves| waves.clamp(-LARGEST_WAVES, LARGEST_WAVES));
        if let Some(layers) = &mut self.model.layers {
            layers.focus_depth_um = layers.focus_depth_um.clamp(0.0, 1e5);
        }
    }
}
