//! Truth of a scan beside the result of its fit.

use serde_json::Value;
use suite::scan::SimulatedScan;

/// A fitted quantity with its truth.
pub(super) struct Quantity {
    pub(super) name: String,
    pub(super) truth: f64,
    pub(super) value: f64,
    pub(super) sd: f64,
    /// 95 % interval.
    pub(super) interval: [f64; 2],
    /// Largest allowed error.
    pub(super) bar: f64,
    /// Whether intervals of this quantity count in the coverage.
    pub(super) counts: bool,
}

impl Quantity {
    /// Whether the error is within the limit.
    pub(super) fn is_within(&self) -> bool {
        (self.value - self.truth).abs() <= self.bar
    }

    /// Whether the interval covers the truth.
    pub(super) fn is_covered(&self) -> bool {
        (self.interval[0]..=self.interval[1]).contains(&self.truth)
    }
}

/// Distance of the two focal planes, um, of a cylindrical lens.
fn focus_shift_um(scan: &SimulatedScan) -> f64 {
    let a = scan.settings.focal_length * (1.0 + 1.0 / scan.settings.magnification);
    -(4.0 / 9.0) * a * a / scan.settings.cyl_focal_length
}

/// All quantities of a fit, from its `fit.json`.
pub(super) fn quantities(scan: &SimulatedScan, fit: &Value) -> Vec<Quantity> {
    let settings = &scan.settings;
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    let parameter = |name: &str, truth: f64, bar: f64, counts: bool| {
        let all = fit["parameters"].as_array().into_iter().flatten();
        let own = all.clone().find(|p| p["name"] == name).cloned().unwrap_or_default();
        let of = |key: &str| number(&own[key]);
        let interval = [of("low_95"), of("high_95")];
        Quantity { name: name.to_owned(), truth, value: of("value"), sd: of("sd"), interval, bar, counts }
    };
    let (na, f, d) = (settings.numerical_aperture, settings.focal_length, scan.diameter_um);
    let mut all = vec![
        parameter("numerical_aperture", na, 5e-3 * na, true),
        parameter("focal_length", f, 1.5e-2 * f, true),
        parameter("particle_diameter_um", d, 2e-2 * d, true),
        parameter("background_mean", settings.background_mean, 0.5, true),
    ];
    if settings.cyl_focal_length != 0.0 {
        let delta = focus_shift_um(scan);
        let cylinder = settings.cyl_focal_length;
        all.push(parameter("focus_shift_um", delta, 1e-2 * delta.abs(), true));
        all.push(parameter("cyl_focal_length", cylinder, 2e-2 * cylinder.abs(), true));
        all.push(parameter("rotation_deg", scan.rotation_deg, 0.3, true));
    }
    for (name, truth) in [("pixel_size", settings.pixel_size), ("ri_lens", settings.ri_lens)] {
        let own = parameter(name, truth, 1e-2 * truth, true);
        // Otherwise they are given to the fit.
        if own.sd > 0.0 {
            all.push(own);
        }
    }
    let plain = |name: &str, truth: f64, value: f64, bar: f64| {
        let (name, interval) = (name.to_owned(), [f64::NAN; 2]);
        Quantity { name, truth, value, sd: f64::NAN, interval, bar, counts: false }
    };
    all.push(plain("direction", scan.direction, number(&fit["direction"]), 0.0));
    let chi2 = number(&fit["chi2"]);
    all.push(plain("chi2", 1.0, chi2, 0.15));
    // The images of the larger particles of case d change little with depth.
    let bar_z = if settings.magnification <= 5.0 { 0.5 } else { 0.2 };
    let places = fit["particles"].as_array().map_or(&[][..], Vec::as_slice);
    for (k, bead) in scan.beads.iter().enumerate() {
        let far = |p: &Value| (number(&p["x_px"]) - bead.x_px).hypot(number(&p["y_px"]) - bead.y_px);
        let nearest = places.iter().min_by(|a, b| far(a).total_cmp(&far(b))).filter(|p| far(p) < 3.0);
        let Some(found) = nearest else {
            all.push(plain(&format!("particle {} (not found)", k + 1), bead.x_px, f64::NAN, 0.0));
            continue;
        };
        for (i, (axis, truth, bar)) in
            [("x_px", bead.x_px, 0.02), ("y_px", bead.y_px, 0.02), ("z_um", bead.z_um, bar_z)]
                .into_iter()
                .enumerate()
        {
            let (value, sd) = (number(&found[axis]), number(&found["sd"][i]));
            let interval = [value - 1.96 * sd, value + 1.96 * sd];
            let name = format!("{axis} of particle {}", k + 1);
            all.push(Quantity { name, truth, value, sd, interval, bar, counts: axis == "z_um" });
        }
    }
    all
}

/// Quantities of the camera, from the settings that the fit wrote.
pub(super) fn camera(scan: &SimulatedScan, fit: &Value, written: &microsig_core::Settings) -> Vec<Quantity> {
    let truth = &scan.settings;
    let plain = |name: &str, truth: f64, value: f64, bar: f64| {
        let (name, interval) = (name.to_owned(), [f64::NAN; 2]);
        Quantity { name, truth, value, sd: f64::NAN, interval, bar, counts: false }
    };
    let noise = truth.background_noise;
    // Rays cannot represent a rotated cylindrical lens: the noise of such a scan is shot noise, with `gain`
    // counts per photon.
    let gain = if scan.rotation_deg == 0.0 {
        written.gain
    } else {
        fit["variance_per_count"].as_f64().unwrap_or(f64::NAN)
    };
    vec![
        plain("gain", truth.gain, gain, 0.1 * truth.gain),
        plain("background_noise", noise, written.background_noise, 0.03 * noise),
    ]
}
