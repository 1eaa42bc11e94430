//! The files of a fit of a field: a scenario with all terms, and a table of the particles.

use microsig_core::emission::emitted_rays;
use microsig_core::{Particle, Settings};

use super::{FieldFit, FieldOptions};

/// The parts of the scenario.
pub(super) struct Twin<'a> {
    pub(super) fitted: &'a FieldFit,
    pub(super) options: &'a FieldOptions,
    /// Spherical aberration, waves.
    pub(super) spherical: f64,
    /// Transmission at the rim of the pupil less that at its center.
    pub(super) transmission: f64,
    pub(super) size_px: [usize; 2],
    /// Mean light of a particle, counts emitted toward the lens.
    pub(super) light: f64,
    /// Number of particles in the scan.
    pub(super) particles: usize,
}

/// The smallest number of particles of the scenario.
const FEWEST: usize = 5;

impl Twin<'_> {
    /// The scenario: particles at rest in the depth range of the scan, as many as in it.
    pub(super) fn scenario(&self) -> String {
        let Twin { fitted, options, spherical, transmission, size_px, .. } = self;
        let FieldFit { field, numerical_aperture, blur_um, depths_um, noise, background, .. } = fitted;
        let given = &options.given;
        let waves = &options.waves;
        let settings = Settings {
            magnification: given.magnification,
            pixel_size: given.pixel_size_um,
            ..Settings::setting1()
        };
        let rays = emitted_rays(&settings, &Particle::sphere(0.0, 0.0, 0.0, options.diameter_um));
        // Counts per ray, so that particles are as bright as the scan's.
        let photons_per_count = 1.0;
        let per_e = if noise[1] > 0.0 { noise[1] } else { 1.0 };
        let read_e = libm::sqrt(noise[0].max(0.0)) / per_e;
        let gain = self.light / rays / per_e;
        let layers = waves.layers.map_or(String::new(), |l| {
            format!(", layers: (n_s: {:?}, focus_depth_um: {:?})", l.n_s, l.focus_depth_um)
        });
        let [low, high] = depths_um.map(|depth| round(depth, 2));
        format!(
            "// Images as the scanned microscope would record them; written by `microsig fit --field`.\n\
             // Choose a flow (`microsig flows`), the number of particles and the timing.\n\
             (\n    name: \"twin\",\n    description: \"Digital twin of a real microscope, center to corner\",\n    \
             optics: (\n        magnification: {:?}, numerical_aperture: {:?}, pixel_size: {:?}, pixel_dim_x: {}, pixel_dim_y: {},\n        \
             cyl_focal_length: 0, background_mean: 0, background_noise: 0, gain: {:?}, lens: aplanatic{layers},\n        \
             pupil: (zernike: [(11, {:?})], transmission: {:?}), blur_um: {:?},\n        \
             field: (\n            focus: (curvature_um_per_mm2: {:?}, tilt_um_per_mm: ({:?}, {:?})),\n            \
             chief_ray: (slope: ({:?}, {:?}), per_mm: {:?}),\n            light_per_mm2: {:?},\n            \
             coma: (constant: ({:?}, {:?}), per_mm: {:?}),\n            \
             astigmatism: (constant: ({:?}, {:?}), per_mm: {:?}, per_mm2: {:?}),\n            \
             vignetting: (meridional_per_mm2: {:?}),\n        ),\n    ),\n    \
             render: (mode: waves, wavelength_um: {:?}, emission: {}, tolerance: 0.02),\n    \
             sensor: (photons_per_count: {photons_per_count:?}, quantum_efficiency: 1, read_noise_e: {:?}, gain_counts_per_e: {:?},\n        \
             offset_counts: {:?}, full_well_e: 1000000, bits: 16),\n    \
             motion: flow(field: rest),\n    \
             particles: (number: count({}), diameter_um: constant({:?})),\n    \
             boundaries: (z_um: ({low:?}, {high:?})),\n    timing: sequence(frames: 5, dt_s: 1.0),\n)\n",
            given.magnification,
            round(*numerical_aperture, 5),
            given.pixel_size_um,
            size_px[0],
            size_px[1],
            significant(gain),
            round(*spherical, 5),
            round(*transmission, 4),
            round(*blur_um, 4),
            round(field.focus.curvature_um_per_mm2, 4),
            round(field.focus.tilt_um_per_mm.0, 4),
            round(field.focus.tilt_um_per_mm.1, 4),
            round(field.chief_ray.slope.0, 6),
            round(field.chief_ray.slope.1, 6),
            round(field.chief_ray.per_mm, 6),
            round(field.light_per_mm2, 4),
            round(field.coma.constant.0, 5),
            round(field.coma.constant.1, 5),
            round(field.coma.per_mm, 5),
            round(field.astigmatism.constant.0, 5),
            round(field.astigmatism.constant.1, 5),
            round(field.astigmatism.per_mm, 5),
            round(field.astigmatism.per_mm2, 5),
            round(field.vignetting.meridional_per_mm2, 5),
            waves.wavelength_um,
            waves.emission.name(),
            significant(read_e),
            significant(per_e),
            round(*background, 2),
            self.particles.max(FEWEST),
            options.diameter_um,
        )
    }
}

fn round(value: f64, digits: i32) -> f64 {
    let scale = libm::pow(10.0, f64::from(digits));
    libm::round(value * scale) / scale
}

/// Four significant digits.
fn significant(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    round(value, 3 - libm::floor(libm::log10(value.abs())) as i32)
}

/// The particles as CSV: place, misfit, and each quantity as measured, with its standard deviation and by the
/// laws.
pub(super) fn table(fitted: &FieldFit) -> Vec<u8> {
    let mut text = "x_px,y_px,x_mm,y_mm,single,chi2,r2,chi2_of_laws,r2_of_laws,light_counts".to_owned();
    for name in &fitted.quantities {
        text += &format!(",{name},{name}_sd,{name}_law");
    }
    text.push('\n');
    for p in &fitted.particles {
        let [x, y] = p.place_mm;
        text += &format!(
            "{:.3},{:.3},{x:.5},{y:.5},{},{:.3},{:.5},{:.3},{:.5},{:.0}",
            p.x_px,
            p.y_px,
            if p.is_single { "yes" } else { "no" },
            p.chi2,
            p.r2,
            p.chi2_of_laws,
            p.r2_of_laws,
            p.light
        );
        for ((measured, sd), law) in p.measured.iter().zip(&p.sd).zip(&p.law) {
            text += &format!(",{measured:.5},{sd:.5},{law:.5}");
        }
        text.push('\n');
    }
    text.into_bytes()
}
