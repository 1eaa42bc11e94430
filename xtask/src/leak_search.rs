//! The search for leaks in a challenge, in full: what `tests/suite/release.rs` does in short.

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use bench::release::{About, Options, derived_seed, release};
use bench::runner::{GenerateOptions, Progress, generate};
use bench::scenario::{parse, resolve};
use suite::leak::{Known, guess_by_noise, guess_by_place, unzip};

const SEEDS: std::ops::Range<u64> = 0..1 << 20;
/// Seed of the public dataset: large, so that it cannot occur by chance.
const SEED: u64 = 8_246_017_395_284_410_067;
/// Seed of the test split that is drawn as it must not be.
const LEAKY: u64 = 987_654;

fn scenario(seed: u64) -> String {
    format!(
        "(name: \"small\", seed: {seed}, optics: (pixel_dim_x: 120, pixel_dim_y: 90), motion: flow(field: poiseuille(max_speed_um_s: 6000)), \
         particles: (number: count(12)), timing: sequence(frames: 8, dt_s: 0.002))"
    )
}

/// Attacks a test split as it is released, and one from a public seed.
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
    let about = About { version: "1".to_owned(), ..About::default() };
    let options = Options {
        out: challenge.clone(),
        force: false,
        val: None,
        test: None,
        test_set: Vec::new(),
        exact_times: false,
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
    let told = known.told_by(&files);
    let what = format!("numbers, keys, seeds, names, orders: {} files, {bytes} bytes", files.len());
    row(&what, "released", if told.is_empty() { "nothing" } else { "something" }, start);

    let words = |seed: Option<u64>| seed.map_or_else(|| "nothing".to_owned(), |s| format!("seed {s}"));
    let mut wrong = told;
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
    let readme = format!(
        "# Search for leaks in a challenge\n\n\
         `cargo xtask leak-search --out {}` makes a small challenge (8 frames of 120 x 90 px, 12 particles in view) and \
         plays someone who knows its truth. The second test split is drawn from the public seed {LEAKY}, as a release \
         never does, to see that the search finds something.\n\n{table}\n{verdict} {}\n",
        out.display(),
        wrong.join("; ")
    );
    std::fs::create_dir_all(out)?;
    std::fs::write(out.join("README.md"), &readme)?;
    println!("{readme}");
    Ok(if wrong.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
