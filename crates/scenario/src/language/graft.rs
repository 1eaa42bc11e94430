//! Replaces the value at a path of a tree: for `--set` and the axes of sweeps.
//!
//! The steps of a path are keys, variants and list indices. A step that names a variant other than the
//! present one switches to it.

use std::sync::Arc;

use microsig_core::problem::{Place, Problem, Source};

use super::read::find;
use super::schema::{Schema, ValueKind, joined};
use super::text::{Content, Field, Node, parse};

/// The value of an assignment as a tree. Quotes around a string are optional.
pub(crate) fn assigned(root: Schema<'_>, path: &str, value: &str) -> Result<Node, Problem> {
    let source = Arc::new(Source::assignment(path, value));
    let whole = Place { source: source.clone(), span: source.value_at..source.text.len() };
    let is_text =
        root.find(path).and_then(|entry| entry.schema).is_some_and(|s| matches!(s.kind(), ValueKind::Text));
    let is_quoted = ["\"", "r\"", "r#"].iter().any(|quote| value.trim_start().starts_with(quote));
    if is_text && !is_quoted {
        return Ok(Node { content: Content::Text(value.to_owned()), place: whole });
    }
    parse(&source)
}

/// The tree with the value at `path` replaced.
pub(crate) fn graft(tree: Node, root: Schema<'_>, path: &str, value: Node) -> Result<Node, Problem> {
    let steps: Vec<&str> = path.split('.').collect();
    Graft { root, path, steps: &steps }.below(Some(tree), root, 0, value)
}

struct Graft<'g, 's> {
    root: Schema<'s>,
    path: &'g str,
    steps: &'g [&'g str],
}

impl Graft<'_, '_> {
    fn below(
        &self,
        node: Option<Node>,
        schema: Schema<'_>,
        depth: usize,
        value: Node,
    ) -> Result<Node, Problem> {
        let Some(step) = self.steps.get(depth) else { return Ok(value) };
        let place = value.place.clone();
        let unknown = || {
            let parent = self.steps[..depth].join(".");
            let hint = self.root.suggestion(&parent, step);
            Problem::unknown_key(&joined(&parent, step)).at(&place).hinted(hint)
        };
        let node = node.map(|node| match node.content {
            Content::Variant(name, inner) if name == "Some" => *inner,
            _ => node,
        });
        let entries = schema.children();
        match schema.kind() {
            ValueKind::Section => {
                let key = find(&entries, step).ok_or_else(unknown)?;
                let inner = key.schema.ok_or_else(unknown)?;
                let (mut fields, at) = match node {
                    Some(Node { content: Content::Fields(fields), place }) => (fields, place),
                    _ => (Vec::new(), place.clone()),
                };
                let is_key = |f: &Field| find(&entries, &f.key).is_some_and(|entry| entry.name == key.name);
                let old = fields.iter().position(is_key).map(|i| fields.remove(i));
                let value = self.below(old.map(|field| field.value), inner, depth + 1, value)?;
                fields.push(Field { key: key.name.to_owned(), place, value });
                Ok(Node { place: at, content: Content::Fields(fields) })
            }
            ValueKind::Choice => {
                let variant = find(&entries, step).ok_or_else(unknown)?;
                let Some(inner) = variant.schema else {
                    return Err(Problem::other(
                        self.path,
                        format!("`{step}` takes no value; set the key to `{step}`"),
                    )
                    .at(&place));
                };
                let content = match node.map(|node| node.content) {
                    Some(Content::Variant(name, content)) if name == *step => Some(*content),
                    Some(Content::Fields(mut one)) if one.len() == 1 && one[0].key == *step => {
                        Some(one.remove(0).value)
                    }
                    _ => None,
                };
                let content = self.below(content, inner, depth + 1, value)?;
                Ok(Node { place, content: Content::Variant(variant.name.to_owned(), Box::new(content)) })
            }
            ValueKind::List(_) | ValueKind::Tuple(_) => {
                let inner = schema.child(step).and_then(|entry| entry.schema).ok_or_else(unknown)?;
                let index: usize = step.parse().map_err(|_| unknown())?;
                let Some(Node { content: Content::Items(mut items), place: at }) = node else {
                    return Err(Problem::other(self.path, "there is no list at this path").at(&place));
                };
                if index >= items.len() {
                    let message = format!("the list has {} values; indices start at 0", items.len());
                    return Err(Problem::other(self.path, message).at(&place));
                }
                let old = items[index].clone();
                items[index] = self.below(Some(old), inner, depth + 1, value)?;
                Ok(Node { place: at, content: Content::Items(items) })
            }
            _ => Err(unknown()),
        }
    }
}
