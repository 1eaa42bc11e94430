//! The files of a fit of a field: settings and a scenario with all terms, and a table of the particles.

use microsig_core::emission::emitted_rays;
use microsig_core::{Particle, Settings};

use super::{FieldFit, WaveOptions};
use crate::output::{Twin, in_fluid, layers, render_line, round};

/// What files are made from.
pub(super) struct Files<'a> {
    pub(super) fitted: &'a FieldFit,
    pub(super) options: &'a WaveOptions,
    /// Spherical aberration, waves.
    pub(super) spherical: f64,
    /// Transmission at the rim of the pupil less that at its center.
    pub(super) transmission: f64,
    pub(super) size_px: [usize; 2],
    /// Light of a particle, counts emitted toward the lens: mean and standard deviation.
    pub(super) light: (f64, f64),
    /// Number of particles in the scan.
    pub(super) particles: usize,
}

impl Files<'_> {
    /// Counts per electron, from the noise that grows with light.
    fn counts_per_e(&self) -> f64 {
        let [_, per_count, _] = self.fitted.noise;
        if per_count > 0.0 { per_count } else { 1.0 }
    }

    /// MicroSIG's settings, in photons for a camera of quantum efficiency 1: particles are as bright as those
    /// of the scan.
    pub(super) fn settings(&self) -> Settings {
        let given = &self.options.given;
        let settings = Settings {
            magnification: given.magnification,
            numerical_aperture: round(self.fitted.numerical_aperture, 5),
            ri_medium: given.ri_medium,
            ri_lens: given.ri_lens,
            pixel_size: given.pixel_size_um,
            pixel_dim_x: self.size_px[0] as u32,
            pixel_dim_y: self.size_px[1] as u32,
            background_mean: 0.0,
            background_noise: 0.0,
            cyl_focal_length: 0.0,
            ..Settings::setting1()
        };
        let rays =
            emitted_rays(&settings, &Particle::sphere(0.0, 0.0, 0.0, self.fitted.particle_diameter_um));
        Settings { gain: significant(self.light.0 / rays / self.counts_per_e()), ..settings }
    }

    pub(super) fn scenario(&self) -> String {
        let Files { fitted, options, .. } = self;
        let FieldFit { field, blur_um, depths_um: [low, high], noise, background, .. } = fitted;
        let model = &options.waves;
        let pair =
            |(x, y): (f64, f64), digits: i32| format!("({:?}, {:?})", round(x, digits), round(y, digits));
        let (focus, chief_ray) = (&field.focus, &field.chief_ray);
        let (coma, astigmatism) = (&field.coma, &field.astigmatism);
        let optics = format!(
            ", lens: aplanatic{},\n        pupil: (zernike: [(11, {:?})], transmission: {:?}), blur_um: {:?},\n        \
             field: (\n            focus: (curvature_um_per_mm2: {:?}, tilt_um_per_mm: {}, scatter_um: {:?}),\n            \
             chief_ray: (slope: {}, per_mm: {:?}),\n            light_per_mm2: {:?},\n            \
             coma: (constant: {}, per_mm: {:?}),\n            \
             astigmatism: (constant: {}, per_mm: {:?}, per_mm2: {:?}),\n            \
             vignetting: (meridional_per_mm2: {:?}),\n        )",
            layers(model),
            round(self.spherical, 5),
            round(self.transmission, 4),
            round(*blur_um, 4),
            round(focus.curvature_um_per_mm2, 4),
            pair(focus.tilt_um_per_mm, 4),
            round(focus.scatter_um, 4),
            pair(chief_ray.slope, 6),
            round(chief_ray.per_mm, 6),
            round(field.light_per_mm2, 4),
            pair(coma.constant, 5),
            round(coma.per_mm, 5),
            pair(astigmatism.constant, 5),
            round(astigmatism.per_mm, 5),
            round(astigmatism.per_mm2, 5),
            round(field.vignetting.meridional_per_mm2, 5),
        );
        let per_e = self.counts_per_e();
        let sensor = format!(
            "    sensor: (photons_per_count: 1.0, quantum_efficiency: 1.0, shot_noise: true, read_noise_e: {:?}, gain_counts_per_e: {:?}, \
             offset_counts: {:?}),\n",
            significant(libm::sqrt(noise[0]) / per_e),
            significant(per_e),
            round(*background, 2),
        );
        let twin = Twin {
            settings: &self.settings(),
            depth_factor: options.given.depth_factor,
            diameter_um: fitted.particle_diameter_um,
            depths_um: in_fluid((*low, *high), model, fitted.particle_diameter_um),
            px_um: options.given.pixel_size_um / options.given.magnification,
            particles: self.particles,
            brightness_sd: self.light.1 / self.light.0,
            optics: (optics, render_line(model)),
            sensor,
        };
        twin.text()
    }
}

/// Four significant digits.
fn significant(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    round(value, 3 - libm::floor(libm::log10(value.abs())) as i32)
}

/// The particles as CSV: place, misfit, and each quantity as measured, with its standard deviation and by the
/// field dependence.
pub(super) fn table(fitted: &FieldFit) -> Vec<u8> {
    let mut text =
        "x_px,y_px,x_mm,y_mm,single,chi2,r2,chi2_of_field,r2_of_field,refitted_focus_um,light_counts"
            .to_owned();
    for name in &fitted.quantities {
        text += &format!(",{name},{name}_sd,{name}_field");
    }
    text.push('\n');
    for p in &fitted.particles {
        let [x, y] = p.place_mm;
        text += &format!(
            "{:.3},{:.3},{x:.5},{y:.5},{},{:.3},{:.5},{:.3},{:.5},{:.4},{:.0}",
            p.x_px,
            p.y_px,
            if p.is_single { "yes" } else { "no" },
            p.chi2,
            p.r2,
            p.chi2_of_field,
            p.r2_of_field,
            p.refitted_focus_um,
            p.light
        );
        for ((measured, sd), of_field) in p.measured.iter().zip(&p.sd).zip(&p.of_field) {
            text += &format!(",{measured:.5},{sd:.5},{of_field:.5}");
        }
        text.push('\n');
    }
    text.into_bytes()
}
