//! A small challenge: checks of a submission, and of the truth before it is published.

use clap::FromArgMatches;

use super::*;

fn dataset(out: &Path) -> PathBuf {
    let text = r#"(
        name: "small",
        optics: (gaussian: (diameter_px: 3), pixel_dim_x: 60, pixel_dim_y: 40),
        motion: flow(field: poiseuille(max_speed_um_s: 900)),
        particles: (number: count(8)),
        boundaries: (z_um: (-5, 5)),
        timing: sequence(frames: 3),
        calibration: none,
    )"#;
    let scenario = scenario::load_text(text, ("small.ron", out), &[], None, &Context::default()).unwrap();
    let out = out.join("dataset");
    generate(
        &scenario,
        &GenerateOptions { out: out.clone(), force: false, resume: false, progress: Progress::default() },
    )
    .unwrap();
    out
}

#[test]
fn points_outside_the_image_and_the_depth_range_are_counted() {
    let place = tempfile::tempdir().unwrap();
    let test = dataset(place.path());
    let mut about: serde_json::Value = serde_json::from_str(&submission::template(None, &"".into())).unwrap();
    for key in ["team", "method", "version", "hardware"] {
        about[key] = "a".into();
    }
    let sums = std::fs::read_to_string(test.join(SHA256SUMS)).unwrap();
    about["images_sha256"] = checksums::images_digest(&sums).into();
    let folder = place.path().join("submission");
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(folder.join("submission.json"), about.to_string()).unwrap();
    let warnings = |rows: &str| {
        let text = format!("frame,track,x_px,y_px,z_um\n{rows}");
        std::fs::write(folder.join("results.csv"), text).unwrap();
        let files = SubmissionFiles::open(&folder, limits(&test).unwrap()).unwrap();
        validate(&test, &files).unwrap().warnings
    };
    assert_eq!(warnings("0,0,30,20,5\n1,0,60.4,0.5,-5\n2,0,9,9,0\n"), [""; 0]);
    let two = warnings("0,0,30,20,5.1\n1,0,60.6,20,-7\n2,0,9,9,0\n");
    assert_eq!(two, ["1 points lie outside the image", "2 points lie outside the depth range"]);
}

#[test]
fn a_truth_that_was_not_promised_is_not_published() {
    let place = tempfile::tempdir().unwrap();
    let challenge = place.path().join("challenge");
    let arguments = ReleaseOptions::augment_args(clap::Command::new("release"));
    let arguments = arguments.get_matches_from(["release", "--val", "2"]);
    let options = ReleaseOptions::from_arg_matches(&arguments).unwrap();
    let options = ReleaseOptions { out: challenge.clone(), ..options };
    release(&dataset(place.path()), &options).unwrap();
    let reveal = |name: &str| {
        let now = SystemTime::UNIX_EPOCH;
        let out = place.path().join(name);
        reveal(&challenge, &RevealOptions { out, force: false, early: true, now })
    };
    assert_eq!(reveal("promised").unwrap().name, "small");
    std::fs::write(challenge.join("withheld/salt.bin"), [0; 32]).unwrap();
    let message = reveal("other").unwrap_err().to_string();
    assert!(message.contains("they are not the truth that was promised"), "{message}");
    assert!(!place.path().join("other").exists());
}
