//! The same result in many formats gives the same scores; malicious files give clear errors with little
//! memory.

use std::path::{Path, PathBuf};
use std::process::Command;

use scoring::results::{Conventions, TrackerResult, read};
use suite::microsig::{fail, microsig, path, run, write};

fn folder() -> PathBuf {
    suite::data().join("formats")
}

fn given() -> Conventions {
    Conventions { um_per_px: Some(0.645), depth_um: Some((-10.0, 10.0)), ..Conventions::default() }
}

/// The rows of docs/conventions.md: files that other programs wrote, the options that read them, and the errors.
#[test]
fn files_of_other_programs_are_read_as_the_page_says() {
    let place = tempfile::tempdir().unwrap();
    let root = suite::data().join("../..");
    let scenario = std::fs::read_to_string(root.join("examples/conventions/scenario.ron")).unwrap();
    let dataset = suite::microsig::generate(place.path(), "conventions", &scenario);
    let page = std::fs::read_to_string(root.join("docs/conventions.md")).unwrap();
    let mut files = Vec::new();
    for row in page.lines().filter(|line| line.starts_with("| ") && line.contains("(`c")) {
        let cells: Vec<&str> = row.split('|').map(|cell| cell.trim().trim_matches('`')).collect();
        let (file, options, expected) = (cells[3], cells[8].replace("no option", ""), cells[9]);
        let (out, result) = (place.path().join(file), suite::data().join("conventions").join(file));
        let mut arguments = vec!["evaluate", path(&dataset), path(&result), "--out", path(&out)];
        arguments.extend(options.split_whitespace());
        run(&arguments);
        let text = std::fs::read_to_string(out.join("score.json")).unwrap();
        let score: serde_json::Value = serde_json::from_str(&text).unwrap();
        let field = |axis: &str| score["field"][axis]["rms_px"].as_f64();
        let rms = match field("u").zip(field("v")) {
            Some((u, v)) => u.hypot(v),
            None => score["detection"]["rmse_xy_px"].as_f64().unwrap(),
        };
        assert_eq!(format!("{rms:.4}"), expected, "{row}");
        assert_eq!(score["hints"].as_array().map(Vec::len), Some(0), "{row}: {}", score["hints"]);
        files.push(file.to_owned());
    }
    let all = std::fs::read_dir(suite::data().join("conventions")).unwrap();
    let mut all: Vec<String> = all.map(|f| f.unwrap().file_name().to_string_lossy().into_owned()).collect();
    files.sort();
    all.sort();
    assert_eq!(files, all);
}

#[test]
fn a_column_of_depths_that_is_empty_in_every_row_is_no_depth() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("r.csv");
    for (rows, has_z, n, expected) in [
        ("0,1,2,3,\n1,1,2,3,NA\n", false, 2, "z is empty in every row: no depth"),
        ("0,1,2,3,\n1,1,2,3,-4\n2,1,,3,5\n", true, 1, "2 rows without coordinates were dropped (lines 2, 4)"),
    ] {
        std::fs::write(&file, format!("frame,track,x_px,y_px,z_um\n{rows}")).unwrap();
        let TrackerResult::Points(points) = read(&file, &given()).unwrap() else { panic!("a field") };
        assert_eq!((points.has_z, points.rows.len(), points.lines.len()), (has_z, n, n), "{rows}");
        assert!(points.notes.iter().any(|note| note == expected), "{:?}", points.notes);
    }
    std::fs::write(&file, "frame,x_px,y_px\n0,2,3\n").unwrap();
    let one = Conventions { frame_base: Some(1), ..given() };
    let said = read(&file, &one).unwrap_err().to_string();
    assert!(said.ends_with("from 1 on (--frame-base, in Python frame_base)"), "{said}");
}

#[test]
fn pivlab_files_are_read_whatever_separates_their_columns() {
    let place = tempfile::tempdir().unwrap();
    let vectors = |name: &str, text: &str| {
        let file = write(place.path(), name, text);
        match read(&file, &Conventions::default()).unwrap() {
            TrackerResult::Field(field) => field.vectors,
            TrackerResult::Points(_) => panic!("{name}: particles"),
        }
    };
    let text = std::fs::read_to_string(folder().join("pivlab.txt")).unwrap();
    let commas = vectors("commas.txt", &text);
    let lines: Vec<&str> = text.lines().collect();
    for (name, separator) in [("tabs.txt", "\t"), ("spaces.txt", " ")] {
        let table = lines[2..].join("\r\n").replace(',', separator);
        let read = vectors(name, &format!("{}\r\n{}\r\n{table}\r\n", lines[0], lines[1]));
        // Invalid displacements are NaN, which is not equal to itself.
        assert_eq!(format!("{read:?}"), format!("{commas:?}"), "{name}");
    }
}

fn read_error(file: &Path) -> String {
    read(file, &Conventions::default()).unwrap_err().to_string()
}

#[test]
fn velocities_are_read_with_their_unit() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("r.csv");
    let read_with = |header: &str| {
        std::fs::write(&file, format!("frame,x_px,y_px,{header}\n0,4.5,2,1.5,-2,\n")).unwrap();
        let up = Conventions { y_up: Some(true), height_px: Some(9.0), ..Conventions::default() };
        let TrackerResult::Points(points) = read(&file, &up).unwrap() else { panic!("no particles") };
        (format!("{:?}", points.velocities), points.notes)
    };
    let (velocities, notes) = read_with("u_um_s,v_um_s,w_um_s");
    assert_eq!(velocities, "Some(Velocities { unit: UmPerS, rows: [[1.5, 2.0, NaN]] })");
    assert!(notes.iter().any(|n| n.contains("u_um_s, v_um_s, w_um_s are velocities in um/s")), "{notes:?}");
    let (velocities, notes) = read_with("vx,vy,vz");
    assert_eq!(velocities, "Some(Velocities { unit: PerFrame, rows: [[1.5, 2.0, NaN]] })");
    assert!(notes.iter().any(|n| n.contains("px per frame")), "{notes:?}");
    std::fs::write(&file, "frame,x_px,y_px,vx,vy\n0,4.5,2,1,inf\n").unwrap();
    assert!(read_error(&file).contains(":2: vy = inf: expected "), "{}", read_error(&file));
}

#[test]
fn rows_without_coordinates_are_told_with_their_lines() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("r.csv");
    let rows = "0,,5,2,1,0\n0,0,nan,2,1,0\n0,0,4,2,1,0\n0,0,,2,1,0\n";
    for (header, dropped) in [("frame,track,x_px,y_px,a,b\n", 2), ("pair,dy_px,x_px,y_px,dx_px,b\n", 2)] {
        std::fs::write(&file, format!("{header}{rows}")).unwrap();
        let (n, notes) = match read(&file, &Conventions::default()).unwrap() {
            TrackerResult::Points(p) => (p.n_nan, p.notes),
            TrackerResult::Field(f) => (f.n_nan, f.notes),
        };
        let expected = "2 rows without coordinates were dropped (lines 3, 5)";
        assert!(n == dropped && notes.iter().any(|n| n == expected), "{n} {notes:?}");
    }
    // The challenge trims missing points at the ends of tracks and drops tracks with missing points in
    // between.
    let detection = |t: u32, x: &str| format!("<detection t=\"{t}\" x=\"{x}\" y=\"1\" z=\"0\"/>");
    let track = |xs: [&str; 3]| {
        let all: String = (0..).zip(xs).map(|(t, x)| detection(t, x)).collect();
        format!("<particle>{all}</particle>")
    };
    let tracks = [["NaN", "2", "3"], ["4", "NaN", "5"], ["6", "7", "8"]].map(track).concat();
    let text = format!("<root><TrackContestISBI2012>{tracks}</TrackContestISBI2012></root>");
    std::fs::write(&file, text).unwrap();
    let TrackerResult::Points(points) = read(&file, &Conventions::default()).unwrap() else {
        panic!("no particles")
    };
    let kept: Vec<(i64, f64)> = points.rows.iter().map(|r| (r.track, r.at.x_px)).collect();
    assert_eq!(kept, [(0, 3.0), (0, 4.0), (2, 7.0), (2, 8.0), (2, 9.0)]);
    assert_eq!(points.n_nan, 4);
    let note = "4 detections without coordinates were dropped, with all of 1 tracks";
    assert!(points.notes.iter().any(|n| n.starts_with(note)), "{:?}", points.notes);
}

/// Every readable file, a coordinate or displacement as written in it, and whether it is a field.
const READ: [(&str, &str, bool); 13] = [
    ("canonical.csv", "10.3", false),
    ("trackpy.csv", "9.3", false),
    ("trackmate_spots.csv", "5.9985", false),
    ("trackmate_tracks.xml", "5.9985", false),
    ("trackmate_model.xml", "5.9985", false),
    ("isbi2012.xml", "9.3", false),
    ("defocustracker.csv", "10.3", false),
    ("defocustracker_ascii.txt", "1.03000e+01", false),
    ("napari_tracks.csv", "9.4", false),
    ("field_canonical.csv", "1.16", true),
    ("openpiv.txt", "1.1600e+00", true),
    ("pivlab.txt", "1.16", true),
    ("dense.flo", "", true),
];

/// Runs the command with 1 GiB of address space; returns exit code and standard error.
fn confined(arguments: &[&str]) -> (Option<i32>, String) {
    let program = microsig().get_program().to_owned();
    let output = Command::new("bash")
        .args(["-c", "ulimit -v 1048576; exec \"$0\" \"$@\""])
        .arg(program)
        .args(arguments)
        .output()
        .unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

const DETECTIONS: &str = "<detection t=\"0\" x=\"1\" y=\"1\" z=\"0\"/>";

/// Names, contents, and what the message says.
fn hostile_files() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let t = |text: &str| text.as_bytes().to_vec();
    let flo = |width: i32, height: i32, rest: usize| {
        let mut bytes = t("PIEH");
        bytes.extend(width.to_le_bytes());
        bytes.extend(height.to_le_bytes());
        bytes.resize(12 + rest, 0);
        bytes
    };
    let bomb = "<?xml version=\"1.0\"?><!DOCTYPE a [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;\">]>\
                <Tracks><particle><detection t=\"&b;\" x=\"1\" y=\"1\" z=\"0\"/></particle></Tracks>";
    vec![
        ("large.csv", t("frame,track,x_px,y_px\n0,0,1e308,1\n"), ":2: x = 1e308"),
        ("infinite.csv", t("frame,track,x_px,y_px\n0,0,inf,1\n"), ":2: x = inf"),
        ("frame.csv", t("frame,track,x_px,y_px\n1e300,0,1,1\n"), ":2: frame = 1e300"),
        ("frame2.csv", t("frame,track,x_px,y_px\n0.5,0,1,1\n"), ":2: frame = 0.5"),
        ("track.csv", t("frame,track,x_px,y_px\n0,1e300,1,1\n"), ":2: track = 1"),
        (
            "claim.csv",
            t("frame,track,x_px,y_px,sx_px\n0,1,4.5,2,-0.1\n"),
            ":2: sx_px = -0.1: expected 0.0 to 1e9",
        ),
        ("twice.csv", t("frame,track,x_px,y_px\n0,3,1,1\n0,3,2,2\n"), "track 3 appears twice in frame 0"),
        ("workbook.xlsx", b"PK\x03\x04\x14\0\x06\0".to_vec(), "save the sheet as CSV"),
        ("empty.csv", Vec::new(), "empty"),
        ("names.csv", t("frame,track,x,y\n0,3,1,5\n"), "have no units"),
        (
            "long.csv",
            [t("frame,track,x_px,y_px\n"), vec![b'1'; 10 << 20]].concat(),
            "line 2: the line is longer",
        ),
        ("longer.csv", vec![b'1'; 10 << 20], "longer than"),
        ("claim.flo", flo(i32::MAX, i32::MAX, 0), "2147483647 x 2147483647 px"),
        ("short.flo", flo(100, 100, 79_999), "need 80012 bytes; the file has 80011"),
        ("negative.flo", flo(-1, 5, 40), "-1 x 5 px"),
        ("header.flo", b"PIEH\x01".to_vec(), "shorter than the header"),
        ("bomb.xml", t(bomb), "document type"),
        (
            "long.xml",
            [t("<Tracks><particle><detection t=\""), vec![b'1'; 10 << 20]].concat(),
            "a tag or text is longer",
        ),
        ("open.xml", format!("<Tracks><particle>{DETECTIONS}").into_bytes(), "open.xml"),
        ("unclosed.xml", t("<Tracks><particle><detection t=\"1\""), "unclosed.xml"),
        (
            "words.xml",
            t("<Tracks><particle><detection t=\"a\" x=\"1\" y=\"1\" z=\"0\"/></particle></Tracks>"),
            "t = \"a\"",
        ),
        ("field.csv", t("x_px,y_px,dx_px,dy_px\n1,1,1e308,0\n"), ":2: 1e308: "),
        ("flag.csv", t("x_px,y_px,dx_px,dy_px,flag\n1,1,1,0,7\n"), ":2: flag = 7"),
        ("openpiv.txt", t("# x\ty\tu\tv\tflags\tmask\n1\t1\tx\t0\t0\t0\n"), ":2: u = \"x\""),
        ("openpiv7.txt", t("# x\ty\tu\tv\tflags\tmask\n1\t1\t1\t0\t7\t0\n"), ":2: flags = 7"),
        ("same.csv", t("frame,track,x_px,y_px,x_px\n0,0,1,1,2\n"), "column x_px appears twice"),
        ("pivlab.txt", t("PIVlab\nFRAME\nx [mm],y [mm],u [mm/s],v [mm/s]\n1,1,1,1\n"), "give --dt"),
        ("binary.csv", vec![0xff; 4000], "fits no format"),
        ("column.csv", t("frame,track,x_px\n0,0,1\n"), "expected columns frame, track, x_px, y_px"),
    ]
}

#[test]
fn hostile_files_are_refused_within_a_gigabyte() {
    let place = tempfile::tempdir().unwrap();
    let truth = folder().join("canonical.csv");
    let field_truth = folder().join("field_canonical.csv");
    for (name, bytes, expected) in hostile_files() {
        let file = write(place.path(), name, bytes);
        let arguments = ["evaluate", path(&truth), path(&file), "--um-per-px", "0.645", "--threads", "1"];
        let (code, message) = confined(&arguments);
        assert_eq!(code, Some(2), "{name}: {message}");
        assert!(message.contains(expected), "{name}: {message}");
        assert!(message.len() < 4000, "{name}: {} bytes of message", message.len());
    }
    // In every format: a line of 10 MB, an implausibly large number, truncation at any byte; never a panic.
    for (name, number, is_field) in READ {
        let whole = std::fs::read(folder().join(name)).unwrap();
        let file = place.path().join(name);
        let run = |bytes: Vec<u8>| {
            std::fs::write(&file, bytes).unwrap();
            let known = ["--depth", "-10", "10", "--threads", "1", "--quiet", "--um-per-px", "0.645"];
            // Fields are in px; with a scale, those without units would be in a physical unit.
            let (truth, known) = if is_field { (&field_truth, &known[..6]) } else { (&truth, &known[..]) };
            confined(&[&["evaluate", path(truth), path(&file)], known].concat())
        };
        let long = [&whole[..], &vec![b'7'; 10 << 20]].concat();
        let (code, message) = run(long);
        let expected = if name.ends_with(".flo") { "bytes" } else { "longer than" };
        assert_eq!(code, Some(2), "{name} with a long line: {message}");
        assert!(message.contains(expected) && message.len() < 4000, "{name} with a long line: {message}");
        if let Ok(text) = std::str::from_utf8(&whole) {
            assert!(text.contains(number), "{name}");
            let (code, message) = run(text.replacen(number, "1e308", 1).into_bytes());
            assert_eq!(code, Some(2), "{name} with 1e308: {message}");
            assert!(message.contains("308") || message.contains("inf"), "{name} with 1e308: {message}");
        }
        for part in 1..8 {
            std::fs::write(&file, &whole[..part * whole.len() / 8]).unwrap();
            // Only a file truncated between two lines is a valid, shorter table.
            let read = read(&file, &given());
            assert!(!name.ends_with(".flo") || read.is_err(), "{name}, {part}/8 of it");
        }
    }
    // A header that claims a billion rows is refused without allocating memory.
    let claim = format!(
        "<Tracks nTracks=\"1000000000\"><particle nSpots=\"1000000000\">{DETECTIONS}</particle></Tracks>"
    );
    let file = write(place.path(), "claim.xml", claim);
    let arguments =
        ["evaluate", path(&truth), path(&file), "--um-per-px", "0.645", "--threads", "1", "--quiet"];
    let (code, message) = confined(&arguments);
    assert!(code == Some(2) && message.contains("nTracks"), "{message}");
}

#[test]
fn what_is_not_known_is_asked_for() {
    let truth = folder().join("canonical.csv");
    let ask = |file: &str| fail(2, &["evaluate", path(&truth), path(&folder().join(file))]);
    assert!(ask("trackmate_spots.csv").contains("--um-per-px"));
    assert!(ask("defocustracker.csv").contains("--depth"));
    let validate = |file: &Path| run(&["evaluate", path(&truth), path(file), "--validate-only"]);
    assert!(validate(&folder().join("isbi2012.xml")).contains("25 particles"));
    assert!(validate(&folder().join("openpiv.txt")).contains("20 vectors"));
}

#[test]
fn formats_that_are_not_read_yet_are_named() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("result");
    for (head, name) in [
        (&b"2\n   1    6.644    6.708    0.000    1   -1   -1   -1\n"[..], "OpenPTV"),
        (b"2\n  -1    0      6.644      6.708      0.000\n", "OpenPTV"),
        (b"0\t6.644\t6.708\t0.000\t0\t-1\t-1\t0.020\t0.000\n", "MyPTV"),
        (b"\x89PNG\r\n\x1a\n", "KITTI"),
    ] {
        std::fs::write(&file, head).unwrap();
        let message = read_error(&file);
        assert!(message.contains(name) && message.contains("cannot be read; write a CSV"), "{message}");
        // KITTI is a format of fields.
        assert_eq!(message.contains("dx_px"), name == "KITTI", "{message}");
    }
}
