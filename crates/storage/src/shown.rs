//! Display of text from untrusted files.

/// Whether a character is invisible but changes how others are shown: control characters, and invisible
/// Unicode characters that reverse or join text. Names from untrusted files may contain them.
pub fn is_hidden(c: char) -> bool {
    let format = ['\u{200b}'..='\u{200f}', '\u{2028}'..='\u{202e}', '\u{2060}'..='\u{206f}'];
    c.is_control() || c == '\u{feff}' || format.iter().any(|range| range.contains(&c))
}

/// The text with hidden characters replaced, line breaks included: a name of one line.
pub fn name(text: &str) -> String {
    text.chars().map(|c| if is_hidden(c) { '\u{fffd}' } else { c }).collect()
}

/// A [`name`] for tables that spreadsheets open: cells that start like a formula are quoted.
pub fn cell(text: &str) -> String {
    let shown = name(text);
    if shown.starts_with(['=', '+', '-', '@']) { format!("'{shown}") } else { shown }
}
