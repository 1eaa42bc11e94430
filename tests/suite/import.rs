//! `microsig import`: a recording in the formats of other programs becomes a folder that trackers and scores
//! read like a dataset, and inputs that it refuses.

use std::fmt::Write as _;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use microsig_core::Settings;
use serde_json::Value;
use suite::microsig::{fail, json, listing, path, run};
use suite::scan::{Bead, SimulatedScan, write_pages};
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::{Gray8, Gray32Float, RGB8};
use tiff::tags::Tag;

/// Edge of the images, px.
const SIDE: u32 = 240;

/// Frames of the recording: planes of the scan.
const FRAMES: [usize; 6] = [1, 4, 7, 13, 16, 19];

/// Nine particles in a plane, scanned through focus.
fn target() -> SimulatedScan {
    let simulated = SimulatedScan::tenfold(21, 4.0);
    let bead = |k: u32| Bead {
        x_px: 41.3 + 79.37 * f64::from(k % 3),
        y_px: 39.8 + 79.71 * f64::from(k / 3),
        z_um: -12.0,
        c_int: 1.0 + 0.05 * f64::from(k),
    };
    SimulatedScan {
        settings: Settings { pixel_dim_x: SIDE, pixel_dim_y: SIDE, ..simulated.settings.clone() },
        drift_px_per_um: [0.0; 2],
        beads: (0..9).map(bead).collect(),
        ..simulated
    }
}

/// Three passes of the scan, with noise of their own, which all tests share.
static PASSES: LazyLock<[Vec<Vec<u16>>; 3]> =
    LazyLock::new(|| [1, 2, 3].map(|seed| target().planes(seed).unwrap()));

/// Counts of a camera of 8 bit.
fn eight_bit(plane: &[u16]) -> Vec<u8> {
    plane.iter().map(|count| (count / 24).min(255) as u8).collect()
}

fn write_eight_bit(file: &Path, pages: &[Vec<u8>], description: &str) {
    let mut encoder = TiffEncoder::new(File::create(file).unwrap()).unwrap();
    for page in pages {
        let mut image = encoder.new_image::<Gray8>(SIDE, SIDE).unwrap();
        image.encoder().write_tag(Tag::ImageDescription, description).unwrap();
        image.write_data(page).unwrap();
    }
}

/// A recording with its scan, in a folder.
struct Recording {
    place: tempfile::TempDir,
}

impl Recording {
    /// The scan with two frames of each plane, as 8-bit pages; the recording as OME-TIFF with two channels, of
    /// which the first is dark; heights of the planes, and positions of four particles and of one that no image shows.
    fn new() -> Self {
        let (place, truth) = (tempfile::tempdir().unwrap(), target());
        let at = |name: &str| place.path().join(name);
        let [first, second, third] = &*PASSES;
        let scan: Vec<Vec<u8>> =
            first.iter().zip(second).flat_map(|(a, b)| [eight_bit(a), eight_bit(b)]).collect();
        write_eight_bit(&at("scan.tif"), &scan, "a camera");
        let z: String =
            truth.stage_um.iter().enumerate().fold("page,z_um\n".to_owned(), |mut text, (k, z)| {
                let _ = writeln!(text, "{},{z}\n{},{z}", 2 * k, 2 * k + 1);
                text
            });
        std::fs::write(at("z.csv"), z).unwrap();
        let dark = vec![14; (SIDE * SIDE) as usize];
        let frames: Vec<Vec<u8>> =
            FRAMES.iter().flat_map(|k| [dark.clone(), eight_bit(&third[*k])]).collect();
        let ome = format!(
            r#"<?xml version="1.0"?><OME><Image ID="Image:0"><Pixels DimensionOrder="XYCZT" SizeX="{SIDE}" SizeY="{SIDE}" SizeC="2" SizeZ="1" SizeT="{}" Type="uint8"/></Image></OME>"#,
            FRAMES.len()
        );
        write_eight_bit(&at("run.ome.tif"), &frames, &ome);
        let (mut planes, mut known) =
            ("frame,z_um\n".to_owned(), "frame,x_px,y_px,visible\n0,-40,7,0\n".to_owned());
        for (frame, plane) in FRAMES.iter().enumerate() {
            let _ = writeln!(planes, "{frame},{}", truth.stage_um[*plane]);
            for bead in &truth.beads[..4] {
                let _ = writeln!(known, "{frame},{},{},1", bead.x_px, bead.y_px);
            }
        }
        std::fs::write(at("planes.csv"), planes).unwrap();
        std::fs::write(at("known.csv"), known).unwrap();
        Recording { place }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.place.path().join(name)
    }

    /// Arguments of an import of these images with this scan.
    fn arguments(&self, images: &str, scan: &str, more: &[&str]) -> Vec<String> {
        let (images, scan, z, out) = (self.at(images), self.at(scan), self.at("z.csv"), self.at("out"));
        let own = ["import", "--images", path(&images), "--scan", path(&scan), "--z", path(&z)];
        let scale = ["--magnification", "10", "--pixel-size", "6.45", "--out", path(&out)];
        own.iter().chain(&scale).chain(more).map(|text| (*text).to_owned()).collect()
    }

    /// What an import of these images with this scan reports.
    fn import(&self, images: &str, scan: &str, more: &[&str]) -> Value {
        json(&self.arguments(images, scan, more))
    }

    /// The message about an import that is refused.
    fn refused(&self, images: &str, scan: &str, more: &[&str]) -> String {
        let message = fail(2, &self.arguments(images, scan, more));
        let left = listing(self.place.path());
        assert!(!left.iter().any(|name| name.starts_with("out")), "nothing is written: {left:?}");
        message
    }
}

#[test]
fn a_recording_of_other_programs_is_tracked_and_scored() {
    let recording = Recording::new();
    let (planes, known, out) = (recording.at("planes.csv"), recording.at("known.csv"), recording.at("out"));
    let more = ["--page", "1", "--field", "2", "--dt", "0.1", "--truth", path(&planes), path(&known)];
    let made = recording.import("run.ome.tif", "scan.tif", &more);
    assert_eq!((&made["frames"], &made["written"], &made["depths"]), (&6.into(), &6.into(), &21.into()));
    assert_eq!(made["places"].as_array().unwrap().len(), 4, "{made}");
    // Rays of gain 3.2 in counts of 24: 0.13 per count, of the background (10 / 24)^2, of rounding 1 / 12.
    let noise: Vec<f64> =
        made["noise"]["variance"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert!((0.15..0.5).contains(&noise[0]) && (0.05..0.25).contains(&noise[1]), "{noise:?}");
    run(&["verify", path(&out)]);

    let found = recording.at("found.csv");
    run(&["track", path(&out), "--method", "ncc", "--out", path(&found)]);
    let score: Value = json(&["evaluate", path(&out), path(&found), "--crlb"]);
    assert!(score["warnings"].to_string().contains("a recording has no scenario"), "{}", score["warnings"]);
    let number = |part: &str, key: &str| score[part][key].as_f64().unwrap_or(f64::NAN);
    // Steps of 4 um; all nine particles, of which four are known.
    assert!(
        number("planes", "share_within") > 0.95 && number("planes", "rmse_z_um") < 1.0,
        "{}",
        score["planes"]
    );
    assert!(number("planes", "n") >= 50.0, "{}", score["planes"]);
    assert_eq!(number("detection", "recall"), 1.0);
    assert!(number("detection", "rmse_xy_px") < 0.2, "{}", score["detection"]);
    assert!(score["detection"]["precision"].is_null() && score["hota"].is_null(), "{}", score["detection"]);
    assert!(score["unknown"][0].as_str().unwrap().starts_with("precision"), "{}", score["unknown"]);

    for method in ["spots", "aptv", "piv"] {
        run(&["track", path(&out), "--method", method, "--out", path(&found), "--force"]);
    }
    let no_model = fail(2, &["track", path(&out), "--method", "mle", "--out", path(&found), "--force"]);
    assert!(no_model.contains("without a model of its optics"), "{no_model}");
    let scores = recording.at("scores");
    run(&["track", path(&out), "--method", "ncc", "--out", path(&found), "--force"]);
    run(&["evaluate", path(&out), path(&found), "--out", path(&scores), "--report"]);
    run(&["compare", path(&scores), "--out", path(&recording.at("leaderboard"))]);
    run(&["export", path(&out), "--format", "trackpy", "--out", path(&recording.at("known.trackpy.csv"))]);

    // Without track numbers there are no links.
    recording.import("run.ome.tif", "scan.tif", &[&more[..], &["--all-particles", "--force"]].concat());
    let score: Value = json(&["evaluate", path(&out), path(&found)]);
    assert!(score["detection"]["precision"].is_number(), "{}", score["detection"]);
    assert!(score["links"].is_null() && score["hota"].is_null(), "{}", score["links"]);
    assert!(score["unknown"][0].as_str().unwrap().starts_with("links and tracks"), "{}", score["unknown"]);
}

const OPTICS: &str = "(name: \"o\", optics: (preset: setting1, magnification: 10, numerical_aperture: 0.3, focal_length: 350, \
                      pixel_size: 6.45, gain: 0.13), particles: (number: count(1), diameter_um: constant(2)), \
                      motion: flow(field: poiseuille()), timing: pairs(count: 1), boundaries: (z_um: (-60, 40)))";

#[test]
fn optics_make_mle_possible() {
    let recording = Recording::new();
    std::fs::write(recording.at("optics.ron"), OPTICS).unwrap();
    let (optics, planes, out) = (recording.at("optics.ron"), recording.at("planes.csv"), recording.at("out"));
    let more = ["--page", "1", "--optics", path(&optics), "--truth", path(&planes)];
    recording.import("run.ome.tif", "scan.tif", &more);
    // Where the model's focus is on the axis of the stage is found.
    let card = std::fs::read_to_string(out.join("README.md")).unwrap();
    let zero: f64 =
        card.split("of this model is at ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((zero - 12.0).abs() < 1.0, "{zero}");
    let found = recording.at("found.csv");
    run(&["track", path(&out), "--method", "mle", "--out", path(&found)]);
    let score: Value = json(&["evaluate", path(&out), path(&found)]);
    let of = |key: &str| score["planes"][key].as_f64().unwrap();
    assert!(of("share_within") > 0.95 && of("rmse_z_um") < 1.5, "{}", score["planes"]);
}

/// A tracker of microsig and a command run on a recording and its twin, which has as many particles, as bright, at the same places.
#[test]
fn the_twin_of_a_recording_predicts_the_scores_of_trackers() {
    let recording = Recording::new();
    std::fs::write(recording.at("optics.ron"), OPTICS).unwrap();
    let [optics, planes, out, twin] =
        ["optics.ron", "planes.csv", "out", "twin"].map(|name| recording.at(name));
    let more = ["--page", "1", "--optics", path(&optics), "--truth", path(&planes)];
    recording.import("run.ome.tif", "scan.tif", &more);
    // A tracker that finds what `ncc` found last.
    let command = format!(
        "ncc,cp {}/$(basename {{dataset}} | sed s/out/recorded/)-ncc.csv {{out}} # {{images}}",
        path(&twin)
    );
    let arguments = ["twin", path(&out), "--optics", path(&optics), "--run", &command, "--out", path(&twin)];
    let made = json(&arguments);
    let of =
        |tracker: usize, images: &str, key: &str| made["trackers"][tracker][images][key].as_f64().unwrap();
    // Nine particles in six frames. Of the recording, heights are known.
    assert_eq!((of(0, "twin", "n"), of(0, "recorded", "n")), (54.0, 54.0));
    assert!(of(0, "twin", "recall") > 0.95 && made["trackers"][0]["recorded"]["recall"].is_null(), "{made}");
    let [own, predicted] = ["recorded", "twin"].map(|images| of(0, images, "rms_z_um"));
    assert!((0.5..2.0).contains(&(predicted / own)), "{own} um, {predicted} um on the twin");
    assert_eq!(of(1, "twin", "rms_z_um"), predicted);
    let sentence = made["trackers"][0]["sentence"].as_str().unwrap();
    assert!(
        sentence.starts_with("ncc finds 100 % +- 0 of the particles at ")
            && sentence.contains("only heights"),
        "{sentence}"
    );
    assert!(
        made["trackers"][1]["sentence"].as_str().unwrap().starts_with("your tracker finds 100 %"),
        "{made}"
    );
    let page = std::fs::read_to_string(twin.join("report.html")).unwrap();
    assert!(
        page.contains(sentence.split(" of the").next().unwrap())
            && page.matches("data:image/png").count() == 10
    );
    run(&["verify", path(&twin.join("twin"))]);

    assert!(fail(2, &arguments).contains("exists"));
    for (tracker, code, what) in [
        ("nnc", 2, "expected one of"),
        ("ls {images}", 2, "{out}"),
        ("exit 3 # {images} {out}", 1, "exit status: 3"),
    ] {
        let again = ["--out", path(&twin), "--force", "--run", tracker];
        let said = fail(code, &[&["twin", path(&out), "--optics", path(&optics)], &again[..]].concat());
        assert!(said.contains(what), "{said}");
    }
    let (dataset, other) = (twin.join("generated"), recording.at("x"));
    let said = fail(2, &["twin", path(&dataset), "--optics", path(&optics), "--out", path(&other)]);
    assert!(said.contains("expected a recording"), "{said}");
}

#[test]
fn another_background_than_that_of_the_scan_is_said() {
    let recording = Recording::new();
    let brighter =
        |by: u8| eight_bit(&PASSES[2][4]).iter().map(|count| count.saturating_add(by)).collect::<Vec<_>>();
    for (by, is_said) in [(0, false), (5, true)] {
        write_eight_bit(&recording.at("run.tif"), &[brighter(by)], "a camera");
        let made = recording.import("run.tif", "scan.tif", &["--force"]);
        let said = made["warnings"].to_string();
        assert_eq!(said.contains("in the scan 14.0"), is_said, "{said}");
    }
}

#[test]
fn whole_files_are_linked_or_copied_as_they_are() {
    let recording = Recording::new();
    let folder = recording.at("run");
    std::fs::create_dir(&folder).unwrap();
    let planes = &PASSES[2];
    for (k, plane) in [4, 7, 13].into_iter().enumerate() {
        write_eight_bit(&folder.join(format!("img{}.tif", 8 + k)), &[eight_bit(&planes[plane])], "a camera");
    }
    let made = recording.import("run", "scan.tif", &[]);
    assert_eq!(made["linked"].as_u64().unwrap() + made["copied"].as_u64().unwrap(), 3);
    // In natural order: img8, img9, img10.
    let first = std::fs::read(recording.at("out/images/frame_00000.tif")).unwrap();
    assert_eq!(first, std::fs::read(folder.join("img8.tif")).unwrap());
    let copied = recording.import("run", "scan.tif", &["--copy", "--force"]);
    assert_eq!(copied["copied"], 3);
    let unknown = fail(2, &["evaluate", path(&recording.at("out")), path(&recording.at("known.csv"))]);
    assert!(unknown.contains("nothing is known"), "{unknown}");
}

#[test]
fn images_in_focus_are_imported_without_a_scan() {
    let recording = Recording::new();
    // Pairs whose names tell them, in another order than the names. Plane 13 is in focus.
    for (k, seed) in [0, 1].into_iter().enumerate() {
        for (role, pass) in [("a", &PASSES[seed]), ("b", &PASSES[2])] {
            write_eight_bit(&recording.at(&format!("{role}_{k}.tif")), &[eight_bit(&pass[13])], "a camera");
        }
    }
    let (images, known, out) = (recording.at("?_?.tif"), recording.at("known.csv"), recording.at("out"));
    let scale = ["--magnification", "10", "--pixel-size", "6.45", "--pairs", "--dt", "0.01"];
    std::fs::write(
        &known,
        target().beads.iter().fold("frame,x_px,y_px\n".to_owned(), |text, bead| {
            text + &(0..4).map(|frame| format!("{frame},{},{}\n", bead.x_px, bead.y_px)).collect::<String>()
        }),
    )
    .unwrap();
    let truth = ["--out", path(&out), "--truth", path(&known), "--all-particles"];
    let own = [&["import", "--images", path(&images)], &truth[..]].concat();
    let made = json(&[&own[..], &scale].concat());
    assert_eq!((&made["frames"], &made["depths"], &made["noise"]), (&4.into(), &0.into(), &Value::Null));
    for (image, file) in [("pair_00000_b.tif", "b_0.tif"), ("pair_00001_a.tif", "a_1.tif")] {
        let [image, file] =
            [out.join("images").join(image), recording.at(file)].map(|f| std::fs::read(f).unwrap());
        assert!(image == file);
    }
    run(&["verify", path(&out)]);
    let card = std::fs::read_to_string(out.join("README.md")).unwrap();
    assert!(card.contains("without a calibration") && !card.contains("`calibration/`"), "{card}");
    let found = recording.at("found.csv");
    for method in ["piv", "spots"] {
        run(&["track", path(&out), "--method", method, "--out", path(&found), "--force"]);
    }
    let score: Value = json(&["evaluate", path(&out), path(&found)]);
    let of = |key: &str| score["detection"][key].as_f64().unwrap();
    // The noise of this camera, below one count, makes no row: all are within 17 px of a particle, half of them pieces of the
    // halos of particles that are 200 times as bright as the noise.
    assert!(of("recall") > 0.9 && of("precision") > 0.45 && of("rmse_xy_px") < 0.2, "{}", score["detection"]);
    for row in std::fs::read_to_string(&found).unwrap().lines().skip(1) {
        let [x, y] = [2, 3].map(|column| row.split(',').nth(column).unwrap().parse::<f64>().unwrap());
        assert!(target().beads.iter().any(|bead| (bead.x_px - x).hypot(bead.y_px - y) < 17.0), "{row}");
    }
    let refused = fail(2, &["track", path(&out), "--method", "ncc", "--out", path(&found), "--force"]);
    assert!(refused.contains("`microsig import --scan`"), "{refused}");
    let refused = fail(2, &[&own[..], &scale, &["--force", "--field", "2"]].concat());
    assert!(refused.contains("--field: expected with --scan only"), "{refused}");
}

#[test]
fn a_dense_scan_has_calibration_images_between_its_particles() {
    let place = tempfile::tempdir().unwrap();
    let (side, mut state) = (200u32, 12_345u64);
    let mut random = || {
        state = (state * 1_103_515_245 + 12_345) % (1 << 31);
        state as f64 / f64::from(1u32 << 31)
    };
    let beads: Vec<[f64; 2]> = (0..80).map(|_| [4.0 + 192.0 * random(), 4.0 + 192.0 * random()]).collect();
    let mut plane = |k: u32| -> Vec<u16> {
        let variance = 1.44 + (f64::from(k) - 7.0).powi(2);
        let light = |x: f64, y: f64| {
            let of = |[u, v]: &[f64; 2]| (-0.5 * ((x - u).powi(2) + (y - v).powi(2)) / variance).exp();
            20_000.0 / variance * beads.iter().map(of).sum::<f64>()
        };
        let pixel = |i: u32| 100.0 + light(f64::from(i % side), f64::from(i / side)) + 6.0 * random();
        (0..side * side).map(pixel).map(|count| count.min(65_535.0) as u16).collect()
    };
    let planes: Vec<Vec<u16>> = (0..15).map(&mut plane).collect();
    let (scan, frame, out) =
        (place.path().join("s.tif"), place.path().join("f.tif"), place.path().join("out"));
    write_pages(&scan, (side, side), &planes).unwrap();
    write_pages(&frame, (side, side), &planes[7..8]).unwrap();
    let scale = ["--magnification", "60", "--pixel-size", "6.5", "--z-step", "1"];
    let own = ["import", "--images", path(&frame), "--scan", path(&scan), "--out", path(&out)];
    let made = json(&[&own[..], &scale].concat());
    // The images far from focus overlap everywhere; windows as wide as these hold no single particle.
    assert!(made["warnings"].to_string().contains("as the spacing of the particles allows"), "{made}");
    assert!(made["places"][0]["particles"].as_u64().unwrap() >= 3, "{made}");
}

#[test]
fn images_that_cannot_be_imported_are_refused_by_file_page_and_value() {
    let recording = Recording::new();
    let pixels = (SIDE * SIDE) as usize;
    let file = |name: &str| File::create(recording.at(name)).unwrap();
    TiffEncoder::new(file("float.tif"))
        .unwrap()
        .write_image::<Gray32Float>(SIDE, SIDE, &vec![1.0; pixels])
        .unwrap();
    TiffEncoder::new(file("color.tif"))
        .unwrap()
        .write_image::<RGB8>(SIDE, SIDE, &vec![1; 3 * pixels])
        .unwrap();
    write_pages(&recording.at("cropped.tif"), (100, 80), &[vec![300; 8000]]).unwrap();
    std::fs::write(recording.at("text.tif"), "no image").unwrap();
    std::fs::write(recording.at("late.csv"), "frame,z_um\n0,1\n9,2\n").unwrap();
    std::fs::write(recording.at("beyond.csv"), "frame,x_px,y_px\n0,10,400\n").unwrap();
    std::fs::write(recording.at("other.csv"), "time,depth\n0,10\n").unwrap();
    for (images, more, found) in [
        ("float.tif", vec![], "float.tif: page 0: floating-point numbers of 32 bit"),
        ("color.tif", vec![], "color.tif: page 0: RGB(8)"),
        ("cropped.tif", vec![], "cropped.tif: page 0: 100 x 80 px: expected 240 x 240 px, as the scan"),
        ("text.tif", vec![], "text.tif: "),
        ("nothing*.tif", vec![], "no file has such a name"),
        ("run.ome.tif", vec![], "2 pages for each time (2 channels, OME-XML): give --page, 0 to 1"),
        ("run.ome.tif", vec!["--page", "2"], "--page 2"),
        (
            "run.ome.tif",
            vec!["--pages-per-time", "5", "--page", "0"],
            "expected a multiple of --pages-per-time 5",
        ),
    ] {
        let message = recording.refused(images, "scan.tif", &more);
        assert!(message.contains(found), "{images}: {message}");
    }
    for (table, found) in [
        ("late.csv", "late.csv:3: frame = 9: expected 0 to 5"),
        ("beyond.csv", "beyond.csv:2: y_px = 400: expected 0.5 to 240.5"),
        ("other.csv", "column frame is missing"),
    ] {
        let table = recording.at(table);
        let message = recording.refused("run.ome.tif", "scan.tif", &["--page", "1", "--truth", path(&table)]);
        assert!(message.contains(found), "{message}");
    }
}

#[test]
fn scans_without_single_particles_are_refused_and_poor_ones_are_warned_of() {
    let recording = Recording::new();
    let write = |name: &str, scan: &SimulatedScan, saturated: bool| {
        // A camera of 10 bit.
        let limit = |count: u16| if saturated { count.min(1023) } else { count };
        let planes: Vec<Vec<u16>> =
            scan.planes(1).unwrap().into_iter().map(|plane| plane.into_iter().map(limit).collect()).collect();
        write_pages(&recording.at(name), (SIDE, SIDE), &planes).unwrap();
    };
    let step = |images: &str, scan: &str| {
        let mut arguments = recording.arguments(images, scan, &["--page", "1"]);
        let z = arguments.iter().position(|text| text == "--z").unwrap();
        arguments[z] = "--z-step".to_owned();
        arguments[z + 1] = "4".to_owned();
        arguments
    };
    let refused = |scan: &str| fail(2, &step("run.ome.tif", scan));

    write("saturated.tif", &target(), true);
    let message = refused("saturated.tif");
    assert!(message.contains("9 saturated") && message.contains("exposure"), "{message}");

    // Pairs of particles side by side, each in another direction.
    let twin = |(k, bead): (usize, &Bead)| {
        let angle = 0.7 * k as f64;
        let by = |sign: f64| Bead {
            x_px: bead.x_px + sign * 1.6 * angle.cos(),
            y_px: bead.y_px + sign * 1.6 * angle.sin(),
            ..*bead
        };
        [by(1.0), by(-1.0)]
    };
    let beads = target().beads.iter().enumerate().flat_map(twin).collect();
    write("doublets.tif", &SimulatedScan { beads, ..target() }, false);
    let message = refused("doublets.tif");
    assert!(message.contains("no single particle"), "{message}");

    write("empty.tif", &SimulatedScan { beads: Vec::new(), ..target() }, false);
    assert!(refused("empty.tif").contains("empty.tif: no particle found"), "{}", refused("empty.tif"));

    let corner =
        SimulatedScan { beads: vec![Bead { x_px: 4.0, y_px: 5.0, ..target().beads[0] }], ..target() };
    write("corner.tif", &corner, false);
    let message = refused("corner.tif");
    assert!(message.contains("none of 1 particles") && message.contains("1 cut by the edge"), "{message}");

    write("one.tif", &SimulatedScan { beads: vec![target().beads[4]], ..target() }, false);
    let made = json(&step("run.ome.tif", "one.tif"));
    let warnings = made["warnings"].to_string();
    assert!(warnings.contains("one particle"), "{warnings}");
    // Without repeated frames the noise of the light is unknown.
    assert_eq!(
        (made["noise"]["variance"].as_array().unwrap().len(), &made["noise"]["repeats"]),
        (1, &1.into())
    );

    let mut without = recording.arguments("run.ome.tif", "scan.tif", &["--page", "1"]);
    let z = without.iter().position(|text| text == "--z").unwrap();
    without.drain(z..z + 2);
    without.push("--force".to_owned());
    let message = fail(2, &without);
    assert!(message.contains("stage positions are unknown; give --z or --z-step"), "{message}");
}
