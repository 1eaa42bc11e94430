//! A microscope of one's own: wave optics from a scenario to a dataset, and light in photons.

use std::path::{Path, PathBuf};

use microsig_core::formats::tiff;
use microsig_core::render::Context;
use scenario::{parse, resolve};
use serde_json::Value;
use suite::golden::Hashes;
use suite::microsig::{fail, json, manifest, microsig, path, run, succeed, write};

fn objective_20x() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/objective_20x.ron")
}

/// Small enough for a test.
const SMALL: [&str; 4] =
    ["optics.pixel_dim_x=96", "optics.pixel_dim_y=80", "timing.pairs.count=1", "boundaries.margin_px=20"];

#[test]
fn a_dataset_by_waves_tells_its_optics_and_has_the_same_bytes_for_any_number_of_threads() {
    let place = tempfile::tempdir().unwrap();
    let made = |threads: &str| {
        let out = place.path().join(format!("dataset-{threads}"));
        let scenario = objective_20x();
        let mut arguments = vec!["generate", path(&scenario), "--out", path(&out), "--threads", threads];
        arguments.extend(SMALL.iter().flat_map(|set| ["--set", set]));
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

/// Sections of a scenario, and what is said about them.
const REFUSED: &str = r#"
render: (mode: waves) => `wavelength_um` is missing
render: (wavelength_um: 0.5) => render.wavelength_um: expected nothing, or render: (mode: waves)
optics: (lens: aplanatic) => optics.lens: expected nothing
optics: (pupil: (zernike: [(6, 0.1)])), render: (mode: expected) => optics.pupil: expected nothing
WAVES, bandwidth_um: 0.2) => render.bandwidth_um = 0.2: expected 0 to 0.1500 um
WAVES), optics: (gaussian: ()) => render.mode = waves: expected nothing: Gaussian spots are not diffracted
WAVES), optics: (layers: (), depth_factor: 1.33) => optics.depth_factor = 1.33: expected 1: with `layers` depths are physical
WAVES), optics: (layers: (focus_depth_um: 10)) => it would lie inside the cover slip
WAVES), optics: (pupil: (zernike: [(1, 0.1)])) => optics.pupil.zernike.0.0 = 1: expected a Noll index from 2 to 66
WAVES), optics: (pupil: (mask: pinholes([(x: 0.9, y: 0, r: 0.2)]))) => expected a disc of radius > 0 within the pupil
WAVES), optics: (cyl_angle_deg: 10) => optics.cyl_angle_deg = 10: expected 0: there is no cylindrical lens
WAVES), particles: (spheroids: (e_p: 2)) => it is a spheroid, which waves draw with lens: aplanatic only
particles: (photons: (emitted: constant(1e6)), c_int: constant(2)) => particles.c_int: expected nothing: particles.photons says
particles: (photons: (emitted: constant(1e6))), sensor: (photons_per_count: 5) => sensor.photons_per_count = 5: expected 1
particles: (photons: (emitted: constant(1e6))), sensor: (), optics: (gain: 2) => optics.gain = 2: expected 1
"#;

#[test]
fn what_waves_and_photons_cannot_do_is_refused_at_its_key() {
    for (rest, expected) in REFUSED.trim().lines().map(|line| line.split_once(" => ").unwrap()) {
        let rest = rest.replace("WAVES", "render: (mode: waves, wavelength_um: 0.5");
        let text = format!(
            "(name: \"s\", motion: flow(field: poiseuille()), timing: pairs(count: 1), calibration: none, {rest})"
        );
        let said = parse(&text, "s.ron").and_then(|spec| resolve(spec, Path::new("."), &Context::default()));
        let said = said.map(drop).unwrap_err().to_string();
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
        progress: storage::Progress::default(),
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

/// Tables are kept from run to run, and change no image.
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
    let hashes = |out: &str, more: &[&str]| {
        let out = place.path().join(out);
        let generate = ["generate", path(&scenario), "--quiet", "--out", path(&out)];
        succeed(microsig().args(generate).args(more).env("MICROSIG_CACHE", &cache));
        Hashes::of(&out).unwrap()
    };
    let first = hashes("first", &[]);
    let kept: Vec<_> = std::fs::read_dir(&cache).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert!(!kept.is_empty() && kept.iter().all(|file| file.extension().unwrap() == "table"), "{kept:?}");
    assert!(hashes("second", &[]) == first && hashes("third", &["--no-cache"]) == first);

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
    let told = json(&["optics", path(&scenario), "--variant", lens, "--plot", path(&svg)]);
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
