//! Challenges: what is published, what is withheld, what each side can check, and what cannot be found out.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use suite::leak::{Files, Known, guess_by_noise, guess_by_place, unzip};
use suite::microsig::{fail, path, run};

/// A seed that cannot occur anywhere by chance.
const SEED: u64 = 8_246_017_395_284_410_067;

fn scenario(seed: u64) -> String {
    format!(
        r#"(
    name: "small",
    seed: {seed},
    optics: (pixel_dim_x: 120, pixel_dim_y: 90),
    motion: flow(field: poiseuille(max_speed_um_s: 6000)),
    particles: (number: count(12)),
    timing: sequence(frames: 8, dt_s: 0.002),
)"#
    )
}

fn generate(folder: &Path, name: &str, scenario: &str) -> PathBuf {
    let (file, out) = (folder.join(format!("{name}.ron")), folder.join(name));
    std::fs::write(&file, scenario).unwrap();
    run(&["generate", path(&file), "--out", path(&out)]);
    out
}

/// A dataset and a challenge made of it, for all tests that only read.
struct Challenge {
    _place: tempfile::TempDir,
    dataset: PathBuf,
    out: PathBuf,
    /// The public test split, unpacked.
    test: PathBuf,
}

static CHALLENGE: LazyLock<Challenge> = LazyLock::new(|| {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", &scenario(SEED));
    let (out, unpacked) = (place.path().join("challenge"), place.path().join("unpacked"));
    let (creator, val) = (["--creator", "Doe, Jane"], ["--val", "4"]);
    run(&[&["release", path(&dataset), "--out", path(&out)], &creator[..], &val[..]].concat());
    unpack(&out.join("public/small-test.zip"), &unpacked);
    Challenge { _place: place, dataset, out, test: unpacked.join("small-test") }
});

fn unpack(archive: &Path, folder: &Path) {
    for (name, bytes) in unzip(archive).unwrap() {
        let file = folder.join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, bytes).unwrap();
    }
}

/// Everything that is published, decompressed, archives' files under their own names.
fn published() -> Files {
    let mut files = Files::new();
    for entry in std::fs::read_dir(CHALLENGE.out.join("public")).unwrap() {
        let file = entry.unwrap().path();
        let name = file.file_name().unwrap().to_str().unwrap().to_owned();
        match name.as_str() {
            "small-test.zip" => files.extend(unzip(&file).unwrap()),
            // What train and val tell is theirs; of the test split nothing must be in them either, but names.
            _ if name.ends_with(".zip") => {}
            _ => drop(files.insert(name, std::fs::read(&file).unwrap())),
        }
    }
    files
}

fn known() -> Known {
    let val = bench::release::derived_seed(SEED, "val");
    Known::of(&CHALLENGE.out.join("withheld/test"), &[SEED, val]).unwrap()
}

fn listing(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn check_sums(folder: &Path) {
    let text = std::fs::read_to_string(folder.join("SHA256SUMS")).unwrap();
    for line in text.lines() {
        let (hash, file) = line.split_once("  ").unwrap();
        assert_eq!(suite::sha256(&folder.join(file)).unwrap(), hash, "{file}");
    }
}

fn sha256(parts: &[Vec<u8>]) -> String {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("parts");
    std::fs::write(&file, parts.concat()).unwrap();
    suite::sha256(&file).unwrap()
}

#[test]
fn a_release_has_a_public_and_a_withheld_part() {
    let c = &*CHALLENGE;
    let public = c.out.join("public");
    let flat = [
        ".zenodo.json",
        "CITATION.cff",
        "LICENSE",
        "README.md",
        "SHA256SUMS",
        "commitment.sha256",
        "croissant.json",
        "datapackage.json",
        "small-test.zip",
        "small-train.zip",
        "small-val.zip",
    ];
    assert_eq!(listing(&public), flat);
    assert_eq!(listing(&c.out.join("withheld")), ["README.md", "salt.bin", "small-test-truth.zip", "test"]);
    check_sums(&public);
    check_sums(&c.test);

    // Train is the dataset, val can be made again by anybody, test by whoever has the key.
    let place = tempfile::tempdir().unwrap();
    for split in ["train", "val"] {
        unpack(&public.join(format!("small-{split}.zip")), place.path());
        run(&["verify", path(&place.path().join(format!("small-{split}"))), "--regenerate"]);
    }
    let sums = |d: &Path| std::fs::read_to_string(d.join("SHA256SUMS")).unwrap();
    assert_eq!(sums(&place.path().join("small-train")), sums(&c.dataset));
    run(&["verify", path(&c.out.join("withheld/test")), "--regenerate"]);
    assert_eq!(listing(&c.test.join("images")).len(), 8);
    assert_eq!(listing(&place.path().join("small-val/images")).len(), 4);
}

#[test]
fn the_revealed_truth_is_the_promised_one_and_makes_the_public_images() {
    let c = &*CHALLENGE;
    let withheld = c.out.join("withheld");
    let read = |file: &str| std::fs::read(withheld.join(file)).unwrap();
    let promised = std::fs::read_to_string(c.out.join("public/commitment.sha256")).unwrap();
    let (salt, truth) = (read("salt.bin"), read("small-test-truth.zip"));
    assert_eq!(promised, sha256(&[salt.clone(), truth.clone()]) + "  -\n");
    assert_ne!(
        promised,
        sha256(std::slice::from_ref(&truth)) + "  -\n",
        "without salt a guessed truth could be checked"
    );
    let mut other = truth;
    other[100] ^= 1;
    assert_ne!(promised, sha256(&[salt, other]) + "  -\n");

    // As README.md says: the archive, and the images that were public all the time.
    let place = tempfile::tempdir().unwrap();
    unpack(&withheld.join("small-test-truth.zip"), place.path());
    let revealed = place.path().join("small-test");
    std::fs::create_dir(revealed.join("images")).unwrap();
    for image in listing(&c.test.join("images")) {
        std::fs::copy(c.test.join("images").join(&image), revealed.join("images").join(&image)).unwrap();
    }
    run(&["verify", path(&revealed), "--regenerate"]);

    // With another key other bytes are made.
    let key = std::fs::read_to_string(revealed.join("secret_key.txt")).unwrap();
    let flipped = if key.starts_with('0') { "1" } else { "0" };
    std::fs::write(revealed.join("secret_key.txt"), format!("{flipped}{}", &key[1..])).unwrap();
    assert!(fail(1, &["verify", path(&revealed)]).contains("secret_key.txt: changed"));
}

#[test]
fn train_and_val_are_the_same_every_time_and_test_never_is() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let again = place.path().join("again");
    run(&["release", path(&c.dataset), "--out", path(&again), "--val", "4"]);
    let read = |out: &Path, file: &str| std::fs::read(out.join("public").join(file)).unwrap();
    for (file, same) in [
        ("small-train.zip", true),
        ("small-val.zip", true),
        ("small-test.zip", false),
        ("commitment.sha256", false),
    ] {
        assert_eq!(read(&c.out, file) == read(&again, file), same, "{file}");
    }
    assert!(fail(2, &["release", path(&c.dataset), "--out", path(&again)]).contains("exists already"));
    run(&["release", path(&c.dataset), "--out", path(&again), "--force", "--quiet"]);
}

/// A submission folder whose points are the truth's.
fn submission(folder: &Path, images_sha256: &str) -> PathBuf {
    let c = &*CHALLENGE;
    let out = folder.join("submission");
    std::fs::create_dir_all(&out).unwrap();
    std::fs::copy(c.out.join("withheld/test/truth/tracks.csv"), out.join("results.csv")).unwrap();
    let mut about: serde_json::Value =
        serde_json::from_slice(&std::fs::read(c.test.join("submission/submission.json")).unwrap()).unwrap();
    for (key, value) in [("team", "A"), ("method", "truth"), ("version", "1"), ("hardware", "paper")] {
        about[key] = value.into();
    }
    about["runtime_s"] = 1.5.into();
    about["images_sha256"] = images_sha256.into();
    std::fs::write(out.join("submission.json"), about.to_string()).unwrap();
    out
}

/// What `grep '  images/' SHA256SUMS | sha256sum` says.
fn images_sha256() -> String {
    let sums = std::fs::read_to_string(CHALLENGE.test.join("SHA256SUMS")).unwrap();
    let lines: Vec<Vec<u8>> =
        sums.lines().filter(|l| l.contains("  images/")).map(|l| format!("{l}\n").into_bytes()).collect();
    sha256(&lines)
}

#[test]
fn a_submission_is_checked_without_the_truth_and_scored_with_it() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let good = submission(place.path(), &images_sha256());
    let said = run(&["evaluate", "--validate-only", path(&c.test), path(&good), "--quiet"]);
    assert!(said.contains("a valid submission of A: "), "{said}");

    let score = run(&["evaluate", path(&c.out.join("withheld/test")), path(&good), "--json", "--quiet"]);
    let score: serde_json::Value = serde_json::from_str(&score).unwrap();
    assert_eq!((score["detection"]["f1"].as_f64(), score["links"]["f1"].as_f64()), (Some(1.0), Some(1.0)));

    // The same as an archive.
    let archive = place.path().join("team-a.zip");
    let mut zip = zip::ZipWriter::new(std::fs::File::create(&archive).unwrap());
    for file in ["results.csv", "submission.json"] {
        zip.start_file(format!("team-a/{file}"), zip::write::SimpleFileOptions::default()).unwrap();
        std::io::Write::write_all(&mut zip, &std::fs::read(good.join(file)).unwrap()).unwrap();
    }
    zip.finish().unwrap();
    run(&["evaluate", "--validate-only", path(&c.test), path(&archive), "--quiet"]);
}

#[test]
fn a_test_split_says_that_its_truth_is_withheld() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let result = submission(place.path(), &images_sha256()).join("results.csv");
    let out = place.path().join("out");
    for arguments in [
        vec!["evaluate", path(&c.test), path(&result)],
        vec!["export", path(&c.test), "--format", "isbi", "--out", path(&out)],
        vec!["export", path(&c.test), "--format", "flo", "--out", path(&out)],
    ] {
        let message = fail(2, &arguments);
        assert!(message.contains("a test split, whose truth is withheld"), "{message}");
    }
}

#[test]
fn a_wrong_submission_is_told_what_and_where() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    // The template as it is: every empty entry is named.
    let message = fail(2, &["evaluate", "--validate-only", path(&c.test), path(&c.test.join("submission"))]);
    for expected in ["submission.json: team", "method", "version", "hardware", "images_sha256"] {
        assert!(message.contains(expected), "{expected}: {message}");
    }
    let good = submission(place.path(), &images_sha256());
    let texts: BTreeMap<&str, String> = ["results.csv", "submission.json"]
        .map(|f| (f, std::fs::read_to_string(good.join(f)).unwrap()))
        .into_iter()
        .collect();
    let second = texts["results.csv"].lines().nth(1).unwrap();
    for (file, from, to, expected) in [
        ("results.csv", second, second.replacen("0,", "8,", 1), "results.csv:2: frame = 8: expected 0 to 7"),
        ("results.csv", second, "x".to_owned() + second, "results.csv:2: frame = \"x0\": expected a number"),
        ("results.csv", "x_px", "x_um".to_owned(), "results.csv:1: "),
        ("submission.json", "\"team\":", "\"crew\":".to_owned(), "unknown field `crew`"),
        ("submission.json", "y_px downward", "y_px upward".to_owned(), "coordinate_declaration"),
        ("submission.json", "1.5", "-1.5".to_owned(), "runtime_s: expected a time >= 0"),
        ("submission.json", &images_sha256(), "0".repeat(64), "other images were used"),
    ] {
        std::fs::write(good.join(file), texts[file].replacen(from, &to, 1)).unwrap();
        let message = fail(2, &["evaluate", "--validate-only", path(&c.test), path(&good)]);
        assert!(message.contains(expected), "{expected}: {message}");
        std::fs::write(good.join(file), &texts[file]).unwrap();
    }
    std::fs::remove_file(good.join("submission.json")).unwrap();
    assert!(
        fail(2, &["evaluate", "--validate-only", path(&c.test), path(&good)]).contains("submission.json")
    );
}

#[test]
fn what_cannot_be_released_is_refused_and_leaves_nothing() {
    let place = tempfile::tempdir().unwrap();
    let dataset = generate(place.path(), "dataset", &scenario(1));
    let out = place.path().join("out");
    let refuse = |code: i32, dataset: &Path, more: &[&str], expected: &str| {
        let message = fail(code, &[&["release", path(dataset), "--out", path(&out)], more].concat());
        assert!(message.contains(expected), "{expected}: {message}");
        assert!(!out.exists() && !place.path().join("out.partial").exists(), "{expected}");
    };
    refuse(2, &dataset, &["--test", "0"], "timing.sequence.frames = 0");
    refuse(2, &dataset, &["--test-set", "optics.gain=2"], "participants are told all others");
    refuse(2, &dataset, &["--test-set", "motion.flow.field.poiseuille.speed=2"], "unknown key");
    refuse(2, &CHALLENGE.out.join("withheld/test"), &[], "made from a secret key");

    std::fs::write(place.path().join("places.txt"), "40 30 -20 2\n60 50 0 2\n").unwrap();
    let placed = scenario(1).replace("count(12)", "file(\"places.txt\")");
    let placed = generate(place.path(), "placed", &placed);
    refuse(2, &placed, &[], "particles are placed by a file");

    let image = dataset.join("images/frame_00000.tif");
    let mut bytes = std::fs::read(&image).unwrap();
    bytes[2000] ^= 1;
    std::fs::write(&image, bytes).unwrap();
    refuse(1, &dataset, &[], "frame_00000.tif: changed");
}

#[test]
fn the_test_split_may_hide_another_flow() {
    let c = &*CHALLENGE;
    let place = tempfile::tempdir().unwrap();
    let out = place.path().join("out");
    let hidden = "motion.flow.field.poiseuille.max_speed_um_s=777";
    run(&["release", path(&c.dataset), "--out", path(&out), "--test-set", hidden]);
    let kept = std::fs::read_to_string(out.join("withheld/test/scenario.ron")).unwrap();
    assert!(kept.contains("777"), "{kept}");
    let told = unzip(&out.join("public/small-test.zip")).unwrap();
    assert!(told.values().all(|bytes| !String::from_utf8_lossy(bytes).contains("777.0")));
    run(&["verify", path(&out.join("withheld/test")), "--regenerate"]);
}

#[test]
fn nothing_that_is_published_tells_the_truth() {
    let found = known().told_by(&published());
    assert!(found.is_empty(), "{found:#?}");
}

/// The search is worth something only if it finds what is there.
#[test]
fn the_search_finds_what_is_told() {
    let known = known();
    let tracks = std::fs::read(CHALLENGE.out.join("withheld/test/truth/tracks.csv")).unwrap();
    let key = std::fs::read(CHALLENGE.out.join("withheld/test/secret_key.txt")).unwrap();
    let mut reader = csv::Reader::from_reader(&tracks[..]);
    let rows: Vec<Vec<f64>> = reader
        .records()
        .map(|r| r.unwrap().iter().take(6).map(|t| t.parse().unwrap()).collect::<Vec<f64>>())
        .collect();
    let column = |k: usize| rows.iter().map(move |r| r[k]);
    let mut by_depth: Vec<&Vec<f64>> = rows.iter().filter(|r| r[0] == 0.0).collect();
    by_depth.sort_by(|a, b| a[5].total_cmp(&b[5]));
    let places: String = by_depth.iter().map(|r| format!("{},{:.1},{:.1}\n", r[0], r[3], r[4])).collect();
    let counts = std::fs::read_to_string(CHALLENGE.out.join("withheld/test/truth/frames.csv")).unwrap();
    let noise = |n: usize| -> Vec<u8> { (0..n).map(|i| (i * i * 31 + i / 7) as u8).collect() };
    let hidden = |bytes: Vec<u8>| [noise(101), bytes, noise(50)].concat();
    for (file, bytes, expected) in [
        ("tracks.csv", tracks.clone(), "as text"),
        ("note.txt", format!("the first is at {:.9}", column(3).next().unwrap()).into_bytes(), "as text"),
        ("a.bin", hidden(column(3).flat_map(f64::to_le_bytes).collect()), "as f64"),
        ("b.bin", hidden(column(5).flat_map(f64::to_be_bytes).collect()), "as f64"),
        ("c.bin", hidden(column(4).flat_map(|v| (v as f32).to_le_bytes()).collect()), "as f32"),
        ("d.bin", hidden(column(5).flat_map(|v| (v as f32).to_be_bytes()).collect()), "as f32"),
        ("e.json", format!("{{\"made_from\": {SEED}}}").into_bytes(), "as text"),
        ("f.bin", hidden(SEED.to_be_bytes().to_vec()), "seeds"),
        ("g.txt", key.clone(), "as text"),
        ("h.json", b"{\"n_visible\": 7}".to_vec(), "`n_visible`"),
        ("particles/frame_00000.txt", b"1 2 3 2\n".to_vec(), "a data file"),
        ("places.csv", format!("frame,x_px,y_px\n{places}").into_bytes(), "in the order of depth"),
        ("frames.csv", counts.replace("n_visible", "count").into_bytes(), "number of particles"),
    ] {
        let found = known.told_by(&Files::from([(file.to_owned(), bytes)]));
        assert!(found.iter().any(|f| f.contains(expected)), "{file}: {expected}: {found:?}");
    }
}

/// The first seeds; `cargo xtask leak-search` tries all of 20 bits.
#[test]
fn no_small_seed_makes_the_test_split() {
    const SEEDS: std::ops::Range<u64> = 0..1 << 16;
    let settings = suite::settings(&CHALLENGE.test.join("settings.txt")).unwrap();
    let counts = suite::counts(&CHALLENGE.test.join("images/frame_00000.tif")).unwrap();
    assert_eq!(guess_by_noise(&settings, &counts, SEEDS), None);
    assert_eq!(guess_by_place(&CHALLENGE.out.join("withheld/test"), 0..4000).unwrap(), None);

    // Nor a seed that follows from the public one.
    for name in ["test", "val", "train", "small-test"] {
        let derived = bench::release::derived_seed(SEED, name);
        assert_eq!(guess_by_noise(&settings, &counts, derived..derived + 1), None);
    }

    // A test split drawn from a public seed is found out.
    let place = tempfile::tempdir().unwrap();
    let leaky = generate(place.path(), "leaky", &scenario(54_321));
    let counts = suite::counts(&leaky.join("images/frame_00000.tif")).unwrap();
    assert_eq!(guess_by_noise(&settings, &counts, SEEDS), Some(54_321));
    assert_eq!(guess_by_place(&leaky, 54_000..55_000).unwrap(), Some(54_321));
}
