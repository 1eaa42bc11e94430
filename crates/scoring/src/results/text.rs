//! Text files as other programs write them: UTF-8 or UTF-16, any line ends, lines of limited length.
//!
//! UTF-16 is read if a byte order mark makes it certain. Files that are not text (workbooks, archives,
//! arrays) are identified in the message, because their bytes would only give errors about the header.

use std::fs::File;
use std::io::{BufRead, BufReader, Error as IoError, ErrorKind, Read};

use storage::InputFile;
use storage::error::{Error, Result};

/// Maximum length of a line, bytes.
const LONGEST_LINE: usize = 1 << 16;

/// Maximum distance between the ends of two XML tags, bytes; TrackMate saves its log, which may be long.
const LONGEST_TEXT: usize = 1 << 22;

/// Number of bytes from which encoding and format are detected.
pub(super) const HEAD: usize = 4096;

/// First bytes of files that are not text, with the message for each: the type of the file, and what to do.
const CONTAINERS: [(&[u8], &str); 9] = [
    (b"PK\x03\x04", WORKBOOK),
    (b"\xd0\xcf\x11\xe0", WORKBOOK),
    (b"\x1f\x8b", "compressed by gzip; unpack it first"),
    (b"\x89HDF", HDF5),
    (b"MATLAB 5.0", "a MATLAB file; save the table by writetable(table, \"result.csv\")"),
    (b"MATLAB 7.3", "a MATLAB file; save the table by writetable(table, \"result.csv\")"),
    (b"\x93NUMPY", "a NumPy array; save it as CSV with a header of column names"),
    (b"PAR1", "a Parquet file; save it as CSV"),
    (b"%PDF", "a PDF; expected a CSV"),
];
const WORKBOOK: &str = "a spreadsheet (.xlsx, .xls, .ods) or another ZIP archive, not text; in Excel or LibreOffice save the sheet as CSV";
const HDF5: &str = "an HDF5 file; save the table as CSV";

/// A text file, decoded to UTF-8 without a byte order mark.
#[derive(Debug)]
pub(crate) struct Text {
    file: File,
    encoding: Encoding,
    /// Bytes of UTF-16 that are not decoded yet.
    raw: Vec<u8>,
    /// Bytes of UTF-8, and how many of them have been returned.
    ready: Vec<u8>,
    given: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Utf8,
    Utf16Le,
    Utf16Be,
}

impl Text {
    /// Opens a text file.
    pub(crate) fn open(path: &InputFile) -> Result<Self> {
        let mut file = path.open()?;
        let mut head = Vec::new();
        (&mut file).take(HEAD as u64).read_to_end(&mut head).map_err(|e| Error::read(path, e))?;
        let is_not = |what: &str| Err(Error::Unsupported(vec![format!("{}: {what}", path.display())]));
        if let Some((_, what)) = CONTAINERS.iter().find(|(magic, _)| head.starts_with(magic)) {
            return is_not(what);
        }
        let (mark, encoding) = match head.as_slice() {
            [0xff, 0xfe, 0, 0, ..] => return is_not("UTF-32 text; save it as UTF-8"),
            [0xff, 0xfe, ..] => (2, Encoding::Utf16Le),
            [0xfe, 0xff, ..] => (2, Encoding::Utf16Be),
            [0xef, 0xbb, 0xbf, ..] => (3, Encoding::Utf8),
            _ => (0, Encoding::Utf8),
        };
        if encoding == Encoding::Utf8 && head.contains(&0) {
            // In UTF-16 without a mark, every other byte of plain characters is 0.
            let zeros = |first: usize| head.iter().skip(first).step_by(2).all(|b| *b == 0);
            return is_not(match head.len() > 1 && (zeros(0) || zeros(1)) {
                true => "UTF-16 text without a byte order mark; save it as UTF-8",
                false => "binary data, not text; expected a table, for example CSV",
            });
        }
        head.drain(..mark);
        let (raw, ready) = if encoding == Encoding::Utf8 { (Vec::new(), head) } else { (head, Vec::new()) };
        Ok(Text { file, encoding, raw, ready, given: 0 })
    }

    /// The first bytes of a text file, decoded, after a line `sep=` for Excel.
    pub(super) fn head(path: &InputFile) -> Result<Vec<u8>> {
        let mut head = Vec::new();
        let failed = |e| Error::input(format!("{}: {e}", path.display()));
        Text::open(path)?.take(HEAD as u64).read_to_end(&mut head).map_err(failed)?;
        if let Some(end) = head.iter().position(|b| matches!(b, b'\n' | b'\r'))
            && excel_separator(&head[..end]).is_some()
        {
            head.drain(..end + if head[end..].starts_with(b"\r\n") { 2 } else { 1 });
        }
        Ok(head)
    }

    pub(super) fn is_utf16(&self) -> bool {
        self.encoding != Encoding::Utf8
    }

    /// Decodes the next part of UTF-16; no bytes are ready afterwards only at the end of the file.
    fn decode(&mut self) -> std::io::Result<()> {
        let wrong = |what| IoError::new(ErrorKind::InvalidData, what);
        (self.ready, self.given) = (Vec::new(), 0);
        while self.ready.is_empty() {
            let before = self.raw.len();
            (&mut self.file).take(HEAD as u64).read_to_end(&mut self.raw)?;
            let is_end = self.raw.len() == before;
            let unit = |pair: &[u8]| match self.encoding {
                Encoding::Utf16Be => u16::from_be_bytes([pair[0], pair[1]]),
                _ => u16::from_le_bytes([pair[0], pair[1]]),
            };
            let mut units: Vec<u16> = self.raw.chunks_exact(2).map(unit).collect();
            // The second half of a pair of surrogates may come with the next part.
            if !is_end && units.last().is_some_and(|u| (0xd800..0xdc00).contains(u)) {
                units.pop();
            }
            self.raw.drain(..2 * units.len());
            let text = String::from_utf16(&units);
            self.ready =
                text.map_err(|_| wrong("expected UTF-16, as its byte order mark says"))?.into_bytes();
            if is_end {
                let whole = self.raw.is_empty();
                return if whole { Ok(()) } else { Err(wrong("the file ends within a character of UTF-16")) };
            }
        }
        Ok(())
    }
}

impl Read for Text {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        if self.given == self.ready.len() {
            if self.encoding == Encoding::Utf8 {
                return self.file.read(buffer);
            }
            self.decode()?;
        }
        let n = buffer.len().min(self.ready.len() - self.given);
        buffer[..n].copy_from_slice(&self.ready[self.given..][..n]);
        self.given += n;
        Ok(n)
    }
}

/// The separator of a first line `sep=;`, which Excel reads and writes.
pub(super) fn excel_separator(line: &[u8]) -> Option<u8> {
    let line = line.trim_ascii().strip_prefix(b"\"").unwrap_or(line);
    let line = line.strip_suffix(b"\"").unwrap_or(line);
    match line {
        [s, e, p, b'=', separator] if [s, e, p].map(u8::to_ascii_lowercase) == *b"sep" => Some(*separator),
        _ => None,
    }
}

/// XML that fails if a tag or text is too long.
#[derive(Debug)]
pub(crate) struct Bounded {
    inner: Text,
    length: usize,
    line: u64,
}

impl Bounded {
    pub(crate) fn new(inner: Text) -> Self {
        Bounded { inner, length: 0, line: 1 }
    }
}

impl Read for Bounded {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.inner.read(buffer)?;
        for &byte in &buffer[..n] {
            self.length = if byte == b'>' { 0 } else { self.length + 1 };
            self.line += u64::from(byte == b'\n');
            if self.length > LONGEST_TEXT {
                return Err(too_long(self.line, "a tag or text", LONGEST_TEXT));
            }
        }
        Ok(n)
    }
}

fn too_long(line: u64, what: &str, most: usize) -> IoError {
    IoError::new(ErrorKind::InvalidData, format!("line {line}: {what} is longer than {most} bytes"))
}

/// Lines that end with a newline, a carriage return, both, or with the end of the file.
#[derive(Debug)]
pub(super) struct Lines {
    text: BufReader<Text>,
    /// Whether the last line ended with a carriage return.
    after_return: bool,
    /// Number of the last line, from 1.
    pub(super) number: u64,
}

impl Lines {
    pub(super) fn new(text: Text) -> Self {
        Lines { text: BufReader::new(text), after_return: false, number: 0 }
    }

    /// Reads the next line without its end; `false` if there is none.
    pub(super) fn next(&mut self, line: &mut Vec<u8>) -> std::io::Result<bool> {
        line.clear();
        self.number += 1;
        let mut is_begun = false;
        loop {
            let ready = self.text.fill_buf()?;
            let skipped = usize::from(self.after_return && ready.first() == Some(&b'\n'));
            let rest = &ready[skipped..];
            if ready.is_empty() {
                return Ok(is_begun);
            }
            is_begun |= !rest.is_empty();
            let end = rest.iter().position(|byte| b"\n\r".contains(byte));
            line.extend_from_slice(&rest[..end.unwrap_or(rest.len())]);
            self.after_return = end.is_some_and(|end| rest[end] == b'\r');
            let used = skipped + end.map_or(rest.len(), |end| end + 1);
            self.text.consume(used);
            if line.len() > LONGEST_LINE {
                return Err(too_long(self.number, "the line", LONGEST_LINE));
            }
            if end.is_some() {
                return Ok(true);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> std::result::Result<String, String> {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("t.csv");
        std::fs::write(&path, bytes).unwrap();
        let mut text = String::new();
        Text::open(&path.into())
            .map_err(|e| e.to_string())?
            .read_to_string(&mut text)
            .map_err(|e| e.to_string())?;
        Ok(text)
    }

    fn utf16(text: &str, mark: bool, bytes: fn(u16) -> [u8; 2]) -> Vec<u8> {
        let mark = mark.then_some(0xfeff);
        mark.into_iter().chain(text.encode_utf16()).flat_map(bytes).collect()
    }

    #[test]
    fn text_is_decoded_as_its_byte_order_mark_says() {
        // Pairs of surrogates lie across the ends of the parts that are decoded together.
        for text in ["a,b\n1,2\n".to_owned(), format!("x{}", "\u{1f600}".repeat(3000)), String::new()] {
            assert_eq!(read(format!("\u{feff}{text}").as_bytes()).unwrap(), text);
            assert_eq!(read(text.as_bytes()).unwrap(), text);
            assert_eq!(read(&utf16(&text, true, u16::to_le_bytes)).unwrap(), text);
            assert_eq!(read(&utf16(&text, true, u16::to_be_bytes)).unwrap(), text);
        }
        let bytes = utf16("a,b\n", true, u16::to_le_bytes);
        assert!(read(&bytes[..bytes.len() - 1]).unwrap_err().contains("ends within a character"));
        assert!(read(&[0xff, 0xfe, 0, 0xd8, b'a', 0]).unwrap_err().contains("expected UTF-16"));
    }

    #[test]
    fn what_is_not_text_is_named() {
        let cases: [(&[u8], &str); 5] = [
            (b"PK\x03\x04\x14\0", "save the sheet as CSV"),
            (b"\x1f\x8b\x08\0", "gzip"),
            (b"MATLAB 5.0 MAT-file", "writetable"),
            (b"\x01\0\x02\x03\0\0", "binary data"),
            (
                &utf16("frame,x_px\n", false, u16::to_le_bytes),
                "UTF-16 text without a byte order mark; save it as UTF-8",
            ),
        ];
        for (bytes, expected) in cases {
            let said = read(bytes).unwrap_err();
            assert!(said.contains("t.csv: ") && said.contains(expected), "{said}");
        }
    }
}
