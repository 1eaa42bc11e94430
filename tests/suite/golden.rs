//! The bytes of datasets: the same for any number of threads, build profile and CPU feature mask, and the same as ever.
//!
//! `data/golden/golden.txt` holds the SHA-256 of each dataset's SHA256SUMS. `cargo xtask golden` makes it anew, with a
//! release build; a change of it is an entry under "Image bits changed" in CHANGELOG.md.

use std::collections::BTreeMap;

use suite::microsig::{microsig, path, run};

fn golden() -> BTreeMap<String, String> {
    let text = std::fs::read_to_string(suite::data().join("golden/golden.txt")).unwrap();
    let entry =
        |line: &str| line.split_once("  ").map(|(hash, name)| (name.to_owned(), hash.to_owned())).unwrap();
    text.lines().map(entry).collect()
}

#[test]
fn datasets_have_the_bytes_they_always_had() {
    let place = tempfile::tempdir().unwrap();
    let golden = golden();
    assert_eq!(
        golden.keys().collect::<Vec<_>>(),
        ["bursts", "expected", "fields", "pairs", "rods", "sequence", "setting2", "spots", "tracks"]
    );
    // glibc picks other versions of its maths functions when these features are hidden from it.
    let masked = Some("glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable");
    for (name, hash) in golden {
        let scenario = suite::data().join(format!("golden/{name}.ron"));
        for (threads, mask) in [("1", None), ("2", None), ("7", None), ("2", masked)] {
            let out = place.path().join(format!("{name}-{threads}-{}", mask.is_some()));
            let mut command = microsig();
            if let Some(mask) = mask {
                command.env("GLIBC_TUNABLES", mask);
            }
            command.args(["generate", path(&scenario), "--out", path(&out), "--threads", threads]);
            let output = command.output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let sums = suite::sha256(&out.join("SHA256SUMS")).unwrap();
            assert_eq!(sums, hash, "{name} with {threads} threads, mask {mask:?}: see {}", out.display());
        }
    }
}

#[test]
fn rendering_a_datasets_own_data_files_gives_its_images() {
    let place = tempfile::tempdir().unwrap();
    for (name, seed) in [
        ("pairs", "11"),
        ("sequence", "12"),
        ("setting2", "13"),
        ("fields", "14"),
        ("bursts", "16"),
        ("tracks", "17"),
    ] {
        let scenario = suite::data().join(format!("golden/{name}.ron"));
        let dataset = place.path().join(name);
        let images = place.path().join(format!("{name}-images"));
        run(&["generate", path(&scenario), "--out", path(&dataset)]);
        let (settings, particles) = (dataset.join("settings.txt"), dataset.join("particles"));
        run(&["render", path(&settings), path(&particles), path(&images), "--seed", seed]);
        let mut compared = 0;
        for entry in std::fs::read_dir(dataset.join("images")).unwrap() {
            let image = entry.unwrap().path();
            let again = images.join(image.file_name().unwrap());
            // Counts: a dataset's image files tell the time between frames too.
            assert!(suite::counts(&image).unwrap() == suite::counts(&again).unwrap(), "{}", again.display());
            compared += 1;
        }
        assert_eq!(compared, std::fs::read_dir(&images).unwrap().count(), "{name}: number of images");
    }
}
