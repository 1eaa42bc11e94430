//! `cargo xtask wrap`: wraps comments at the width of code, which stable rustfmt does not do.

use std::path::{Path, PathBuf};

use anyhow::Context;

/// Wraps the comments with too wide lines in files and in all Rust files below folders.
pub(crate) fn run(paths: &[PathBuf]) -> anyhow::Result<()> {
    let format = std::fs::read_to_string("rustfmt.toml").context("run this at the root of the repository")?;
    let width = format.lines().find_map(|line| line.strip_prefix("max_width = ")).context("max_width")?;
    let width = width.trim().parse()?;
    let mut changed = 0;
    let mut queue = paths.to_vec();
    while let Some(path) = queue.pop() {
        if path.is_dir() {
            for entry in std::fs::read_dir(&path)? {
                let path = entry?.path();
                if path.is_dir() && path.file_name().is_some_and(|name| name != "target")
                    || path.extension().is_some_and(|e| e == "rs")
                {
                    queue.push(path);
                }
            }
        } else {
            changed += u32::from(wrap_file(&path, width)?);
        }
    }
    println!("{changed} files changed");
    Ok(())
}

fn wrap_file(path: &Path, width: usize) -> anyhow::Result<bool> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let wrapped = wrap(&text, width);
    if wrapped != text {
        std::fs::write(path, &wrapped)?;
    }
    Ok(wrapped != text)
}

/// Splits a comment line into its prefix (indent and slashes) and its text.
fn split(line: &str) -> Option<(&str, &str)> {
    let slashes = line.len() - line.trim_start().len();
    let marker = ["///", "//!", "//"].into_iter().find(|m| line[slashes..].starts_with(m))?;
    let (before, words) = line.split_at(slashes + marker.len());
    (words.is_empty() || words.starts_with(' ')).then_some((before, words))
}

/// Wraps every comment paragraph that has a line wider than `width`; list items stay separate, tables and
/// code are unchanged.
fn wrap(text: &str, width: usize) -> String {
    let lines: Vec<&str> = text.lines().collect();
    let mut out = String::with_capacity(text.len());
    let mut fenced = false;
    let mut at = 0;
    while at < lines.len() {
        let Some((before, words)) = split(lines[at]) else {
            out += lines[at];
            out.push('\n');
            at += 1;
            continue;
        };
        fenced ^= words.trim_start().starts_with("```");
        let plain = |words: &str| {
            let words = words.trim_start();
            !words.is_empty() && !["```", "|", "#", "<"].iter().any(|mark| words.starts_with(mark))
        };
        if fenced || !plain(words) {
            out += lines[at];
            out.push('\n');
            at += 1;
            continue;
        }
        let indent = words.len() - words.trim_start().len();
        let hang = indent + item_mark(words);
        let continues = |line: &&&str| {
            split(line).is_some_and(|(b, w)| {
                b == before && plain(w) && item_mark(w) == 0 && w.len() - w.trim_start().len() == hang
            })
        };
        let end = at + 1 + lines[at + 1..].iter().take_while(continues).count();
        let paragraph = &lines[at..end];
        let code = indent > 4;
        if code || paragraph.iter().all(|line| line.chars().count() <= width) {
            paragraph.iter().for_each(|line| {
                out += line;
                out.push('\n');
            });
        } else {
            let words =
                paragraph.iter().filter_map(|line| split(line)).flat_map(|(_, w)| w.split_whitespace());
            fill(
                &mut out,
                words,
                [format!("{before}{}", " ".repeat(indent)), format!("{before}{}", " ".repeat(hang))],
                width,
            );
        }
        at = end;
    }
    if !text.ends_with('\n') {
        out.pop();
    }
    out
}

/// Length of a list marker including its blank; 0 if the text does not begin with one.
fn item_mark(words: &str) -> usize {
    let words = words.trim_start();
    let number = words.trim_start_matches(|c: char| c.is_ascii_digit());
    let digits = words.len() - number.len();
    if ["- ", "* ", "+ "].iter().any(|mark| words.starts_with(mark)) {
        2
    } else if digits > 0 && (number.starts_with(". ") || number.starts_with(") ")) {
        digits + 2
    } else {
        0
    }
}

/// Fills lines with words; a word that looks like a list marker is not moved to the start of a line.
fn fill<'a>(out: &mut String, words: impl Iterator<Item = &'a str>, before: [String; 2], width: usize) {
    let mut line = before[0].clone();
    let mut empty = true;
    for word in words {
        let room = line.chars().count() + 1 + word.chars().count() <= width;
        if !empty && !room && item_mark(&format!("{word} ")) == 0 && !word.starts_with(['#', '|', '<']) {
            out.push_str(&line);
            out.push('\n');
            line.clone_from(&before[1]);
            empty = true;
        }
        if !empty {
            line.push(' ');
        }
        line += word;
        empty = false;
    }
    out.push_str(&line);
    out.push('\n');
}

#[cfg(test)]
mod tests {
    use super::wrap;

    #[test]
    fn only_paragraphs_with_a_line_too_wide_are_wrapped() {
        let text = "/// one two three four five\n/// six\n///\n/// seven\n/// eight\nlet a = \"// one two three four five\";\n";
        let expected = "/// one two three\n/// four five six\n///\n/// seven\n/// eight\nlet a = \"// one two three four five\";\n";
        assert_eq!(wrap(text, 18), expected);
    }

    #[test]
    fn lists_hang_and_tables_and_code_stay() {
        let text = "    //! - one two three four\n    //! - five\n    //! | a table that is wide | b |\n    //! ```\n    //! code that is wide indeed\n    //! ```\n";
        let expected = "    //! - one two\n    //!   three four\n    //! - five\n    //! | a table that is wide | b |\n    //! ```\n    //! code that is wide indeed\n    //! ```\n";
        assert_eq!(wrap(text, 21), expected);
    }
}
