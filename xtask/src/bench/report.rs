//! Writes `runs.csv` and README.md of the benchmark.

use std::fmt::Write;
use std::path::Path;

use super::floors::LowerLimit;
use super::workload::{EXPECTED, EXPECTED_MANY, GROWTH, LONG};
use super::{Measured, Record, cpu_ms};

/// CPU time of the original program, ms per particle (minimum and maximum, measured by its users on other
/// machines), and the speedup that is the goal.
const GOALS: [(&str, [f64; 2], f64); 3] = [
    ("setting 1, one size", [7.5, 8.5], 200.0),
    ("setting 1, several sizes", [27.0, 29.0], 600.0),
    ("setting 2", [170.0, 280.0], 800.0),
];

/// Groups that are run with one and two threads.
const THREADS: [&str; 2] = ["threads, rays", "threads, gaussian"];

/// Greatest growth of CPU time per doubling of the size that counts as linear: 10 % above 2.
const DOUBLING: f64 = 2.2;

pub(super) fn write(out: &Path, record: &Record) -> anyhow::Result<()> {
    let mut table = csv::Writer::from_path(out.join("runs.csv"))?;
    table.write_record([
        "group",
        "workload",
        "size",
        "threads",
        "repeats",
        "images",
        "particles",
        "output_mb",
        "wall_s",
        "cpu_s",
        "peak_mb",
        "images_per_s",
        "particles_per_s",
        "output_gb_per_s",
    ])?;
    for m in &record.measured {
        let (w, u) = (&m.workload, &m.usage);
        table.write_record([
            w.group.to_owned(),
            w.name.clone(),
            w.size.to_string(),
            w.threads.to_string(),
            w.repeats.to_string(),
            m.images.to_string(),
            m.particles.to_string(),
            format!("{:.3}", m.bytes / 1e6),
            format!("{:.4}", u.wall_s),
            format!("{:.4}", u.cpu_s),
            format!("{:.1}", u.peak_mb),
            format!("{:.2}", m.images / u.wall_s),
            format!("{:.1}", m.particles / u.wall_s),
            format!("{:.4}", m.bytes / 1e9 / u.wall_s),
        ])?;
    }
    table.flush()?;
    std::fs::write(out.join("README.md"), readme(out, record)?)?;
    Ok(())
}

fn readme(out: &Path, record: &Record) -> Result<String, std::fmt::Error> {
    let mut text = format!(
        "# Speed and memory\n\nMade by `cargo xtask bench --out {}` with {}.\nOn {}.\n\n\
         Whole runs of the command, including noise and files. Medians of {} interleaved runs; CPU time is \
         user and system time of all threads. `runs.csv` has every figure.\n\n",
        out.display(),
        record.version,
        record.machine,
        record.repeats
    );
    requirements_table(&mut text, record)?;
    let ran = |part: &str| record.measured.iter().any(|m| m.workload.group.contains(part));
    if ran("throughput") {
        goals(&mut text, record)?;
        throughput(&mut text, record)?;
    }
    if !record.floors.is_empty() {
        floors(&mut text, record)?;
    }
    if ran("threads") {
        threads(&mut text, record)?;
    }
    if GROWTH.iter().any(|(group, _)| ran(group)) {
        growth(&mut text, record)?;
    }
    if ran("large") {
        large(&mut text, record)?;
    }
    Ok(text)
}

/// A requirement or goal for whole runs.
struct Requirement {
    what: String,
    found: f64,
    unit: &'static str,
    bar: f64,
    is_met: bool,
}

/// Requirements and goals, as far as they were measured.
fn requirements(record: &Record) -> Vec<Requirement> {
    let named = |name: &str| record.measured.iter().find(|m| m.workload.name == name);
    let mut all = Vec::new();
    let mut add = |what: &str, found: f64, unit: &'static str, bar: f64, is_met: bool| {
        all.push(Requirement { what: what.to_owned(), found, unit, bar, is_met });
    };
    let started = 1e3 * record.startup.wall_s.max(record.startup.cpu_s);
    add("starting and exiting the program", started, " ms", 10.0, started < 10.0);
    if let Some(m) = named("quickstart.ron") {
        add("quickstart, CPU time", m.usage.cpu_s, " s", 1.0, m.usage.cpu_s < 1.0);
    }
    let steps: Vec<f64> = GROWTH.iter().flat_map(|(name, _)| doublings(record, name)).collect();
    if !steps.is_empty() {
        let most = steps.iter().copied().fold(0.0, f64::max);
        add("largest growth of CPU time when the size doubles", most, "", DOUBLING, most <= DOUBLING);
    }
    if let [Some(short), Some(long)] = LONG.map(named) {
        let growth = long.usage.peak_mb / short.usage.peak_mb;
        add("memory for 10,000 frames relative to 100 frames", growth, "", 1.2, growth <= 1.2);
    }
    if let [Some(few), Some(many)] = [EXPECTED, EXPECTED_MANY].map(named) {
        let rate = (many.images - few.images) / (many.usage.cpu_s - few.usage.cpu_s);
        add("images of 500 particles per CPU s, expected, excluding tables", rate, "", 1000.0, rate >= 1e3);
    }
    for (name, both) in THREADS.map(|name| (name, group(record, name).collect::<Vec<_>>())) {
        if let [one, two] = both[..] {
            let faster = one.usage.wall_s / two.usage.wall_s;
            let what = format!("speedup by a second core: {}", name.trim_start_matches("threads, "));
            add(&what, faster, "", 1.95, faster >= 1.95);
        }
    }
    all
}

fn requirements_table(text: &mut String, record: &Record) -> std::fmt::Result {
    writeln!(text, "## Requirements and goals\n\n| | measured | limit | met |\n|---|---|---|---|")?;
    for Requirement { what, found, unit, bar, is_met } in requirements(record) {
        let met = if is_met { "yes" } else { "**no**" };
        writeln!(text, "| {what} | {found:.3}{unit} | {bar}{unit} | {met} |")?;
    }
    writeln!(text)
}

/// Growth of CPU time per doubling, between consecutive sizes of a group.
fn doublings(record: &Record, name: &str) -> Vec<f64> {
    let members: Vec<&Measured> = group(record, name).collect();
    let step = |w: &[&Measured]| {
        let doublings = (w[1].workload.size / w[0].workload.size).log2();
        (w[1].usage.cpu_s / w[0].usage.cpu_s).powf(1.0 / doublings)
    };
    members.windows(2).map(step).collect()
}

fn group<'a>(record: &'a Record, name: &str) -> impl Iterator<Item = &'a Measured> {
    record.measured.iter().filter(move |m| m.workload.group == name)
}

fn goals(text: &mut String, record: &Record) -> std::fmt::Result {
    writeln!(
        text,
        "## Comparison with a NumPy loop and the original\n\n\
         `xtask/src/bench/yardstick.py` is a NumPy loop that traces every ray of every particle and reproduces the counts of the original \
         exactly (`yardstick.py --check tests/data/exact`); its runs were interleaved with those of microsig. The times of the original \
         were reported by its users on other machines, so ratios to them are orders of magnitude. For particles of one size, the original uses one \
         light field for all particles, which neither microsig nor the NumPy loop does.\n"
    )?;
    let yardstick = match &record.yardstick {
        Ok(results) => results,
        Err(reason) => return writeln!(text, "The NumPy loop could not be run: {reason}\n"),
    };
    writeln!(
        text,
        "| CPU ms per particle | microsig, everything included | NumPy loop | speedup | original, reported | NumPy loop / original | \
         speedup over the original | goal |\n|---|---|---|---|---|---|---|---|"
    )?;
    for (name, [low, high], goal) in GOALS {
        let Some(ours) = group(record, "throughput").find(|m| m.workload.name == name) else { continue };
        let ms = 1e3 * ours.usage.cpu_s / ours.particles;
        let theirs = yardstick.get(name).map_or(f64::NAN, cpu_ms);
        writeln!(
            text,
            "| {name} | {ms:.3} | {theirs:.1} | {:.0} | {low} to {high} | {:.2} to {:.2} | {:.0} to {:.0} | {goal} |",
            theirs / ms,
            theirs / high,
            theirs / low,
            low / ms,
            high / ms
        )?;
    }
    writeln!(text)
}

fn throughput(text: &mut String, record: &Record) -> std::fmt::Result {
    writeln!(
        text,
        "## One thread\n\n| | images | particles in all | CPU s | wall s | images per CPU s | particles per CPU s | written, GB per s | \
         peak MB |\n|---|---|---|---|---|---|---|---|---|"
    )?;
    for m in group(record, "throughput") {
        let u = &m.usage;
        writeln!(
            text,
            "| {} | {} | {} | {:.3} | {:.3} | {:.0} | {:.0} | {:.3} | {:.0} |",
            m.workload.name,
            m.images,
            m.particles,
            u.cpu_s,
            u.wall_s,
            m.images / u.cpu_s,
            m.particles / u.cpu_s,
            m.bytes / 1e9 / u.wall_s,
            u.peak_mb
        )?;
    }
    for (name, reason) in &record.refused {
        writeln!(text, "\nNot measured: {name} ({}).", reason.trim())?;
    }
    writeln!(
        text,
        "\nFor `generate`, \"particles\" are those in view; it also writes truth, checksums and data files.\n"
    )
}

fn floors(text: &mut String, record: &Record) -> std::fmt::Result {
    let nothing = record.floors.iter().find(|f| f.0 == LowerLimit::Nothing).map_or(0.0, |f| f.1.cpu_s);
    let ms = |wanted: LowerLimit| {
        let found = record.floors.iter().find(|f| f.0 == wanted);
        found.map_or(f64::NAN, |(floor, usage)| 1e3 * (usage.cpu_s - nothing) / floor.images() as f64)
    };
    let pixels = 752.0 * 366.0;
    let (copy, words, file) = (ms(LowerLimit::Memcpy), ms(LowerLimit::Philox), ms(LowerLimit::Write));
    let floor = copy + words + file;
    writeln!(
        text,
        "## Lower limits\n\nFor one image of 752 x 366 px in 16 bit, CPU time on one thread: a memory copy {:.4} ms ({:.1} GB/s), a \
         Philox word per pixel, as in microsig's streams, {words:.3} ms ({:.2} ns each), a raw file {file:.3} ms ({:.2} GB/s).",
        copy,
        2.0 * pixels / copy / 1e6,
        1e6 * words / pixels,
        2.0 * pixels / file / 1e6
    )?;
    if let Some(empty) = group(record, "throughput").find(|m| m.workload.name == "no particles") {
        let ours = 1e3 * empty.usage.cpu_s / empty.images;
        writeln!(
            text,
            "An image without particles takes {ours:.3} ms: {:.1} times the lower limit of {floor:.3} ms (a copy, a Philox word per pixel \
             for its noise, a raw file).",
            ours / floor
        )?;
    }
    writeln!(text)
}

fn threads(text: &mut String, record: &Record) -> std::fmt::Result {
    writeln!(
        text,
        "## A second thread\n\n| | wall s, 1 thread | 2 threads | speedup | growth of CPU time |\n|---|---|---|---|---|"
    )?;
    for name in THREADS {
        let both: Vec<&Measured> = group(record, name).collect();
        if let [one, two] = both[..] {
            let (a, b) = (&one.usage, &two.usage);
            writeln!(
                text,
                "| {} | {:.3} | {:.3} | {:.2} | {:.2} |",
                name.trim_start_matches("threads, "),
                a.wall_s,
                b.wall_s,
                a.wall_s / b.wall_s,
                b.cpu_s / a.cpu_s
            )?;
        }
    }
    writeln!(
        text,
        "\nWall times are unreliable if the machine had other load; the load at the start is given above.\n"
    )
}

fn growth(text: &mut String, record: &Record) -> std::fmt::Result {
    writeln!(
        text,
        "## Growth\n\n![CPU time](growth.svg)\n\n![peak memory](memory.svg)\n\n\
         | | CPU s | peak MB | CPU time per doubling | linear within 10 % |\n|---|---|---|---|---|"
    )?;
    for (name, _) in GROWTH {
        let members: Vec<&Measured> = group(record, name).collect();
        if members.len() < 2 {
            continue;
        }
        let list =
            |of: &dyn Fn(&Measured) -> String| members.iter().map(|m| of(m)).collect::<Vec<_>>().join(", ");
        // Sizes grow by factors of 2 or 4; the growth is per factor of 2.
        let steps = doublings(record, name);
        let linear = steps.iter().all(|s| *s <= DOUBLING);
        writeln!(
            text,
            "| {name}: {} | {} | {} | {} | {} |",
            list(&|m| m.workload.size.round().to_string()),
            list(&|m| format!("{:.3}", m.usage.cpu_s)),
            list(&|m| format!("{:.0}", m.usage.peak_mb)),
            steps.iter().map(|s| format!("{s:.2}")).collect::<Vec<_>>().join(", "),
            if linear { "yes" } else { "**no**" }
        )?;
    }
    writeln!(text)
}

fn large(text: &mut String, record: &Record) -> std::fmt::Result {
    writeln!(
        text,
        "## Large runs\n\nOne run each.\n\n| | threads | CPU s | wall s | peak MB | written MB |\n|---|---|---|---|---|---|"
    )?;
    for m in group(record, "large") {
        let u = &m.usage;
        writeln!(
            text,
            "| {} | {} | {:.1} | {:.1} | {:.0} | {:.0} |",
            m.workload.name,
            m.workload.threads,
            u.cpu_s,
            u.wall_s,
            u.peak_mb,
            m.bytes / 1e6
        )?;
    }
    Ok(())
}
