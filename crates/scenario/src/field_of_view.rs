//! The ends of the field of view, where optics that vary over it differ most from those in its middle.

use microsig_core::Settings;
use microsig_core::optics::FieldOptics;

/// Corners at which images are checked, px: one if the optics are the same everywhere.
pub(super) fn corners(field: Option<&FieldOptics>, settings: &Settings) -> Vec<[f64; 2]> {
    let (right, below) = (f64::from(settings.pixel_dim_x), f64::from(settings.pixel_dim_y));
    let all = [[1.0, 1.0], [right, 1.0], [1.0, below], [right, below]];
    all[..if field.is_some() { 4 } else { 1 }].to_vec()
}

/// A warning if the middle of the field is in focus within a depth range (um, as in data files), and a corner
/// is not.
pub(super) fn lost_focus(
    field: &FieldOptics,
    settings: &Settings,
    (low, high): (f64, f64),
) -> Option<String> {
    let focus = |[x, y]: &[f64; 2]| field.at(FieldOptics::place(settings, *x, *y)).focus_um;
    let beyond = |z: f64| (low - z).max(z - high);
    let corners = corners(Some(field), settings);
    let worst = corners.iter().max_by(|a, b| beyond(focus(a)).total_cmp(&beyond(focus(b))))?;
    let (z_um, [x, y]) = (focus(worst), worst);
    (beyond(0.0) <= 0.0 && beyond(z_um) > 0.0).then(|| {
        format!(
            "optics.field.focus: z = 0 in the middle of the field is z = {z_um:.1} um in the corner ({x}, {y}), outside the depth range \
             of {low} to {high} um: images there are those of {:.1} to {:.1} um in the middle, on one side of the focus only",
            low - z_um,
            high - z_um
        )
    })
}

#[cfg(test)]
mod tests {
    use microsig_core::optics::FocusSurface;

    use super::*;

    #[test]
    fn a_focus_beyond_the_depth_range_is_told_with_place_and_depths() {
        // 1 px is 1 um.
        let size = Settings { magnification: 10.0, pixel_size: 10.0, ..Settings::setting1() };
        let settings = Settings { pixel_dim_x: 601, pixel_dim_y: 801, ..size };
        let with = |curvature_um_per_mm2: f64, tilt_um_per_mm: (f64, f64)| FieldOptics {
            focus: FocusSurface { curvature_um_per_mm2, tilt_um_per_mm, scatter_um: 0.0 },
            ..FieldOptics::default()
        };
        let warning = |field: &FieldOptics, z_um| lost_focus(field, &settings, z_um);
        let curved = warning(&with(-100.0, (0.0, 0.0)), (-20.0, 20.0)).unwrap();
        assert!(
            curved.contains("z = -25.0 um in the corner") && curved.contains("5.0 to 45.0 um"),
            "{curved}"
        );
        let tilted = warning(&with(0.0, (0.0, 60.0)), (-30.0, 20.0)).unwrap();
        assert!(tilted.contains("(601, 801)") && tilted.contains("-54.0 to -4.0 um"), "{tilted}");
        assert_eq!(warning(&with(-70.0, (0.0, 0.0)), (-20.0, 20.0)), None);
        // Out of focus everywhere.
        assert_eq!(warning(&with(-100.0, (0.0, 0.0)), (6.0, 30.0)), None);
        assert_eq!(
            (corners(None, &settings).len(), corners(Some(&with(0.0, (1.0, 0.0))), &settings).len()),
            (1, 4)
        );
    }
}
