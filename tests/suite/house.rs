//! Rules of the repository that neither clippy nor rustfmt checks: files are opened where pipes and devices are
//! refused, documents have no dead links, messages name options that exist, and versions that decide bytes are exact.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

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

/// Files that may open others past `storage::input`: what writes and locks them, and what reads the system's
/// own (`/proc`).
const OPENING: [&str; 6] = [
    "crates/storage/src/file.rs",
    "crates/storage/src/folder.rs",
    "crates/storage/src/journal.rs",
    "crates/storage/src/lock.rs",
    "crates/storage/src/memory.rs",
    "crates/storage/src/standard.rs",
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
    opening.retain(|(path, _)| !OPENING.contains(&path.as_str()));
    assert!(opening.is_empty(), "files opened past storage::input: {opening:#?}");
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

/// The long options of a command and of all below it.
fn options(command: &clap::Command, found: &mut BTreeSet<String>) {
    found.extend(command.get_arguments().filter_map(|argument| Some(format!("--{}", argument.get_long()?))));
    command.get_subcommands().for_each(|below| options(below, found));
}

#[test]
fn options_that_messages_name_are_options_of_the_command() {
    let mut known = BTreeSet::new();
    options(&<bench::cli::Cli as clap::CommandFactory>::command(), &mut known);
    let (mut named, mut wrong) = (0, Vec::new());
    for (path, text) in files(".rs").into_iter().filter(|(path, _)| path.starts_with("crates/")) {
        for constructor in [" option(\"", "(option(\"", " flag(\"", "(flag(\"", "NumberRange { key: \""] {
            let keys = text.split(constructor).skip(1).filter_map(|rest| rest.split('"').next());
            for option in keys.map(storage::advice::option_of) {
                named += 1;
                if !known.contains(&option) {
                    wrong.push(format!("{path}: {option}"));
                }
            }
        }
    }
    assert!(wrong.is_empty() && named > 60, "{named} options, of which no verb has {wrong:?}");
}

/// What decides the bytes of datasets (arithmetic, random numbers, numbers as text, images and previews) and
/// of the archives of challenges.
const DECIDING: &str =
    "chacha20 csv fdeflate flate2 glam image itoa libm miniz_oxide png ron serde_json tiff zip zmij";

/// `cargo install` without `--locked` takes the newest versions that Cargo.toml allows.
#[test]
fn what_decides_bytes_does_not_depend_on_the_lock_file() {
    let read = |name: &str| std::fs::read_to_string(root().join(name)).unwrap();
    let (manifest, lock) = (read("Cargo.toml"), read("Cargo.lock"));
    let of_command = ["microsig-core", "flows", "storage", "scenario", "generator", "arena", "bench"];
    let of_command: Vec<String> =
        of_command.iter().map(|of| read(&format!("crates/{of}/Cargo.toml"))).collect();
    for name in DECIDING.split(' ') {
        let begins = [format!("{name} = \""), format!("{name} = {{ version = \"")];
        let version = manifest
            .lines()
            .find_map(|line| begins.iter().find_map(|begin| line.strip_prefix(begin.as_str())))
            .and_then(|rest| rest.split('"').next())
            .unwrap_or_default();
        let locked = |exact| lock.contains(&format!("name = \"{name}\"\nversion = \"{exact}\""));
        assert!(
            version.strip_prefix('=').is_some_and(locked),
            "{name} = \"{version}\": expected = and the version in Cargo.lock"
        );
        // It binds only if a package of the command asks for it.
        let asks = of_command.iter().any(|manifest| manifest.contains(&format!("\n{name}.workspace = true")));
        assert!(asks, "{name}: no package of the command depends on it");
    }
}
