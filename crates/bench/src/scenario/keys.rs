//! Every key of the scenario language, those that work and those that are planned.
//!
//! A path is the way from the scenario's outermost brackets to the key; variants of an enum are steps of it. The
//! reader takes suggestions for misspelt keys from here, and tells planned keys from unknown ones.

/// What a path leads to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// A key.
    Key,
    /// A variant of the key before it.
    Variant,
    /// Either of them, part of the language but not built yet.
    Planned,
}

use Status::{Key, Planned, Variant};

/// All keys.
pub const KEYS: &[(&str, Status)] = &[
    ("name", Key),
    ("description", Key),
    ("seed", Key),
    ("optics", Key),
    ("optics.preset", Key),
    ("optics.settings", Key),
    ("optics.depth_factor", Key),
    ("optics.gaussian", Planned),
    ("optics.magnification", Key),
    ("optics.numerical_aperture", Key),
    ("optics.focal_length", Key),
    ("optics.ri_medium", Key),
    ("optics.ri_lens", Key),
    ("optics.pixel_size", Key),
    ("optics.pixel_dim_x", Key),
    ("optics.pixel_dim_y", Key),
    ("optics.background_mean", Key),
    ("optics.background_noise", Key),
    ("optics.points_per_pixel", Key),
    ("optics.n_rays", Key),
    ("optics.gain", Key),
    ("optics.cyl_focal_length", Key),
    ("sensor", Key),
    ("sensor.photons_per_count", Key),
    ("sensor.quantum_efficiency", Key),
    ("sensor.shot_noise", Key),
    ("sensor.dark_e", Key),
    ("sensor.read_noise_e", Key),
    ("sensor.full_well_e", Key),
    ("sensor.gain_counts_per_e", Key),
    ("sensor.offset_counts", Key),
    ("sensor.bits", Key),
    ("sensor.prnu", Key),
    ("sensor.dsnu_e", Key),
    ("sensor.hot_pixels", Key),
    ("sensor.hot_pixels.fraction", Key),
    ("sensor.hot_pixels.dark_e", Key),
    ("sensor.vignetting", Key),
    ("sensor.background", Key),
    ("motion", Key),
    ("motion.flow", Variant),
    ("motion.flow.field", Key),
    ("motion.flow.field.uniform", Variant),
    ("motion.flow.field.uniform.velocity_um_s", Key),
    ("motion.flow.field.poiseuille", Variant),
    ("motion.flow.field.poiseuille.max_speed_um_s", Key),
    ("motion.flow.field.poiseuille.walls_z_um", Key),
    ("motion.flow.field.poiseuille.direction_rad", Key),
    ("motion.flow.field.lamb_oseen", Variant),
    ("motion.flow.field.lamb_oseen.max_speed_um_s", Key),
    ("motion.flow.field.lamb_oseen.core_radius_um", Key),
    ("motion.flow.field.lamb_oseen.viscosity_um2_s", Key),
    ("motion.flow.field.lamb_oseen.centre_um", Key),
    ("motion.flow.field.shear", Planned),
    ("motion.flow.field.rotation", Planned),
    ("motion.flow.field.strain", Planned),
    ("motion.flow.field.dilatation", Planned),
    ("motion.flow.field.linear", Planned),
    ("motion.flow.field.couette_poiseuille", Planned),
    ("motion.flow.field.duct", Planned),
    ("motion.flow.field.tube", Planned),
    ("motion.flow.field.womersley", Planned),
    ("motion.flow.field.electro_osmotic", Planned),
    ("motion.flow.field.hele_shaw", Planned),
    ("motion.flow.field.rankine", Planned),
    ("motion.flow.field.burgers", Planned),
    ("motion.flow.field.taylor_green", Planned),
    ("motion.flow.field.cellular", Planned),
    ("motion.flow.field.double_gyre", Planned),
    ("motion.flow.field.abc", Planned),
    ("motion.flow.field.hill", Planned),
    ("motion.flow.field.sinusoid", Planned),
    ("motion.flow.field.tanh_layer", Planned),
    ("motion.flow.field.bickley_jet", Planned),
    ("motion.flow.field.source", Planned),
    ("motion.flow.field.stokes_sphere", Planned),
    ("motion.flow.field.stokes_cylinder", Planned),
    ("motion.flow.field.toroidal_drop", Planned),
    ("motion.flow.field.coffee_ring", Planned),
    ("motion.flow.field.rayleigh_streaming", Planned),
    ("motion.flow.field.acoustophoresis", Planned),
    ("motion.flow.field.kraichnan", Planned),
    ("motion.flow.field.gridded", Planned),
    ("motion.flow.field.sum", Planned),
    ("motion.flow.field.scaled", Planned),
    ("motion.flow.field.translated", Planned),
    ("motion.flow.field.rotated", Planned),
    ("motion.flow.field.moving", Planned),
    ("motion.flow.field.modulated", Planned),
    ("motion.flow.field.mirrored", Planned),
    ("motion.flow.placement", Planned),
    ("motion.tracks", Planned),
    ("particles", Key),
    ("particles.number", Key),
    ("particles.number.count", Variant),
    ("particles.number.ppp", Variant),
    ("particles.number.n_s", Planned),
    ("particles.number.per_um3", Planned),
    ("particles.diameter_um", Key),
    ("particles.diameter_um.constant", Variant),
    ("particles.diameter_um.normal", Planned),
    ("particles.diameter_um.lognormal", Planned),
    ("particles.diameter_um.uniform", Planned),
    ("particles.diameter_um.list", Planned),
    ("particles.seeding", Planned),
    ("particles.spheroids", Planned),
    ("particles.orientation", Planned),
    ("particles.c_int", Planned),
    ("particles.brownian", Planned),
    ("particles.settling", Planned),
    ("boundaries", Key),
    ("boundaries.z_um", Key),
    ("boundaries.z", Key),
    ("boundaries.z.open", Variant),
    ("boundaries.z.wall", Variant),
    ("boundaries.z.periodic", Planned),
    ("boundaries.x", Planned),
    ("boundaries.y", Planned),
    ("boundaries.bodies", Planned),
    ("boundaries.margin_px", Key),
    ("timing", Key),
    ("timing.pairs", Variant),
    ("timing.pairs.count", Key),
    ("timing.pairs.dt_s", Key),
    ("timing.pairs.interval_s", Key),
    ("timing.pairs.seeding", Planned),
    ("timing.pairs.exposure_s", Planned),
    ("timing.sequence", Variant),
    ("timing.sequence.frames", Key),
    ("timing.sequence.dt_s", Key),
    ("timing.sequence.exposure_s", Planned),
    ("timing.four_pulse", Planned),
    ("illumination", Planned),
    ("render", Key),
    ("render.mode", Key),
    ("render.mode.rays", Variant),
    ("render.mode.expected", Planned),
    ("render.spheroids", Planned),
    ("truth_grid", Planned),
    ("calibration", Key),
    ("calibration.stack", Variant),
    ("calibration.none", Variant),
];

/// The status of a path; a key below a planned one is planned too. `None`: no such key.
pub fn status(path: &str) -> Option<Status> {
    KEYS.iter().find_map(|&(key, status)| {
        let below = status == Planned && path.strip_prefix(key).is_some_and(|rest| rest.starts_with('.'));
        (key == path || below).then_some(status)
    })
}

/// The key most like `path`, if one with the same parent is near enough.
pub fn suggestion(path: &str) -> Option<&'static str> {
    let split = |p: &'static str| p.rsplit_once('.').unwrap_or(("", p));
    let (parent, name) = path.rsplit_once('.').unwrap_or(("", path));
    KEYS.iter()
        .filter(|&&(key, status)| status == Key && split(key).0 == parent)
        .map(|&(key, _)| (strsim::jaro_winkler(split(key).1, name), split(key).1))
        .filter(|&(likeness, _)| likeness > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planned_keys_cover_what_is_below_them() {
        assert_eq!(status("optics.gain"), Some(Key));
        assert_eq!(status("illumination.sheet.thickness_um"), Some(Planned));
        assert_eq!(status("optics.gain.x"), None);
        assert_eq!(status("nonsense"), None);
    }

    #[test]
    fn misspelt_keys_get_a_suggestion_from_their_own_section() {
        assert_eq!(suggestion("optics.magnificaton"), Some("magnification"));
        assert_eq!(suggestion("timing.pairs.dt"), Some("dt_s"));
        assert_eq!(suggestion("particles.zzz"), None);
    }

    #[test]
    fn no_key_is_listed_twice() {
        let mut paths: Vec<_> = KEYS.iter().map(|k| k.0).collect();
        paths.sort_unstable();
        assert!(paths.windows(2).all(|w| w[0] != w[1]));
    }
}
