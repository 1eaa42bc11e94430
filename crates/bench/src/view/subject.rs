//! What the page shows: a scenario, a dataset with results, or the cases of a sweep with the results of
//! trackers.

use std::path::{Path, PathBuf};

use microsig_core::render::Context;
use scenario::{SCENARIO, Shipped, read_text};
use scoring::evaluate::measurement::check_order;
use storage::dataset::cases::{CASES, CaseReader};
use storage::dataset::manifest::MANIFEST;
use storage::error::{Error, Result};
use storage::folder::is_partial;

/// What the page shows. Requests refer to datasets and trackers by their index in these lists.
#[derive(Debug, Clone, Default)]
pub struct Subject {
    /// The scenario's file, which `save` writes; `None` if the page starts from a shipped scenario.
    pub scenario: Option<PathBuf>,
    /// Name of the shipped scenario that was asked for.
    pub shipped: Option<String>,
    /// The datasets: one, or the cases of a sweep.
    pub datasets: Vec<DatasetEntry>,
    /// The trackers whose results are shown.
    pub trackers: Vec<Tracker>,
    pub axes: Vec<String>,
    /// The sweep's folder, if a sweep is shown.
    pub sweep: Option<PathBuf>,
    pub context: Context,
}

/// A dataset that can be opened.
#[derive(Debug, Clone)]
pub struct DatasetEntry {
    /// Its name, or its case's in a sweep.
    pub name: String,
    pub folder: PathBuf,
    pub values: Vec<String>,
}

#[derive(Debug, Clone)]
pub struct Tracker {
    /// The name of its file or folder.
    pub name: String,
    /// The result for each dataset, if there is one.
    pub results: Vec<Option<PathBuf>>,
}

/// Maximum number of cases of a sweep that are shown.
const MAX_CASES: usize = 100_000;

impl Subject {
    /// The subject at a path; `results` are results for a dataset, or folders with results for the cases of a
    /// sweep.
    pub fn of(path: Option<&Path>, results: &[PathBuf]) -> Result<Self> {
        let Some(path) = path else { return Ok(Subject::default()) };
        if path.is_dir() {
            if is_partial(path) {
                let hint = "unfinished; microsig generate --resume (or sweep --resume) continues it";
                return Err(Error::input(format!("{}: {hint}", path.display())));
            }
            if path.join(MANIFEST).is_file() {
                return Subject::from_dataset(path, results);
            }
            return Subject::from_sweep(path, results);
        }
        if let Some(stray) = results.first() {
            check_order(path, stray)?;
            let what = "is a scenario, which has no results";
            return Err(Error::input(format!("{}: {} {what}", stray.display(), path.display())));
        }
        let named = path.to_str().and_then(Shipped::named);
        if path.exists() {
            read_text(path)?;
        } else if let Some(named) = named {
            return Ok(Subject { shipped: Some(named.name.to_owned()), ..Subject::default() });
        } else if !path.extension().is_some_and(|end| end == "ron" || end == "json") {
            let expected = "expected a scenario, a dataset or a sweep's folder";
            return Err(Error::input(format!("{}: no such file or folder; {expected}", path.display())));
        }
        Ok(Subject { scenario: Some(path.to_owned()), ..Subject::default() })
    }

    fn from_dataset(folder: &Path, results: &[PathBuf]) -> Result<Self> {
        let name =
            |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let mut trackers: Vec<Tracker> = Vec::new();
        for path in results {
            let path = found(path)?;
            let own = path.file_stem().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            // Results with the same name are in different folders.
            let is_taken = trackers.iter().any(|tracker| tracker.name == own);
            let name = if is_taken { path.display().to_string() } else { own };
            trackers.push(Tracker { name, results: vec![Some(path)] });
        }
        let whole = folder.canonicalize().map_err(|e| Error::read(folder, e))?;
        let dataset = DatasetEntry { name: name(&whole), folder: folder.to_owned(), values: Vec::new() };
        Ok(Subject { datasets: vec![dataset], trackers, ..Subject::default() })
    }

    fn from_sweep(folder: &Path, results: &[PathBuf]) -> Result<Self> {
        let (axes, cases) = cases(folder)?;
        let datasets: Vec<DatasetEntry> = cases
            .into_iter()
            .map(|(name, values)| DatasetEntry { folder: folder.join(&name), name, values })
            .collect();
        if datasets.is_empty() {
            let expected = "expected a scenario, a dataset or a sweep's folder";
            return Err(Error::input(format!("{}: contains no dataset; {expected}", folder.display())));
        }
        let mut trackers = Vec::new();
        for root in results {
            if !root.is_dir() {
                let expected = "expected a folder with a result of each case, CASE.csv or CASE/result.csv";
                return Err(Error::input(format!("{}: {expected}", root.display())));
            }
            let of_case = |case: &DatasetEntry| {
                let names = [
                    format!("{}.csv", case.name),
                    format!("{}.xml", case.name),
                    format!("{}/result.csv", case.name),
                ];
                names.iter().map(|name| root.join(name)).find(|path| path.is_file())
            };
            let of_cases: Vec<Option<PathBuf>> = datasets.iter().map(of_case).collect();
            if of_cases.iter().all(Option::is_none) {
                let expected = "contains no result of a case; expected CASE.csv or CASE/result.csv";
                return Err(Error::input(format!("{}: {expected}", root.display())));
            }
            let name = root.file_name().map(|n| n.to_string_lossy().into_owned());
            trackers.push(Tracker {
                name: name.unwrap_or_else(|| root.display().to_string()),
                results: of_cases,
            });
        }
        Ok(Subject { datasets, trackers, axes, sweep: Some(folder.to_owned()), ..Subject::default() })
    }

    /// Name and text with which the editor starts.
    pub fn text(&self) -> Result<(String, String)> {
        let path = match (&self.scenario, self.datasets.first()) {
            (Some(path), _) if path.exists() => path.clone(),
            (None, Some(dataset)) if dataset.folder.join(SCENARIO).is_file() => dataset.folder.join(SCENARIO),
            (path, _) => {
                let named = self.shipped.as_deref();
                let start = Shipped::named(named.unwrap_or("quickstart"));
                let name = path.as_ref().map(|p| p.display().to_string());
                let name = name.unwrap_or_else(|| format!("{}.ron", named.unwrap_or("scenario")));
                return Ok((name, start.map(|start| start.text.to_owned()).unwrap_or_default()));
            }
        };
        Ok((path.display().to_string(), read_text(&path)?))
    }

    /// The folder that paths in the scenario are relative to.
    pub fn base(&self) -> PathBuf {
        let beside = |file: &PathBuf| file.parent().map(Path::to_path_buf);
        let of_dataset = || self.datasets.first().map(|dataset| dataset.folder.clone());
        let base = self.scenario.as_ref().and_then(beside).or_else(of_dataset).unwrap_or_default();
        if base.as_os_str().is_empty() { PathBuf::from(".") } else { base }
    }
}

/// Checks that a result exists.
fn found(path: &Path) -> Result<PathBuf> {
    std::fs::metadata(path).map_err(|e| Error::read(path, e))?;
    Ok(path.to_owned())
}

/// A case of a sweep: its folder's name and its values on the axes.
type Case = (String, Vec<String>);

/// Axes and finished cases of a sweep: from its table, or from its folders if it is unfinished.
fn cases(folder: &Path) -> Result<(Vec<String>, Vec<Case>)> {
    let is_case = |name: &str| is_name(name) && folder.join(name).join(MANIFEST).is_file();
    if !folder.join(CASES).is_file() {
        let mut names = storage::walk::names(folder, is_name)?;
        names.retain(|name| is_case(name));
        names.sort_unstable();
        names.truncate(MAX_CASES);
        return Ok((Vec::new(), names.into_iter().map(|name| (name, Vec::new())).collect()));
    }
    let mut reader = CaseReader::open(folder)?.ok_or_else(|| {
        Error::input(format!("{}: is not a table of a sweep's cases", folder.join(CASES).display()))
    })?;
    let mut cases = Vec::new();
    for _ in 0..MAX_CASES {
        let Some(case) = reader.next_case()? else { break };
        if is_case(&case.0) {
            cases.push(case);
        }
    }
    Ok((reader.axes().to_vec(), cases))
}

/// Whether a text is a plain name, without separators.
fn is_name(text: &str) -> bool {
    let mut parts = Path::new(text).components();
    matches!((parts.next(), parts.next()), (Some(std::path::Component::Normal(_)), None))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shipped_scenario_is_shown_by_its_name() {
        let subject = Subject::of(Some(Path::new("coffee_ring")), &[]).unwrap();
        let (name, text) = subject.text().unwrap();
        assert_eq!((name.as_str(), subject.scenario), ("coffee_ring.ron", None));
        assert!(text.contains("name: \"coffee_ring\""));
        assert_eq!(Subject::default().text().unwrap().0, "scenario.ron");
        let said = Subject::of(Some(Path::new("cofee_ring")), &[]).unwrap_err().to_string();
        assert!(said.contains("cofee_ring: no such file or folder; expected a scenario"), "{said}");
    }
}
