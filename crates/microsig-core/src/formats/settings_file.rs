//! MicroSIG's settings file: `key = value`, one per line, 14 mandatory keys.
//!
//! `#` and `%` start comments. Unknown keys are kept, with a warning. Values must be numbers (the original
//! evaluates them as program code, which this reader never does).

use std::collections::BTreeMap;
use std::io::{Read, Write};

use crate::error::Error;
use crate::formats::text_line;
use crate::problem::{Problem, Problems};
use crate::settings::{self, KEYS, Settings};

/// The contents of a settings file.
#[derive(Debug, Clone, PartialEq)]
pub struct SettingsFile {
    /// The 14 settings, all valid.
    pub settings: Settings,
    /// Unknown keys and their values as text, in the order of the file.
    pub unknown: Vec<(String, String)>,
    /// One message per unknown key, with its line.
    pub warnings: Vec<String>,
}

/// Maximum length of a settings file, bytes: fourteen lines and comments.
const MAX_BYTES: u64 = 1_000_000;

/// Number of unreadable lines that are listed.
const MAX_UNREADABLE: usize = 3;

/// Reads a settings file; `name` is the name of the file in messages. Errors: [`Error::Malformed`] with every
/// line that is not `key = value`, every missing or duplicate key, and every value that is not a number or
/// out of range; text that is not UTF-8 or longer than 1 MB, and lines that end in CR alone; [`Error::Io`] if
/// reading fails.
pub fn read(reader: impl Read, name: &str) -> Result<SettingsFile, Error> {
    read_immersed(reader, name, 1.0)
}

/// As [`read`], for an objective whose immersion has the refractive index `n_i`: the numerical aperture must
/// be less. The file itself does not know the immersion.
pub fn read_immersed(reader: impl Read, name: &str, n_i: f64) -> Result<SettingsFile, Error> {
    let mut bytes = Vec::new();
    reader.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(|e| Error::io(name, e))?;
    let (mut lines, mut problems) = (Vec::new(), Problems::default());
    let in_line = |problem: Problem, line: usize| problem.within(format!("{name}:{line}"));
    if bytes.len() as u64 > MAX_BYTES {
        let message = format!("expected a settings file of at most {} MB", MAX_BYTES / 1_000_000);
        return Err(Error::malformed(name, message));
    }
    for (index, line) in bytes.split(|byte| *byte == b'\n').enumerate() {
        match text_line::text_of(line) {
            Ok(text) => lines.push(text),
            Err(message) => problems.push(in_line(Problem::other("", message), index + 1)),
        }
    }
    // What such a file lacks is not worth a message.
    problems.0.truncate(MAX_UNREADABLE);
    std::mem::take(&mut problems).finish(Error::Malformed)?;

    let mut found: BTreeMap<usize, (f64, usize)> = BTreeMap::new();
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let (mut unknown, mut warnings) = (Vec::new(), Vec::new());
    for (index, raw) in lines.into_iter().enumerate() {
        let line = index + 1;
        let raw = if line == 1 { raw.trim_start_matches('\u{feff}') } else { raw };
        let mut refuse = |problem: Problem| problems.push(in_line(problem, line));
        let content = raw.split(['#', '%']).next().unwrap_or_default().trim();
        if content.is_empty() {
            continue;
        }
        let Some((key, value)) = content.split_once('=').map(|(k, v)| (k.trim(), v.trim())) else {
            refuse(Problem::value("", format!("`{content}`"), "`key = value`"));
            continue;
        };
        if let Some(first) = seen.insert(key.to_owned(), line) {
            let message = format!("{key} is given a second time (first in line {first})");
            refuse(Problem::other("", message));
            continue;
        }
        let Some(known) = KEYS.iter().position(|k| k.name == key) else {
            warnings.push(format!("{name}:{line}: unknown key `{key}` is ignored"));
            unknown.push((key.to_owned(), value.to_owned()));
            continue;
        };
        match value.parse::<f64>() {
            Ok(number) => {
                found.insert(known, (number, line));
            }
            Err(_) => refuse(Problem::value(key, value, &KEYS[known].allowed())),
        }
    }
    for key in KEYS.iter().filter(|k| !seen.contains_key(k.name)) {
        let found = format!("{} is missing", key.name);
        problems.push(Problem::value("", found, &key.allowed()).within(name));
    }
    // Ranges are checked only when all values are numbers, because they depend on each other.
    problems.finish(Error::Malformed)?;
    let values = std::array::from_fn(|i| found[&i].0);
    settings::check(values, n_i, |i| format!("{name}:{}", found[&i].1)).finish(Error::Malformed)?;
    Ok(SettingsFile { settings: Settings::from_values(values), unknown, warnings })
}

/// Writes a settings file; [`read`] returns the same values.
pub fn write(mut writer: impl Write, settings: &Settings) -> std::io::Result<()> {
    for (key, value) in KEYS.iter().zip(settings.values()) {
        writeln!(writer, "{} = {value}", key.name)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(settings: &Settings) -> String {
        let mut bytes = Vec::new();
        write(&mut bytes, settings).unwrap();
        String::from_utf8(bytes).unwrap()
    }

    fn message(text: &str) -> String {
        read(text.as_bytes(), "s.txt").unwrap_err().to_string()
    }

    #[test]
    fn what_is_written_is_read_back() {
        for settings in [Settings::setting1a(), Settings::setting2()] {
            let file = read(text(&settings).as_bytes(), "s.txt").unwrap();
            assert_eq!(file.settings, settings);
            assert!(file.warnings.is_empty());
        }
    }

    #[test]
    fn comments_blank_lines_exponents_and_unknown_keys_are_accepted() {
        let text = text(&Settings::setting1()).replace("focal_length = 350", "focal_length=3.5e2 # um");
        let file = read(format!("% header\n\n{text}color = red\r\n").as_bytes(), "s.txt").unwrap();
        assert_eq!(file.settings, Settings::setting1());
        assert_eq!(file.unknown, [("color".to_owned(), "red".to_owned())]);
        assert_eq!(file.warnings, ["s.txt:17: unknown key `color` is ignored"]);
    }

    #[test]
    fn every_kind_of_problem_names_line_and_key() {
        let good = text(&Settings::setting1());
        let cases = [
            (good.replace("gain = 3.2\n", ""), "s.txt: gain is missing"),
            (good.replace('\n', "\r"), "s.txt:1: line end CR: expected lines that end in LF or CR LF"),
            (format!("{good}gain = 3\n"), "s.txt:15: gain is given a second time (first in line 13)"),
            (good.replace("= 0.3", "= 0,3"), "s.txt:2: numerical_aperture = 0,3: expected a number"),
            (
                good.replace("= 0.3", "= 1.25"),
                "s.txt:2: numerical_aperture = 1.25: expected a number > 0; < 1",
            ),
            (
                good.replace("n_rays = 500", "n_rays = 12.5"),
                "s.txt:12: n_rays = 12.5: expected a whole number",
            ),
            (
                good.replace("ri_lens = 1.5", "ri_lens = 1"),
                "s.txt:5: ri_lens = 1: expected a number > ri_medium",
            ),
            (good.replace("gain = 3.2", "gain = inf"), "s.txt:13: gain = inf: expected a number >= 0"),
            (good.replace("gain = 3.2", "gain 3.2"), "s.txt:13: `gain 3.2`: expected `key = value`"),
            (good.replace("= 10\n", "= __import__('os')\n"), "s.txt:1: magnification = __import__('os')"),
        ];
        for (text, expected) in cases {
            assert!(message(&text).contains(expected), "{} lacks {expected}", message(&text));
        }
    }
}
