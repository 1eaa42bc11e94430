//! The `microsig` command: verbs and exit codes.

mod cli;
mod listing;
mod scoring;
mod tracking;

use std::fmt::Display;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use bench::dataset::verify::verify;
use bench::release::{About, Options as ReleaseOptions, release};
use bench::runner::{
    GenerateOptions, Progress, RenderOptions, Shard, SweepOptions, collect, generate, is_made, render, sweep,
};
use bench::{Error, Result, export, scenario};
use clap::Parser;
use cli::{
    Cli, Common, Displacement, Export, ExportFormat, Generate, Mode, New, Release, Render, Spheroids, Sweep,
    Verb, Verify,
};
use microsig_core::emission::SpheroidLaw;
use serde::Serialize;

fn main() -> ExitCode {
    let cli = Cli::parse();
    match run(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            let mut stderr = std::io::stderr().lock();
            // With nowhere left to complain to, the exit code must do.
            let _ = e.to_string().lines().try_for_each(|line| writeln!(stderr, "error: {line}"));
            ExitCode::from(e.exit_code())
        }
    }
}

fn run(cli: &Cli) -> Result<()> {
    let common = &cli.common;
    rayon::ThreadPoolBuilder::new()
        .num_threads(common.threads)
        .build_global()
        .map_err(|e| Error::input(format!("--threads {}: {e}", common.threads)))?;
    match &cli.verb {
        Verb::Render(arguments) => run_render(arguments, common),
        Verb::Generate(arguments) => run_generate(arguments, common),
        Verb::Sweep(arguments) => run_sweep(arguments, common),
        Verb::Flows(arguments) => listing::run_flows(arguments, common),
        Verb::New(arguments) => run_new(arguments, common),
        Verb::Verify(arguments) => run_verify(arguments, common),
        Verb::Track(arguments) => tracking::run_track(arguments, common),
        Verb::Evaluate(arguments) => scoring::run_evaluate(arguments, common),
        Verb::Export(arguments) => run_export(arguments, common),
        Verb::Release(arguments) => run_release(arguments, common),
        Verb::Compare(arguments) => scoring::run_compare(arguments, common),
    }
}

fn run_render(arguments: &Render, common: &Common) -> Result<()> {
    let rendered = render(&RenderOptions {
        settings: arguments.settings.clone(),
        data: arguments.data.clone(),
        out: arguments.out.clone(),
        seed: common.seed.unwrap_or(0),
        first_frame: arguments.first_frame,
        law: match arguments.spheroids {
            Spheroids::Original => SpheroidLaw::Original,
            Spheroids::Uniform => SpheroidLaw::Uniform,
        },
        expected: arguments.mode == Mode::Expected,
        force: common.force,
        progress: progress(common),
    })?;
    warn(&rendered.warnings, common);
    let text = format!(
        "{} images of {} x {} px with {} particles in {:.2} s ({:.1} images/s), in {}",
        rendered.images,
        rendered.width_px,
        rendered.height_px,
        rendered.particles,
        rendered.seconds,
        rendered.images as f64 / rendered.seconds.max(1e-9),
        rendered.out.display()
    );
    report(&text, &rendered, common)
}

fn run_generate(arguments: &Generate, common: &Common) -> Result<()> {
    let scenario = scenario::load(&arguments.scenario, &arguments.set, common.seed)?;
    warn(&scenario.warnings, common);
    let out = arguments.out.clone().unwrap_or_else(|| Path::new("datasets").join(&scenario.spec.name));
    if arguments.resume && !common.force && is_made(&scenario, &out)? {
        let text = format!("dataset {} is there already, in {}", scenario.spec.name, out.display());
        return report(&text, &serde_json::json!({ "name": scenario.spec.name, "out": out }), common);
    }
    let generated = generate(
        &scenario,
        &GenerateOptions { out, force: common.force, resume: arguments.resume, progress: progress(common) },
    )?;
    // Those that drawing has added.
    warn(&generated.warnings[scenario.warnings.len()..], common);
    let text = format!(
        "dataset {}: {} images, {:.1} particles in view on average, {} displacements of up to {:.2} px, in {:.2} s, in {}",
        generated.name,
        generated.images,
        generated.particles as f64 / f64::from(generated.images.max(1)),
        generated.displacements,
        generated.max_displacement_px,
        generated.seconds,
        generated.out.display()
    );
    report(&text, &generated, common)
}

fn run_sweep(arguments: &Sweep, common: &Common) -> Result<()> {
    let path = &arguments.sweep;
    let text = std::fs::read_to_string(path).map_err(|e| Error::read(path, e))?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let plan = scenario::parse_sweep(&text, &path.display().to_string(), folder, common.seed)?;
    if arguments.list {
        let line = |c: &scenario::Case| {
            let values = plan.spec.axes.iter().zip(&c.values).map(|(a, v)| format!("{}={v}", a.path));
            format!("{}  seed={}  {}", c.name, c.seed, values.collect::<Vec<_>>().join("  "))
        };
        return report(&plan.cases.iter().map(line).collect::<Vec<_>>().join("\n"), &plan.cases, common);
    }
    let out = arguments.out.clone().unwrap_or_else(|| Path::new("datasets").join(&plan.spec.name));
    if arguments.collect {
        let (done, failed) = collect(&plan, &out)?;
        let missing = plan.cases.len() - done - failed;
        if missing > 0 {
            return Err(Error::Failed(vec![format!(
                "{}: {missing} cases are missing, no table",
                out.display()
            )]));
        }
        let text = format!("{}: {done} cases done, {failed} failed", out.join("cases.csv").display());
        return report(&text, &serde_json::json!({ "out": out, "done": done, "failed": failed }), common);
    }
    let shard = match &arguments.shard {
        Some(text) => Shard::parse(text)?,
        None => Shard::of_slurm(|name| std::env::var(name).ok())?.unwrap_or(Shard::ALL),
    };
    if shard != Shard::ALL {
        say(&format!("shard {shard}"), common);
    }
    // The base scenario may lie elsewhere, and its own files beside it.
    let inputs = folder.join(&plan.spec.base).parent().unwrap_or(folder).to_owned();
    let swept = sweep(
        &plan,
        &SweepOptions {
            out,
            inputs,
            shard,
            force: common.force,
            resume: arguments.resume,
            progress: progress(common),
        },
    )?;
    let text = format!(
        "sweep {}: {} of {} cases done, {} failed, {} made now in {:.2} s, in {}",
        plan.spec.name,
        swept.done,
        swept.cases,
        swept.failed,
        swept.made,
        swept.seconds,
        swept.out.display()
    );
    report(&text, &swept, common)?;
    if swept.failed > 0 {
        return Err(Error::Failed(vec![format!("{} cases failed; see *.failed", swept.failed)]));
    }
    Ok(())
}

fn run_new(arguments: &New, common: &Common) -> Result<()> {
    let file = &arguments.file;
    if file.exists() && !common.force {
        return Err(Error::Exists(file.clone()));
    }
    std::fs::write(file, scenario::TEMPLATE).map_err(Error::write(file))?;
    let text = format!("{}: edit it, then `microsig generate {}`", file.display(), file.display());
    report(&text, &serde_json::json!({ "file": file }), common)
}

fn run_verify(arguments: &Verify, common: &Common) -> Result<()> {
    let verified = verify(&arguments.dataset, arguments.regenerate, progress(common))?;
    let again = if verified.regenerated { "; generated again, it has the same bytes" } else { "" };
    let text = format!(
        "{}: {} files ({:.1} MB) agree with checksums and manifest{again}",
        arguments.dataset.display(),
        verified.files,
        verified.bytes as f64 / 1e6
    );
    report(&text, &verified, common)
}

fn run_export(arguments: &Export, common: &Common) -> Result<()> {
    let exported = export::export(
        &arguments.dataset,
        &export::Options {
            format: match arguments.format {
                ExportFormat::Isbi => export::Format::Isbi,
                ExportFormat::Trackpy => export::Format::Trackpy,
                ExportFormat::Defocustracker => export::Format::Defocustracker,
                ExportFormat::TrackmateSpots => export::Format::TrackmateSpots,
                ExportFormat::Napari => export::Format::Napari,
                ExportFormat::Flo => export::Format::Flo,
                ExportFormat::Openpiv => export::Format::Openpiv,
            },
            out: arguments.out.clone(),
            pair: arguments.pair,
            displacement: match arguments.displacement {
                Displacement::Central => export::Displacement::Central,
                Displacement::Forward => export::Displacement::Forward,
                Displacement::Weighted => export::Displacement::Weighted,
            },
            force: common.force,
        },
    )?;
    let of = exported.tracks.map_or_else(|| "vectors".to_owned(), |n| format!("points of {n} tracks"));
    report(&format!("{}: {} {of}", exported.out.display(), exported.rows), &exported, common)
}

fn run_release(arguments: &Release, common: &Common) -> Result<()> {
    let about = About {
        title: arguments.title.clone(),
        creators: arguments.creator.clone(),
        version: arguments.release_version.clone(),
    };
    let released = release(
        &arguments.dataset,
        &ReleaseOptions {
            out: arguments.out.clone(),
            force: common.force,
            val: arguments.val,
            test: arguments.test,
            test_set: arguments.test_set.clone(),
            exact_times: arguments.exact_times,
            about,
            progress: progress(common),
        },
    )?;
    let [train, val, test] = released.images;
    let text = format!(
        "challenge {}: {train} + {val} + {test} images (train, val, test) in {:.2} s; publish {}, keep {} to yourself",
        released.name,
        released.seconds,
        released.out.join("public").display(),
        released.out.join("withheld").display()
    );
    report(&text, &released, common)
}

fn progress(common: &Common) -> Progress {
    if common.quiet { Progress::Hidden } else { Progress::Bar }
}

fn warn(warnings: &[impl Display], common: &Common) {
    if !common.quiet {
        let mut stderr = std::io::stderr().lock();
        // A warning that cannot be shown is no reason to stop.
        let _ = warnings.iter().try_for_each(|w| writeln!(stderr, "warning: {w}"));
    }
}

/// Tells what the program chose, on standard error.
fn say(text: &str, common: &Common) {
    if !common.quiet {
        let _ = writeln!(std::io::stderr().lock(), "{text}");
    }
}

/// Prints a result: as a sentence, or as one JSON object.
fn report(text: &str, result: &impl Serialize, common: &Common) -> Result<()> {
    let line = if common.json {
        serde_json::to_string(result).map_err(|e| Error::input(e.to_string()))?
    } else {
        text.to_owned()
    };
    match writeln!(std::io::stdout().lock(), "{line}") {
        // Whoever reads no further, as `head`, has all that is wanted.
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        written => written.map_err(Error::write(Path::new("standard output"))),
    }
}
