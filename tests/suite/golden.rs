//! The bytes of datasets are the same for any number of threads, build profile and CPU feature mask, and
//! equal the stored ones.
//!
//! With `UPDATE_GOLDEN=1` the test writes `data/golden/golden.txt`; a change needs an entry under "Bytes" in CHANGELOG.md,
//! and a new version.

use std::collections::BTreeMap;

use suite::golden::{Golden, Hashes};
use suite::microsig::{microsig, path, run, succeed};

/// Number of threads of a run, and the features that are masked: glibc selects other versions of its math
/// functions without these.
type Run = (&'static str, Option<&'static str>);

const MASKED: Option<&str> = Some("glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable");
const RUNS: [Run; 4] = [("1", None), ("2", MASKED), ("7", None), ("2", None)];

/// The scenarios in `data/golden`.
const NAMES: [&str; 9] =
    ["bursts", "expected", "fields", "pairs", "rods", "sequence", "setting2", "spots", "tracks"];

/// Each dataset in one of three ways.
#[test]
fn datasets_have_the_bytes_they_always_had() {
    assert_golden(|i| vec![RUNS[i % 3]]);
}

#[test]
#[ignore = "slow: .ci/full"]
fn datasets_have_the_same_bytes_in_every_way() {
    assert_golden(|_| RUNS.to_vec());
}

fn assert_golden(runs: impl Fn(usize) -> Vec<Run>) {
    let (place, golden) = (tempfile::tempdir().unwrap(), Golden::read().unwrap());
    let is_update = std::env::var_os("UPDATE_GOLDEN").is_some();
    let mut now = Golden { version: env!("CARGO_PKG_VERSION").to_owned(), ..Golden::default() };
    for (i, name) in NAMES.into_iter().enumerate() {
        let scenario = suite::data().join(format!("golden/{name}.ron"));
        for (threads, mask) in runs(i) {
            let out = place.path().join(format!("{name}-{threads}-{}", mask.is_some()));
            let mut command = microsig();
            if let Some(mask) = mask {
                command.env("GLIBC_TUNABLES", mask);
            }
            command.args(["generate", path(&scenario), "--out", path(&out), "--threads", threads]);
            succeed(&mut command);
            let made = Hashes::of(&out).unwrap();
            let is_known = golden.datasets.get(name) == Some(&made);
            let see = out.display();
            assert!(is_known || is_update, "{name} with {threads} threads, mask {mask:?}: see {see}");
            now.datasets.insert(name.to_owned(), made);
        }
    }
    if is_update {
        assert_eq!(golden.refusal(&now), None);
        return now.write().unwrap();
    }
    assert_eq!(golden, now, "run this test with UPDATE_GOLDEN=1 after a change of version");
}

#[test]
fn a_released_version_keeps_its_bytes_and_one_under_development_may_change_them() {
    let golden = |version: &str, images: &str, files: &str| {
        let hashes = Hashes { images: images.to_owned(), files: files.to_owned() };
        Golden { version: version.to_owned(), datasets: BTreeMap::from([("pairs".to_owned(), hashes)]) }
    };
    let before = golden("1.0.0", "a", "b");
    assert_eq!(before.refusal(&before), None);
    let said = before.refusal(&golden("1.0.0", "c", "d")).unwrap();
    assert!(said.contains("images: pairs; only other files: )"), "{said}");
    let said = before.refusal(&golden("1.0.0", "a", "d")).unwrap();
    assert!(said.contains("images: ; only other files: pairs)"), "{said}");
    assert_eq!(before.refusal(&golden("1.1.0", "c", "d")), None);
    assert_eq!(golden("1.1.0-dev", "a", "b").refusal(&golden("1.1.0-dev", "c", "d")), None);
}

#[test]
fn rendering_a_datasets_own_data_files_gives_its_images() {
    assert_rendered_again(&[("bursts", "16"), ("tracks", "17")]);
}

#[test]
#[ignore = "slow: .ci/full"]
fn rendering_data_files_of_more_datasets_gives_their_images() {
    assert_rendered_again(&[("pairs", "11"), ("sequence", "12"), ("setting2", "13"), ("fields", "14")]);
}

fn assert_rendered_again(names_and_seeds: &[(&str, &str)]) {
    let place = tempfile::tempdir().unwrap();
    for (name, seed) in names_and_seeds {
        let scenario = suite::data().join(format!("golden/{name}.ron"));
        let dataset = place.path().join(name);
        let images = place.path().join(format!("{name}-images"));
        run(&["generate", path(&scenario), "--out", path(&dataset)]);
        let (settings, particles) = (dataset.join("settings.txt"), dataset.join("particles"));
        run(&["render", path(&settings), path(&particles), path(&images), "--seed", seed, "--round-once"]);
        let mut compared = 0;
        for entry in std::fs::read_dir(dataset.join("images")).unwrap() {
            let image = entry.unwrap().path();
            let again = images.join(image.file_name().unwrap());
            // Compares counts only: image files of a dataset also contain the frame interval.
            assert!(suite::counts(&image).unwrap() == suite::counts(&again).unwrap(), "{}", again.display());
            compared += 1;
        }
        assert_eq!(compared, std::fs::read_dir(&images).unwrap().count(), "{name}: number of images");
    }
}
