//! The trackers: microsig's own, and third-party ones in `examples/trackers/NAME/`.
//!
//! A third-party tracker has `tracker.toml` (or the same keys as JSON in `tracker.json`): `name`, `command`
//! (default `python track.py`), `tracks` (`"D3"`, or `"T/entering"` for a single case), `made_for`, `depth`
//! (false if it measures no depth and does not enter cases that are scored with depth), and `tune` and
//! `tune_once`, see [`Tuning`]. Its `requirements.txt` is installed into a separate environment. The command
//! is run as `COMMAND DATASET --out results.csv [--params FILE]`, with `params/TRACK/CASE.json`,
//! `params/TRACK.json` or `params.json`.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};
use serde_json::Value;

use super::Case;
use suite::process;

/// A tracker of microsig.
struct Own {
    name: &'static str,
    arguments: &'static [&'static str],
    enters: &'static [&'static str],
    made_for: &'static str,
    has_depth: bool,
}

const OWN: &[Own] = &[
    Own {
        name: "spots",
        arguments: &["--method", "spots"],
        enters: &["P2", "T"],
        made_for: "particles in focus, in the image plane; default parameters",
        has_depth: false,
    },
    Own {
        name: "ncc",
        arguments: &["--method", "ncc"],
        enters: &["D3", "A3", "T/channel", "T/vortex", "T/brownian", "T/mixing", "T/turbulence"],
        made_for: "defocused images that resemble those of the calibration stack (GDPT); default parameters",
        has_depth: true,
    },
    Own {
        name: "ncc-spheroid",
        arguments: &["--method", "ncc", "--shape", "spheroid"],
        enters: &["S"],
        made_for: "rods and discs whose images resemble those of the optical model at some tilt; their common aspect ratio is measured; default parameters",
        has_depth: true,
    },
    Own {
        name: "mle-spheroid",
        arguments: &["--method", "mle", "--shape", "spheroid"],
        enters: &["S"],
        made_for: "rods and discs whose images follow the optical model with which they were generated; their common aspect ratio is measured; default parameters",
        has_depth: true,
    },
    Own {
        name: "mle",
        arguments: &["--method", "mle"],
        enters: &["D3", "A3", "T/channel", "T/vortex", "T/brownian", "T/mixing", "T/turbulence"],
        made_for: "images that follow the optical model with which they were generated: the performance of an exact model; default parameters",
        has_depth: true,
    },
    Own {
        name: "aptv",
        arguments: &["--method", "aptv"],
        enters: &["A3", "T/turbulence"],
        made_for: "isolated astigmatic images elongated along x or y; default parameters",
        has_depth: true,
    },
    Own {
        name: "piv",
        arguments: &["--method", "piv"],
        enters: &["V"],
        made_for: "displacement fields of single image pairs in focus; default parameters",
        has_depth: false,
    },
    Own {
        name: "piv-ensemble",
        arguments: &["--method", "piv", "--ensemble"],
        enters: &["V"],
        made_for: "one displacement field of a steady flow from all image pairs; default parameters",
        has_depth: false,
    },
];

/// How a tracker is run.
#[derive(Debug, Clone)]
pub(super) enum How {
    /// `microsig track` with these arguments.
    Own(Vec<String>),
    /// A command in its folder, with an environment for Python.
    Command { folder: PathBuf, command: Vec<String>, python: PathBuf },
}

/// Cases on which a tracker is tuned.
#[derive(Debug, Clone, Default)]
pub(super) struct Tuning {
    /// Tracks and cases with separate parameters.
    each: Vec<String>,
    /// Cases whose parameters apply to their track.
    once: Vec<String>,
}

impl Tuning {
    /// As `tracker.toml` specifies.
    fn of(description: &Value) -> Self {
        let list = |key: &str| -> Vec<String> {
            description[key]
                .as_array()
                .into_iter()
                .flatten()
                .filter_map(Value::as_str)
                .map(str::to_owned)
                .collect()
        };
        Tuning { each: list("tune"), once: list("tune_once") }
    }

    /// The file for the parameters that a search on this case finds, in the tracker's folder.
    pub(super) fn params(&self, case: &Case) -> Option<PathBuf> {
        let has = |list: &[String], name: &str| list.iter().any(|listed| listed == name);
        if has(&self.once, &case.folder()) {
            Some(format!("params/{}.json", case.track).into())
        } else if has(&self.each, &case.track) || has(&self.each, &case.folder()) {
            Some(format!("params/{}.json", case.folder()).into())
        } else {
            None
        }
    }
}

/// A tracker.
#[derive(Debug, Clone)]
pub(super) struct Tracker {
    pub(super) name: String,
    pub(super) how: How,
    /// Tracks and single cases.
    pub(super) tracks: Vec<String>,
    pub(super) made_for: String,
    /// Whether it measures depth.
    pub(super) has_depth: bool,
    pub(super) tuning: Tuning,
    /// Versions of the packages in its environment.
    pub(super) versions: String,
}

impl Tracker {
    /// Whether it takes part in a case.
    pub(super) fn enters(&self, case: &Case) -> bool {
        let is_asked = self.tracks.iter().any(|entered| *entered == case.track || *entered == case.folder());
        is_asked && (self.has_depth || !case.has_depth)
    }

    /// The file with its parameters for a case.
    pub(super) fn params(&self, case: &Case) -> Option<PathBuf> {
        let How::Command { folder, .. } = &self.how else { return None };
        let choices = [
            format!("params/{}.json", case.folder()),
            format!("params/{}.json", case.track),
            "params.json".to_owned(),
        ];
        choices.iter().map(|name| folder.join(name)).find(|path| path.is_file())
    }

    /// Creates its environment, unless one with the same requirements exists.
    pub(super) fn install(&mut self, venvs: &Path) -> anyhow::Result<()> {
        let How::Command { folder, python, .. } = &mut self.how else { return Ok(()) };
        let requirements = folder.join("requirements.txt");
        if !requirements.is_file() {
            return Ok(());
        }
        let venv = venvs.join(&self.name);
        let (installed, own) = (venv.join("installed.sha256"), venv.join("bin/python"));
        let hash = suite::sha256(&requirements)?;
        if std::fs::read_to_string(&installed).is_ok_and(|before| before == hash) {
            *python = own;
        } else {
            println!("{}: installing", self.name);
            if venv.exists() {
                std::fs::remove_dir_all(&venv)?;
            }
            process::run(Command::new("python3").args(["-m", "venv"]).arg(&venv))?;
            let pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r"];
            process::run(Command::new(&own).args(pip).arg(&requirements))?;
            std::fs::write(&installed, &hash)?;
            *python = own;
        }
        let freeze = ["-m", "pip", "freeze", "--disable-pip-version-check"];
        let (_, versions) = process::run(Command::new(&*python).args(freeze))?;
        self.versions = versions;
        Ok(())
    }
}

/// All trackers: ours first.
pub(super) fn all(examples: &Path) -> anyhow::Result<Vec<Tracker>> {
    let texts = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect();
    let own = OWN.iter().map(|own| Tracker {
        name: own.name.to_owned(),
        how: How::Own(texts(own.arguments)),
        tracks: texts(own.enters),
        made_for: own.made_for.to_owned(),
        has_depth: own.has_depth,
        tuning: Tuning::default(),
        versions: String::new(),
    });
    let mut all: Vec<Tracker> = own.collect();
    let mut folders: Vec<PathBuf> = std::fs::read_dir(examples)
        .map(|entries| entries.filter_map(|entry| Some(entry.ok()?.path())).collect())
        .unwrap_or_default();
    folders.sort();
    for folder in folders {
        let Some(description) = description(&folder)? else { continue };
        let tracker = read(&folder, &description).with_context(|| folder.display().to_string())?;
        if all.iter().any(|other| other.name == tracker.name) {
            bail!("{}: name = {:?}: another tracker has this name", folder.display(), tracker.name);
        }
        all.push(tracker);
    }
    Ok(all)
}

/// The contents of `tracker.toml` or `tracker.json`.
fn description(folder: &Path) -> anyhow::Result<Option<Value>> {
    let (toml, json) = (folder.join("tracker.toml"), folder.join("tracker.json"));
    if toml.is_file() {
        let text = std::fs::read_to_string(&toml)?;
        return of_toml(&text).with_context(|| toml.display().to_string()).map(Some);
    }
    if json.is_file() {
        let text = std::fs::read_to_string(&json)?;
        return serde_json::from_str(&text).with_context(|| json.display().to_string()).map(Some);
    }
    Ok(None)
}

/// The strings, lists of strings and booleans of a TOML file as JSON; other values are ignored.
fn of_toml(text: &str) -> anyhow::Result<Value> {
    let document: toml_edit::DocumentMut = text.parse()?;
    let mut description = serde_json::Map::new();
    for (key, item) in document.iter() {
        if let Some(text) = item.as_str() {
            description.insert(key.to_owned(), text.into());
        } else if let Some(is_so) = item.as_bool() {
            description.insert(key.to_owned(), is_so.into());
        } else if let Some(list) = item.as_array() {
            let texts: Vec<&str> = list.iter().filter_map(toml_edit::Value::as_str).collect();
            description.insert(key.to_owned(), texts.into());
        }
    }
    Ok(description.into())
}

fn read(folder: &Path, description: &Value) -> anyhow::Result<Tracker> {
    let text = |key: &str| description[key].as_str().map(str::to_owned);
    let name = text("name").context("name: expected a text")?;
    let is_name = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    ensure!(
        !name.is_empty() && name.chars().all(is_name),
        "name = {name:?}: expected letters, digits, `.`, `_`, `-`"
    );
    let tracks = description["tracks"].as_array().context("tracks: expected a list of texts")?;
    let command = text("command").unwrap_or_else(|| "python track.py".to_owned());
    Ok(Tracker {
        name,
        how: How::Command {
            folder: std::path::absolute(folder)?,
            command: command.split_whitespace().map(str::to_owned).collect(),
            python: "python3".into(),
        },
        tracks: tracks.iter().filter_map(|track| track.as_str().map(str::to_owned)).collect(),
        made_for: match (text("made_for").context("made_for: expected a text")?, text("out_of_depth")) {
            (made_for, Some(limits)) => format!("{made_for} Limitations: {limits}"),
            (made_for, None) => made_for,
        },
        has_depth: description["depth"].as_bool().unwrap_or(true),
        tuning: Tuning::of(description),
        versions: String::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(track: &str, name: &str, has_depth: bool) -> Case {
        Case { track: track.to_owned(), name: name.to_owned(), has_depth, rules: Vec::new() }
    }

    #[test]
    fn a_tracker_of_others_is_read_from_its_file() {
        let text =
            "name = \"a\"\ntracks = [\"P2\", \"T/entering\"]\nmade_for = \"\"\"\nspots\"\"\"\nbudget = 24\n";
        let tracker = read(Path::new("folder"), &of_toml(text).unwrap()).unwrap();
        assert!(tracker.enters(&case("P2", "x", false)) && tracker.enters(&case("T", "entering", true)));
        assert!(!tracker.enters(&case("T", "channel", false)));
        let flat = read(Path::new("folder"), &of_toml(&format!("{text}depth = false\n")).unwrap()).unwrap();
        assert!(flat.enters(&case("T", "entering", false)) && !flat.enters(&case("T", "entering", true)));
        assert_eq!(tracker.made_for.trim(), "spots");
        let wrong = read(Path::new("folder"), &of_toml("name = \"a/b\"\ntracks = []").unwrap());
        assert!(wrong.unwrap_err().to_string().contains("a/b"));
    }

    #[test]
    fn cases_are_tuned_alone_or_for_their_track() {
        let tuning = Tuning::of(&serde_json::json!({ "tune": ["P2", "T/a"], "tune_once": ["A3/x"] }));
        let params = |track: &str, name: &str| {
            let path = tuning.params(&case(track, name, false))?;
            Some(path.to_string_lossy().into_owned())
        };
        assert_eq!(params("P2", "x").as_deref(), Some("params/P2/x.json"));
        assert_eq!(params("T", "a").as_deref(), Some("params/T/a.json"));
        assert_eq!(params("A3", "x").as_deref(), Some("params/A3.json"));
        assert_eq!((params("T", "b"), params("A3", "y")), (None, None));
    }
}
