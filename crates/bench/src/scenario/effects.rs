//! What single keys do to the image: the pictures of the reference. `cargo xtask figures keys` draws them.

/// A row of pictures of one scene, each with another value.
#[derive(Debug, Clone, Copy)]
pub struct Effect {
    /// The key.
    pub path: &'static str,
    /// Assignments (`path=value`, separated by `;`) of each picture, from left to right, on top of those of the scene.
    pub pictures: &'static [&'static str],
    /// The scene.
    pub scene: Scene,
    /// What is seen.
    pub caption: &'static str,
}

/// What the pictures show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scene {
    /// Three particles at z = -70, -25 and +15 um side by side.
    Ladder,
    /// A cloud of particles all over the default channel.
    Cloud,
    /// A dense cloud of small particles, seen a little below focus.
    Dense,
    /// A cloud in one plane a little below focus, in fast flow.
    Fast,
    /// The dense cloud in the second frame of a pair, 0.1 s after the first.
    Later,
}

impl Effect {
    /// Name of its picture.
    pub fn file(&self) -> String {
        format!("{}.png", self.path.replace('.', "_"))
    }
}

const fn ladder(path: &'static str, pictures: &'static [&'static str], caption: &'static str) -> Effect {
    Effect { path, pictures, scene: Scene::Ladder, caption }
}

const fn cloud(path: &'static str, pictures: &'static [&'static str], caption: &'static str) -> Effect {
    Effect { path, pictures, scene: Scene::Cloud, caption }
}

const fn lit(path: &'static str, pictures: &'static [&'static str], caption: &'static str) -> Effect {
    Effect { path, pictures, scene: Scene::Dense, caption }
}

const fn streaks(path: &'static str, pictures: &'static [&'static str], caption: &'static str) -> Effect {
    Effect { path, pictures, scene: Scene::Fast, caption }
}

const fn later(path: &'static str, pictures: &'static [&'static str], caption: &'static str) -> Effect {
    Effect { path, pictures, scene: Scene::Later, caption }
}

/// All of them, in the order of the document.
pub const EFFECTS: &[Effect] = &[
    ladder("optics.preset", &["optics.preset=setting1", "optics.preset=setting1a"], "setting1, setting1a"),
    cloud(
        "optics.gaussian",
        &[
            "optics.gain=3.2",
            "optics.gaussian=(diameter_px: 2.5, peak_counts: 1000)",
            "optics.gaussian=(diameter_px: 5, peak_counts: 1000)",
        ],
        "none; spots of 2.5 and 5 px",
    ),
    cloud(
        "optics.depth_factor",
        &["optics.depth_factor=1", "optics.depth_factor=1.33", "optics.depth_factor=2"],
        "1, 1.33, 2",
    ),
    ladder(
        "optics.magnification",
        &["optics.magnification=8", "optics.magnification=10", "optics.magnification=12"],
        "8, 10, 12",
    ),
    ladder(
        "optics.numerical_aperture",
        &["optics.numerical_aperture=0.15", "optics.numerical_aperture=0.3", "optics.numerical_aperture=0.4"],
        "0.15, 0.3, 0.4",
    ),
    ladder(
        "optics.focal_length",
        &["optics.focal_length=200", "optics.focal_length=350", "optics.focal_length=600"],
        "200, 350, 600 um",
    ),
    ladder(
        "optics.ri_medium",
        &["optics.ri_medium=1", "optics.ri_medium=1.1", "optics.ri_medium=1.2"],
        "1, 1.1, 1.2",
    ),
    ladder(
        "optics.ri_lens",
        &["optics.ri_lens=1.4", "optics.ri_lens=1.5", "optics.ri_lens=1.8"],
        "1.4, 1.5, 1.8",
    ),
    ladder(
        "optics.pixel_size",
        &["optics.pixel_size=5", "optics.pixel_size=6.45", "optics.pixel_size=9"],
        "5, 6.45, 9 um",
    ),
    ladder(
        "optics.background_mean",
        &["optics.background_mean=0", "optics.background_mean=500", "optics.background_mean=1000"],
        "0, 500, 1000 counts",
    ),
    ladder(
        "optics.background_noise",
        &["optics.background_noise=0", "optics.background_noise=10", "optics.background_noise=50"],
        "0, 10, 50 counts",
    ),
    ladder(
        "optics.points_per_pixel",
        &[
            "optics.points_per_pixel=4;optics.gain=64.8",
            "optics.points_per_pixel=9;optics.gain=12.8",
            "optics.points_per_pixel=18;optics.gain=3.2",
        ],
        "4, 9, 18, at a gain that gives the same brightness",
    ),
    ladder(
        "optics.n_rays",
        &[
            "optics.n_rays=100;optics.gain=16",
            "optics.n_rays=250;optics.gain=6.4",
            "optics.n_rays=500;optics.gain=3.2",
        ],
        "100, 250, 500, at a gain that gives the same brightness",
    ),
    ladder("optics.gain", &["optics.gain=1.6", "optics.gain=3.2", "optics.gain=6.4"], "1.6, 3.2, 6.4"),
    ladder(
        "optics.cyl_focal_length",
        &["optics.cyl_focal_length=0", "optics.cyl_focal_length=8000", "optics.cyl_focal_length=4000"],
        "0 (none), 8000, 4000 um",
    ),
    lit(
        "illumination.shape.sheet.thickness_um",
        &[
            "illumination=()",
            "illumination=(shape: sheet(thickness_um: 100))",
            "illumination=(shape: sheet(thickness_um: 40))",
        ],
        "uniform light; a sheet 100 and 40 um thick about z = -30 um, across the optical axis",
    ),
    lit(
        "illumination.shape.sheet.normal",
        &[
            "illumination=(shape: sheet(thickness_um: 40, normal: (0, 0, 1)))",
            "illumination=(shape: sheet(thickness_um: 40, normal: (0, 1, 0)))",
            "illumination=(shape: sheet(thickness_um: 40, normal: (1, 1, 0)))",
        ],
        "a sheet 40 um thick with its normal along z, along y, and oblique in the image plane",
    ),
    lit(
        "illumination.shape.beam.waist_um",
        &[
            "illumination=(shape: beam(waist_um: 200))",
            "illumination=(shape: beam(waist_um: 50))",
            "illumination=(shape: beam(waist_um: 25))",
        ],
        "200, 50, 25 um",
    ),
    lit(
        "illumination.ramp_per_um",
        &[
            "illumination=()",
            "illumination=(ramp_per_um: (0.01, 0, 0))",
            "illumination=(ramp_per_um: (0.02, 0, 0))",
        ],
        "0, 0.01, 0.02 per um along x",
    ),
    later(
        "illumination.pulse_energies",
        &[
            "illumination=(pulse_energies: [1, 1])",
            "illumination=(pulse_energies: [1, 0.5])",
            "illumination=(pulse_energies: [1, 0.2])",
        ],
        "second frame with energies of 1, 0.5, 0.2",
    ),
    later(
        "illumination.bleaching_s",
        &["illumination=()", "illumination=(bleaching_s: 0.1)", "illumination=(bleaching_s: 0.05)"],
        "second frame, 0.1 s after the first: without, 0.1 s, 0.05 s",
    ),
    ladder(
        "sensor.photons_per_count",
        &[
            "sensor.photons_per_count=0.02;sensor.shot_noise=true;sensor.gain_counts_per_e=50",
            "sensor.photons_per_count=0.2;sensor.shot_noise=true;sensor.gain_counts_per_e=5",
            "sensor.photons_per_count=2;sensor.shot_noise=true;sensor.gain_counts_per_e=0.5",
        ],
        "0.02, 0.2, 2 photons per count with shot noise, at a gain that gives the same counts",
    ),
    ladder(
        "sensor.quantum_efficiency",
        &["sensor.quantum_efficiency=0.3", "sensor.quantum_efficiency=0.6", "sensor.quantum_efficiency=1"],
        "0.3, 0.6, 1",
    ),
    ladder(
        "sensor.shot_noise",
        &[
            "sensor.photons_per_count=0.1;sensor.gain_counts_per_e=10",
            "sensor.photons_per_count=0.1;sensor.gain_counts_per_e=10;sensor.shot_noise=true",
        ],
        "false, true, at one photon per ten counts",
    ),
    ladder(
        "sensor.dark_e",
        &["sensor.dark_e=0", "sensor.dark_e=200", "sensor.dark_e=600"],
        "0, 200, 600 electrons",
    ),
    ladder(
        "sensor.read_noise_e",
        &["sensor.read_noise_e=0", "sensor.read_noise_e=20", "sensor.read_noise_e=100"],
        "0, 20, 100 electrons",
    ),
    ladder(
        "sensor.full_well_e",
        &["sensor.full_well_e=100000", "sensor.full_well_e=1500", "sensor.full_well_e=800"],
        "100000, 1500, 800 electrons",
    ),
    ladder(
        "sensor.gain_counts_per_e",
        &["sensor.gain_counts_per_e=0.3", "sensor.gain_counts_per_e=0.6", "sensor.gain_counts_per_e=1"],
        "0.3, 0.6, 1",
    ),
    ladder(
        "sensor.offset_counts",
        &["sensor.offset_counts=0", "sensor.offset_counts=200", "sensor.offset_counts=600"],
        "0, 200, 600 counts",
    ),
    ladder(
        "sensor.bits",
        &[
            "sensor.bits=16;optics.background_mean=50",
            "sensor.bits=10;optics.background_mean=50",
            "sensor.bits=8;optics.background_mean=50",
        ],
        "16, 10, 8: what is above 1023 and 255 counts is cut off (background of 50 counts)",
    ),
    ladder("sensor.prnu", &["sensor.prnu=0", "sensor.prnu=0.1", "sensor.prnu=0.3"], "0, 0.1, 0.3"),
    ladder(
        "sensor.dsnu_e",
        &["sensor.dark_e=200", "sensor.dark_e=200;sensor.dsnu_e=30", "sensor.dark_e=200;sensor.dsnu_e=100"],
        "0, 30, 100 electrons about 200",
    ),
    ladder(
        "sensor.hot_pixels",
        &[
            "sensor.offset_counts=0",
            "sensor.hot_pixels=(fraction: 0.002, dark_e: 1500)",
            "sensor.hot_pixels=(fraction: 0.02, dark_e: 1500)",
        ],
        "none; a share of 0.002, 0.02 with 1500 electrons",
    ),
    ladder(
        "sensor.vignetting",
        &[
            "sensor.vignetting=0;optics.background_mean=800",
            "sensor.vignetting=0.4;optics.background_mean=800",
            "sensor.vignetting=0.8;optics.background_mean=800",
        ],
        "0, 0.4, 0.8, over a background of 800 counts",
    ),
    ladder(
        "sensor.background",
        &["sensor.offset_counts=0", "sensor.background=\"background.tif\""],
        "none; an image that is brighter to the right, with three smudges",
    ),
    cloud(
        "particles.number",
        &["particles.number=count(10)", "particles.number=ppp(0.002)", "particles.number=ppp(0.005)"],
        "count(10), ppp(0.002), ppp(0.005)",
    ),
    cloud(
        "particles.seeding",
        &[
            "particles.number=ppp(0.001)",
            "particles.number=ppp(0.001);particles.seeding=jittered_grid(0.3)",
            "particles.number=ppp(0.001);particles.seeding=apart_in_image(6)",
        ],
        "uniform, jittered_grid(0.3), apart_in_image(6)",
    ),
    ladder(
        "particles.diameter_um",
        &[
            "particles.diameter_um=constant(1)",
            "particles.diameter_um=constant(2)",
            "particles.diameter_um=constant(4)",
        ],
        "1, 2, 4 um",
    ),
    cloud(
        "particles.diameter_um.lognormal",
        &[
            "particles.diameter_um=constant(2)",
            "particles.diameter_um=lognormal(mean: 2, sd: 0.4, min: 0.8, max: 5)",
            "particles.diameter_um=lognormal(mean: 2, sd: 1, min: 0.8, max: 5)",
        ],
        "constant(2), lognormal with a standard deviation of 0.4 and 1 um",
    ),
    ladder(
        "particles.c_int",
        &["particles.c_int=constant(0.5)", "particles.c_int=constant(1)", "particles.c_int=constant(2)"],
        "0.5, 1, 2",
    ),
    cloud(
        "particles.c_int.uniform",
        &["particles.c_int=constant(1)", "particles.c_int=uniform(min: 0.2, max: 1.8)"],
        "constant(1), uniform from 0.2 to 1.8",
    ),
    ladder(
        "particles.spheroids.e_p",
        &[
            "particles.diameter_um=constant(4);particles.spheroids=(e_p: 0.3, orientation: aligned(1, 0, 0))",
            "particles.diameter_um=constant(4);particles.spheroids=(e_p: 1, orientation: aligned(1, 0, 0))",
            "particles.diameter_um=constant(4);particles.spheroids=(e_p: 4, orientation: aligned(1, 0, 0))",
        ],
        "0.3, 1, 4, with a diameter of 4 um and axes along x",
    ),
    ladder(
        "particles.spheroids.orientation",
        &[
            "particles.diameter_um=constant(4);particles.spheroids=(e_p: 4, orientation: aligned(1, 0, 0))",
            "particles.diameter_um=constant(4);particles.spheroids=(e_p: 4, orientation: aligned(0, 0, 1))",
            "particles.diameter_um=constant(4);particles.spheroids=(e_p: 4, orientation: random)",
        ],
        "aligned(1, 0, 0), aligned(0, 0, 1), random, with a diameter of 4 um and e_p 4",
    ),
    streaks(
        "timing.pairs.exposure_s",
        &["timing.pairs.exposure_s=0", "timing.pairs.exposure_s=0.01", "timing.pairs.exposure_s=0.03"],
        "0, 0.01, 0.03 s, in a flow of up to 1000 um/s",
    ),
    streaks(
        "timing.pairs.flashes",
        &[
            "timing.pairs.exposure_s=0",
            "timing.pairs.flashes=(count: 2, spacing_s: 0.015)",
            "timing.pairs.flashes=(count: 4, spacing_s: 0.01)",
        ],
        "one; two 0.015 s apart; four 0.01 s apart",
    ),
    ladder(
        "render.mode",
        &[
            "optics.background_noise=0;optics.gain=16;optics.n_rays=100;render.mode=rays",
            "optics.background_noise=0;optics.gain=16;optics.n_rays=100;render.mode=expected",
        ],
        "rays, expected; 100 rays per point, no background noise",
    ),
    ladder(
        "render.spheroids",
        &[
            "particles.diameter_um=constant(6);particles.spheroids=(e_p: 3, orientation: aligned(1, 0, 0));render.spheroids=original",
            "particles.diameter_um=constant(6);particles.spheroids=(e_p: 3, orientation: aligned(1, 0, 0));render.spheroids=uniform",
        ],
        "original, uniform, with a diameter of 6 um and e_p 3",
    ),
    cloud(
        "boundaries.z_um",
        &["boundaries.z_um=(-30, -20)", "boundaries.z_um=(-80, 20)", "boundaries.z_um=(-80, -60)"],
        "(-30, -20), (-80, 20), (-80, -60)",
    ),
    cloud(
        "boundaries.bodies",
        &[
            "particles.number=ppp(0.003);boundaries.bodies=[]",
            "particles.number=ppp(0.003);boundaries.bodies=[cylinder(centre_um: (0, 0), radius_um: 25)]",
        ],
        "none; a cylinder of 25 um radius in the middle",
    ),
];
