//! Every key of the scenario language.
//!
//! A path is the way from the scenario's outermost brackets to the key; variants of an enum are steps of it. The
//! reader takes suggestions for misspelt keys from here.

/// What a path leads to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// A key.
    Key,
    /// A variant of the key before it.
    Variant,
}

use std::sync::LazyLock;

use Status::{Key, Variant};
use flows::registry;

/// All keys but those of fields, which [`all`] adds.
const KEYS: &[(&str, Status)] = &[
    ("name", Key),
    ("description", Key),
    ("license", Key),
    ("seed", Key),
    ("optics", Key),
    ("optics.preset", Key),
    ("optics.preset.setting1", Variant),
    ("optics.preset.setting1a", Variant),
    ("optics.preset.setting2", Variant),
    ("optics.settings", Key),
    ("optics.depth_factor", Key),
    ("optics.gaussian", Key),
    ("optics.gaussian.diameter_px", Key),
    ("optics.gaussian.reference_um", Key),
    ("optics.gaussian.peak_counts", Key),
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
    ("motion.flow.placement", Key),
    ("motion.flow.placement.offset_um", Key),
    ("motion.flow.placement.axis", Key),
    ("motion.flow.placement.angle_rad", Key),
    ("motion.flow.placement.centre_um", Key),
    ("motion.tracks", Variant),
    ("motion.tracks.file", Key),
    ("particles", Key),
    ("particles.number", Key),
    ("particles.number.count", Variant),
    ("particles.number.ppp", Variant),
    ("particles.number.per_um3", Variant),
    ("particles.number.n_s", Variant),
    ("particles.number.file", Variant),
    ("particles.seeding", Key),
    ("particles.seeding.uniform", Variant),
    ("particles.seeding.jittered_grid", Variant),
    ("particles.seeding.apart", Variant),
    ("particles.seeding.apart_in_image", Variant),
    ("particles.diameter_um", Key),
    ("particles.diameter_um.constant", Variant),
    ("particles.diameter_um.list", Variant),
    ("particles.diameter_um.uniform", Variant),
    ("particles.diameter_um.uniform.min", Key),
    ("particles.diameter_um.uniform.max", Key),
    ("particles.diameter_um.normal", Variant),
    ("particles.diameter_um.normal.mean", Key),
    ("particles.diameter_um.normal.sd", Key),
    ("particles.diameter_um.normal.min", Key),
    ("particles.diameter_um.normal.max", Key),
    ("particles.diameter_um.lognormal", Variant),
    ("particles.diameter_um.lognormal.mean", Key),
    ("particles.diameter_um.lognormal.sd", Key),
    ("particles.diameter_um.lognormal.min", Key),
    ("particles.diameter_um.lognormal.max", Key),
    ("particles.c_int", Key),
    ("particles.c_int.constant", Variant),
    ("particles.c_int.uniform", Variant),
    ("particles.c_int.uniform.min", Key),
    ("particles.c_int.uniform.max", Key),
    ("particles.c_int.normal", Variant),
    ("particles.c_int.normal.mean", Key),
    ("particles.c_int.normal.sd", Key),
    ("particles.c_int.power_of_diameter", Variant),
    ("particles.c_int.power_of_diameter.reference_um", Key),
    ("particles.c_int.power_of_diameter.exponent", Key),
    ("particles.spheroids", Key),
    ("particles.spheroids.e_p", Key),
    ("particles.spheroids.orientation", Key),
    ("particles.spheroids.orientation.random", Variant),
    ("particles.spheroids.orientation.aligned", Variant),
    ("particles.spheroids.orientation.von_mises_fisher", Variant),
    ("particles.spheroids.orientation.von_mises_fisher.mean", Key),
    ("particles.spheroids.orientation.von_mises_fisher.kappa", Key),
    ("particles.brownian", Key),
    ("particles.brownian.temperature_k", Key),
    ("particles.brownian.viscosity_pa_s", Key),
    ("particles.brownian.substeps", Key),
    ("particles.settling", Key),
    ("particles.settling.density_difference_kg_m3", Key),
    ("particles.settling.viscosity_pa_s", Key),
    ("particles.settling.direction", Key),
    ("boundaries", Key),
    ("boundaries.z_um", Key),
    ("boundaries.x", Key),
    ("boundaries.x.open", Variant),
    ("boundaries.x.wall", Variant),
    ("boundaries.x.periodic", Variant),
    ("boundaries.y", Key),
    ("boundaries.y.open", Variant),
    ("boundaries.y.wall", Variant),
    ("boundaries.y.periodic", Variant),
    ("boundaries.z", Key),
    ("boundaries.z.open", Variant),
    ("boundaries.z.wall", Variant),
    ("boundaries.z.periodic", Variant),
    ("boundaries.margin_px", Key),
    ("boundaries.bodies", Key),
    ("boundaries.bodies.sphere", Variant),
    ("boundaries.bodies.sphere.centre_um", Key),
    ("boundaries.bodies.sphere.radius_um", Key),
    ("boundaries.bodies.cylinder", Variant),
    ("boundaries.bodies.cylinder.centre_um", Key),
    ("boundaries.bodies.cylinder.radius_um", Key),
    ("boundaries.bodies.outside_drop", Variant),
    ("boundaries.bodies.outside_drop.centre_um", Key),
    ("boundaries.bodies.outside_drop.radius_um", Key),
    ("boundaries.bodies.outside_drop.height_um", Key),
    ("boundaries.bodies.drain", Variant),
    ("boundaries.bodies.drain.centre_um", Key),
    ("boundaries.bodies.drain.radius_um", Key),
    ("boundaries.keep_ids", Key),
    ("timing", Key),
    ("timing.pairs", Variant),
    ("timing.pairs.count", Key),
    ("timing.pairs.dt_s", Key),
    ("timing.pairs.interval_s", Key),
    ("timing.pairs.seeding", Key),
    ("timing.pairs.seeding.fresh", Variant),
    ("timing.pairs.seeding.continuing", Variant),
    ("timing.pairs.exposure_s", Key),
    ("timing.pairs.flashes", Key),
    ("timing.pairs.flashes.count", Key),
    ("timing.pairs.flashes.spacing_s", Key),
    ("timing.pairs.jitter_s", Key),
    ("timing.sequence", Variant),
    ("timing.sequence.frames", Key),
    ("timing.sequence.dt_s", Key),
    ("timing.sequence.exposure_s", Key),
    ("timing.sequence.flashes", Key),
    ("timing.sequence.flashes.count", Key),
    ("timing.sequence.flashes.spacing_s", Key),
    ("timing.sequence.jitter_s", Key),
    ("timing.four_pulse", Variant),
    ("timing.four_pulse.count", Key),
    ("timing.four_pulse.dt_s", Key),
    ("timing.four_pulse.gap_s", Key),
    ("timing.four_pulse.interval_s", Key),
    ("timing.four_pulse.exposure_s", Key),
    ("timing.four_pulse.flashes", Key),
    ("timing.four_pulse.flashes.count", Key),
    ("timing.four_pulse.flashes.spacing_s", Key),
    ("timing.four_pulse.jitter_s", Key),
    ("illumination", Key),
    ("illumination.shape", Key),
    ("illumination.shape.uniform", Variant),
    ("illumination.shape.sheet", Variant),
    ("illumination.shape.sheet.profile", Key),
    ("illumination.shape.sheet.profile.gaussian", Variant),
    ("illumination.shape.sheet.profile.top_hat", Variant),
    ("illumination.shape.sheet.profile.super_gaussian", Variant),
    ("illumination.shape.sheet.thickness_um", Key),
    ("illumination.shape.sheet.centre_um", Key),
    ("illumination.shape.sheet.normal", Key),
    ("illumination.shape.beam", Variant),
    ("illumination.shape.beam.centre_um", Key),
    ("illumination.shape.beam.axis", Key),
    ("illumination.shape.beam.waist_um", Key),
    ("illumination.shape.beam.rayleigh_um", Key),
    ("illumination.ramp_per_um", Key),
    ("illumination.pulse_energies", Key),
    ("illumination.energy_jitter", Key),
    ("illumination.bleaching_s", Key),
    ("render", Key),
    ("render.mode", Key),
    ("render.mode.rays", Variant),
    ("render.mode.expected", Variant),
    ("render.tolerance", Key),
    ("render.spheroids", Key),
    ("render.spheroids.original", Variant),
    ("render.spheroids.uniform", Variant),
    ("truth", Key),
    ("truth.gradient", Key),
    ("truth_grid", Key),
    ("truth_grid.grid", Variant),
    ("truth_grid.grid.spacing_px", Key),
    ("truth_grid.grid.planes", Key),
    ("truth_grid.grid.planes.even", Variant),
    ("truth_grid.grid.planes.at_um", Variant),
    ("truth_grid.grid.weighting", Key),
    ("truth_grid.grid.weighting.peak_squared", Variant),
    ("truth_grid.grid.weighting.curvature", Variant),
    ("truth_grid.grid.weighting.none", Variant),
    ("truth_grid.grid.window_px", Key),
    ("truth_grid.grid.backward", Key),
    ("truth_grid.none", Variant),
    ("calibration", Key),
    ("calibration.stack", Variant),
    ("calibration.none", Variant),
];

/// All keys, with those of every field in `flows::registry`.
pub fn all() -> &'static [(String, Status)] {
    static ALL: LazyLock<Vec<(String, Status)>> = LazyLock::new(|| {
        let mut all: Vec<_> = KEYS.iter().map(|&(path, status)| (path.to_owned(), status)).collect();
        for entry in registry::ENTRIES {
            let field = format!("{FIELD}.{}", entry.name);
            let inner = if COMPOSITIONS.contains(&entry.name) { ".by" } else { "" };
            let own: &[&str] = match entry.name {
                "gridded" => &["file", "geometry"],
                name if COMPOSITIONS.contains(&name) => &["field", "by"],
                _ => &[],
            };
            all.push((field.clone(), Variant));
            all.extend(own.iter().map(|key| (format!("{field}.{key}"), Key)));
            let geometry = ["origin_um", "spacing_um", "times_s"];
            all.extend(entry.parameters.iter().filter(|p| !own.contains(&p.name)).map(|p| {
                let of_file = entry.name == "gridded" && geometry.contains(&p.name);
                let inner = if of_file { ".geometry" } else { inner };
                (format!("{field}{inner}.{}", p.name), Key)
            }));
        }
        all
    });
    &ALL
}

/// Where fields are.
pub(super) const FIELD: &str = "motion.flow.field";

/// Fields that change another one.
const COMPOSITIONS: [&str; 6] = ["scaled", "translated", "rotated", "moving", "modulated", "mirrored"];

/// A path without places in lists, and with the fields inside compositions taken for the field itself.
fn flat(path: &str) -> String {
    let is_index = |step: &&str| !step.is_empty() && step.bytes().all(|b| b.is_ascii_digit());
    let path = path.split('.').filter(|step| !is_index(step)).collect::<Vec<_>>().join(".");
    let Some(mut rest) = path.strip_prefix(FIELD) else { return path };
    loop {
        let mut steps = rest.splitn(4, '.').skip(1);
        let (kind, inner) = (steps.next().unwrap_or_default(), steps.next().unwrap_or_default());
        // `scaled.field` and `sum` themselves stay.
        let length = match kind {
            "sum" if !inner.is_empty() => kind.len() + 1,
            _ if COMPOSITIONS.contains(&kind) && inner == "field" && steps.next().is_some() => {
                kind.len() + inner.len() + 2
            }
            _ => return format!("{FIELD}{rest}"),
        };
        rest = &rest[length..];
    }
}

/// What a path leads to. `None`: no such key.
pub fn status(path: &str) -> Option<Status> {
    let path = flat(path);
    all().iter().find(|(key, _)| *key == path).map(|(_, status)| *status)
}

/// What may follow a path: the keys of a section, or the variants of a key.
pub(super) fn below(path: &str) -> Vec<(&'static str, Status)> {
    let path = match flat(path) {
        // What stands in the brackets of a sum or of `field` is a field.
        p if p == format!("{FIELD}.sum") => FIELD.to_owned(),
        p if p.strip_prefix(FIELD).is_some_and(|p| p.ends_with(".field")) => FIELD.to_owned(),
        p => p,
    };
    let name = |key: &'static str| match path.is_empty() {
        true => (!key.contains('.')).then_some(key),
        false => key.strip_prefix(path.as_str())?.strip_prefix('.').filter(|name| !name.contains('.')),
    };
    all().iter().filter_map(|(key, status)| Some((name(key)?, *status))).collect()
}

/// The key or variant most like a misspelt path: one with the same parent if that is near enough, else one of that very
/// name elsewhere, with its path.
pub fn suggestion(path: &str) -> Option<&'static str> {
    let path = flat(path);
    let (parent, name) = path.rsplit_once('.').unwrap_or(("", &path));
    let near = nearest(name, below(parent).into_iter().map(|(name, _)| name));
    // Parameters of fields are named alike in many of them.
    let elsewhere = || {
        let own = all().iter().map(|(key, _)| key.as_str()).filter(|key| !key.starts_with(FIELD));
        own.filter(|key| key.rsplit('.').next() == Some(name)).min_by_key(|key| key.len())
    };
    near.or_else(elsewhere)
}

/// What to say of a misspelt path: what was probably meant, else what is allowed there.
pub fn hint(path: &str) -> String {
    if let Some(near) = suggestion(path) {
        return format!("; did you mean `{near}`?");
    }
    let parent = path.rsplit_once('.').map_or("", |(parent, _)| parent);
    let names: Vec<&str> = below(parent).into_iter().map(|(name, _)| name).collect();
    if names.is_empty() { String::new() } else { format!("; expected one of {}", names.join(", ")) }
}

/// The word most like `name`, if one is near enough.
pub fn nearest<'a>(name: &str, words: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let likeness = |word: &str| strsim::jaro_winkler(word, name);
    let near = words.into_iter().map(|word| (likeness(word), word)).filter(|&(likeness, _)| likeness > 0.75);
    near.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, word)| word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_found_by_their_whole_path() {
        assert_eq!(status("optics.gain"), Some(Key));
        assert_eq!(status("optics.gain.x"), None);
        assert_eq!(status("nonsense"), None);
    }

    #[test]
    fn misspelt_keys_get_a_suggestion_from_their_own_section() {
        assert_eq!(suggestion("optics.magnificaton"), Some("magnification"));
        assert_eq!(suggestion("timing.pairs.dt"), Some("dt_s"));
        assert_eq!(suggestion("particles.number.cuont"), Some("count"));
        assert_eq!(suggestion("particles.zzz"), None);
        assert_eq!(suggestion("particles.background_noise"), Some("optics.background_noise"));
    }

    #[test]
    fn what_is_like_no_key_gets_the_keys_of_its_section() {
        let allowed = "; expected one of speed_um_s, radius_um, axis, moving, centre_um";
        assert_eq!(hint("motion.flow.field.hill.qqq"), allowed);
        assert_eq!(hint("motion.flow.field.sum.0.hill.qqq"), allowed);
        assert_eq!(hint("motion.flow.field.hill.centre"), "; did you mean `centre_um`?");
        assert!(hint("qqq").starts_with("; expected one of name, description, license, seed"));
        assert_eq!(hint("name.qqq"), "");
    }

    #[test]
    fn fields_inside_compositions_have_the_keys_of_fields() {
        for (path, expected) in [
            ("motion.flow.field.sum.0.lamb_oseen.core_radius_um", Some(Key)),
            ("motion.flow.field.scaled.field", Some(Key)),
            ("motion.flow.field.scaled.field.hill", Some(Variant)),
            ("motion.flow.field.scaled.by.velocity_factor", Some(Key)),
            ("motion.flow.field.rotated.field.sum.1.abc.nonsense", None),
            ("motion.flow.field.gridded.geometry.spacing_um", Some(Key)),
            ("motion.flow.field.sum.0", Some(Variant)),
            ("boundaries.bodies.2.drain.radius_um", Some(Key)),
        ] {
            assert_eq!(status(path), expected, "{path}");
        }
    }

    #[test]
    fn no_key_is_listed_twice() {
        let mut paths: Vec<_> = all().iter().map(|k| k.0.clone()).collect();
        paths.sort_unstable();
        assert!(paths.windows(2).all(|w| w[0] != w[1]));
    }
}
