//! The speed of a pressure-driven channel flow, as the maximum, the mean or the flow rate.

use crate::error::{ParameterCheck, Result};

/// Default of the maximum, um/s: 10 px of 0.645 um in 5 ms.
const MAX_SPEED_UM_S: f64 = 1290.0;

/// um^3/s in a flow rate of 1 ul/min.
const UM3_PER_S: f64 = 1e9 / 60.0;

/// The maximum, um/s, in a channel whose mean speed is `mean_share` of it, from one of maximum (um/s), mean (um/s) and
/// flow rate (ul/min), or none of them. Errors: more than one of the three; a value that is not finite; a flow rate in
/// a channel of unknown cross-section (`area_um2`).
pub(super) fn max_speed(
    given: [Option<f64>; 3],
    check: ParameterCheck,
    mean_share: f64,
    area_um2: impl FnOnce() -> Result<f64>,
) -> Result<f64> {
    match given {
        [max_um_s, None, None] => check.finite("max_speed_um_s", max_um_s.unwrap_or(MAX_SPEED_UM_S)),
        [None, Some(mean), None] => Ok(check.finite("mean_speed_um_s", mean)? / mean_share),
        [None, None, Some(rate)] => {
            let rate = check.finite("flow_rate_ul_min", rate)?;
            check.finite("flow_rate_ul_min", rate * UM3_PER_S / area_um2()? / mean_share)
        }
        several => {
            let named = ["max_speed_um_s", "mean_speed_um_s", "flow_rate_ul_min"].into_iter().zip(several);
            let named: Vec<(&'static str, f64)> =
                named.filter_map(|(name, value)| Some((name, value?))).collect();
            let others: Vec<&str> = named[1..].iter().map(|(name, _)| *name).collect();
            let allowed =
                format!("no value besides {}: only one of them sets the speed", others.join(" and "));
            Err(check.fault(named[0].0, named[0].1, &allowed))
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::entry::FieldParameters;
    use crate::field::VelocityField;
    use crate::fields::{DuctParams, PoiseuilleParams, TubeParams};
    use glam::DVec3;

    /// Flow rate in ul/min through |y| < 100, 0 < z < 50 um, by the midpoint rule.
    fn flow_rate(field: &dyn VelocityField) -> f64 {
        let (n, mut sum) = (400, 0.0);
        for j in 0..n {
            for k in 0..n {
                let share = |i: i32| (f64::from(i) + 0.5) / f64::from(n);
                sum += field.velocity(DVec3::new(0.0, 200.0 * share(j) - 100.0, 50.0 * share(k)), 0.0).x;
            }
        }
        sum / f64::from(n * n) * 200.0 * 50.0 * 60.0 / 1e9
    }

    #[test]
    fn flow_rates_and_mean_speeds_are_those_of_the_profile() {
        let walls_z_um = Some([0.0, 50.0]);
        let tube = |speed: TubeParams| TubeParams {
            radius_um: Some(25.0),
            center_yz_um: Some([0.0, 25.0]),
            ..speed
        };
        let (rate, mean) = (Some(0.3), Some(500.0));
        let area = std::f64::consts::PI * 625.0;
        let by_rate: [Box<dyn VelocityField>; 3] = [
            DuctParams { flow_rate_ul_min: rate, walls_z_um, ..DuctParams::default() }.build().unwrap(),
            tube(TubeParams { flow_rate_ul_min: rate, ..TubeParams::default() }).build().unwrap(),
            PoiseuilleParams {
                flow_rate_ul_min: rate,
                width_um: Some(200.0),
                walls_z_um,
                ..PoiseuilleParams::default()
            }
            .build()
            .unwrap(),
        ];
        for field in by_rate {
            // The midpoint rule errs most at the rim of the tube.
            assert!((flow_rate(field.as_ref()) / 0.3 - 1.0).abs() < 1e-4, "{}", flow_rate(field.as_ref()));
        }
        let by_mean: [(Box<dyn VelocityField>, f64); 3] = [
            (DuctParams { mean_speed_um_s: mean, walls_z_um, ..DuctParams::default() }.build().unwrap(), 1e4),
            (tube(TubeParams { mean_speed_um_s: mean, ..TubeParams::default() }).build().unwrap(), area),
            (
                PoiseuilleParams { mean_speed_um_s: mean, walls_z_um, ..PoiseuilleParams::default() }
                    .build()
                    .unwrap(),
                1e4,
            ),
        ];
        for (field, area_um2) in by_mean {
            let found = flow_rate(field.as_ref()) / 60.0 * 1e9 / area_um2;
            assert!((found / 500.0 - 1.0).abs() < 1e-4, "{found}");
        }
    }

    #[test]
    fn one_speed_is_enough() {
        let two =
            DuctParams { max_speed_um_s: Some(1.0), flow_rate_ul_min: Some(2.0), ..DuctParams::default() };
        let said = two.build().err().unwrap().to_string();
        assert!(
            said.contains("max_speed_um_s = 1") && said.contains("no value besides flow_rate_ul_min"),
            "{said}"
        );
        let wide = PoiseuilleParams { flow_rate_ul_min: Some(2.0), ..PoiseuilleParams::default() };
        assert!(wide.build().err().unwrap().to_string().contains("width_um"));
        assert!(TubeParams { mean_speed_um_s: Some(f64::NAN), ..TubeParams::default() }.build().is_err());
    }
}
