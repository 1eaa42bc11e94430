//! The rows of a dataset's tables.
//!
//! Comments of fields are the descriptions of columns in the manifest: a change of them changes the bytes of
//! datasets.

use std::path::{Path, PathBuf};

use crate::dataset::table::{Row, table};

/// Name of the optional columns of [`TrackRow`] with the velocity gradient.
pub const GRADIENT: &str = "gradient";
/// Name of the optional columns of [`TrackRow`] with what optics that vary over the field do.
pub const OPTICS: &str = "optics";
/// Name of the optional columns of [`FieldRow`] with displacements averaged over depth.
pub const WEIGHTED: &str = "weighted";
/// Name of the optional columns of [`FieldRow`] with displacements averaged over a window.
pub const WINDOW: &str = "window";
/// Name of the optional columns of [`FieldRow`] with displacements to the second frame.
pub const BACKWARD: &str = "backward";
/// Name of the optional column of [`CalibrationRow`] with the diameter.
pub const SIZES: &str = "sizes";
/// Name of the optional columns of [`CalibrationRow`] with the place in the field of view.
pub const PLACES: &str = "places";

table! {
    /// One row per frame.
    pub struct FrameRow in "truth/frames.csv" {
        /// number of the frame, from 0
        frame: u32, "";
        /// pair of a pair recording, else empty
        pair: Option<u32>, "";
        /// a or b of a pair recording, a to d of a burst of four, else empty
        role: String, "";
        /// time
        t_s: f64, "s";
        /// path of the image
        image: String, "";
        /// path of the MicroSIG data file
        particles: String, "";
        /// particles in the data file
        n_rendered: u64, "";
        /// particles whose centre is on the sensor
        n_visible: u64, "";
        /// factor on the light of this frame: energy of its pulse and bleaching
        energy: f64, "";
    }
}

impl FrameRow {
    /// Path of the table in a released test split, which has no `truth/`.
    pub const RELEASED_PATH: &str = "frames.csv";

    /// The table in a dataset or a released test split; `None` without one.
    pub fn path_in(folder: &Path) -> Option<PathBuf> {
        [Self::PATH, Self::RELEASED_PATH].map(|path| folder.join(path)).into_iter().find(|path| path.exists())
    }
}

table! {
    /// One row per particle and frame, also of particles that are not on the sensor.
    pub struct TrackRow in "truth/tracks.csv" {
        /// number of the frame, from 0
        frame: u32, "";
        /// time
        t_s: f64, "s";
        /// number of the particle; never reused
        track: u64, "";
        /// column of the centre; the first pixel's centre is 1
        x_px: f64, "px";
        /// row of the centre, downward; the first pixel's centre is 1
        y_px: f64, "px";
        /// physical depth of the centre, growing away from the lens
        z_um: f64, "um";
        /// centre in object space, from the middle of the image
        x_um: f64, "um";
        /// centre in object space, from the middle of the image, downward
        y_um: f64, "um";
        /// diameter; of a spheroid the equatorial one
        d_um: f64, "um";
        /// aspect ratio; 1 for a sphere
        e_p: f64, "";
        /// orientation as in MicroSIG's data file
        alpha_rad: f64, "rad";
        /// orientation as in MicroSIG's data file
        beta_rad: f64, "rad";
        /// factor on the particle's brightness, that of the illumination left out
        c_int: f64, "";
        /// velocity of the particle along x at this place and time, or its mean over the exposure
        u_um_s: f64, "um/s";
        /// velocity along y
        v_um_s: f64, "um/s";
        /// velocity along z
        w_um_s: f64, "um/s";
        /// 1 if the centre is on the sensor
        visible: bool, "";
        /// 1 if the particle is in the data file: some of its light may reach the sensor
        rendered: bool, "";
        /// factor of the illumination and of this frame's pulse; the data file has c_int times this
        light: f64, "";
        /// velocity along x half-way in time to the next frame of the pair, on the particle's path without
        /// random motion; empty in the last frame
        u_mid_um_s: f64, "um/s";
        /// the same along y
        v_mid_um_s: f64, "um/s";
        /// the same along z
        w_mid_um_s: f64, "um/s";
        /// greatest count of the particle's own noise-free image above the background, on the sensor
        peak_counts: f64, "counts";
        /// peak_counts over the standard deviation of the background there; empty without noise
        snr: f64, "";
        /// share of the particle's light that other particles' light matches, 0 to 1: sum over pixels of the
        /// lesser of own and others' noise-free light, over the sum of its own
        overlap: f64, "";
        /// 1 if a pixel of its noise-free image (above 10 % of its peak) is saturated, others' light included
        saturated: bool, "";
        /// what the optics at this place of the field add to x_px: chief ray and distortion
        optics_dx_px: f64, "px", OPTICS;
        /// the same for y_px
        optics_dy_px: f64, "px", OPTICS;
        /// the same for z_um: the image is that of a particle in the middle of the field at z_um + optics_dz_um
        optics_dz_um: f64, "um", OPTICS;
        /// velocity gradient of the flow at this place and time
        du_dx_1_s: f64, "1/s", GRADIENT;
        /// velocity gradient
        du_dy_1_s: f64, "1/s", GRADIENT;
        /// velocity gradient
        du_dz_1_s: f64, "1/s", GRADIENT;
        /// velocity gradient
        dv_dx_1_s: f64, "1/s", GRADIENT;
        /// velocity gradient
        dv_dy_1_s: f64, "1/s", GRADIENT;
        /// velocity gradient
        dv_dz_1_s: f64, "1/s", GRADIENT;
        /// velocity gradient
        dw_dx_1_s: f64, "1/s", GRADIENT;
        /// velocity gradient
        dw_dy_1_s: f64, "1/s", GRADIENT;
        /// velocity gradient
        dw_dz_1_s: f64, "1/s", GRADIENT;
    }
}

table! {
    /// One row per particle that is in both frames of a pair; in a sequence pair k is frames k and k + 1.
    pub struct DisplacementRow in "truth/displacements.csv" {
        /// number of the pair
        pair: u32, "";
        /// first frame
        frame_a: u32, "";
        /// second frame
        frame_b: u32, "";
        /// number of the particle; never reused
        track: u64, "";
        /// column of the centre in the first frame
        x_px: f64, "px";
        /// row of the centre in the first frame
        y_px: f64, "px";
        /// depth of the centre in the first frame
        z_um: f64, "um";
        /// displacement along x from the first to the second frame
        dx_px: f64, "px";
        /// displacement along y
        dy_px: f64, "px";
        /// displacement along z
        dz_um: f64, "um";
        /// its part without random motion, along x
        drift_dx_px: f64, "px";
        /// its part without random motion, along y
        drift_dy_px: f64, "px";
        /// its part without random motion, along z
        drift_dz_um: f64, "um";
        /// 1 if the centre is on the sensor in the first frame
        visible_a: bool, "";
        /// 1 if the centre is on the sensor in the second frame
        visible_b: bool, "";
    }
}

table! {
    /// One row per particle image that appears in a frame. Pixels belong to it where its own noise-free light
    /// exceeds the given share of its peak and the standard deviation of the background.
    pub struct BoxRow in "truth/boxes.csv" {
        /// number of the frame, from 0
        frame: u32, "";
        /// number of the particle; never reused
        track: u64, "";
        /// middle of the box; the first pixel's centre is 1
        x_px: f64, "px";
        /// middle of the box, downward; the first pixel's centre is 1
        y_px: f64, "px";
        /// width of the box: of its pixels' outermost columns, both included
        w_px: u32, "px";
        /// height of the box
        h_px: u32, "px";
        /// number of its pixels
        area_px: u32, "px^2";
        /// physical depth of the centre, growing away from the lens
        z_um: f64, "um";
        /// number of its diameter in the list of diameters, from 0; else 0
        class: u32, "";
        /// share of its pixels in which the light of all others exceeds its own
        hidden: f64, "";
        /// 1 if the centre is on the sensor
        visible: bool, "";
        /// its pixels: COCO's compressed run lengths, column by column, over the whole image
        mask: String, "";
    }
}

impl BoxRow {
    /// Left, top, width and height, px; the corner of the first pixel is at (0, 0).
    pub fn rectangle(&self) -> [f64; 4] {
        let (w, h) = (f64::from(self.w_px), f64::from(self.h_px));
        [self.x_px - 0.5 - 0.5 * w, self.y_px - 0.5 - 0.5 * h, w, h]
    }
}

table! {
    /// One row per depth, 51 of them through the depth range: the noise-free image of a sphere of the mean
    /// diameter and the middle brightness, centred on a pixel in the middle of the image, in the light there.
    pub struct DepthRow in "truth/depth.csv" {
        /// physical depth, growing away from the lens
        z_um: f64, "um";
        /// greatest count of the image above the background
        peak_counts: f64, "counts";
        /// peak_counts over the standard deviation of the background; empty without noise
        snr: f64, "";
        /// pixels above 10 % of the peak
        area_px: f64, "px";
        /// share of this depth in the depth-weighted displacement; empty if there is none
        weight: f64, "";
    }
}

table! {
    /// The displacement of the fluid from the first to the second frame of a pair, at the nodes of a grid. A
    /// steady flow is written once, with pair empty.
    pub struct FieldRow in "truth/field.csv" {
        /// number of the pair, as in displacements.csv; empty if the flow is the same for all
        pair: Option<u32>, "";
        /// number of the plane, from 0, in the order of depth
        plane: u32, "";
        /// column of the node
        x_px: f64, "px";
        /// row of the node
        y_px: f64, "px";
        /// depth of the node
        z_um: f64, "um";
        /// displacement along x of what is at the node in the first frame
        forward_dx_px: f64, "px";
        /// the same along y
        forward_dy_px: f64, "px";
        /// the same along z
        forward_dz_um: f64, "um";
        /// displacement along x of what is at the node half-way in time
        central_dx_px: f64, "px";
        /// the same along y
        central_dy_px: f64, "px";
        /// the same along z
        central_dz_um: f64, "um";
        /// central displacement along x, averaged over depth with the weight of the manifest
        weighted_dx_px: f64, "px", WEIGHTED;
        /// the same along y
        weighted_dy_px: f64, "px", WEIGHTED;
        /// the same along z
        weighted_dz_um: f64, "um", WEIGHTED;
        /// 1 if there is no fluid at the node (walls, bodies): no displacement then
        mask: bool, "";
        /// central displacement along x, averaged over a square window about the node
        window_dx_px: f64, "px", WINDOW;
        /// the same along y
        window_dy_px: f64, "px", WINDOW;
        /// the same along z
        window_dz_um: f64, "um", WINDOW;
        /// displacement along x of what is at the node in the second frame
        backward_dx_px: f64, "px", BACKWARD;
        /// the same along y
        backward_dy_px: f64, "px", BACKWARD;
        /// the same along z
        backward_dz_um: f64, "um", BACKWARD;
    }
}

table! {
    /// One row per image of the calibration stack: a single particle, scanned through the depth range.
    pub struct CalibrationRow in "calibration/calibration.csv" {
        /// number of the step, from 0
        step: u32, "";
        /// physical depth of the particle, growing away from the lens
        z_um: f64, "um";
        /// column of its centre
        x_px: f64, "px";
        /// row of its centre
        y_px: f64, "px";
        /// path of the image
        image: String, "";
        /// path of the MicroSIG data file
        particles: String, "";
        /// diameter of the particle; steps are numbered within each size
        d_um: f64, "um", SIZES;
        /// number of the place of the stack in the field of view, from 0, row by row; steps are numbered within each place
        place: u32, "", PLACES;
        /// column of that place in the frames
        place_x_px: f64, "px", PLACES;
        /// row of that place in the frames
        place_y_px: f64, "px", PLACES;
    }
}

table! {
    /// One row per particle, or cluster of touching particles, of the scan of a recording.
    pub struct ScanParticleRow in "calibration/scan.csv" {
        /// column of its centre
        x_px: f64, "px";
        /// row of its centre
        y_px: f64, "px";
        /// light of its sharpest image, relative to the median of all
        light: f64, "";
    }
}

table! {
    /// One row per frame of a recording in which all particles are in a plane of known height.
    pub struct PlaneRow in "truth/planes.csv" {
        /// number of the frame, from 0
        frame: u32, "";
        /// height of the plane, growing away from the lens, in the coordinate of the calibration stack
        z_um: f64, "um";
    }
}
