//! Conversion between image coordinates (px) and object space (um); no other module of this crate uses px.
//!
//! x = (x_px - (width + 1) / 2) um_per_px, likewise y: the center of the sensor is the origin, the center of
//! the top-left pixel is (1, 1) px, rows go down, and the sensor covers 0.5 <= x_px < width + 0.5. The depth
//! of a MicroSIG data file is the physical depth divided by `depth_factor`. A cylindrical lens in front of
//! the camera stretches images about the center of the sensor along one direction.

use crate::{ParameterCheck, Region, Result};
use glam::{DMat2, DVec2, DVec3};

const CHECK: ParameterCheck = ParameterCheck("scale");

/// A point in the coordinates of MicroSIG's data files.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagePoint {
    /// Column, px; 1 is the center of the first column.
    pub x_px: f64,
    /// Row, px, downward; 1 is the center of the first row.
    pub y_px: f64,
    /// Depth as written in the data file, um, positive away from the lens.
    pub z_um: f64,
}

/// A difference of two image points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageVector {
    /// Along columns, px.
    pub dx_px: f64,
    /// Along rows, px, downward.
    pub dy_px: f64,
    /// Depth as written in the data file, um.
    pub dz_um: f64,
}

/// Size of a sensor and its scale in object space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    um_per_px: f64,
    width: u32,
    height: u32,
    depth_factor: f64,
    /// Image over object apart from `um_per_px`, and its inverse.
    stretch: Option<[DMat2; 2]>,
}

impl Scale {
    /// The scale of a sensor of `width` x `height` px, each pixel covering `um_per_px` (um) in object space;
    /// `depth_factor` is physical depth over depth in the data file (1 in air, about the refractive index for
    /// a dry objective imaging into a liquid). All must be > 0.
    pub fn new(um_per_px: f64, width: u32, height: u32, depth_factor: f64) -> Result<Self> {
        CHECK.positive("um_per_px", um_per_px)?;
        CHECK.positive("width_px", f64::from(width))?;
        CHECK.positive("height_px", f64::from(height))?;
        CHECK.positive("depth_factor", depth_factor)?;
        Ok(Scale { um_per_px, width, height, depth_factor, stretch: None })
    }

    /// The scale of an image that is stretched by `factor` (> 0) along the direction at this azimuth
    /// (degrees, from x toward y).
    pub fn stretched(self, factor: f64, azimuth_deg: f64) -> Self {
        let (sine, cosine) = libm::sincos(azimuth_deg.to_radians());
        let along = |factor: f64| {
            let more = factor - 1.0;
            let off = more * sine * cosine;
            DMat2::from_cols_array(&[1.0 + more * cosine * cosine, off, off, 1.0 + more * sine * sine])
        };
        Scale { stretch: Some([along(factor), along(1.0 / factor)]), ..self }
    }

    /// The rows of the matrix by which a cylindrical lens in front of the camera stretches images; `None`
    /// without one.
    pub fn stretch(&self) -> Option<[[f64; 2]; 2]> {
        self.stretch.map(|[matrix, _]| matrix.transpose().to_cols_array_2d())
    }

    fn to_px(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let px = [x / self.um_per_px, y / self.um_per_px];
        self.stretch.map_or(px, |[matrix, _]| (matrix * DVec2::from(px)).into())
    }

    /// The image vector as it would be without the stretch.
    pub fn unstretched(self, vector: [f64; 2]) -> [f64; 2] {
        self.stretch.map_or(vector, |[_, inverse]| (inverse * DVec2::from(vector)).into())
    }

    /// Physical depth over depth in MicroSIG's data files.
    pub fn depth_factor(&self) -> f64 {
        self.depth_factor
    }

    /// Pixel size in object space, um.
    pub fn um_per_px(&self) -> f64 {
        self.um_per_px
    }

    /// The point of object space (um) of an image point.
    pub fn to_object(&self, point: ImagePoint) -> DVec3 {
        let center = self.center_px();
        let [x, y] = self.unstretched([point.x_px - center.0, point.y_px - center.1]);
        DVec3::new(x * self.um_per_px, y * self.um_per_px, point.z_um * self.depth_factor)
    }

    /// The image point of a point of object space (um).
    pub fn to_image(&self, x: DVec3) -> ImagePoint {
        let center = self.center_px();
        let [x_px, y_px] = self.to_px([x.x, x.y]);
        ImagePoint { x_px: x_px + center.0, y_px: y_px + center.1, z_um: x.z / self.depth_factor }
    }

    /// The image displacement of a displacement in object space (um).
    pub fn displacement_to_image(&self, displacement: DVec3) -> ImageVector {
        let [dx_px, dy_px] = self.to_px([displacement.x, displacement.y]);
        ImageVector { dx_px, dy_px, dz_um: displacement.z / self.depth_factor }
    }

    /// The region of object space imaged between two physical depths (um), enlarged laterally by `margin_px`
    /// (px) on all sides. `Err` if it has no volume.
    pub fn view(&self, z_min: f64, z_max: f64, margin_px: f64) -> Result<Region> {
        let half = DVec3::new(f64::from(self.width), f64::from(self.height), 0.0) * 0.5 + margin_px;
        let half = self.stretch.map_or(half, |[_, inverse]| {
            let [[a, b], [c, d]] = inverse.to_cols_array_2d().map(|column| column.map(f64::abs));
            DVec3::new(a * half.x + c * half.y, b * half.x + d * half.y, half.z)
        });
        let half = half * self.um_per_px;
        Region::new(DVec3::new(-half.x, -half.y, z_min), DVec3::new(half.x, half.y, z_max))
    }

    /// Ratio of the area of [`Scale::view`] to the area that the sensor images: more than 1 if images are
    /// stretched along a direction that is not an axis.
    pub fn excess_of_view(&self) -> f64 {
        self.stretch.map_or(1.0, |[matrix, inverse]| {
            let [[a, b], [c, d]] = inverse.to_cols_array_2d().map(|column| column.map(f64::abs));
            let (w, h) = (f64::from(self.width), f64::from(self.height));
            (a * w + c * h) * (b * w + d * h) / (w * h) * matrix.determinant()
        })
    }

    fn center_px(&self) -> (f64, f64) {
        (0.5 * (f64::from(self.width) + 1.0), 0.5 * (f64::from(self.height) + 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn setting1(depth_factor: f64) -> Scale {
        Scale::new(0.645, 752, 366, depth_factor).unwrap()
    }

    #[test]
    fn the_center_of_the_sensor_is_the_origin() {
        let center = setting1(1.0).to_object(ImagePoint { x_px: 376.5, y_px: 183.5, z_um: 7.0 });
        assert_eq!(center, DVec3::new(0.0, 0.0, 7.0));
        let corner = setting1(1.0).to_object(ImagePoint { x_px: 0.5, y_px: 0.5, z_um: -80.0 });
        let view = setting1(1.0).view(-80.0, 20.0, 0.0).unwrap();
        // The field of view is 485.0 x 236.1 um, up to rounding.
        assert!((corner - view.min()).length() < 1e-12);
        assert!((view.size() - DVec3::new(485.04, 236.07, 100.0)).length() < 1e-12);
        let wide = setting1(1.0).view(-80.0, 20.0, 40.0).unwrap();
        assert!((wide.size() - view.size() - DVec3::new(51.6, 51.6, 0.0)).length() < 1e-12);
    }

    #[test]
    fn the_depth_factor_acts_on_depth_only() {
        let image = setting1(1.33).to_image(DVec3::new(6.45, -6.45, 133.0));
        assert!((image.x_px - 386.5).abs() < 1e-12 && (image.y_px - 173.5).abs() < 1e-12);
        assert!((image.z_um - 100.0).abs() < 1e-12);
        let step = setting1(1.33).displacement_to_image(DVec3::new(6.45, 0.0, -1.33));
        assert!((step.dx_px - 10.0).abs() < 1e-14 && step.dy_px == 0.0 && step.dz_um == -1.0);
    }

    #[test]
    fn a_scale_needs_positive_numbers() {
        assert!(Scale::new(0.645, 0, 366, 1.0).unwrap_err().to_string().contains("width_px = 0"));
        assert!(Scale::new(-0.645, 752, 366, 1.0).is_err());
        assert!(Scale::new(0.645, 752, 366, 0.0).is_err());
        assert!(setting1(1.0).view(-80.0, 20.0, -200.0).is_err());
    }

    #[test]
    fn a_stretched_image_is_covered_and_comes_back() {
        let flat = setting1(1.0);
        for azimuth_deg in [0.0, 30.0, 90.0] {
            let scale = flat.stretched(0.8, azimuth_deg);
            let (sine, cosine) = libm::sincos(azimuth_deg.to_radians());
            let along = DVec3::new(6.45 * cosine, 6.45 * sine, 0.0);
            let moved = scale.displacement_to_image(along);
            assert!((moved.dx_px - 8.0 * cosine).abs() < 1e-12 && (moved.dy_px - 8.0 * sine).abs() < 1e-12);
            let across = scale.displacement_to_image(DVec3::new(-along.y, along.x, 0.0));
            assert!(
                (across.dx_px + 10.0 * sine).abs() < 1e-12 && (across.dy_px - 10.0 * cosine).abs() < 1e-12
            );
            let view = scale.view(-1.0, 1.0, 0.0).unwrap();
            for (x_px, y_px) in [(0.5, 0.5), (752.5, 0.5), (752.5, 366.5), (300.0, 200.0)] {
                let at = scale.to_object(ImagePoint { x_px, y_px, z_um: 0.0 });
                let back = scale.to_image(at);
                assert!((back.x_px - x_px).abs() < 1e-10 && (back.y_px - y_px).abs() < 1e-10);
                assert!(at.x.abs() < view.max().x + 1e-9 && at.y.abs() < view.max().y + 1e-9);
            }
            let seen = 485.04 / 0.8 * 236.07;
            let size = view.size();
            assert!((size.x * size.y / seen / scale.excess_of_view() - 1.0).abs() < 1e-12);
            assert!((scale.excess_of_view() - 1.0).abs() < 1e-12 || azimuth_deg == 30.0);
            let rows = scale.stretch().unwrap();
            let own = [0, 1].map(|i| (rows[i][0] * along.x + rows[i][1] * along.y) / 0.645);
            assert!((own[0] - moved.dx_px).abs() < 1e-12 && (own[1] - moved.dy_px).abs() < 1e-12);
        }
        // Less magnification: more is seen.
        let wide = flat.stretched(0.8, 0.0).view(-1.0, 1.0, 0.0).unwrap().size();
        assert!((wide - DVec3::new(485.04 / 0.8, 236.07, 2.0)).length() < 1e-9);
    }

    proptest! {
        #[test]
        fn there_and_back(x in -500.0..500.0, y in -500.0..500.0, z in -100.0..100.0, factor in 0.5..2.0) {
            let x = DVec3::new(x, y, z);
            let back = setting1(factor).to_object(setting1(factor).to_image(x));
            // A few rounding errors of 1000 px.
            prop_assert!((back - x).length() < 1e-12);
        }
    }
}
