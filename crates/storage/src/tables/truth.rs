//! The tables of the truth and their columns.

use super::{Column, Table, column};

const FRAME: Column = column("frame", "integer", "", "number of the frame, from 0");
const T_S: Column = column("t_s", "number", "s", "time");
const TRACK: Column = column("track", "integer", "", "number of the particle; never reused");

/// Path of the table of the true displacement field; its columns depend on the truth grid of the scenario.
pub const FIELD_PATH: &str = "truth/field.csv";

/// `truth/frames.csv`: one row per frame.
pub static FRAMES: Table = Table::new(
    "truth/frames.csv",
    "One row per frame.",
    &[
        FRAME,
        column("pair", "integer", "", "pair of a pair recording, else empty"),
        column("role", "string", "", "a or b of a pair recording, a to d of a burst of four, else empty"),
        T_S,
        column("image", "string", "", "path of the image"),
        column("particles", "string", "", "path of the MicroSIG data file"),
        column("n_rendered", "integer", "", "particles in the data file"),
        column("n_visible", "integer", "", "particles whose centre is on the sensor"),
        column(
            "energy",
            "number",
            "",
            "factor on the light of this frame: energy of its pulse and bleaching",
        ),
    ],
);

/// `truth/tracks.csv`: one row per particle and frame.
pub static TRACKS: Table = Table::new(
    "truth/tracks.csv",
    "One row per particle and frame, also of particles that are not on the sensor.",
    &[
        FRAME,
        T_S,
        TRACK,
        column("x_px", "number", "px", "column of the centre; the first pixel's centre is 1"),
        column("y_px", "number", "px", "row of the centre, downward; the first pixel's centre is 1"),
        column("z_um", "number", "um", "physical depth of the centre, growing away from the lens"),
        column("x_um", "number", "um", "centre in object space, from the middle of the image"),
        column("y_um", "number", "um", "centre in object space, from the middle of the image, downward"),
        column("d_um", "number", "um", "diameter; of a spheroid the equatorial one"),
        column("e_p", "number", "", "aspect ratio; 1 for a sphere"),
        column("alpha_rad", "number", "rad", "orientation as in MicroSIG's data file"),
        column("beta_rad", "number", "rad", "orientation as in MicroSIG's data file"),
        column(
            "c_int",
            "number",
            "",
            "factor on the particle's brightness, that of the illumination left out",
        ),
        column(
            "u_um_s",
            "number",
            "um/s",
            "velocity of the particle along x at this place and time, or its mean over the exposure",
        ),
        column("v_um_s", "number", "um/s", "velocity along y"),
        column("w_um_s", "number", "um/s", "velocity along z"),
        column("visible", "integer", "", "1 if the centre is on the sensor"),
        column(
            "rendered",
            "integer",
            "",
            "1 if the particle is in the data file: some of its light may reach the sensor",
        ),
        column(
            "light",
            "number",
            "",
            "factor of the illumination and of this frame's pulse; the data file has c_int times this",
        ),
        column(
            "u_mid_um_s",
            "number",
            "um/s",
            "velocity along x half-way in time to the next frame of the pair, on the particle's path without random \
             motion; empty in the last frame",
        ),
        column("v_mid_um_s", "number", "um/s", "the same along y"),
        column("w_mid_um_s", "number", "um/s", "the same along z"),
        column(
            "peak_counts",
            "number",
            "counts",
            "greatest count of the particle's own noise-free image above the background, on the sensor",
        ),
        column(
            "snr",
            "number",
            "",
            "peak_counts over the standard deviation of the background there; empty without noise",
        ),
        column(
            "overlap",
            "number",
            "",
            "share of the particle's light that other particles' light matches, 0 to 1: sum over pixels of the lesser of \
             own and others' noise-free light, over the sum of its own",
        ),
        column(
            "saturated",
            "integer",
            "",
            "1 if a pixel of its noise-free image (above 10 % of its peak) is saturated, others' light included",
        ),
    ],
);

/// `truth/displacements.csv`: one row per particle that is present in both frames of a pair.
pub static DISPLACEMENTS: Table = Table::new(
    "truth/displacements.csv",
    "One row per particle that is in both frames of a pair; in a sequence pair k is frames k and k + 1.",
    &[
        column("pair", "integer", "", "number of the pair"),
        column("frame_a", "integer", "", "first frame"),
        column("frame_b", "integer", "", "second frame"),
        TRACK,
        column("x_px", "number", "px", "column of the centre in the first frame"),
        column("y_px", "number", "px", "row of the centre in the first frame"),
        column("z_um", "number", "um", "depth of the centre in the first frame"),
        column("dx_px", "number", "px", "displacement along x from the first to the second frame"),
        column("dy_px", "number", "px", "displacement along y"),
        column("dz_um", "number", "um", "displacement along z"),
        column("drift_dx_px", "number", "px", "its part without random motion, along x"),
        column("drift_dy_px", "number", "px", "its part without random motion, along y"),
        column("drift_dz_um", "number", "um", "its part without random motion, along z"),
        column("visible_a", "integer", "", "1 if the centre is on the sensor in the first frame"),
        column("visible_b", "integer", "", "1 if the centre is on the sensor in the second frame"),
    ],
);

/// Optional columns of `truth/tracks.csv`: the velocity gradient of the flow.
pub const GRADIENT: [Column; 9] = [
    column("du_dx_1_s", "number", "1/s", "velocity gradient of the flow at this place and time"),
    column("du_dy_1_s", "number", "1/s", "velocity gradient"),
    column("du_dz_1_s", "number", "1/s", "velocity gradient"),
    column("dv_dx_1_s", "number", "1/s", "velocity gradient"),
    column("dv_dy_1_s", "number", "1/s", "velocity gradient"),
    column("dv_dz_1_s", "number", "1/s", "velocity gradient"),
    column("dw_dx_1_s", "number", "1/s", "velocity gradient"),
    column("dw_dy_1_s", "number", "1/s", "velocity gradient"),
    column("dw_dz_1_s", "number", "1/s", "velocity gradient"),
];

/// `truth/boxes.csv`, optional: one row per particle image and frame.
pub static BOXES: Table = Table::new(
    "truth/boxes.csv",
    "One row per particle image that appears in a frame. Pixels belong to it where its own noise-free light exceeds the \
     given share of its peak and the standard deviation of the background.",
    &[
        FRAME,
        TRACK,
        column("x_px", "number", "px", "middle of the box; the first pixel's centre is 1"),
        column("y_px", "number", "px", "middle of the box, downward; the first pixel's centre is 1"),
        column("w_px", "integer", "px", "width of the box: of its pixels' outermost columns, both included"),
        column("h_px", "integer", "px", "height of the box"),
        column("area_px", "integer", "px^2", "number of its pixels"),
        column("z_um", "number", "um", "physical depth of the centre, growing away from the lens"),
        column("class", "integer", "", "number of its diameter in the list of diameters, from 0; else 0"),
        column(
            "hidden",
            "number",
            "",
            "share of its pixels in which the light of all others exceeds its own",
        ),
        column("visible", "integer", "", "1 if the centre is on the sensor"),
        column(
            "mask",
            "string",
            "",
            "its pixels: COCO's compressed run lengths, column by column, over the whole image",
        ),
    ],
);
