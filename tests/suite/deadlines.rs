//! Deadlines of challenges and publication of their truth.

use std::fs;
use std::path::{Path, PathBuf};

use suite::microsig::{fail, microsig, path, run, succeed};

use crate::release::{CHALLENGE, submission, unpack};

/// A challenge of the shared dataset.
fn challenge(place: &Path, name: &str, more: &[&str]) -> PathBuf {
    let out = place.join(name);
    run(&[&["release", path(&CHALLENGE.dataset), "--out", path(&out), "--quiet"], more].concat());
    out
}

/// SHA-256 of several files in a row, as of `cat A B | sha256sum`.
fn sha256(files: &[PathBuf]) -> String {
    let all: Vec<u8> = files.iter().flat_map(|file| fs::read(file).unwrap()).collect();
    suite::sha256_of(&all)
}

#[test]
fn the_truth_is_published_after_the_deadline_and_is_the_promised_one() {
    let place = tempfile::tempdir().unwrap();
    let over = challenge(place.path(), "over", &["--deadline", "9999-12-31"]);
    // Until it is over.
    let manifest = over.join("public/datapackage.json");
    let text = fs::read_to_string(&manifest).unwrap();
    fs::write(&manifest, text.replace("9999-12-31", "2020-02-29")).unwrap();
    let before = suite::tree(&over).unwrap();
    let truth = place.path().join("truth");
    run(&["reveal", path(&over), "--out", path(&truth)]);
    assert!(suite::tree(&over).unwrap() == before, "the challenge is unchanged");
    let files: Vec<String> =
        suite::tree(&truth).unwrap().into_keys().filter(|name| !name.starts_with('.')).collect();
    let expected = ["README.md", "SHA256SUMS", "commitment.sha256", "salt.bin", "small-test-truth.zip"];
    assert_eq!(files, expected);

    // With what participants have: the commitment and the images of the public part.
    let commitment = fs::read_to_string(over.join("public/commitment.sha256")).unwrap();
    let found = sha256(&["salt.bin", "small-test-truth.zip"].map(|name| truth.join(name)));
    assert_eq!(commitment, format!("{found}  -\n"));
    let (images, revealed) = (place.path().join("images"), place.path().join("revealed"));
    unpack(&over.join("public/small-test.zip"), &images);
    unpack(&truth.join("small-test-truth.zip"), &revealed);
    fs::rename(images.join("small-test/images"), revealed.join("small-test/images")).unwrap();
    run(&["verify", path(&revealed.join("small-test")), "--regenerate"]);

    assert!(fail(2, &["reveal", path(&over), "--out", path(&truth)]).contains("--force"));
}

#[test]
fn before_the_deadline_only_an_option_publishes_the_truth() {
    let place = tempfile::tempdir().unwrap();
    let open = challenge(place.path(), "open", &["--deadline", "9999-12-31"]);
    let truth = place.path().join("truth");
    let reveal = |of: &Path| fail(2, &["reveal", path(of), "--out", path(&truth)]);
    for (of, expected) in [
        (open.as_path(), "its deadline is 9999-12-31"),
        (&CHALLENGE.out, "states no deadline; --early"),
        (&CHALLENGE.dataset, "not a challenge made by `microsig release`"),
    ] {
        let message = reveal(of);
        assert!(message.contains(expected) && !truth.exists(), "{message}");
    }
    run(&["reveal", path(&open), "--out", path(&truth), "--early"]);
    assert!(truth.join("salt.bin").is_file());

    // Participants read the deadline on the page, in the manifests and in the check of their submission, which
    // tells that it has passed.
    for file in ["README.md", "datapackage.json"] {
        let text = fs::read_to_string(open.join("public").join(file)).unwrap();
        assert!(text.contains("9999-12-31"), "{file}");
    }
    let unpacked = place.path().join("test");
    unpack(&open.join("public/small-test.zip"), &unpacked);
    let test = unpacked.join("small-test");
    let good = submission(place.path(), &suite::microsig::images_sha256(&test));
    let manifest = test.join("datapackage.json");
    let text = fs::read_to_string(&manifest).unwrap();
    for (day, is_over) in [("9999-12-31", false), ("2020-02-29", true)] {
        fs::write(&manifest, text.replace("9999-12-31", day)).unwrap();
        let output = succeed(microsig().args(["check-submission", path(&test), path(&good)]));
        let told = suite::microsig::text(&[output.stdout, output.stderr].concat());
        assert!(told.contains(&format!("; deadline {day}")), "{told}");
        assert_eq!(told.contains("has passed"), is_over, "{told}");
    }
}
