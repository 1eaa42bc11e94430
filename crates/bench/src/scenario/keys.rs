//! Every key of the scenario language, those that work and those that are planned.
//!
//! A path is the way from the scenario's outermost brackets to the key; variants of an enum are steps of it. The
//! reader takes suggestions for misspelt keys from here, and tells planned keys from unknown ones.

/// Whether a key works.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// It does.
    Works,
    /// It is part of the language but not built yet.
    Planned,
}

use Status::{Planned, Works};

/// All keys.
pub const KEYS: &[(&str, Status)] = &[
    ("name", Works),
    ("description", Works),
    ("seed", Works),
    ("optics", Works),
    ("optics.preset", Works),
    ("optics.settings", Works),
    ("optics.depth_factor", Works),
    ("optics.gaussian", Planned),
    ("optics.magnification", Works),
    ("optics.numerical_aperture", Works),
    ("optics.focal_length", Works),
    ("optics.ri_medium", Works),
    ("optics.ri_lens", Works),
    ("optics.pixel_size", Works),
    ("optics.pixel_dim_x", Works),
    ("optics.pixel_dim_y", Works),
    ("optics.background_mean", Works),
    ("optics.background_noise", Works),
    ("optics.points_per_pixel", Works),
    ("optics.n_rays", Works),
    ("optics.gain", Works),
    ("optics.cyl_focal_length", Works),
    ("sensor", Planned),
    ("motion", Works),
    ("motion.flow", Works),
    ("motion.flow.field", Works),
    ("motion.flow.field.uniform", Works),
    ("motion.flow.field.uniform.velocity_um_s", Works),
    ("motion.flow.field.poiseuille", Works),
    ("motion.flow.field.poiseuille.max_speed_um_s", Works),
    ("motion.flow.field.poiseuille.walls_z_um", Works),
    ("motion.flow.field.poiseuille.direction_rad", Works),
    ("motion.flow.field.lamb_oseen", Works),
    ("motion.flow.field.lamb_oseen.max_speed_um_s", Works),
    ("motion.flow.field.lamb_oseen.core_radius_um", Works),
    ("motion.flow.field.lamb_oseen.viscosity_um2_s", Works),
    ("motion.flow.field.lamb_oseen.centre_um", Works),
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
    ("particles", Works),
    ("particles.number", Works),
    ("particles.number.count", Works),
    ("particles.number.ppp", Works),
    ("particles.number.n_s", Planned),
    ("particles.number.per_um3", Planned),
    ("particles.diameter_um", Works),
    ("particles.diameter_um.constant", Works),
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
    ("boundaries", Works),
    ("boundaries.z_um", Works),
    ("boundaries.z", Works),
    ("boundaries.z.open", Works),
    ("boundaries.z.wall", Works),
    ("boundaries.z.periodic", Planned),
    ("boundaries.x", Planned),
    ("boundaries.y", Planned),
    ("boundaries.bodies", Planned),
    ("boundaries.margin_px", Works),
    ("timing", Works),
    ("timing.pairs", Works),
    ("timing.pairs.count", Works),
    ("timing.pairs.dt_s", Works),
    ("timing.pairs.interval_s", Works),
    ("timing.pairs.seeding", Planned),
    ("timing.pairs.exposure_s", Planned),
    ("timing.sequence", Works),
    ("timing.sequence.frames", Works),
    ("timing.sequence.dt_s", Works),
    ("timing.sequence.exposure_s", Planned),
    ("timing.four_pulse", Planned),
    ("illumination", Planned),
    ("render", Works),
    ("render.mode", Works),
    ("render.mode.rays", Works),
    ("render.mode.expected", Planned),
    ("render.spheroids", Planned),
    ("truth_grid", Planned),
    ("calibration", Works),
    ("calibration.stack", Works),
    ("calibration.none", Works),
];

/// The status of a path; a key below a planned one is planned too. `None`: no such key.
pub fn status(path: &str) -> Option<Status> {
    KEYS.iter().find_map(|&(key, status)| {
        let below = status == Planned && path.strip_prefix(key).is_some_and(|rest| rest.starts_with('.'));
        (key == path || below).then_some(status)
    })
}

/// The working key most like `path`, if one with the same parent is near enough.
pub fn suggestion(path: &str) -> Option<&'static str> {
    let split = |p: &'static str| p.rsplit_once('.').unwrap_or(("", p));
    let (parent, name) = path.rsplit_once('.').unwrap_or(("", path));
    KEYS.iter()
        .filter(|&&(key, status)| status == Works && split(key).0 == parent)
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
        assert_eq!(status("optics.gain"), Some(Works));
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
