//! Dependencies between the modules of a crate, read from its source, and cycles among modules of one folder.
//!
//! Paths are followed through imports and re-exports to the defining module. A module and its submodules
//! count as one: a parent and its children may use each other. Code under `#[cfg(test)]` is skipped.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, anyhow};
use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// A path as segments, without the leading `crate`.
type Segments = Vec<String>;

/// The declarations and paths of one module.
#[derive(Debug, Default)]
struct Module {
    children: BTreeSet<String>,
    /// Names of the items defined here.
    items: BTreeSet<String>,
    /// Imported names and their paths.
    imports: BTreeMap<String, Segments>,
    /// Modules imported by `use path::*`.
    globs: Vec<Segments>,
    /// Paths with at least two segments; those that begin with `crate`, `self` or `super` are made absolute.
    paths: BTreeSet<Segments>,
}

/// The modules of one crate.
#[derive(Debug, Default)]
pub struct ModuleGraph {
    modules: BTreeMap<Segments, Module>,
}

/// A dependency between two sibling modules; names begin at the root of the crate.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Use {
    /// The dependent module.
    pub from: String,
    /// The module it depends on.
    pub to: String,
}

impl ModuleGraph {
    /// Reads a crate from its root file (`lib.rs` or `main.rs`); fails on a file that is missing or is not
    /// Rust.
    pub fn read(root: &Path) -> anyhow::Result<Self> {
        let mut graph = ModuleGraph::default();
        let folder = root.parent().context("a root file lies in a folder")?;
        graph.read_file(root, folder, Vec::new())?;
        Ok(graph)
    }

    /// Number of modules.
    pub fn len(&self) -> usize {
        self.modules.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.modules.is_empty()
    }

    fn read_file(&mut self, file: &Path, folder: &Path, path: Segments) -> anyhow::Result<()> {
        let text = std::fs::read_to_string(file).with_context(|| file.display().to_string())?;
        let tokens: TokenStream = text.parse().map_err(|e| anyhow!("{}: {e}", file.display()))?;
        self.read_module(tokens, folder, path)
    }

    fn read_module(&mut self, tokens: TokenStream, folder: &Path, path: Segments) -> anyhow::Result<()> {
        let mut module = Module::default();
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let mut at = 0;
        while at < tokens.len() {
            match &tokens[at] {
                TokenTree::Punct(p) if p.as_char() == '#' && is_test(tokens.get(at + 1)) => {
                    at = end_of_item(&tokens, at + 2);
                }
                TokenTree::Ident(word) if word == "mod" => {
                    let name = tokens.get(at + 1).context("a module has a name")?.to_string();
                    module.children.insert(name.clone());
                    let child: Segments = path.iter().cloned().chain([name.clone()]).collect();
                    match tokens.get(at + 2) {
                        Some(TokenTree::Group(body)) => {
                            self.read_module(body.stream(), &folder.join(&name), child)?;
                        }
                        _ => {
                            let inside = folder.join(&name);
                            let file = folder.join(format!("{name}.rs"));
                            let file = if file.exists() { file } else { inside.join("mod.rs") };
                            self.read_file(&file, &inside, child)?;
                        }
                    }
                    at += 3;
                }
                TokenTree::Ident(word) if word == "use" => {
                    let end = (at..tokens.len()).find(|k| is_punct(&tokens[*k], ';')).unwrap_or(tokens.len());
                    module.import(&tokens[at + 1..end], &[], &path);
                    at = end + 1;
                }
                TokenTree::Ident(word) if ITEMS.contains(&word.to_string().as_str()) => {
                    if let Some(TokenTree::Ident(name)) = tokens.get(at + 1) {
                        module.items.insert(name.to_string());
                    }
                    at += 1;
                }
                TokenTree::Group(group) => {
                    module.name_paths(group.stream(), &path);
                    at += 1;
                }
                _ => at = module.name_path(&tokens, at, &path),
            }
        }
        self.modules.insert(path, module);
        Ok(())
    }

    /// The module that a path names, or that defines the item; `None` outside the crate.
    fn resolve(&self, path: &[String], depth: u32) -> Option<Segments> {
        let mut here = Segments::new();
        for (k, name) in path.iter().enumerate() {
            let module = self.modules.get(&here)?;
            if module.children.contains(name) {
                here.push(name.clone());
                continue;
            }
            if depth == 0 || module.items.contains(name) {
                return Some(here);
            }
            if let Some(target) = module.imports.get(name) {
                let further: Segments = target.iter().chain(&path[k + 1..]).cloned().collect();
                return self.resolve_from(&here, &further, depth - 1);
            }
            let through = module.globs.iter().find_map(|glob| {
                let there = self.resolve_from(&here, glob, depth - 1)?;
                let defines = self.modules.get(&there).is_some_and(|m| {
                    m.items.contains(name) || m.imports.contains_key(name) || m.children.contains(name)
                });
                defines.then(|| there.iter().chain(&path[k..]).cloned().collect::<Segments>())
            });
            return through.map_or(Some(here), |path| self.resolve(&path, depth - 1));
        }
        Some(here)
    }

    /// The same for a path as written in the module `here`: absolute (`crate`), or relative to that module.
    fn resolve_from(&self, here: &Segments, path: &[String], depth: u32) -> Option<Segments> {
        let (first, rest) = path.split_first()?;
        if first == "crate" {
            return self.resolve(rest, depth);
        }
        let module = self.modules.get(here)?;
        if module.children.contains(first) || module.items.contains(first) {
            let absolute: Segments = here.iter().chain(path).cloned().collect();
            return self.resolve(&absolute, depth);
        }
        let target = module.imports.get(first).filter(|target| depth > 0 && target.as_slice() != path)?;
        let further: Segments = target.iter().chain(rest).cloned().collect();
        self.resolve_from(here, &further, depth - 1)
    }

    /// Every dependency between siblings, with the modules in which it occurs.
    fn uses(&self) -> BTreeMap<Use, BTreeSet<String>> {
        let mut uses: BTreeMap<Use, BTreeSet<String>> = BTreeMap::new();
        for (here, module) in &self.modules {
            for path in module.paths.iter().chain(module.imports.values()).chain(&module.globs) {
                let Some(there) = self.resolve_from(here, path, 16) else { continue };
                let shared = here.iter().zip(&there).take_while(|(a, b)| a == b).count();
                if shared < here.len() && shared < there.len() {
                    let edge = Use { from: here[..=shared].join("::"), to: there[..=shared].join("::") };
                    uses.entry(edge).or_default().insert(here.join("::"));
                }
            }
        }
        uses
    }

    /// Cycles that remain without the `allowed` dependencies, and allowed dependencies that are not part of a
    /// cycle.
    pub fn cycles(&self, allowed: &[Use]) -> (Vec<String>, Vec<Use>) {
        let uses = self.uses();
        let reach = |from: &str, to: &str, without: &dyn Fn(&Use) -> bool| -> Option<Vec<Use>> {
            let mut queue = std::collections::VecDeque::from([from.to_owned()]);
            let mut came: BTreeMap<String, Use> = BTreeMap::new();
            while let Some(at) = queue.pop_front() {
                for edge in uses.keys().filter(|e| e.from == at && !without(e)) {
                    if edge.to != from && !came.contains_key(&edge.to) {
                        came.insert(edge.to.clone(), edge.clone());
                        queue.push_back(edge.to.clone());
                    }
                }
            }
            let mut way = vec![came.get(to)?.clone()];
            while way[way.len() - 1].from != from {
                way.push(came.get(&way[way.len() - 1].from)?.clone());
            }
            way.reverse();
            Some(way)
        };
        let mut found = BTreeSet::new();
        for edge in uses.keys().filter(|e| !allowed.contains(e)) {
            if let Some(way) = reach(&edge.to, &edge.from, &|e| allowed.contains(e)) {
                let mut cycle: Vec<&Use> = std::iter::once(edge).chain(&way).collect();
                let first = (0..cycle.len()).min_by_key(|k| cycle[*k]).unwrap_or(0);
                cycle.rotate_left(first);
                let steps: Vec<String> = cycle
                    .iter()
                    .map(|e| {
                        let places: Vec<&str> = uses[e].iter().map(String::as_str).collect();
                        format!("{} -> {} (in {})", e.from, e.to, places.join(", "))
                    })
                    .collect();
                found.insert(steps.join("\n    "));
            }
        }
        let idle = allowed
            .iter()
            .filter(|e| {
                let others = |other: &Use| other != *e && allowed.contains(other);
                !uses.contains_key(e) || reach(&e.to, &e.from, &others).is_none()
            })
            .cloned()
            .collect();
        (found.into_iter().collect(), idle)
    }
}

/// Keywords before the name of an item.
const ITEMS: [&str; 9] = ["struct", "enum", "union", "fn", "trait", "const", "static", "type", "macro_rules"];

impl Module {
    /// Adds the names imported by one `use`; `before` is the path in front of a group.
    fn import(&mut self, tokens: &[TokenTree], before: &[String], here: &Segments) {
        let mut path = before.to_vec();
        let mut at = 0;
        while at < tokens.len() {
            match &tokens[at] {
                TokenTree::Ident(word) if word == "as" => {
                    if let Some(TokenTree::Ident(name)) = tokens.get(at + 1) {
                        self.enter(name.to_string(), &path, here);
                    }
                    return;
                }
                TokenTree::Ident(word) => path.push(word.to_string()),
                TokenTree::Punct(p) if p.as_char() == '*' => {
                    self.globs.push(absolute(&path, here));
                    return;
                }
                TokenTree::Group(group) => {
                    let inner: Vec<TokenTree> = group.stream().into_iter().collect();
                    inner.split(|t| is_punct(t, ',')).for_each(|part| self.import(part, &path, here));
                    return;
                }
                _ => {}
            }
            at += 1;
        }
        if path.len() > before.len() {
            if path.last().is_some_and(|last| last == "self") && path.len() > 1 {
                path.pop();
            }
            let name = path[path.len() - 1].clone();
            self.enter(name, &path, here);
        }
    }

    fn enter(&mut self, name: String, path: &[String], here: &Segments) {
        let path = absolute(path, here);
        self.paths.insert(path.clone());
        if name != "_" {
            self.imports.insert(name, path);
        }
    }

    /// Adds all paths of a body.
    fn name_paths(&mut self, tokens: TokenStream, here: &Segments) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let mut at = 0;
        while at < tokens.len() {
            match &tokens[at] {
                TokenTree::Punct(p) if p.as_char() == '#' && is_test(tokens.get(at + 1)) => {
                    at = end_of_item(&tokens, at + 2);
                }
                TokenTree::Ident(word) if word == "use" => {
                    let end = (at..tokens.len()).find(|k| is_punct(&tokens[*k], ';')).unwrap_or(tokens.len());
                    self.import(&tokens[at + 1..end], &[], here);
                    at = end + 1;
                }
                TokenTree::Group(group) => {
                    self.name_paths(group.stream(), here);
                    at += 1;
                }
                _ => at = self.name_path(&tokens, at, here),
            }
        }
    }

    /// Adds the path that begins at a token, if any; returns the index of its end.
    fn name_path(&mut self, tokens: &[TokenTree], at: usize, here: &Segments) -> usize {
        let TokenTree::Ident(first) = &tokens[at] else { return at + 1 };
        let mut path = vec![first.to_string()];
        let mut end = at + 1;
        while let [TokenTree::Punct(a), TokenTree::Punct(b), TokenTree::Ident(name), ..] = &tokens[end..] {
            if a.as_char() != ':' || b.as_char() != ':' {
                break;
            }
            path.push(name.to_string());
            end += 3;
        }
        if path.len() > 1 {
            self.paths.insert(absolute(&path, here));
        }
        end
    }
}

/// Makes paths with `self` and `super` absolute; leaves others unchanged.
fn absolute(path: &[String], here: &Segments) -> Segments {
    let supers = path.iter().take_while(|s| *s == "super").count();
    let own = usize::from(path.first().is_some_and(|s| s == "self"));
    if supers + own == 0 {
        return path.to_vec();
    }
    let base = &here[..here.len().saturating_sub(supers)];
    std::iter::once("crate".to_owned()).chain(base.iter().chain(&path[supers + own..]).cloned()).collect()
}

fn is_punct(token: &TokenTree, character: char) -> bool {
    matches!(token, TokenTree::Punct(p) if p.as_char() == character)
}

/// Whether the brackets after a `#` belong to `#[cfg(test)]` or `#[test]`.
fn is_test(brackets: Option<&TokenTree>) -> bool {
    matches!(brackets, Some(TokenTree::Group(g)) if g.delimiter() == Delimiter::Bracket
        && ["cfg(test)", "test"].contains(&g.stream().to_string().replace(' ', "").as_str()))
}

/// The end of the item that begins at `at`: after its braces or semicolon.
fn end_of_item(tokens: &[TokenTree], at: usize) -> usize {
    let ends = |t: &TokenTree| {
        is_punct(t, ';') || matches!(t, TokenTree::Group(g) if g.delimiter() == Delimiter::Brace)
    };
    (at..tokens.len()).find(|k| ends(&tokens[*k])).map_or(tokens.len(), |k| k + 1)
}
