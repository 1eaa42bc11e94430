//! The house rules of the repository that a program can check (CONTRIBUTING.md): no cycles between modules,
//! files of readable length, comments no wider than code, documents without dead links.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use suite::modules::{ModuleGraph, Use};

/// Maximum length of a file whose header gives no reason, lines.
const LONGEST_FILE: usize = 500;
/// Start of the sentence of the header in which a longer file gives its reason.
const REASON: &str = "Longer than 500 lines because";
/// Endings of the languages of the repository, with the starts of lines that are comments.
const LANGUAGES: [(&str, &[&str]); 4] =
    [(".rs", &["//"]), (".py", &["#"]), (".js", &["//", "/**", "* "]), (".mjs", &["//", "/**", "* "])];

/// Known cycles still to be removed: crate, the using module, the used module.
const ALLOWED_CYCLES: [(&str, &str, &str); 0] = [];
/// Files still to be split or to be given a reason.
const LONG_FILES_TO_GO: [&str; 0] = [];
/// Folders with comments still to be wrapped.
const WIDE_COMMENTS_TO_GO: [&str; 0] = [];
/// Folders with files in which public items still lack documentation.
const UNDOCUMENTED_TO_GO: [&str; 0] = [];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

/// Paths (relative to the root of the repository) and texts of all files with the ending.
fn files(ending: &str) -> Vec<(String, String)> {
    let found: Vec<_> = paths()
        .into_iter()
        .filter(|path| path.ends_with(ending))
        .map(|path| (path.clone(), std::fs::read_to_string(root().join(&path)).unwrap()))
        .collect();
    assert!(found.len() > 3, "files that end in {ending}: {}", found.len());
    found
}

/// Paths and texts of all source files written here, with the starts of their comments.
fn written() -> impl Iterator<Item = (String, String, &'static [&'static str])> {
    let of = |(ending, marks): (&str, &'static [&'static str])| {
        files(ending).into_iter().map(move |(path, text)| (path, text, marks))
    };
    LANGUAGES.into_iter().flat_map(of).filter(|(path, ..)| !path.contains("uPlot"))
}

/// Paths of all files of the repository relative to its root, without build folders and datasets.
fn paths() -> Vec<String> {
    let root = root();
    let mut found = Vec::new();
    let mut folders = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_dir() {
                if !name.starts_with('.')
                    && !["target", "datasets", "corpus", "artifacts", "node_modules"].contains(&name.as_str())
                {
                    folders.push(path);
                }
            } else {
                found.push(path.strip_prefix(&root).unwrap().to_string_lossy().into_owned());
            }
        }
    }
    found.sort();
    found
}

#[test]
fn modules_beside_each_other_form_no_cycles() {
    let mut wrong = Vec::new();
    for (name, file) in [
        ("microsig-core", "crates/microsig-core/src/lib.rs"),
        ("flows", "crates/flows/src/lib.rs"),
        ("storage", "crates/storage/src/lib.rs"),
        ("visibility", "crates/visibility/src/lib.rs"),
        ("scenario", "crates/scenario/src/lib.rs"),
        ("generator", "crates/generator/src/lib.rs"),
        ("scoring", "crates/scoring/src/lib.rs"),
        ("tracking", "crates/tracking/src/lib.rs"),
        ("fit", "crates/fit/src/lib.rs"),
        ("bench", "crates/bench/src/lib.rs"),
        ("microsig", "crates/bench/src/main.rs"),
        ("suite", "tests/src/lib.rs"),
        ("xtask", "xtask/src/main.rs"),
    ] {
        let graph = ModuleGraph::read(&root().join(file)).unwrap();
        let allowed: Vec<Use> = ALLOWED_CYCLES
            .iter()
            .filter(|(of, ..)| *of == name)
            .map(|(_, from, to)| Use { from: (*from).to_owned(), to: (*to).to_owned() })
            .collect();
        let (cycles, idle) = graph.cycles(&allowed);
        wrong.extend(cycles.iter().map(|cycle| format!("{name}: a cycle:\n    {cycle}")));
        wrong.extend(idle.iter().map(|e| {
            format!("{name}: {} -> {} closes no cycle: remove it from ALLOWED_CYCLES", e.from, e.to)
        }));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn cycles_are_found_through_imports_and_re_exports() {
    let place = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(place.path().join(name), text).unwrap();
    write("lib.rs", "pub mod a; mod b; mod c; pub use b::B;\n");
    write("a.rs", "use crate::B;\npub struct A(B);\n");
    write("b.rs", "pub struct B; fn f() { println!(\"{}\", crate::c::g()) }\n");
    write("c.rs", "pub fn g() -> u8 { 1 }\n#[cfg(test)]\nmod tests { use crate::a::A; }\n");
    let graph = || ModuleGraph::read(&place.path().join("lib.rs")).unwrap();
    assert_eq!(graph().len(), 4);
    assert_eq!(graph().cycles(&[]), (vec![], vec![]), "tests may use what they like");

    write("c.rs", "pub fn g() -> u8 { size_of::<super::a::A>() as u8 }\n");
    let closing = Use { from: "c".to_owned(), to: "a".to_owned() };
    let (cycles, _) = graph().cycles(&[]);
    assert_eq!(cycles, ["a -> b (in a)\n    b -> c (in b)\n    c -> a (in c)"]);
    assert_eq!(graph().cycles(std::slice::from_ref(&closing)), (vec![], vec![]));

    write("c.rs", "pub fn g() -> u8 { 1 }\n");
    assert_eq!(graph().cycles(std::slice::from_ref(&closing)), (vec![], vec![closing]));
}

/// Fails on findings outside the list of known exceptions and on exceptions without a finding.
fn nothing_but(to_go: &[&str], found: &[(String, String)], what: &str) {
    let new: Vec<&str> = found
        .iter()
        .filter(|(path, _)| !to_go.iter().any(|known| path.starts_with(known)))
        .map(|(_, finding)| finding.as_str())
        .collect();
    assert!(new.is_empty(), "{} {what}:\n{}", new.len(), new[..new.len().min(20)].join("\n"));
    let done: Vec<_> =
        to_go.iter().filter(|known| !found.iter().any(|(path, _)| path.starts_with(**known))).collect();
    assert!(done.is_empty(), "fixed by now, remove them from the list of exceptions: {done:?}");
}

#[test]
fn long_files_say_in_their_header_why() {
    let long: Vec<_> = written()
        .map(|(path, text, _)| (path, text))
        .filter(|(_, text)| text.lines().count() > LONGEST_FILE && !text.contains(REASON))
        .map(|(path, text)| (path.clone(), format!("{path}: {} lines", text.lines().count())))
        .collect();
    nothing_but(&LONG_FILES_TO_GO, &long, &format!("files without `{REASON} ...` in the header"));
}

#[test]
fn comments_stay_within_the_width_of_code() {
    let format = std::fs::read_to_string(root().join("rustfmt.toml")).unwrap();
    let width = format.lines().find_map(|line| line.strip_prefix("max_width = ")).unwrap().parse().unwrap();
    let mut wide = Vec::new();
    for (path, text, marks) in written() {
        for (number, line) in text.lines().enumerate() {
            let comment = marks.iter().any(|mark| line.trim_start().starts_with(mark));
            // A link or a path cannot be broken.
            let words = line.split_whitespace().skip(1).count();
            if comment && line.chars().count() > width && words > 1 {
                wide.push((path.clone(), format!("{path}:{}", number + 1)));
            }
        }
    }
    nothing_but(
        &WIDE_COMMENTS_TO_GO,
        &wide,
        &format!("comments wider than {width} (`cargo xtask wrap` wraps them)"),
    );
}

/// Files that may open others past `storage::input`: what writes and locks them, and what reads the system's
/// own (`/proc`).
const OPENING: [&str; 6] = [
    "crates/storage/src/file.rs",
    "crates/storage/src/folder.rs",
    "crates/storage/src/journal.rs",
    "crates/storage/src/lock.rs",
    "crates/storage/src/memory.rs",
    "crates/flows/examples/bars.rs",
];

/// A pipe in the place of a file would block whoever opens it, a device may be endless.
#[test]
fn files_are_opened_where_pipes_and_devices_are_refused() {
    const CALLS: [&str; 5] =
        ["File::open(", "fs::read(", "fs::read_to_string(", "OpenOptions::new(", "from_path("];
    let is_program = |path: &str| {
        (path.starts_with("crates/") || path.starts_with("python/src/"))
            && !path.contains("/tests")
            && !path.contains("/benches/")
    };
    let mut opening = Vec::new();
    for (path, text) in files(".rs").into_iter().filter(|(path, _)| is_program(path)) {
        // Tests are at the end of a file.
        let program = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
        for (number, line) in program.lines().enumerate() {
            if CALLS.iter().any(|call| line.contains(call)) {
                opening.push((path.clone(), format!("{path}:{}: {}", number + 1, line.trim())));
            }
        }
    }
    nothing_but(&OPENING, &opening, "files opened past storage::input");
}

#[test]
fn every_public_item_is_documented() {
    let lax: Vec<_> = files(".rs")
        .into_iter()
        .filter(|(path, text)| path != "tests/suite/house.rs" && text.contains("(missing_docs"))
        .map(|(path, _)| (path.clone(), path))
        .collect();
    nothing_but(&UNDOCUMENTED_TO_GO, &lax, "files with `allow(missing_docs)`");
}

/// Targets of the links in a Markdown text, except web and mail addresses.
fn links(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut fenced = false;
    for line in text.lines() {
        fenced ^= line.trim_start().starts_with("```");
        if fenced {
            continue;
        }
        for (at, _) in line.match_indices("](") {
            let target = line[at + 2..].split(')').next().unwrap_or_default();
            if !target.contains("://") && !target.starts_with("mailto:") {
                found.push(target.to_owned());
            }
        }
    }
    found
}

/// Anchors of a page as GitHub derives them from its headings.
fn anchors(text: &str) -> BTreeSet<String> {
    text.lines()
        .filter(|line| line.starts_with('#'))
        .map(|line| {
            let title = line.trim_start_matches('#').trim().to_lowercase();
            let kept = title.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
            kept.map(|c| if c == ' ' { '-' } else { c }).collect()
        })
        .collect()
}

#[test]
fn every_link_in_the_documents_leads_somewhere() {
    let mut broken = Vec::new();
    // Report templates are stored beside the programs that fill them in; their links are relative to the
    // report.
    let pages = files(".md").into_iter().filter(|(path, _)| !path.contains("/src/"));
    for (path, text) in pages {
        let folder = root().join(&path);
        let folder = folder.parent().unwrap();
        for link in links(&text) {
            let (file, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target = if file.is_empty() { root().join(&path) } else { folder.join(file) };
            let there = target.exists()
                && (anchor.is_empty()
                    || std::fs::read_to_string(&target).is_ok_and(|page| anchors(&page).contains(anchor)));
            if !there {
                broken.push(format!("{path}: {link}"));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

/// Text between backticks.
fn code_spans(text: &str) -> Vec<&str> {
    let outside_fences = text.split("```").step_by(2);
    outside_fences.flat_map(|part| part.split('`').skip(1).step_by(2)).collect()
}

#[test]
fn every_path_that_architecture_md_names_exists() {
    let text = std::fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let sources = paths();
    let mut missing = Vec::new();
    let mut checked = 0;
    for span in code_spans(&text) {
        let is_path = !span.contains([' ', '*', '(', '<', '='])
            && [".rs", ".md", ".ron", ".toml", ".py", "/"].iter().any(|end| span.ends_with(end));
        if is_path {
            checked += 1;
            let (name, tail) = (span.trim_end_matches('/'), format!("/{span}"));
            let there = root().join(name).exists()
                || sources.iter().any(|path| path.ends_with(&tail) || path.contains(&format!("/{name}/")));
            // Files of a dataset, not of the repository.
            if !there && !DATASET_PATHS.contains(&span) {
                missing.push(span);
            }
        }
    }
    assert!(checked > 30, "paths in ARCHITECTURE.md: {checked}");
    assert!(missing.is_empty(), "ARCHITECTURE.md names what is not there: {missing:?}");
}

/// Paths inside datasets that ARCHITECTURE.md mentions.
const DATASET_PATHS: [&str; 2] = ["scenario.ron", "images/"];
