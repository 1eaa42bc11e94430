//! The full search for leaks in a challenge; `tests/suite/release.rs` has a short version.

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use bench::release::{Publication, ReleaseOptions, derived_seed, release};
use generator::runner::{GenerateOptions, Progress, generate};
use scenario::{parse, resolve};
use suite::leak::{Known, guess_by_noise, guess_by_place, unzip};
use suite::template::fill;

const SEEDS: std::ops::Range<u64> = 0..1 << 20;
/// Seed of the public dataset: large, so that it cannot occur by chance.
const SEED: u64 = 8_246_017_395_284_410_067;
/// Public seed of the leaky test split.
const LEAKY: u64 = 987_654;

fn scenario(seed: u64) -> String {
    format!(
        "(name: \"small\", seed: {seed}, optics: (pixel_dim_x: 120, pixel_dim_y: 90), motion: flow(field: poiseuille(max_speed_um_s: 6000)), \
         particles: (number: count(12)), timing: sequence(frames: 8, dt_s: 0.002))"
    )
}

/// Searches a released test split, and one generated from a public seed.
pub(crate) fn run(out: &Path) -> anyhow::Result<ExitCode> {
    let place = tempfile::tempdir()?;
    let make = |name: &str, seed: u64| -> anyhow::Result<std::path::PathBuf> {
        let out = place.path().join(name);
        let scenario = resolve(parse(&scenario(seed), name)?, place.path())?;
        let options =
            GenerateOptions { out: out.clone(), force: false, resume: false, progress: Progress::Hidden };
        generate(&scenario, &options)?;
        Ok(out)
    };
    let dataset = make("dataset", SEED)?;
    let challenge = place.path().join("challenge");
    let about = Publication { version: "1".to_owned(), ..Publication::default() };
    let options = ReleaseOptions {
        out: challenge.clone(),
        force: false,
        resume: false,
        new_keys: false,
        val: None,
        test: None,
        test_set: Vec::new(),
        exact_times: false,
        fields: false,
        codabench: false,
        wheel: None,
        about,
        progress: Progress::Hidden,
    };
    release(&dataset, &options)?;
    let withheld = challenge.join("withheld/test");
    let leaky = make("leaky", LEAKY)?;

    let mut table = String::from("| looked for | in | found | s |\n|---|---|---|---|\n");
    let mut row = |what: &str, place: &str, found: &str, start: Instant| {
        // Writing to a string cannot fail.
        let _ = writeln!(table, "| {what} | {place} | {found} | {:.1} |", start.elapsed().as_secs_f64());
    };
    let start = Instant::now();
    let known = Known::of(&withheld, &[SEED, derived_seed(SEED, "val")])?;
    let mut files = unzip(&challenge.join("public/small-test.zip"))?;
    for entry in std::fs::read_dir(challenge.join("public"))? {
        let path = entry?.path();
        if path.extension().is_none_or(|e| e != "zip") {
            files.insert(
                path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                std::fs::read(&path)?,
            );
        }
    }
    let bytes: usize = files.values().map(Vec::len).sum();
    let found_in_files = known.told_by(&files);
    let what = format!("numbers, keys, seeds, names, orders: {} files, {bytes} bytes", files.len());
    row(&what, "released", if found_in_files.is_empty() { "nothing" } else { "something" }, start);

    let words = |seed: Option<u64>| seed.map_or_else(|| "nothing".to_owned(), |s| format!("seed {s}"));
    let mut wrong = found_in_files;
    for (name, dataset, expected) in
        [("released", &withheld, None), ("drawn from a public seed", &leaky, Some(LEAKY))]
    {
        let settings = suite::settings(&dataset.join("settings.txt"))?;
        let counts = suite::counts(&dataset.join("images/frame_00000.tif"))?;
        let start = Instant::now();
        let noise = guess_by_noise(&settings, &counts, SEEDS);
        row(&format!("seeds {SEEDS:?} by noise"), name, &words(noise), start);
        let start = Instant::now();
        let place = guess_by_place(dataset, SEEDS)?;
        row(&format!("seeds {SEEDS:?} by the first place"), name, &words(place), start);
        for found in [noise, place] {
            if found != expected {
                wrong.push(format!("{name}: {}, expected {}", words(found), words(expected)));
            }
        }
    }
    let verdict = if wrong.is_empty() { "As expected." } else { "NOT AS EXPECTED." };
    let readme = fill(
        include_str!("leak_search.md"),
        &[
            ("out", &out.display().to_string()),
            ("seed", &LEAKY.to_string()),
            ("table", &table),
            ("verdict", &format!("{verdict} {}", wrong.join("; "))),
        ],
    );
    std::fs::create_dir_all(out)?;
    std::fs::write(out.join("README.md"), &readme)?;
    println!("{readme}");
    Ok(if wrong.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
