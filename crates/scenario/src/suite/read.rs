//! Reads and checks a suite file.

use std::path::Path;
use std::sync::{Arc, LazyLock};

use microsig_core::problem::{Problem, Problems, Source};

use serde_json::Value;

use super::spec::{LadderSpec, Size, SuiteSpec};
use super::{AxisValue, Rung, Suite};
use crate::language::derive::schema_of;
use crate::language::schema::{Schema, nearest};
use crate::language::text;
use crate::language::typed;
use crate::load::{Assignment, parse as parse_scenario, set};
use crate::source::read_text;
use crate::sweep::parse_sweep;
use storage::error::{Error, Result};

/// The schema of suite files.
pub fn suite_schema() -> Schema<'static> {
    static ROOT: LazyLock<Value> = LazyLock::new(schema_of::<SuiteSpec>);
    Schema::root(&ROOT)
}

pub(super) fn parse(text: &str, name: &str, folder: &Path) -> Result<Suite> {
    let source = Arc::new(Source::file(name, text));
    let tree = text::parse(&source).map_err(|problem| Error::Problems(vec![problem]))?;
    if tree.find("motion").1 || tree.find("axes").1 {
        let verb = if tree.find("axes").1 { "sweep" } else { "generate" };
        return Err(Error::input(format!(
            "{name}: is not a suite; run `microsig {verb} {name}` to generate its datasets"
        )));
    }
    let mut problems = Problems::default();
    let Some(spec) = typed::<SuiteSpec>(suite_schema(), &tree, &mut problems) else {
        return Err(Error::Problems(problems.sorted()));
    };
    named(&spec, &mut problems);
    let mut rungs = Vec::new();
    for (t, track) in spec.tracks.iter().enumerate() {
        let mut track_rungs: Vec<Vec<Rung>> = Vec::new();
        for (l, ladder) in track.ladders.iter().enumerate() {
            let at = format!("tracks.{t}.ladders.{l}");
            let found = rungs_of(ladder, &at, folder, &mut problems);
            for (i, rung) in found.iter().enumerate() {
                if track_rungs.iter().flatten().chain(&found[..i]).any(|other| other.name == rung.name) {
                    let message = format!("case `{}` occurs twice in track {}", rung.name, track.name);
                    problems.other(&at, message);
                }
            }
            chosen(ladder, &at, &found, &mut problems);
            track_rungs.push(found);
        }
        changes(&spec, t, &track_rungs, &mut problems);
        rungs.push(track_rungs);
    }
    tree.locate(&mut problems);
    problems.finish(Error::Problems)?;
    Ok(Suite { spec, folder: folder.to_owned(), is_shipped: false, rungs, _unpacked: None })
}

/// Whether a name is valid for a folder and, in lower case, as part of the name of a dataset.
fn is_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    (1..=60).contains(&name.len()) && name.chars().all(allowed) && !name.starts_with('.')
}

/// Checks the names of suite, tracks and ladders.
fn named(spec: &SuiteSpec, problems: &mut Problems) {
    const ALLOWED: &str = "1 to 60 letters, digits, `.`, `_`, `-`";
    let mut check = |path: &str, name: &str, is_lower: bool| {
        if !is_name(name) || is_lower && name != name.to_lowercase() {
            let allowed = if is_lower { format!("{ALLOWED}, in lower case") } else { ALLOWED.to_owned() };
            problems.value(path, format!("{name:?}"), &allowed);
        }
    };
    check("name", &spec.name, true);
    for (t, track) in spec.tracks.iter().enumerate() {
        check(&format!("tracks.{t}.name"), &track.name, false);
        for (l, ladder) in track.ladders.iter().enumerate() {
            check(&format!("tracks.{t}.ladders.{l}.name"), &ladder.name, true);
        }
    }
    for (t, track) in spec.tracks.iter().enumerate() {
        let is_same = |other: &&super::TrackSpec| other.name.eq_ignore_ascii_case(&track.name);
        if spec.tracks[..t].iter().any(|other| is_same(&other)) {
            problems.other(&format!("tracks.{t}.name"), format!("track {} occurs twice", track.name));
        }
    }
}

fn rungs_of(ladder: &LadderSpec, at: &str, folder: &Path, problems: &mut Problems) -> Vec<Rung> {
    let file = folder.join(&ladder.from);
    let read = read_text(&file).and_then(|text| {
        let name = file.display().to_string();
        let inputs = file.parent().unwrap_or(folder).to_owned();
        let source = Arc::new(Source::file(&name, &text));
        let is_sweep = text::parse(&source).is_ok_and(|tree| tree.find("axes").1);
        if !is_sweep {
            return Ok((vec![(Vec::new(), parse_scenario(&text, &name)?)], Vec::new(), inputs));
        }
        let sweep = parse_sweep(&text, &name, &inputs, None)?;
        let cases = sweep.cases.iter().map(|case| Ok((case.values.clone(), sweep.scenario(case)?)));
        let paths = sweep.spec.axes.iter().map(|axis| axis.path.clone()).collect();
        // Files are relative to the base scenario, which may be in another folder.
        let inputs = inputs.join(&sweep.spec.base).parent().map_or(inputs.clone(), Path::to_owned);
        Ok((cases.collect::<Result<Vec<_>>>()?, paths, inputs))
    });
    let (cases, paths, inputs): (_, Vec<String>, _) = match read {
        Ok(read) => read,
        Err(Error::Problems(found)) => {
            found.into_iter().for_each(|problem| problems.push(problem));
            return Vec::new();
        }
        Err(e) => {
            problems.other(&format!("{at}.from"), e.to_string());
            return Vec::new();
        }
    };
    let places = ladder.case.as_ref().map_or(paths.len(), |case| case.matches("{}").count());
    if places != paths.len() {
        let allowed = format!("`{{}}` for each of the {} axes of {}", paths.len(), ladder.from);
        problems.value(&format!("{at}.case"), format!("{places} times `{{}}`"), &allowed);
        return Vec::new();
    }
    if ladder.labels.len() > paths.len() {
        let (found, allowed) = (ladder.labels.len(), format!("at most {}, one for each axis", paths.len()));
        problems.value(&format!("{at}.labels"), format!("{found} labels"), &allowed);
    }
    let mut rungs = Vec::new();
    for (values, spec) in cases {
        let axes = shown(ladder, &paths, &values);
        let name = name_of(ladder, &axes);
        if !is_name(&name) || name != name.to_lowercase() {
            let allowed = "1 to 60 lower-case letters, digits, `.`, `_`, `-`; `case` gives other names";
            problems.value(at, format!("case {name:?}"), allowed);
        }
        rungs.push(Rung { name, axes, spec, inputs: inputs.clone() });
    }
    rungs
}

/// The values of a case with the labels of the ladder.
fn shown(ladder: &LadderSpec, paths: &[String], values: &[String]) -> Vec<AxisValue> {
    let of = |(i, (path, value)): (usize, (&String, &String))| {
        let label = ladder.labels.get(i);
        let factor = label.map_or(1.0, |label| label.factor);
        // The last number of a tuple such as (258, 0, 200) distinguishes the cases of a ladder; of a variant
        // such as count(46) its content.
        let parsed = text::parse(&Arc::new(Source::assignment(path, value)));
        let number = parsed.ok().and_then(|node| node.last_number()).filter(|number| number.is_finite());
        // A product is rounded to 4 digits: 0.1 times 30 is 3.0000000000000004.
        let product = |x: f64| format!("{:.3e}", x * factor).parse().unwrap_or(x);
        let number = number.map(|x| if factor == 1.0 { x } else { product(x) });
        AxisValue {
            label: label.map_or_else(|| path.clone(), |label| label.name.clone()),
            shown: number.map_or_else(|| value.clone(), |x: f64| x.to_string()),
            number,
        }
    };
    paths.iter().zip(values).enumerate().map(of).collect()
}

fn name_of(ladder: &LadderSpec, axes: &[AxisValue]) -> String {
    let places = vec!["{}"; axes.len()].join("_");
    let default = if axes.is_empty() { ladder.name.clone() } else { format!("{}_{places}", ladder.name) };
    let mut parts = ladder.case.as_ref().unwrap_or(&default).split("{}").map(str::to_owned);
    let first = parts.next().unwrap_or_default();
    axes.iter().zip(parts).fold(first, |name, (axis, after)| name + &axis.shown + &after)
}

/// Checks the names of the cases that small sizes choose.
fn chosen(ladder: &LadderSpec, at: &str, rungs: &[Rung], problems: &mut Problems) {
    if rungs.is_empty() {
        return;
    }
    for size in Size::ALL {
        for (i, name) in ladder.only(size).unwrap_or_default().iter().enumerate() {
            if !rungs.iter().any(|rung| rung.name == *name) {
                let path = format!("{at}.{}.{i}", size.name());
                let names = || rungs.iter().map(|rung| rung.name.as_str());
                let near = nearest(name, names()).map(|near| format!("did you mean \"{near}\"?"));
                let allowed = format!("one of {}", names().collect::<Vec<_>>().join(", "));
                problems.push(Problem::value(&path, format!("{name:?}"), &allowed).hinted(near));
            }
        }
    }
}

/// Checks the changes of each size in the first case of each ladder.
fn changes(spec: &SuiteSpec, t: usize, rungs: &[Vec<Rung>], problems: &mut Problems) {
    let track = &spec.tracks[t];
    for (l, (ladder, rungs)) in track.ladders.iter().zip(rungs).enumerate() {
        let Some(first) = rungs.first() else { continue };
        let (sizes, above) = match &ladder.sizes {
            Some(sizes) => (sizes, format!("tracks.{t}.ladders.{l}.sizes")),
            None => (&track.sizes, format!("tracks.{t}.sizes")),
        };
        for size in Size::ALL {
            for (i, assigned) in sizes.of(size).set.iter().enumerate() {
                let path = format!("{above}.{}.set.{i}", size.name());
                let changed = assigned
                    .parse::<Assignment>()
                    .and_then(|Assignment { path, value }| set(&first.spec, &path, &value));
                if let Err(e) = changed {
                    let first = e.problems().into_iter().next().unwrap_or_default();
                    problems.other(&path, format!("{assigned}: {first} ({})", ladder.from));
                }
            }
        }
    }
}
