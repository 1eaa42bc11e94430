//! Lines of text files as people save them: UTF-8, lines ended by LF or CR LF.

/// The text of a line, without its end; the error is a message.
///
/// Files in UTF-16 and files whose lines end in CR alone are refused: read as UTF-8 with lines that end in
/// LF, the latter would be one line, and all of it a comment if the first line is one.
pub(super) fn text_of(line: &[u8]) -> Result<&str, String> {
    let line = line.strip_suffix(b"\n").unwrap_or(line);
    let wrong = |byte: u8| {
        let hint = if matches!(byte, 0 | 0xfe | 0xff) { " (this looks like UTF-16)" } else { "" };
        format!("byte 0x{byte:02x}: expected text in UTF-8{hint}")
    };
    let text = str::from_utf8(line).map_err(|e| wrong(line[e.valid_up_to()]))?;
    if text.contains('\0') {
        return Err(wrong(0));
    }
    let text = text.trim_end_matches('\r');
    match text.find('\r') {
        Some(_) => Err("line end CR: expected lines that end in LF or CR LF".to_owned()),
        None => Ok(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_encodings_and_line_ends_are_named() {
        for end in ["", "\n", "\r\n", "\r\r\n"] {
            assert_eq!(text_of(format!("1 \u{b5}m{end}").as_bytes()), Ok("1 \u{b5}m"));
        }
        let message = |line: &[u8]| text_of(line).unwrap_err();
        assert_eq!(message(b"1 \xb5m\n"), "byte 0xb5: expected text in UTF-8");
        assert!(message(b"\xff\xfea\0\n").contains("0xff: expected text in UTF-8 (this looks like UTF-16)"));
        assert!(message(b"a\0=\x001\0\n").contains("0x00: expected text in UTF-8 (this looks like UTF-16)"));
        assert!(message(b"# x y z d\r1 2 3 2\r").starts_with("line end CR: expected lines"));
    }
}
