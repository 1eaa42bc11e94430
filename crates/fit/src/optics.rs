//! The microscope in a fit: given and fitted quantities, and the corresponding MicroSIG settings.

use microsig_core::Settings;

use storage::NumberRange;

/// Given properties of the microscope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Given {
    /// Magnification M.
    pub magnification: f64,
    /// Edge of a pixel on the sensor, um.
    pub pixel_size_um: f64,
    /// Refractive index of the medium in MicroSIG's model.
    pub ri_medium: f64,
    /// Refractive index of the virtual lens.
    pub ri_lens: f64,
    /// Physical depth over depth in MicroSIG's model.
    pub depth_factor: f64,
}

impl Given {
    /// A microscope with the usual ratio of refractive indices of lens and medium.
    pub fn new(magnification: f64, pixel_size_um: f64, ri_medium: f64, depth_factor: f64) -> Self {
        Given { magnification, pixel_size_um, ri_medium, ri_lens: 1.5 * ri_medium, depth_factor }
    }

    /// The allowed magnifications.
    pub const MAGNIFICATIONS: NumberRange =
        NumberRange { key: "magnification", least: 0.01, most: 1000.0, unit: "" };
    /// The allowed edges of a pixel.
    pub const PIXEL_SIZES_UM: NumberRange =
        NumberRange { key: "pixel_size_um", least: 0.05, most: 1000.0, unit: "um" };
    /// The allowed refractive indices of the medium, and ratios of depths.
    pub(super) const MEDIA: NumberRange = NumberRange { key: "medium", least: 0.1, most: 1.4, unit: "" };
    pub(super) const DEPTH_FACTORS: NumberRange =
        NumberRange { key: "depth_factor", least: 0.01, most: 10.0, unit: "" };
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Microscope {
    pub(super) magnification: f64,
    pub(super) pixel_size_um: f64,
    pub(super) ri_medium: f64,
    pub(super) ri_lens: f64,
    pub(super) depth_factor: f64,
    /// tan(asin NA).
    pub(super) slope: f64,
    /// Focal length of the virtual spherical lens, um.
    pub(super) focal_length_um: f64,
    /// Depth of the focal plane in the meridian of the cylindrical lens minus that in the other meridian, um
    /// of the model; 0: no cylindrical lens.
    pub(super) focus_shift_um: f64,
    /// Direction in which the cylindrical lens has power, rad from the x axis of the image toward y.
    pub(super) angle: f64,
    /// Particle diameter, um.
    pub(super) diameter_um: f64,
}

impl Microscope {
    pub(super) fn numerical_aperture(&self) -> f64 {
        self.slope / libm::sqrt(1.0 + self.slope * self.slope)
    }

    /// Distance from the paraxial object plane to the lens, um.
    fn object_distance(&self) -> f64 {
        self.focal_length_um * (1.0 + 1.0 / self.magnification)
    }

    /// Focal length of the virtual cylindrical lens, um; 0: none. First order in a/f_cyl.
    pub(super) fn cylinder_um(&self) -> f64 {
        let a = self.object_distance();
        if self.focus_shift_um == 0.0 { 0.0 } else { -(4.0 / 9.0) * a * a / self.focus_shift_um }
    }

    /// Rate at which the edge of an image moves with depth, px/um.
    pub(super) fn edge_px_per_um(&self) -> f64 {
        self.slope * self.magnification / self.pixel_size_um
    }

    /// Axial extent of the focus due to spherical aberration, um.
    pub(super) fn aberration_um(&self) -> f64 {
        1.1 * self.focal_length_um * self.slope * self.slope
    }

    /// MicroSIG's settings for a square sensor of `edge_px` px in the frame of the cylindrical lens;
    /// background, rays and gain as in setting 1.
    pub(super) fn settings(&self, edge_px: usize) -> Settings {
        Settings {
            magnification: self.magnification,
            numerical_aperture: self.numerical_aperture(),
            focal_length: self.focal_length_um,
            ri_medium: self.ri_medium,
            ri_lens: self.ri_lens,
            pixel_size: self.pixel_size_um,
            pixel_dim_x: edge_px as u32,
            pixel_dim_y: edge_px as u32,
            cyl_focal_length: self.cylinder_um(),
            ..Settings::setting1()
        }
    }
}

/// A quantity that experts may fit in addition. If the model is exact, a scan determines each to a few
/// percent; for real objectives they absorb errors of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ExtraParameter {
    /// Refractive index of the virtual lens
    RiLens,
    /// Edge of a pixel, at the given magnification
    PixelSize,
    /// Physical depth over depth in the model
    DepthFactor,
}

impl ExtraParameter {
    pub(super) fn shared(self) -> Shared {
        match self {
            ExtraParameter::RiLens => Shared::RiLens,
            ExtraParameter::PixelSize => Shared::PixelSize,
            ExtraParameter::DepthFactor => Shared::DepthFactor,
        }
    }
}

/// A fitted quantity that is common to all particles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shared {
    NumericalAperture,
    FocalLength,
    FocusShift,
    Angle,
    Diameter,
    RiLens,
    PixelSize,
    DepthFactor,
}

impl Shared {
    /// Name of the quantity: its key in MicroSIG's settings, if there is one.
    pub(super) fn name(self) -> &'static str {
        match self {
            Shared::NumericalAperture => "numerical_aperture",
            Shared::FocalLength => "focal_length",
            Shared::FocusShift => "focus_shift_um",
            Shared::Angle => "rotation_deg",
            Shared::Diameter => "particle_diameter_um",
            Shared::RiLens => "ri_lens",
            Shared::PixelSize => "pixel_size",
            Shared::DepthFactor => "depth_factor",
        }
    }

    /// The microscope with the quantity changed by `by`: in um for the focus shift, in rad for the
    /// angle, otherwise in the logarithm.
    pub(super) fn moved(self, from: Microscope, by: f64) -> Microscope {
        let mut to = from;
        let factor = libm::exp(by);
        match self {
            Shared::NumericalAperture => to.slope *= factor,
            Shared::FocalLength => to.focal_length_um *= factor,
            Shared::FocusShift => to.focus_shift_um += by,
            Shared::Angle => to.angle += by,
            Shared::Diameter => to.diameter_um *= factor,
            Shared::RiLens => to.ri_lens *= factor,
            Shared::PixelSize => to.pixel_size_um *= factor,
            Shared::DepthFactor => to.depth_factor *= factor,
        }
        to
    }

    /// The change from one microscope to another, in the units of [`Self::moved`].
    pub(super) fn distance(self, from: &Microscope, to: &Microscope) -> f64 {
        let ratio = |from: f64, to: f64| libm::log(to / from);
        match self {
            Shared::NumericalAperture => ratio(from.slope, to.slope),
            Shared::FocalLength => ratio(from.focal_length_um, to.focal_length_um),
            Shared::FocusShift => to.focus_shift_um - from.focus_shift_um,
            Shared::Angle => to.angle - from.angle,
            Shared::Diameter => ratio(from.diameter_um, to.diameter_um),
            Shared::RiLens => ratio(from.ri_lens, to.ri_lens),
            Shared::PixelSize => ratio(from.pixel_size_um, to.pixel_size_um),
            Shared::DepthFactor => ratio(from.depth_factor, to.depth_factor),
        }
    }

    /// Step of central differences, in the units of [`Self::moved`]; `None` if the derivative is analytical.
    pub(super) fn step(self, at: &Microscope) -> Option<f64> {
        match self {
            Shared::NumericalAperture | Shared::FocalLength => Some(0.02),
            Shared::FocusShift => Some((0.03 * at.focus_shift_um.abs()).max(0.3)),
            Shared::Diameter => Some(0.04),
            Shared::RiLens | Shared::PixelSize => Some(0.04),
            Shared::Angle | Shared::DepthFactor => None,
        }
    }

    /// Maximum change in one step of the fit, in the units of [`Self::moved`].
    pub(super) fn longest(self, at: &Microscope) -> f64 {
        match self {
            Shared::NumericalAperture => 0.15,
            Shared::FocalLength => 0.4,
            Shared::FocusShift => (0.3 * at.focus_shift_um.abs()).max(3.0),
            Shared::Angle => 0.2,
            Shared::Diameter => 0.3,
            Shared::RiLens | Shared::PixelSize | Shared::DepthFactor => 0.05,
        }
    }
}

/// Least slope of marginal rays.
pub(super) const LEAST_SLOPE: f64 = 0.02;

impl Microscope {
    /// The microscope with its values clamped to those that can be rendered.
    pub(super) fn bounded(mut self) -> Microscope {
        // NA 0.02 to 0.98.
        self.slope = self.slope.clamp(LEAST_SLOPE, 4.9);
        self.focal_length_um = self.focal_length_um.clamp(15.0, 20_000.0);
        self.diameter_um = self.diameter_um.clamp(0.05, 60.0);
        self.ri_lens = self.ri_lens.max(1.05 * self.ri_medium).min(4.0);
        self
    }
}
