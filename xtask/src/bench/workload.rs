//! The timed workloads: runs of the `microsig` command as a user would type them.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Settings, formats::settings_file};

/// A run of the command.
#[derive(Debug, Clone)]
pub(super) struct Workload {
    /// Group of workloads that are compared with each other.
    pub(super) group: &'static str,
    pub(super) name: String,
    /// Size in the unit of its group, for measuring growth.
    pub(super) size: f64,
    /// Arguments without the output folder.
    pub(super) arguments: Vec<String>,
    pub(super) threads: usize,
    pub(super) repeats: usize,
}

/// The groups for which growth is measured, and the units of their sizes.
pub(super) const GROWTH: [(&str, &str); 5] = [
    ("particles, rays", "particles"),
    ("particles, gaussian", "particles"),
    ("image size, gaussian", "pixels"),
    ("n_rays", "rays per point"),
    ("frames, gaussian", "frames"),
];

/// Ray-traced images over the depths of Rossi (2020).
#[derive(Debug, Clone)]
struct Rays {
    settings: Settings,
    images: u32,
    particles: u32,
    z_um: (f64, f64),
    d_um: (f64, f64),
}

impl Rays {
    fn new(settings: Settings, images: u32, particles: u32) -> Self {
        Rays { settings, images, particles, z_um: (-80.0, 40.0), d_um: (2.0, 2.0) }
    }

    /// Writes settings and data files, and returns the workload that renders them.
    fn workload(
        &self,
        scratch: &Path,
        group: &'static str,
        name: &str,
        size: f64,
    ) -> anyhow::Result<Workload> {
        let folder = scratch.join("inputs").join(format!("{group} {name}").replace(' ', "_"));
        std::fs::create_dir_all(folder.join("particles"))?;
        let mut text = Vec::new();
        settings_file::write(&mut text, &self.settings)?;
        std::fs::write(folder.join("settings.txt"), text)?;
        for image in 0..self.images {
            let mut stream = Streams::new(1).stream(Purpose::Seeding, image, 0);
            let mut rows = String::new();
            for _ in 0..self.particles {
                let mut within = |(low, high): (f64, f64)| low + (high - low) * stream.uniform();
                let x = within((0.5, f64::from(self.settings.pixel_dim_x) + 0.5));
                let y = within((0.5, f64::from(self.settings.pixel_dim_y) + 0.5));
                writeln!(rows, "{x:.3} {y:.3} {:.3} {:.4}", within(self.z_um), within(self.d_um))?;
            }
            std::fs::write(folder.join(format!("particles/B{image:05}.txt")), rows)?;
        }
        let path = |p: PathBuf| p.to_string_lossy().into_owned();
        let arguments =
            vec!["render".to_owned(), path(folder.join("settings.txt")), path(folder.join("particles"))];
        Ok(Workload { group, name: name.to_owned(), size, arguments, threads: 1, repeats: usize::MAX })
    }
}

/// Setting 1 with a square sensor of this side, px.
fn square(side: u32) -> Settings {
    Settings { pixel_dim_x: side, pixel_dim_y: side, ..Settings::setting1() }
}

/// Generates a complete dataset of in-focus Gaussian images.
fn gaussian(
    scratch: &Path,
    (group, name): (&'static str, &str),
    size: f64,
    (side, ppp): (u32, f64),
    timing: &str,
) -> anyhow::Result<Workload> {
    let text = format!(
        "(name: \"spots\", seed: 1, optics: (gaussian: (diameter_px: 2.75), pixel_dim_x: {side}, pixel_dim_y: {side}),\n\
         motion: flow(field: uniform(velocity_um_s: (300, 100, 0))), particles: (number: ppp({ppp}), diameter_um: constant(1)),\n\
         boundaries: (z_um: (-5, 5), z: open), timing: {timing})\n"
    );
    let file = scratch.join("inputs").join(format!("{group} {name}.ron").replace(' ', "_"));
    std::fs::create_dir_all(scratch.join("inputs"))?;
    std::fs::write(&file, text)?;
    let arguments = vec!["generate".to_owned(), file.to_string_lossy().into_owned()];
    Ok(Workload { group, name: name.to_owned(), size, arguments, threads: 1, repeats: usize::MAX })
}

/// All workloads; their inputs are written below `scratch`.
pub(super) fn all(scratch: &Path) -> anyhow::Result<Vec<Workload>> {
    let mut all = throughput(scratch)?;
    for threads in [1, 2] {
        let (rays, name) = (Rays::new(Settings::setting1(), 20, 200), format!("rays, {threads} threads"));
        all.push(Workload { threads, ..rays.workload(scratch, "threads, rays", &name, threads as f64)? });
    }
    for threads in [1, 2] {
        let (group, name) = ("threads, gaussian", format!("gaussian, {threads} threads"));
        let pairs = gaussian(scratch, (group, &name), threads as f64, (512, 0.03), "pairs(count: 20)")?;
        all.push(Workload { threads, ..pairs });
    }
    all.extend(growth(scratch)?);
    all.extend(large(scratch)?);
    Ok(all)
}

/// Throughput for the settings of Table 1, for in-focus images, and without particles.
fn throughput(scratch: &Path) -> anyhow::Result<Vec<Workload>> {
    const GROUP: &str = THROUGHPUT;
    let setting1 = Rays::new(Settings::setting1(), 20, 100);
    let setting2 = Rays { z_um: (-40.0, 5.0), d_um: (1.0, 1.0), ..Rays::new(Settings::setting2(), 40, 10) };
    let several = Rays { d_um: (1.8, 2.2), ..setting1.clone() };
    let cylinder = Rays { settings: Settings::setting1a(), ..setting1.clone() };
    let empty = Rays { images: 100, particles: 0, ..setting1.clone() };
    let mut all = Vec::new();
    for (name, rays) in [
        ("setting 1, one size", setting1.clone()),
        ("setting 1, several sizes", several),
        ("setting 1a, one size", cylinder),
        ("setting 2", setting2),
        ("no particles", empty),
    ] {
        all.push(rays.workload(scratch, GROUP, name, f64::from(rays.images))?);
    }
    // The mode `expected`; versions without it are reported as such.
    for (name, images) in [(EXPECTED, FEW), (EXPECTED_MANY, MANY)] {
        let rays = Rays::new(Settings::setting1(), images, 500);
        let mut expected = rays.workload(scratch, GROUP, name, f64::from(images))?;
        expected.arguments.extend(["--mode", "expected"].map(str::to_owned));
        all.push(expected);
    }
    all.push(gaussian(
        scratch,
        (GROUP, "gaussian, 512 x 512, 0.03 ppp"),
        40.0,
        (512, 0.03),
        "pairs(count: 20)",
    )?);
    let quickstart = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/quickstart.ron");
    all.push(Workload {
        group: GROUP,
        name: "quickstart.ron".to_owned(),
        size: 20.0,
        arguments: vec!["generate".to_owned(), quickstart.to_string_lossy().into_owned()],
        threads: 1,
        repeats: usize::MAX,
    });
    Ok(all)
}

/// The group that is compared with floors and yardstick.
pub(super) const THROUGHPUT: &str = "throughput";

/// Workloads that need tables; with few images most of the time is spent on building tables.
pub(super) const EXPECTED: &str = "setting 1, 500 particles, expected";
pub(super) const EXPECTED_MANY: &str = "setting 1, 500 particles, expected, many images";

/// Numbers of images of these workloads.
const FEW: u32 = 20;
const MANY: u32 = 220;

/// Workloads with increasing sizes.
fn growth(scratch: &Path) -> anyhow::Result<Vec<Workload>> {
    let mut all = Vec::new();
    for particles in [50, 100, 200, 400] {
        let rays = Rays::new(Settings::setting1(), 20, particles);
        let name = format!("20 images of {particles}");
        all.push(rays.workload(scratch, GROWTH[0].0, &name, f64::from(20 * particles))?);
    }
    for ppp in [0.02, 0.04, 0.08, 0.16] {
        let (name, size) = (format!("20 images of 512 x 512 px, {ppp} ppp"), ppp * 20.0 * 512.0 * 512.0);
        all.push(gaussian(scratch, (GROWTH[1].0, &name), size, (512, ppp), "pairs(count: 10)")?);
    }
    for side in [256, 512, 1024, 2048] {
        let (name, size) =
            (format!("8 images of {side} x {side} px"), 8.0 * f64::from(side) * f64::from(side));
        all.push(gaussian(scratch, (GROWTH[2].0, &name), size, (side, 0.03), "pairs(count: 4)")?);
    }
    for n_rays in [250, 500, 1000, 2000] {
        let settings = Settings { n_rays, ..Settings::setting1() };
        let rays = Rays::new(settings, 10, 100);
        all.push(rays.workload(
            scratch,
            GROWTH[3].0,
            &format!("{n_rays} rays per point"),
            f64::from(n_rays),
        )?);
    }
    for frames in [250, 500, 1000, 2000] {
        let timing = format!("sequence(frames: {frames})");
        let name = format!("{frames} frames of 128 x 128 px");
        all.push(gaussian(scratch, (GROWTH[4].0, &name), f64::from(frames), (128, 0.02), &timing)?);
    }
    Ok(all)
}

/// Two sequences that should need the same memory.
pub(super) const LONG: [&str; 2] =
    ["gaussian, 100 frames of 128 x 128 px", "gaussian, 10000 frames of 128 x 128 px"];

fn sequence(scratch: &Path, name: &'static str, frames: u32) -> anyhow::Result<Workload> {
    let timing = format!("sequence(frames: {frames})");
    gaussian(scratch, (LARGE, name), f64::from(frames), (128, 0.02), &timing)
}

const LARGE: &str = "large";

/// Large runs with bounded memory; once each.
fn large(scratch: &Path) -> anyhow::Result<Vec<Workload>> {
    const GROUP: &str = LARGE;
    let rays = Rays::new(square(4096), 1, 100_000);
    let ppp = 100_000.0 / (4096.0 * 4096.0);
    let all = vec![
        Workload {
            threads: 2,
            ..rays.workload(scratch, GROUP, "rays, 100000 particles, 4096 x 4096 px", 1e5)?
        },
        gaussian(
            scratch,
            (GROUP, "gaussian, 100000 particles, 4096 x 4096 px, 2 frames"),
            1e5,
            (4096, ppp),
            "sequence(frames: 2)",
        )?,
        sequence(scratch, LONG[0], 100)?,
        sequence(scratch, LONG[1], 10_000)?,
    ];
    Ok(all.into_iter().map(|workload| Workload { repeats: 1, ..workload }).collect())
}
