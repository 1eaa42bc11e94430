//! Checks a tree of values against the schema in a single walk, which finds all problems.

use microsig_core::problem::{Problem, Problems};

use serde_json::{Map, Number, Value};

use super::schema::{Entry, Schema, ValueKind, joined, nearest};
use super::template::written;
use super::text::{Content, Field, Node};

/// The value of a tree as JSON (variants as objects with one key), without invalid values; `None` if required
/// ones are missing.
pub(super) fn read(root: Schema<'_>, node: &Node, problems: &mut Problems) -> Option<Value> {
    Walk { root, problems }.value(node, root, "")
}

struct Walk<'w, 's> {
    root: Schema<'s>,
    problems: &'w mut Problems,
}

impl Walk<'_, '_> {
    fn value(&mut self, node: &Node, schema: Schema<'_>, path: &str) -> Option<Value> {
        let node = node.unwrapped();
        if matches!(&node.content, Content::Word(word) if word == "None" || word == "null")
            && schema.is_optional()
        {
            return Some(Value::Null);
        }
        match (schema.kind(), &node.content) {
            (ValueKind::Choice, _) => self.choice(node, schema, path),
            (ValueKind::Section, Content::Fields(fields)) => self.section(node, fields, schema, path),
            (ValueKind::List(_), Content::Fields(none)) if none.is_empty() => Some(Value::Array(Vec::new())),
            (ValueKind::List(item), Content::Items(items)) => {
                let (least, most) = (count(schema, "minItems"), count(schema, "maxItems"));
                let fits = least.is_none_or(|least| items.len() >= least)
                    && most.is_none_or(|most| items.len() <= most);
                if !fits {
                    let allowed = match (least, most) {
                        (Some(least), None) => format!("at least {least}"),
                        (least, most) => format!("{} to {}", least.unwrap_or(0), most.unwrap_or(usize::MAX)),
                    };
                    self.refuse(node, path, format!("{} values", items.len()), &allowed);
                }
                self.items(items, items.iter().map(|_| item), path)
            }
            (ValueKind::Tuple(types), Content::Items(items)) if types.len() == items.len() => {
                self.items(items, types.into_iter(), path)
            }
            (ValueKind::Number | ValueKind::Whole, Content::Word(word)) => {
                self.number(node, word, schema, path)
            }
            (ValueKind::Flag, Content::Word(word)) if word == "true" || word == "false" => {
                Some((word == "true").into())
            }
            (ValueKind::Text, Content::Text(text)) => {
                let one_of = schema.listed();
                if one_of.is_none_or(|names| names.contains(&text.as_str().into())) {
                    return Some(text.as_str().into());
                }
                let near = one_of.and_then(|names| nearest(text, names.iter().filter_map(Value::as_str)));
                let problem = Problem::value(path, node.written(), &schema.allowed()).at(&node.place);
                self.problems.push(problem.hinted(near.map(|near| format!("did you mean \"{near}\"?"))));
                None
            }
            (ValueKind::Raw, _) => Some(node.place.text().trim().into()),
            _ => {
                self.refuse(node, path, node.written(), &schema.allowed());
                None
            }
        }
    }

    fn refuse(&mut self, node: &Node, path: &str, found: String, allowed: &str) {
        self.problems.push(Problem::value(path, found, allowed).at(&node.place));
    }

    fn items<'t>(
        &mut self,
        items: &[Node],
        types: impl Iterator<Item = Schema<'t>>,
        path: &str,
    ) -> Option<Value> {
        let values: Vec<Option<Value>> = items
            .iter()
            .zip(types)
            .enumerate()
            .map(|(i, (item, schema))| self.value(item, schema, &joined(path, &i.to_string())))
            .collect();
        values.into_iter().collect::<Option<Vec<_>>>().map(Value::Array)
    }

    fn section(&mut self, node: &Node, fields: &[Field], schema: Schema<'_>, path: &str) -> Option<Value> {
        let keys = schema.children();
        let mut section = Map::new();
        let mut given: Vec<&str> = Vec::new();
        for field in fields {
            let Some(key) = find(&keys, &field.key) else {
                if self.problems.is_full() {
                    break;
                }
                let path_of = joined(path, &field.key);
                let hint = self.root.suggestion(path, &field.key);
                self.problems.push(Problem::unknown_key(&path_of).at(&field.place).hinted(hint));
                continue;
            };
            if given.contains(&key.name) {
                let message = format!("`{}` is given a second time", field.key);
                self.problems.push(Problem::other(path, message).at(&field.place));
                continue;
            }
            given.push(key.name);
            let Some(schema) = key.schema else { continue };
            if let Some(value) = self.value(&field.value, schema, &joined(path, key.name)) {
                section.insert(key.name.to_owned(), value);
            }
        }
        for key in schema.required().filter(|key| !given.contains(key)) {
            let near = fields.iter().map(|f| f.key.as_str()).filter(|key| find(&keys, key).is_none());
            // A misspelled key already has a message.
            if nearest(key, near).is_none() {
                let message = format!("`{key}` is missing");
                self.problems.push(Problem::other(path, message).at(&node.place));
            }
        }
        let is_complete =
            |section: &Map<String, Value>| schema.required().all(|key| section.contains_key(key));
        // Missing keys of the root get placeholders, so that constraints between the other values can still
        // be checked.
        if path.is_empty() {
            for key in schema.required() {
                let example = find(&keys, key).and_then(|key| key.attribute("examples")?.get(0));
                if let Some(example) = example.filter(|_| !section.contains_key(key)) {
                    section.insert(key.to_owned(), example.clone());
                }
            }
        }
        is_complete(&section).then_some(Value::Object(section))
    }

    fn choice(&mut self, node: &Node, schema: Schema<'_>, path: &str) -> Option<Value> {
        let variants = schema.children();
        let example = || {
            let mut examples = variants.iter().filter(|variant| variant.schema.is_some()).map(written);
            examples
                .find(|example| !example.contains('\n'))
                .map(|example| format!("write `{example}`, for example"))
        };
        let (name, content) = match &node.content {
            Content::Word(name) | Content::Text(name) => (name, None),
            Content::Variant(name, content) => (name, Some(content.as_ref())),
            // The form of a variant in JSON.
            Content::Fields(fields) if fields.len() == 1 => (&fields[0].key, Some(&fields[0].value)),
            _ => {
                let problem = Problem::value(path, node.written(), &schema.allowed()).at(&node.place);
                self.problems.push(problem.hinted(example()));
                return None;
            }
        };
        let Some(variant) = find(&variants, name) else {
            let hint =
                nearest(name, variants.iter().map(|v| v.name)).map(|near| format!("did you mean `{near}`?"));
            let is_word = name.starts_with(|c: char| c.is_alphabetic());
            let problem = match is_word {
                true => Problem::unknown_variant(path, name, hint, &schema.allowed()),
                false => Problem::value(path, node.written(), &schema.allowed()).hinted(example()),
            };
            self.problems.push(problem.at(&node.place));
            return None;
        };
        let path = joined(path, variant.name);
        let empty = Node::new(&node.place, Content::Fields(Vec::new()));
        let Some(schema) = variant.schema else {
            return match content {
                Some(content) if !matches!(&content.content, Content::Fields(none) if none.is_empty()) => {
                    self.refuse(content, &path, content.written(), "nothing");
                    None
                }
                _ => Some(variant.name.into()),
            };
        };
        let value = self.value(content.unwrap_or(&empty), schema, &path)?;
        Some(Value::Object(Map::from_iter([(variant.name.to_owned(), value)])))
    }

    fn number(&mut self, node: &Node, word: &str, schema: Schema<'_>, path: &str) -> Option<Value> {
        let is_whole = matches!(schema.kind(), ValueKind::Whole);
        let real = ron::from_str::<f64>(word).ok();
        let number = match (is_whole, real) {
            (true, _) => ron::from_str::<u64>(word)
                .map(Number::from)
                .or_else(|_| ron::from_str::<i64>(word).map(Number::from))
                .ok(),
            (false, Some(x)) if x == f64::INFINITY && schema.allows(x) => return Some(Value::Null),
            (false, x) => x.and_then(Number::from_f64),
        };
        let x = number.as_ref().and_then(Number::as_f64).or(real);
        match number {
            Some(number) if x.is_some_and(|x| schema.allows(x)) => return Some(Value::Number(number)),
            _ => {}
        }
        let hint = x.filter(|x| !is_whole && !schema.allows(*x)).and_then(|x| unit_hint(x, path, schema));
        let problem = Problem::value(path, node.written(), &schema.allowed()).at(&node.place);
        self.problems.push(problem.hinted(hint));
        None
    }
}

/// A hint for a number that is in range when converted from meters, or of a wavelength from nanometers, to
/// micrometers.
fn unit_hint(x: f64, path: &str, schema: Schema<'_>) -> Option<String> {
    let is_light = ["wavelength_um", "bandwidth_um"].iter().any(|key| path.ends_with(key));
    let fits = |micro: &f64| schema.words("x-unit") == Some("um") && x > 0.0 && schema.allows(*micro);
    // Rounded, as the multiplication is inexact.
    let rounded = |micro: f64| (micro * 1e6).round() / 1e6;
    let meters = Some(x * 1e6).filter(fits).map(|um| format!("{x:e} m is {} um", rounded(um)));
    meters.or_else(|| {
        Some(x * 1e-3).filter(fits).filter(|_| is_light).map(|um| format!("{x} nm is {} um", rounded(um)))
    })
}

/// The key or variant with a name, or with this former name (`x-formerly`).
pub(super) fn find<'e, 'a>(entries: &'e [Entry<'a>], name: &str) -> Option<&'e Entry<'a>> {
    let of = |name: &str| entries.iter().find(|entry| entry.name == name);
    let formerly = |entry: &&Entry<'a>| {
        entry.attribute("x-formerly").and_then(Value::as_array).is_some_and(|old| old.contains(&name.into()))
    };
    of(name).or_else(|| entries.iter().find(formerly))
}

fn count(schema: Schema<'_>, name: &str) -> Option<usize> {
    schema.attribute(name).and_then(Value::as_u64).map(|n| n as usize)
}
