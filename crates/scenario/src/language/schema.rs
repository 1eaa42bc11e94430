//! Access to the JSON Schema of the language, which [`super::derive`] derives from the structs of `spec`.

use std::ops::Bound;

use microsig_core::Interval;
use serde_json::Value;

/// A type of the language: a section, a choice, a number.
#[derive(Debug, Clone, Copy)]
pub struct Schema<'a> {
    root: &'a Value,
    /// Where the type is used: description, default and range of the key.
    site: &'a Value,
    /// The type itself, with `$ref` and `null` resolved.
    node: &'a Value,
}

/// The kind of a value.
#[derive(Debug, Clone)]
pub enum ValueKind<'a> {
    /// Keys with values.
    Section,
    /// One of several variants.
    Choice,
    /// Any number of values of one type.
    List(Schema<'a>),
    /// A fixed number of values.
    Tuple(Vec<Schema<'a>>),
    /// A real number.
    Number,
    /// A whole number.
    Whole,
    /// True or false.
    Flag,
    /// A string.
    Text,
    /// Kept as written.
    Raw,
}

/// A key or variant of the language.
#[derive(Debug, Clone, Copy)]
pub struct Entry<'a> {
    /// Its name; empty for the items of a list.
    pub name: &'a str,
    /// Whether it is a variant of its parent.
    pub is_variant: bool,
    /// Its type; `None` for a variant without content.
    pub schema: Option<Schema<'a>>,
    site: &'a Value,
}

impl<'a> Schema<'a> {
    /// The schema of a document.
    pub fn root(root: &'a Value) -> Self {
        Schema::at(root, root)
    }

    fn at(root: &'a Value, site: &'a Value) -> Self {
        let mut node = site;
        loop {
            let target = node.get("$ref").and_then(Value::as_str).and_then(|name| root.pointer(&name[1..]));
            let inner = node.get("anyOf").and_then(Value::as_array);
            let inner = inner.and_then(|any| any.iter().find(|one| one.get("type") != Some(&"null".into())));
            match target.or(inner) {
                Some(next) => node = next,
                None => return Schema { root, site, node },
            }
        }
    }

    /// An attribute of the key, or else of its type.
    pub fn attribute(&self, name: &str) -> Option<&'a Value> {
        self.site.get(name).or_else(|| self.node.get(name))
    }

    /// The same as a text.
    pub fn words(&self, name: &str) -> Option<&'a str> {
        self.attribute(name).and_then(Value::as_str)
    }

    fn is(&self, name: &str) -> bool {
        let types = self.node.get("type");
        types == Some(&name.into())
            || types.and_then(Value::as_array).is_some_and(|types| types.contains(&name.into()))
    }

    /// Whether the key may be left without a value.
    pub fn is_optional(&self) -> bool {
        let null = |any: &Value| any.get("type") == Some(&"null".into());
        let in_any = self.site.get("anyOf").and_then(Value::as_array).is_some_and(|any| any.iter().any(null));
        in_any || self.is("null")
    }

    /// The kind of value that the schema describes.
    pub fn kind(&self) -> ValueKind<'a> {
        let count = |name| self.node.get(name).and_then(Value::as_u64);
        if self.node.get("oneOf").is_some()
            || self.is("string") && self.node.get("enum").is_some() && self.attribute("x-quoted").is_none()
        {
            ValueKind::Choice
        } else if let Some(items) = self.node.get("prefixItems").and_then(Value::as_array) {
            ValueKind::Tuple(items.iter().map(|item| Schema::at(self.root, item)).collect())
        } else if let Some(items) = self.node.get("items") {
            let item = Schema::at(self.root, items);
            match (count("minItems"), count("maxItems")) {
                (Some(n), Some(most)) if n == most => ValueKind::Tuple(vec![item; n as usize]),
                _ => ValueKind::List(item),
            }
        } else if self.is("object") {
            ValueKind::Section
        } else if self.is("integer") {
            ValueKind::Whole
        } else if self.is("number") {
            ValueKind::Number
        } else if self.is("boolean") {
            ValueKind::Flag
        } else if self.is("string") {
            ValueKind::Text
        } else {
            ValueKind::Raw
        }
    }

    /// The keys of a section or the variants of a choice; for a list, of its items.
    pub fn children(&self) -> Vec<Entry<'a>> {
        let at = |site| Schema::at(self.root, site);
        let properties =
            |node: &'a Value| node.get("properties").and_then(Value::as_object).into_iter().flatten();
        match self.kind() {
            ValueKind::Section => properties(self.node)
                .map(|(name, site)| Entry { name, is_variant: false, schema: Some(at(site)), site })
                .collect(),
            ValueKind::Choice => {
                let unit = |name: &'a Value, site| {
                    name.as_str().map(|name| Entry { name, is_variant: true, schema: None, site })
                };
                let one = |site: &'a Value| -> Vec<Entry<'a>> {
                    let constant = site.get("const").and_then(|name| unit(name, site));
                    let names = site.get("enum").and_then(Value::as_array).into_iter().flatten();
                    let content = properties(site).map(|(name, content)| Entry {
                        name,
                        is_variant: true,
                        schema: Some(at(content)),
                        site,
                    });
                    constant
                        .into_iter()
                        .chain(names.filter_map(|name| unit(name, site)))
                        .chain(content)
                        .collect()
                };
                match self.node.get("oneOf").and_then(Value::as_array) {
                    Some(choices) => choices.iter().flat_map(one).collect(),
                    None => one(self.node),
                }
            }
            ValueKind::List(item) => item.children(),
            _ => Vec::new(),
        }
    }

    /// The key, variant or item with this name.
    pub fn child(&self, name: &str) -> Option<Entry<'a>> {
        if let Ok(i) = name.parse::<usize>() {
            let item = match self.kind() {
                ValueKind::List(item) => Some(item),
                ValueKind::Tuple(items) => items.get(i).copied(),
                _ => None,
            };
            return item.map(|item| Entry {
                name: "",
                is_variant: false,
                schema: Some(item),
                site: item.site,
            });
        }
        self.children().into_iter().find(|entry| entry.name == name)
    }

    /// The key or variant at a path.
    pub fn find(&self, path: &str) -> Option<Entry<'a>> {
        let root = Entry { name: "", is_variant: false, schema: Some(*self), site: self.site };
        path.split('.').try_fold(root, |entry, step| entry.schema?.child(step))
    }

    /// The required keys of a section.
    pub fn required(&self) -> impl Iterator<Item = &'a str> {
        self.node.get("required").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str)
    }

    /// All keys and variants with their paths, in order. Recursive types (fields in a sum of fields) are
    /// listed only once.
    pub fn keys(&self) -> Vec<(String, Entry<'a>)> {
        let mut keys = Vec::new();
        self.collect("", &mut Vec::new(), &mut keys);
        keys
    }

    fn collect(&self, path: &str, above: &mut Vec<&'a Value>, keys: &mut Vec<(String, Entry<'a>)>) {
        if above.iter().any(|node| std::ptr::eq(*node, self.node)) {
            return;
        }
        above.push(self.node);
        let inner = if let ValueKind::List(item) = self.kind() { item } else { *self };
        let again =
            !std::ptr::eq(inner.node, self.node) && above.iter().any(|n| std::ptr::eq(*n, inner.node));
        for entry in if again { Vec::new() } else { self.children() } {
            let path = joined(path, entry.name);
            keys.push((path.clone(), entry));
            if let Some(schema) = entry.schema {
                schema.collect(&path, above, keys);
            }
        }
        above.pop();
    }

    /// A suggestion for a misspelled key or variant; if none is similar, the list of existing ones.
    pub fn suggestion(&self, parent: &str, name: &str) -> Option<String> {
        let own = Entry { name: "", is_variant: false, schema: Some(*self), site: self.site };
        let names: Vec<&str> =
            self.find(parent).or_else(|| parent.is_empty().then_some(own)).map_or_else(Vec::new, |entry| {
                entry
                    .schema
                    .map_or_else(Vec::new, |schema| schema.children().iter().map(|e| e.name).collect())
            });
        if let Some(near) = nearest(name, names.iter().copied()) {
            return Some(format!("did you mean `{near}`?"));
        }
        // The same name elsewhere, except parameters of fields, as many fields share these.
        let elsewhere =
            self.keys().into_iter().map(|(path, _)| path).filter(|path| {
                path.rsplit('.').next() == Some(name) && !path.starts_with("motion.flow.field.")
            });
        if let Some(path) = elsewhere.min_by_key(String::len) {
            return Some(format!("did you mean `{path}`?"));
        }
        (!names.is_empty()).then(|| format!("expected one of {}", names.join(", ")))
    }

    /// The range of a number.
    pub fn interval(&self) -> Interval {
        let bound = |included, excluded| {
            let value = |name| self.attribute(name).and_then(Value::as_f64);
            let excluded = value(excluded).map_or(Bound::Unbounded, Bound::Excluded);
            value(included).map_or(excluded, Bound::Included)
        };
        Interval { low: bound("minimum", "exclusiveMinimum"), high: bound("maximum", "exclusiveMaximum") }
    }

    /// The only values that are allowed, if they are listed.
    pub(crate) fn listed(&self) -> Option<&'a Vec<Value>> {
        self.attribute("enum").and_then(Value::as_array)
    }

    /// Whether a number is in range.
    pub fn allows(&self, x: f64) -> bool {
        let is_listed = self.listed().is_none_or(|values| values.iter().any(|v| v.as_f64() == Some(x)));
        self.interval().contains(x) && is_listed
            || self.attribute("x-infinite").is_some() && x == f64::INFINITY
    }

    /// The range in words, followed by the condition; empty if every value is allowed.
    pub fn range(&self) -> String {
        let interval = self.interval();
        let range = match (self.kind(), self.listed()) {
            (ValueKind::Choice, _) => String::new(),
            (ValueKind::List(item), _) => each(&item.range()),
            (ValueKind::Tuple(items), _) => {
                let mut ranges = items.iter().map(Schema::range);
                let first = ranges.next().unwrap_or_default();
                if ranges.all(|range| range == first) { each(&first) } else { String::new() }
            }
            (_, Some(values)) => {
                let word = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
                one_of(values.iter().map(word))
            }
            _ if interval == Interval::FINITE => String::new(),
            _ if self.attribute("x-infinite").is_some() => format!("{interval}, or inf"),
            _ => interval.to_string(),
        };
        match self.words("x-condition") {
            Some(condition) if range.is_empty() => condition.to_owned(),
            Some(condition) => format!("{range}; {condition}"),
            None => range,
        }
    }

    /// Type, range and unit in words.
    pub fn allowed(&self) -> String {
        let number = |what: &str| {
            let (interval, unit) = (self.interval(), self.words("x-unit").unwrap_or_default());
            let (is_infinite, is_whole) = (self.attribute("x-infinite").is_some(), what == "whole number");
            let unit = |join| if unit.is_empty() { String::new() } else { format!("{join}{unit}") };
            let range = match (interval.low, interval.high) {
                _ if self.listed().is_some() => format!("a {what}, {}{}", self.range(), unit(" ")),
                (Bound::Unbounded, Bound::Unbounded) if is_whole => format!("a {what}{}", unit(", in ")),
                (Bound::Unbounded, Bound::Unbounded) => format!("a finite {what}{}", unit(", in ")),
                (Bound::Included(_), Bound::Included(_)) => format!("a {what}, {interval}{}", unit(" ")),
                _ => format!("a {what} {interval}{}", unit(" ")),
            };
            let range = if is_infinite { format!("{range}, or inf") } else { range };
            self.words("x-condition").map_or(range.clone(), |condition| format!("{range}; {condition}"))
        };
        match self.kind() {
            ValueKind::Section => {
                let names: Vec<String> =
                    self.children().iter().take(2).map(|entry| format!("{}: ...", entry.name)).collect();
                format!("named values in parentheses, such as ({})", names.join(", "))
            }
            ValueKind::Choice => one_of(self.children().iter().map(|entry| entry.name.to_owned())),
            ValueKind::List(_) => "a list in square brackets".to_owned(),
            ValueKind::Tuple(items) => format!("{} values in parentheses", items.len()),
            ValueKind::Number => number("number"),
            ValueKind::Whole => number("whole number"),
            ValueKind::Flag => "true or false".to_owned(),
            ValueKind::Text if self.range().is_empty() => "a string in quotes".to_owned(),
            ValueKind::Text => self.range(),
            ValueKind::Raw => "a value".to_owned(),
        }
    }
}

impl<'a> Entry<'a> {
    /// Its meaning: the first paragraph of its doc comment, or of its type's.
    pub fn meaning(&self) -> String {
        let own = self.site.get("description").and_then(Value::as_str);
        let text =
            own.or_else(|| self.schema.and_then(|schema| schema.words("description"))).unwrap_or_default();
        text.split("\n\n").next().unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// An attribute of the key, of the variant, or of its type.
    pub fn attribute(&self, name: &str) -> Option<&'a Value> {
        self.site.get(name).or_else(|| self.schema.and_then(|schema| schema.attribute(name)))
    }

    /// The same as a text.
    pub fn words(&self, name: &str) -> Option<&'a str> {
        self.attribute(name).and_then(Value::as_str)
    }
}

pub(crate) fn joined(path: &str, step: &str) -> String {
    if path.is_empty() { step.to_owned() } else { format!("{path}.{step}") }
}

/// The most similar word to `name`, if its Jaro-Winkler similarity exceeds 0.75.
pub fn nearest<'a>(name: &str, words: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_lowercase();
    // NA is the numerical aperture.
    let is_short = |word: &str| word.split('_').filter_map(|part| part.chars().next()).eq(name.chars());
    let similarity = |word: &str| match is_short(word) && name.len() > 1 {
        true => 1.0,
        false => strsim::jaro_winkler(&word.to_lowercase(), &name),
    };
    let near =
        words.into_iter().map(|word| (similarity(word), word)).filter(|&(similarity, _)| similarity > 0.75);
    near.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, word)| word)
}

/// `one of a, b, c`.
fn one_of(names: impl Iterator<Item = String>) -> String {
    format!("one of {}", names.collect::<Vec<_>>().join(", "))
}

/// The range of the items of a list in words.
fn each(range: &str) -> String {
    if range.is_empty() { String::new() } else { format!("each {range}") }
}
