//! The `microsig` command: one file per verb, with its arguments and its action.
//!
//! A new verb needs a file here and a line in each of two lists: of modules, and of `Verb`.

mod about;
mod check_submission;
mod compare;
mod evaluate;
mod export;
mod fit;
mod flows;
mod generate;
mod import;
mod new;
mod optics;
mod options;
mod output;
mod release;
mod render;
mod reveal;
mod spheroid_maps;
mod suite;
mod sweep;
mod sweep_scores;
mod track;
mod twin;
mod verify;
#[cfg(feature = "view")]
mod view;

use std::ffi::OsString;
use std::io::Write;
use std::process::ExitCode;
use std::sync::{Arc, PoisonError};

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{ArgMatches, Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use microsig_core::render::Context;
use options::ProgressStyle;
use output::Caller;
pub use output::{Answer, printable};
use serde_json::json;

use storage::advice::Advice;
use storage::error::{Error, Result};
use storage::progress::{Progress, Tables};
use storage::table_cache::TableFolder;
use storage::{clean_up_on_signals, file_size_limits_are_errors};

/// What `--help` states after the options.
const AFTER_HELP: &str = concat!(
    "In place of a file other than an image, `-` is standard input or standard output. `microsig new --list` lists the scenarios, sweeps \
and suites that can be given by name.

Environment variables:
  MICROSIG_CACHE      folder of image tables [default: ~/.cache/microsig/tables]
  MICROSIG_CACHE_MB   limit of its size in MB [default: 2000]
  XDG_CACHE_HOME      folder of caches in place of ~/.cache
  SLURM_ARRAY_TASK_*  the task of `--shard slurm`
  TMPDIR              folder of temporary files

Documentation: ",
    env!("CARGO_PKG_REPOSITORY"),
    "/blob/main/docs/README.md"
);

/// Benchmark datasets for defocusing and astigmatic PIV/PTV.
#[derive(Debug, Parser)]
#[command(name = "microsig", about, long_about = None, arg_required_else_help = true, disable_version_flag = true,
    after_help = AFTER_HELP)]
pub struct Cli {
    #[command(subcommand)]
    verb: Option<Verb>,
    /// Print version and commit
    #[arg(long, short = 'V')]
    version: bool,
    #[command(flatten)]
    common: Common,
}

/// Options of all verbs; options of several verbs are in [`options`].
#[derive(Debug, Args)]
#[command(next_help_heading = "Global options")]
struct Common {
    /// Number of threads, at most 1024; 0 uses all cores
    #[arg(long, short = 'j', global = true, default_value_t = 0, value_name = "N",
        value_parser = clap::value_parser!(u16).range(0..=1024))]
    threads: u16,
    /// Print only what was asked for, such as lists, tables and JSON: no progress, warnings or summaries
    #[arg(long, short, global = true)]
    quiet: bool,
    /// Print the result as one JSON object
    #[arg(long, global = true)]
    json: bool,
    /// How progress is reported on standard error
    #[arg(long, global = true, value_enum, default_value_t, value_name = "HOW")]
    progress: ProgressStyle,
    /// Who gets the output instead of a terminal.
    #[arg(skip)]
    caller: Option<Caller>,
    #[arg(skip)]
    context: Context,
}

macro_rules! verbs {
    ($($(#[$attribute:meta])* $verb:ident($module:ident),)+) => {
        /// The verbs; the help of each is the documentation of its arguments.
        #[derive(Debug, Subcommand)]
        enum Verb {
            $($(#[$attribute])* $verb($module::$verb),)+
        }

        impl Verb {
            fn run(&self, common: &Common) -> Result<()> {
                match self {
                    $($(#[$attribute])* Verb::$verb(verb) => verb.run(common),)+
                }
            }
        }
    };
}

verbs! {
    Render(render),
    Generate(generate),
    Sweep(sweep),
    Suite(suite),
    Verify(verify),
    #[cfg(feature = "view")]
    View(view),
    Track(track),
    Twin(twin),
    Evaluate(evaluate),
    CheckSubmission(check_submission),
    Compare(compare),
    Export(export),
    Release(release),
    Reveal(reveal),
    Fit(fit),
    Import(import),
    Flows(flows),
    New(new),
    Optics(optics),
    Schema(about),
    Completions(about),
    Man(about),
}

/// Whether image tables are read from the user's cache and stored there: if the verb has the option `--no-cache`, which
/// is not given. `fit` has none, as it evaluates many microscopes, each of them once.
fn keeps_tables(matches: &ArgMatches) -> bool {
    match matches.subcommand() {
        Some((_, verb)) => keeps_tables(verb),
        None => matches!(matches.try_get_one("no_cache"), Ok(Some(false))),
    }
}

impl Cli {
    /// Runs the verb of these arguments, which begin with the name of the program, writes errors to standard error, and
    /// returns the exit code.
    pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
        let Err(e) = Cli::result(arguments) else { return 0 };
        let mut stderr = std::io::stderr().lock();
        // If standard error is closed, only the exit code reports the error.
        let _ = e.messages().iter().try_for_each(|text| writeln!(stderr, "error: {}", printable(text)));
        e.exit_code()
    }

    fn result(arguments: impl IntoIterator<Item = OsString>) -> Result<()> {
        let matches = command().get_matches_from(arguments);
        let Cli { verb, version: is_version, mut common } =
            Cli::from_arg_matches(&matches).unwrap_or_else(|e| e.exit());
        if is_version {
            return version(&common);
        }
        let Some(verb) = verb else {
            Cli::command().error(ErrorKind::MissingSubcommand, "expected a command; see --help").exit()
        };
        rayon::ThreadPoolBuilder::new()
            .num_threads(usize::from(common.threads))
            .build_global()
            .map_err(|e| Error::input(format!("--threads {}: {e}", common.threads)))?;
        clean_up_on_signals(|is_resumable| {
            // Which --resume continues, but does not begin.
            let instead = std::env::args_os().any(|argument| argument == "--new-keys");
            let hint = match (is_resumable, instead) {
                (false, _) => "",
                (true, false) => "; --resume continues this run",
                (true, true) => "; --resume instead of --force --new-keys continues this run",
            };
            let _ = writeln!(std::io::stderr().lock(), "interrupted{hint}");
        })?;
        let folder = if keeps_tables(&matches) { TableFolder::for_user()? } else { None };
        let tables = Tables::new(folder, output::progress(&common));
        common.context = Context { tables: Some(Arc::new(tables)), ..Context::default() };
        verb.run(&common)
    }

    /// Runs a verb for a program, in its threads: prints nothing and never exits. A check that failed after
    /// the verb had a result is part of the answer.
    pub fn call(arguments: &[OsString], progress: Progress) -> Result<Answer> {
        // The standard streams belong to the program: for it, `-` is a file like any other.
        let arguments = arguments.iter().map(|argument| match argument.to_str() {
            Some("-") => OsString::from("./-"),
            Some(text) if text.starts_with("--") && text.ends_with("=-") => {
                OsString::from(format!("{}./-", &text[..text.len() - 1]))
            }
            _ => argument.clone(),
        });
        let matches = command().try_get_matches_from(arguments).map_err(refused)?;
        let mut cli = Cli::from_arg_matches(&matches).map_err(refused)?;
        cli.common.caller = Some(Caller::new(progress));
        let Cli { verb: Some(verb), common, .. } = &cli else {
            return Err(Error::input("expected a command"));
        };
        let done = verb.run(common);
        let Some(caller) = cli.common.caller else { return Ok(Answer::default()) };
        let mut answer = caller.answer.into_inner().unwrap_or_else(PoisonError::into_inner);
        match done {
            Ok(()) => {}
            Err(Error::Failed(failures)) if answer.result.is_some() => answer.failures = failures,
            Err(e) => return Err(e),
        }
        Ok(answer)
    }
}

/// Arguments that cannot be parsed, with the option that clap names as data.
fn refused(e: clap::Error) -> Error {
    let text = e.to_string();
    let text = text.split("\n\n").next().unwrap_or_default().trim_start_matches("error: ");
    let named = [ContextKind::InvalidArg, ContextKind::PriorArg].into_iter().filter_map(|kind| e.get(kind));
    let named = named.flat_map(|value| match value {
        ContextValue::String(one) => std::slice::from_ref(one),
        ContextValue::Strings(all) => all,
        _ => &[],
    });
    let mut python = text.to_owned();
    for argument in named {
        let Some(name) = argument.strip_prefix("--").and_then(|rest| rest.split([' ', '=']).next()) else {
            continue;
        };
        python = python.replacen(argument.as_str(), &name.replace('-', "_"), 1);
    }
    Error::option(Advice::new(text, &python))
}

/// Verbs that write files only if asked to, and the option (or group of options) that asks for it.
const WRITE_IF: [(&str, &str); 5] =
    [("evaluate", "out"), ("flows", "plot"), ("new", "file"), ("optics", "written"), ("view", "export")];

/// The command. Negative numbers are parsed as values, not as options, so that errors state the allowed
/// range.
fn command() -> clap::Command {
    Cli::command().mut_subcommands(|verb| {
        let verb = verb.allow_negative_numbers(true);
        match WRITE_IF.iter().find(|(name, _)| *name == verb.get_name()) {
            Some((_, option)) => verb.mut_arg("force", |force| force.requires(option)),
            None => verb,
        }
    })
}

/// The program.
pub fn main() -> ExitCode {
    // Before any other thread is started.
    file_size_limits_are_errors();
    ExitCode::from(Cli::run(std::env::args_os()))
}

fn version(common: &Common) -> Result<()> {
    let (version, commit) = (storage::VERSION, storage::COMMIT);
    let result = json!({ "name": "microsig", "version": version, "commit": commit });
    output::report(&format!("microsig {version} ({commit})"), &result, common)
}
