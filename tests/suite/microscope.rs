//! A microscope of one's own: wave optics from a scenario to a dataset, and light in photons.

use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

use microsig_core::formats::{data_file, tiff};
use microsig_core::render::Context;
use microsig_core::render::waves::{Lens, WaveOptics, WavesRenderer};
use microsig_core::{Particle, Settings};
use scenario::{parse, resolve};
use serde_json::Value;
use suite::golden::Hashes;
use suite::microsig::{fail, json, microsig, path, run, write};

fn objective_20x() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/objective_20x.ron")
}

fn manifest(dataset: &Path) -> Value {
    let text = std::fs::read_to_string(dataset.join("datapackage.json")).unwrap();
    serde_json::from_str::<Value>(&text).unwrap()["microsig"].clone()
}

/// Settings of a 20x / 0.45 whose pixels are small beside its Airy disc.
fn fine_20x() -> (Settings, f64) {
    let settings = Settings {
        magnification: 20.0,
        numerical_aperture: 0.45,
        pixel_size: 0.65,
        pixel_dim_x: 601,
        pixel_dim_y: 601,
        ..Settings::setting1()
    };
    let airy_px = 0.61 * 0.52 * 20.0 / (0.45 * 0.65);
    (settings, airy_px)
}

fn aplanatic() -> WaveOptics {
    WaveOptics { lens: Lens::Aplanatic, ..WaveOptics::new(0.52) }
}

/// 84 % is the share of the Airy disc (Born and Wolf, 8.5.2: 0.838).
#[test]
fn a_corrected_objective_puts_84_percent_of_a_points_light_into_the_airy_disc() {
    let (settings, airy_px) = fine_20x();
    let renderer = WavesRenderer::new(&settings, &aplanatic(), 1e-3).unwrap();
    assert!((renderer.airy_radius_px() - airy_px).abs() < 1e-9);
    let half = airy_px.ceil() as i32 + 1;
    let places: Vec<[f64; 2]> = (-half..=half)
        .flat_map(|y| (-half..=half).map(move |x| [f64::from(x), f64::from(y)]))
        .filter(|[x, y]| x * x + y * y <= airy_px * airy_px)
        .collect();
    let within: f64 = renderer.share_at(0.0, 0.0, &places).iter().sum();
    // Of the half space, what the aperture accepts.
    let accepted = 1.0 - (1.0f64 - 0.45 * 0.45).sqrt();
    let share = within / accepted;
    println!("{share:.4} within the Airy disc of {airy_px:.2} px");
    assert!((share - 0.838).abs() < 0.01, "{share}");
}

/// Root-mean-square half width and half height of the brighter part of an image.
fn widths(settings: &Settings, z_um: f64) -> [f64; 2] {
    let renderer = WavesRenderer::new(settings, &aplanatic(), 1e-3).unwrap();
    let half = 60;
    let places: Vec<[f64; 2]> =
        (-half..=half).flat_map(|y| (-half..=half).map(move |x| [f64::from(x), f64::from(y)])).collect();
    let light = renderer.share_at(z_um, 1.0, &places);
    let peak = light.iter().copied().fold(0.0, f64::max);
    let bright = || light.iter().zip(&places).filter(|(light, _)| **light > 0.1 * peak);
    let total: f64 = bright().map(|(light, _)| light).sum();
    [0, 1].map(|axis| (bright().map(|(light, at)| light * at[axis] * at[axis]).sum::<f64>() / total).sqrt())
}

#[test]
fn a_weak_cylinder_behind_a_corrected_objective_makes_ellipses_between_two_lines() {
    let (settings, _) = fine_20x();
    let settings = Settings { pixel_size: 6.5, cyl_focal_length: 7473.0, ..settings };
    // Narrow at -10 um, low at 0.
    let ratios: Vec<f64> = [-15.0, -10.0, -5.0, 0.0, 5.0]
        .iter()
        .map(|z_um| {
            let [x, y] = widths(&settings, *z_um);
            x / y
        })
        .collect();
    println!("width over height: {ratios:.2?}");
    let (least, greatest) = ratios.iter().fold((f64::INFINITY, 0.0f64), |(l, g), r| (l.min(*r), g.max(*r)));
    assert!(least < 0.6 && greatest > 1.6, "{ratios:?}");
}

/// Small enough for a test.
const SMALL: [&str; 8] = [
    "--set",
    "optics.pixel_dim_x=96",
    "--set",
    "optics.pixel_dim_y=80",
    "--set",
    "timing.pairs.count=1",
    "--set",
    "boundaries.margin_px=20",
];

#[test]
fn a_dataset_by_waves_tells_its_optics_and_has_the_same_bytes_for_any_number_of_threads() {
    let place = tempfile::tempdir().unwrap();
    let made = |threads: &str| {
        let out = place.path().join(format!("dataset-{threads}"));
        let scenario = objective_20x();
        let mut arguments = vec!["generate", path(&scenario), "--out", path(&out), "--threads", threads];
        arguments.extend(SMALL);
        run(&arguments);
        out
    };
    let (one, three) = (made("1"), made("3"));
    assert_eq!(Hashes::of(&one).unwrap(), Hashes::of(&three).unwrap());
    run(&["verify", path(&one), "--regenerate"]);
    let facts = manifest(&one);
    assert_eq!(facts["renderer"], "waves");
    let waves = &facts["waves"];
    assert_eq!((&waves["lens"], &waves["emission"]), (&"aplanatic".into(), &"volume".into()));
    // Some of the light lies in tails that are not drawn.
    let [least, greatest] = [0, 1].map(|i| waves["drawn_share"][i].as_f64().unwrap());
    assert!(least > 0.9 && least <= greatest && greatest < 1.0, "{least} {greatest}");
    let airy_px = waves["airy_radius_px"].as_f64().unwrap();
    assert!((airy_px - 0.61 * 0.52 * 20.0 / (0.45 * 6.5)).abs() < 1e-9, "{airy_px}");
    let card = std::fs::read_to_string(one.join("README.md")).unwrap();
    assert!(card.contains("Airy radius 2.17 px") && card.contains("0.52 um"), "{card}");
    let focus_um = facts["particle_image"]["focus_um"].as_f64().unwrap();
    assert!(focus_um.abs() < 3.0, "{focus_um}");
    // The truth as a result: the bound follows from waves.
    let truth = one.join("truth/tracks.csv");
    let score: Value = json(&["evaluate", path(&one), path(&truth), "--crlb"]);
    let bins = score["crlb"]["bins"].as_array().unwrap();
    assert!(!bins.is_empty());
    for bin in bins {
        let [x, y, z] = ["crlb_x_px", "crlb_y_px", "crlb_z_um"].map(|key| bin[key].as_f64().unwrap());
        assert!(x > 0.0 && x < 1.0 && (x / y - 1.0).abs() < 0.05 && z > 0.0 && z < 2.0, "{bin}");
    }
}

#[test]
fn what_waves_cannot_do_is_refused_at_its_key() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("s.ron");
    for (rest, expected) in [
        ("render: (mode: waves)", "`wavelength_um` is missing"),
        ("render: (wavelength_um: 0.5)", "render.wavelength_um: expected nothing, or render: (mode: waves)"),
        ("optics: (lens: aplanatic)", "optics.lens: expected nothing"),
        (
            "optics: (pupil: (zernike: [(6, 0.1)])), render: (mode: expected)",
            "optics.pupil: expected nothing",
        ),
        (
            "render: (mode: waves, wavelength_um: 0.5, bandwidth_um: 0.2)",
            "render.bandwidth_um = 0.2: expected 0 to 0.1500 um",
        ),
        (
            "render: (mode: waves, wavelength_um: 0.5), optics: (gaussian: ())",
            "render.mode = waves: expected nothing: Gaussian spots are not diffracted",
        ),
        (
            "render: (mode: waves, wavelength_um: 0.5), optics: (layers: (), depth_factor: 1.33)",
            "optics.depth_factor = 1.33: expected 1: with `layers` depths are physical",
        ),
        (
            "render: (mode: waves, wavelength_um: 0.5), optics: (layers: (focus_depth_um: 10))",
            "it would lie inside the cover slip",
        ),
        (
            "render: (mode: waves, wavelength_um: 0.5), optics: (pupil: (zernike: [(1, 0.1)]))",
            "optics.pupil.zernike.0.0 = 1: expected a Noll index from 2 to 66",
        ),
        (
            "render: (mode: waves, wavelength_um: 0.5), optics: (pupil: (mask: pinholes([(x: 0.9, y: 0, r: 0.2)])))",
            "optics.pupil.mask.pinholes.0 = (x: 0.9, y: 0, r: 0.2): expected a disc of radius > 0 within the pupil",
        ),
        (
            "render: (mode: waves, wavelength_um: 0.5), optics: (cyl_angle_deg: 10)",
            "optics.cyl_angle_deg = 10: expected 0: there is no cylindrical lens",
        ),
        (
            "render: (mode: waves, wavelength_um: 0.5), particles: (spheroids: (e_p: 2))",
            "it is a spheroid, which waves draw with lens: aplanatic only",
        ),
        (
            "particles: (photons: (emitted: constant(1e6)), c_int: constant(2))",
            "particles.c_int: expected nothing: particles.photons says how bright particles are",
        ),
        (
            "particles: (photons: (emitted: constant(1e6))), sensor: (photons_per_count: 5)",
            "sensor.photons_per_count = 5: expected 1",
        ),
        (
            "particles: (photons: (emitted: constant(1e6))), sensor: (), optics: (gain: 2)",
            "optics.gain = 2: expected 1",
        ),
    ] {
        let text = format!(
            "(name: \"s\", motion: flow(field: poiseuille()), timing: pairs(count: 1), calibration: none, {rest})"
        );
        std::fs::write(&file, text).unwrap();
        let said = fail(2, &["generate", path(&file), "--dry-run"]);
        assert!(said.contains(expected), "{rest}: {expected} is not in\n{said}");
    }
}

/// Photons that a particle of 2 um emits.
const PHOTONS: f64 = 1e8;

/// Mean and standard deviation of the background: so little noise dithers, so that light of less than half a
/// count is not lost, and adds 0.2 % to the error of a sum over 301 x 301 px.
const BACKGROUND: [f64; 2] = [100.0, 0.6];

/// All light of one particle in focus, as the images of a dataset show it.
fn seen(place: &Path, mode: &str, optics: &str, particles: &str) -> f64 {
    std::fs::write(place.join("place.txt"), "151 151 0 2\n").unwrap();
    let [mean, noise] = BACKGROUND;
    let text = format!(
        "(name: \"one\", optics: (preset: setting1, pixel_dim_x: 301, pixel_dim_y: 301, background_mean: {mean}, \
         background_noise: {noise}, {optics}), motion: flow(field: uniform(velocity_um_s: (0, 0, 0))), \
         particles: (number: file(\"place.txt\"), {particles}), boundaries: (z_um: (-10, 10)), \
         timing: sequence(frames: 1, dt_s: 1), calibration: none, render: ({mode}))"
    );
    let scenario = resolve(parse(&text, "s.ron").unwrap(), place, &Context::default()).unwrap();
    let out = place.join("one");
    let options = generator::runner::GenerateOptions {
        out: out.clone(),
        force: true,
        resume: false,
        progress: generator::runner::Progress::Hidden,
    };
    generator::runner::generate(&scenario, &options).unwrap();
    let image = std::fs::read(out.join("images/frame_00000.tif")).unwrap();
    let counts = tiff::read(std::io::Cursor::new(image), "one", (301, 301)).unwrap();
    assert!(counts.iter().all(|count| *count < 65535.0), "{mode} {optics}: saturated");
    counts.iter().map(|count| count - mean).sum()
}

/// The share of its photons that an aperture of 0.3 collects in focus.
fn collected() -> f64 {
    0.5 * (1.0 - (1.0f64 - 0.3 * 0.3).sqrt())
}

#[test]
fn photons_are_the_same_whatever_magnification_pixels_and_renderer() {
    let place = tempfile::tempdir().unwrap();
    let photons = format!("photons: (emitted: constant({PHOTONS}))");
    for (mode, spot) in [
        ("mode: rays", ""),
        ("mode: expected", ""),
        ("mode: waves, wavelength_um: 0.52, tolerance: 0.001", ""),
        ("mode: rays", "gaussian: (diameter_px: 12), "),
    ] {
        let mut shares = Vec::new();
        for magnification in [10, 20] {
            for pixel_size in [6.5, 13.0] {
                // Counts hold 16 bits: a count is so many photons.
                let optics = format!(
                    "{spot}magnification: {magnification}, pixel_size: {pixel_size}, gain: 0.05, points_per_pixel: 9"
                );
                let total = seen(place.path(), mode, &optics, &photons) / 0.05;
                let share = total / (PHOTONS * collected());
                println!("{mode} {spot}M {magnification}, pixels of {pixel_size} um: {share:.4}");
                assert!((share - 1.0).abs() < 0.01, "{mode} {spot}{magnification} {pixel_size}: {share}");
                shares.push(share);
            }
        }
        let (least, most) = shares.iter().fold((f64::INFINITY, 0.0f64), |(l, m), s| (l.min(*s), m.max(*s)));
        assert!(most - least < 0.01, "{mode} {spot}: {shares:?}");
    }
}

#[test]
fn photons_grow_with_surface_volume_or_not_at_all() {
    let place = tempfile::tempdir().unwrap();
    let of = |grow_with: &str, emitted: &str| {
        let particles = format!(
            "diameter_um: constant(4), photons: (emitted: {emitted}, grow_with: {grow_with}, reference_um: 2)"
        );
        let counts = seen(place.path(), "mode: expected", "gain: 0.02", &particles);
        counts / 0.02 / (PHOTONS * collected())
    };
    for (grow_with, factor) in [("surface", 4.0), ("volume", 8.0), ("equal", 1.0)] {
        let share = of(grow_with, &format!("constant({PHOTONS})"));
        assert!((share / factor - 1.0).abs() < 0.01, "{grow_with}: {share}");
    }
    let spread = of("equal", &format!("uniform(min: {}, max: {})", 0.5 * PHOTONS, 0.6 * PHOTONS));
    assert!(spread > 0.49 && spread < 0.61, "{spread}");
}

#[test]
fn a_datasets_own_data_files_hold_its_photons() {
    let place = tempfile::tempdir().unwrap();
    let photons = format!("photons: (emitted: constant({PHOTONS}))");
    let total = seen(place.path(), "mode: expected", "gain: 0.05", &photons);
    let dataset = place.path().join("one");
    let images = place.path().join("images");
    let (settings, particles) = (dataset.join("settings.txt"), dataset.join("particles"));
    run(&["render", path(&settings), path(&particles), path(&images), "--mode", "expected", "--round-once"]);
    let image = std::fs::read(images.join("frame_00000.tif")).unwrap();
    let again = tiff::read(std::io::Cursor::new(image), "again", (301, 301)).unwrap();
    let again: f64 = again.iter().map(|count| count - BACKGROUND[0]).sum();
    assert_eq!(again, total);
    let rows = std::fs::read(dataset.join("particles/frame_00000.txt")).unwrap();
    let rows: Vec<Particle> = data_file::read(&rows[..], "rows").unwrap();
    assert!(rows.len() == 1 && rows[0].c_int != 1.0);
}

#[test]
fn ticks_of_a_preview_are_short_and_beside_the_name_of_their_axis() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("optics.svg");
    run(&["optics", path(&objective_20x()), "--quiet", "--plot", path(&file)]);
    let svg = std::fs::read_to_string(&file).unwrap();
    let lines: Vec<&str> = svg.lines().collect();
    let of = |text: &str| {
        let at = lines.iter().position(|line| *line == text).unwrap_or_else(|| panic!("no text {text}"));
        let value = |name: &str| -> f64 {
            let (_, rest) = lines[at - 1].split_once(&format!(" {name}=\"")).unwrap();
            rest.split('"').next().unwrap().parse().unwrap()
        };
        (value("x"), value("font-size"))
    };
    // The name is upright and begins at its place; the tick ends at its own.
    let ((name, high), (tick, size)) = (of("peak, counts"), of("10000"));
    // Digits are about 0.6 times as wide as high, letters with their ascent 1.2 times the size of the font.
    assert!(name + 1.2 * high < tick - 0.6 * 5.0 * size, "{name} {high} {tick} {size}");
    assert!(lines.contains(&"-15") && lines.contains(&"15"));
}

/// Tables are kept from run to run, whatever happens to their files, and change no image.
#[test]
fn tables_are_kept_in_the_folder_of_the_cache() {
    let place = tempfile::tempdir().unwrap();
    let scenario = write(
        place.path(),
        "kept.ron",
        "(name: \"kept\", optics: (pixel_dim_x: 80, pixel_dim_y: 60), motion: flow(field: poiseuille()), \
         boundaries: (z_um: (-20, 0)), timing: pairs(count: 1), calibration: none, \
         render: (mode: waves, wavelength_um: 0.52, tolerance: 0.01))",
    );
    let cache = place.path().join("cache");
    let start = |out: &str, more: &[&str]| {
        let mut command = microsig();
        command.args(["generate", path(&scenario), "--quiet", "--out", path(&place.path().join(out))]);
        command.args(more).env("MICROSIG_CACHE", &cache).stderr(Stdio::piped()).spawn().unwrap()
    };
    let hashes = |out: &str| Hashes::of(&place.path().join(out)).unwrap();
    let files = || -> Vec<PathBuf> {
        std::fs::read_dir(&cache).unwrap().map(|entry| entry.unwrap().path()).collect()
    };
    let ends = |mut run: Child| assert!(run.wait().unwrap().success());

    // Two processes at once, into an empty folder.
    let both = [start("first", &[]), start("second", &[])];
    both.into_iter().for_each(ends);
    let kept = files();
    assert!(!kept.is_empty() && kept.iter().all(|file| file.extension().unwrap() == "table"), "{kept:?}");
    // One file damaged, one cut, one emptied.
    for (k, file) in kept.iter().enumerate() {
        let mut bytes = std::fs::read(file).unwrap();
        let middle = bytes.len() / 2;
        match k % 3 {
            0 => bytes[middle] ^= 1,
            1 => bytes.truncate(middle),
            _ => bytes.clear(),
        }
        std::fs::write(file, bytes).unwrap();
    }
    ends(start("third", &[]));
    assert_eq!(files().len(), kept.len());
    ends(start("fourth", &[]));
    ends(start("fifth", &["--no-cache"]));
    for other in ["second", "third", "fourth", "fifth"] {
        assert_eq!(hashes(other), hashes("first"), "{other}");
    }

    let refused = |code: i32, name: &str, value: &str| {
        let output = microsig().args(["optics", path(&scenario)]).env(name, value).output().unwrap();
        assert_eq!(output.status.code(), Some(code));
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(
        refused(2, "MICROSIG_CACHE_MB", "abc").contains("MICROSIG_CACHE_MB = abc: expected a whole number")
    );
    let below_a_file = scenario.join("cache");
    assert!(refused(1, "MICROSIG_CACHE", path(&below_a_file)).contains("kept.ron/cache: "));
}

/// Without a cylindrical lens the images of an aberration-free objective on both sides of focus differ by less than this noise.
#[test]
fn optics_say_what_lenses_and_densities_allow() {
    let place = tempfile::tempdir().unwrap();
    let scenario = write(
        place.path(),
        "air.ron",
        r#"(name: "air", optics: (magnification: 20, numerical_aperture: 0.3, pixel_size: 6.5, pixel_dim_x: 128, pixel_dim_y: 128,
            lens: aplanatic, background_mean: 500, background_noise: 50),
            motion: flow(field: poiseuille()), timing: pairs(count: 1), boundaries: (z_um: (-10, 10)),
            particles: (number: ppp(0.02), diameter_um: constant(1)), render: (mode: waves, wavelength_um: 0.52, tolerance: 0.02))"#,
    );
    let (svg, png) = (place.path().join("lenses.svg"), place.path().join("lenses.png"));
    let lens = "optics.cylinder=lens(focal_length_mm: 1000, to_sensor_mm: 115)";
    let told = run(&["optics", path(&scenario), "--variant", lens, "--json", "--plot", path(&svg)]);
    let told: Value = serde_json::from_str(&told).unwrap();
    let [none, lens_] = [0, 1].map(|k| &told["scenarios"][k]);
    let number = |of: &Value, path: &str| of.pointer(path).and_then(Value::as_f64).unwrap();
    let share = |of: &Value| number(of, "/bounds/determined_share");
    assert!(share(none) < 0.3 && share(lens_) > 0.9, "{} {}", share(none), share(lens_));
    for axis in ["crlb_x_px", "crlb_y_px", "crlb_z_um"] {
        let [best, mean] = ["best", "mean"].map(|of| number(lens_, &format!("/bounds/{of}/{axis}")));
        assert!(best > 0.0 && best < mean, "{axis}: {best} {mean}");
    }
    let area_px = number(none, "/source_density") / number(none, "/particles_per_px");
    let usual = number(none, "/usual_particles_per_px");
    assert!((usual * area_px / 0.3 - 1.0).abs() < 1e-9);
    // Cones of sine 0.3: the mean over depth of pi r^2 is pi tan^2 (10 um)^2 / 3, besides the particle and diffraction.
    let cone_px = std::f64::consts::PI * 0.3f64.powi(2) / (1.0 - 0.09) * 100.0 / 3.0 / (0.325 * 0.325);
    assert!(area_px > cone_px && area_px < 1.6 * cone_px, "{area_px} {cone_px}");
    let drawn = std::fs::read_to_string(&svg).unwrap();
    for text in ["bound of z, um", "A: air", "B: cylinder = lens"] {
        assert!(drawn.contains(text), "{text} is not in the picture");
    }
    // 85 mm at 300 dots per inch.
    run(&["optics", path(&scenario), "--quiet", "--plot", path(&png)]);
    let image = std::fs::read(&png).unwrap();
    assert_eq!((&image[1..4], u32::from_be_bytes(image[16..20].try_into().unwrap())), (&b"PNG"[..], 1004));
    let spheroids = ["optics", path(&scenario), "--variant", lens, "--spheroids", "-"];
    assert!(fail(2, &spheroids).contains("cannot be used with"));
}
