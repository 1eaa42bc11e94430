//! Long versions of the tests of robustness: runs killed, doubled and stopped by a full disk at many moments.
#![cfg(target_os = "linux")]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use suite::microsig::{generate, microsig, path, run, write};
use suite::tree;

use crate::mutations::clear;
use crate::robust::kill_when;

const SCENARIO: &str = r#"(
    name: "base",
    seed: 5,
    optics: (pixel_dim_x: 200, pixel_dim_y: 150),
    motion: flow(field: poiseuille()),
    timing: pairs(count: 20),
)"#;

const SWEEP: &str = r#"(
    name: "sweep",
    base: "base.ron",
    axes: [(path: "optics.background_noise", values: list([0, 10, 50]))],
)"#;

/// Finished and unfinished datasets of a run of a verb into `out`: itself, or the cases of a sweep.
fn datasets(verb: &str, out: &Path) -> Vec<PathBuf> {
    if verb != "sweep" {
        return [out.to_owned(), out.with_extension("partial")]
            .into_iter()
            .filter(|path| path.is_dir())
            .collect();
    }
    // A `.failed` folder has the reason why its case failed.
    let is_dataset = |path: &PathBuf| path.is_dir() && path.extension().is_none_or(|e| e != "failed");
    let cases = std::fs::read_dir(out).into_iter().flatten().map(|entry| entry.unwrap().path());
    cases.filter(is_dataset).collect()
}

fn verifies(dataset: &Path) -> bool {
    microsig().args(["verify", "--quiet"]).arg(dataset).output().unwrap().status.success()
}

/// Finished datasets pass `verify`, unfinished ones do not, not even under another name, unless complete.
fn nothing_torn_passes(verb: &str, out: &Path) {
    for dataset in datasets(verb, out) {
        let is_partial = dataset.extension().is_some_and(|e| e == "partial");
        assert_ne!(verifies(&dataset), is_partial, "{}", dataset.display());
        if is_partial {
            let torn = out.with_file_name("torn");
            std::fs::rename(&dataset, &torn).unwrap();
            assert!(torn.join("SHA256SUMS").exists() || !verifies(&torn), "{}", dataset.display());
            std::fs::rename(&torn, &dataset).unwrap();
        }
    }
}

#[test]
#[ignore = "slow: .ci/full"]
fn runs_killed_at_any_time_go_on_to_the_same_bytes() {
    let place = tempfile::tempdir().unwrap();
    let scenario = write(place.path(), "base.ron", SCENARIO);
    let sweep = write(place.path(), "sweep.ron", SWEEP);
    let (whole, out) = (place.path().join("whole"), place.path().join("out"));
    for (verb, file) in [("generate", &scenario), ("sweep", &sweep)] {
        let begun = Instant::now();
        run(&[verb, path(file), "--out", path(&whole), "--quiet"]);
        let whole_s = begun.elapsed();
        let expected = tree(&whole).unwrap();
        let resumed = [verb, path(file), "--out", path(&out), "--resume", "--quiet"];
        let mut killed = 0;
        for moment in 0..15 {
            // The run that resumes is killed as well.
            for moment in [moment, 14 - moment] {
                let begun = Instant::now();
                killed += u32::from(kill_when(&resumed, || begun.elapsed() >= whole_s * moment / 15));
                nothing_torn_passes(verb, &out);
                if verb == "generate" && out.exists() {
                    break;
                }
            }
            if verb == "sweep" || !out.exists() {
                run(&resumed);
            }
            assert!(tree(&out).unwrap() == expected, "{verb} killed at {moment}/15");
            std::fs::remove_dir_all(&out).unwrap();
        }
        // Otherwise nothing was tested.
        assert!(killed > 10, "{verb}: {killed} runs killed");
        std::fs::remove_dir_all(&whole).unwrap();
    }
}

fn start(arguments: &[&str], out: &Path, option: Option<&str>) -> Child {
    let before = arguments[0] != "render";
    let out = before.then_some("--out").into_iter().chain([path(out)]);
    let mut command = microsig();
    command.args(arguments).args(out).args(option).args(["--quiet", "--threads", "1"]);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
#[ignore = "slow: .ci/full"]
fn two_runs_of_any_verb_never_write_one_folder() {
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name).display().to_string();
    let dataset = generate(place.path(), "base", SCENARIO);
    write(place.path(), "sweep.ron", SWEEP);
    let (dataset, tracks) = (path(&dataset), at("base/truth/tracks.csv"));
    run(&["evaluate", dataset, &tracks, "--out", &at("score"), "--quiet"]);
    let (base, sweep, score, stack) =
        (at("base.ron"), at("sweep.ron"), at("score"), at("base/calibration/images"));
    let (settings, particles) = (at("base/settings.txt"), at("base/particles"));
    let fit = "--z-step 2 --planes 10-30 --magnification 10 --pixel-size 6.45 --diameter 2 --astigmatic no";
    for (arguments, second) in [
        (vec!["generate", &base], "--resume"),
        (vec!["generate", &base], "--force"),
        (vec!["sweep", &sweep], "--resume"),
        (vec!["suite", "generate", "odpc1", "--size", "smoke", "--track", "P2"], "--resume"),
        (["fit", &stack].into_iter().chain(fit.split(' ')).collect(), "--force"),
        (vec!["release", dataset, "--new-keys"], "--force"),
        (vec!["evaluate", dataset, &tracks], "--force"),
        (vec!["compare", &score], "--force"),
        (vec!["render", &settings, &particles], "--force"),
    ] {
        // A release draws a new key each time, so only its names are compared.
        let files = |out: &Path| {
            let mut files = tree(out).unwrap();
            files.values_mut().filter(|_| arguments[0] == "release").for_each(String::clear);
            files
        };
        let (out, begun) = (place.path().join("out"), Instant::now());
        let alone = start(&arguments, &out, None).wait_with_output().unwrap();
        assert!(alone.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&alone.stderr));
        let (whole, whole_s) = (files(&out), begun.elapsed());
        std::fs::remove_dir_all(&out).unwrap();
        for moment in 0..8 {
            let first = start(&arguments, &out, None);
            std::thread::sleep(whole_s * moment / 8);
            let second = start(&arguments, &out, Some(second));
            let outputs = [first, second].map(|run| run.wait_with_output().unwrap());
            for output in outputs.iter().filter(|output| !output.status.success()) {
                let message = String::from_utf8_lossy(&output.stderr);
                assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
                let expected = ["is writing it", "already exists", "left by an interrupted run"];
                assert!(expected.iter().any(|text| message.contains(text)), "{arguments:?}: {message}");
            }
            assert!(outputs.iter().any(|output| output.status.success()), "{arguments:?}: both refused");
            assert!(files(&out) == whole, "{arguments:?}, second after {moment}/8 of the time");
            if arguments[0] == "generate" {
                run(&["verify", path(&out), "--quiet"]);
            }
            assert_eq!(clear(&out), ["out"], "{arguments:?}");
        }
    }
}

/// A tmpfs of a given size, unmounted at the end.
struct Disk(tempfile::TempDir);

impl Disk {
    /// `None` if this user may not mount.
    fn mount(kilobytes: u64) -> Option<Disk> {
        let (disk, size) = (Disk(tempfile::tempdir().unwrap()), format!("size={kilobytes}k"));
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(disk.0.path());
        mount.output().is_ok_and(|output| output.status.success()).then_some(disk)
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // Fails if it was not mounted.
        let _ = Command::new("umount").arg(self.0.path()).output();
    }
}

/// Size on disk, kB.
fn size_kb(folder: &Path) -> u64 {
    let output = Command::new("du").arg("-sk").arg(folder).output().unwrap();
    String::from_utf8(output.stdout).unwrap().split_whitespace().next().unwrap().parse().unwrap()
}

#[test]
#[ignore = "slow: .ci/full"]
fn disks_that_are_full_at_any_stage_are_told_and_hold_nothing_incomplete() {
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name).display().to_string();
    let dataset = generate(place.path(), "base", SCENARIO);
    write(place.path(), "sweep.ron", SWEEP);
    let (base, sweep, settings) = (at("base.ron"), at("sweep.ron"), at("base/settings.txt"));
    let (dataset, particles, tracks) = (path(&dataset), at("base/particles"), at("base/truth/tracks.csv"));
    let mut full = 0;
    for arguments in [
        vec!["generate", &base, "--out"],
        vec!["sweep", &sweep, "--out"],
        vec!["render", &settings, &particles],
        vec!["evaluate", dataset, &tracks, "--report", "--out"],
    ] {
        let whole = place.path().join(format!("whole-{}", arguments[0]));
        run(&[&arguments[..], &[path(&whole), "--quiet"]].concat());
        let needed = size_kb(&whole);
        for tenth in 0..10 {
            let Some(disk) = Disk::mount((needed * tenth / 10).max(8)) else {
                println!("skipped: only root may mount a tmpfs");
                return;
            };
            let out = disk.0.path().join("out");
            let output = microsig().args(&arguments).arg(&out).arg("--quiet").output().unwrap();
            let (code, message) = (output.status.code(), String::from_utf8_lossy(&output.stderr));
            // `generate` and `sweep` know before they begin.
            let foreseen = code == Some(2) && message.contains(" MB are free");
            // A sweep keeps the messages of its cases.
            let met = message.contains("No space left on device") && message.contains("out")
                || arguments[0] == "sweep" && message.contains("see *.failed");
            assert!(foreseen || (code == Some(1) && met), "{arguments:?}, {tenth}/10: {code:?} {message}");
            full += u32::from(met);
            nothing_torn_passes(arguments[0], &out);
            assert!(arguments[0] == "sweep" || !out.exists(), "{arguments:?}, {tenth}/10");
        }
    }
    // Otherwise nothing was tested.
    assert!(full >= 20, "{full}");
}
