//! `SHA256SUMS`, in the format of `sha256sum`.

use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::io::{BufWriter, Read, Write};
use std::path::Path;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::input;
use crate::error::{Error, Result};

/// Name of the checksum file.
pub const SHA256SUMS: &str = "SHA256SUMS";

/// A SHA-256 hash, displayed in hexadecimal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hash(pub [u8; 32]);

impl fmt::Display for Hash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const DIGITS: &[u8; 16] = b"0123456789abcdef";
        let digits = self.0.iter().flat_map(|byte| [byte >> 4, byte & 15]);
        digits.map(|digit| char::from(DIGITS[usize::from(digit)])).try_for_each(|digit| f.write_char(digit))
    }
}

/// Size and SHA-256 of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fingerprint {
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256.
    pub sha256: Hash,
}

impl Fingerprint {
    /// The fingerprint of these contents.
    pub fn of(content: &[u8]) -> Self {
        Fingerprint { bytes: content.len() as u64, sha256: Hash(Sha256::digest(content).into()) }
    }
}

/// A writer or reader that computes the fingerprint of everything that goes through it.
#[derive(Debug)]
pub struct Hashing<W> {
    inner: W,
    hasher: Sha256,
    bytes: u64,
}

impl<W> Hashing<W> {
    /// Wraps a writer or reader.
    pub fn new(inner: W) -> Self {
        Hashing { inner, hasher: Sha256::new(), bytes: 0 }
    }

    /// The fingerprint of everything written or read.
    pub fn fingerprint(self) -> Fingerprint {
        Fingerprint { bytes: self.bytes, sha256: Hash(self.hasher.finalize().into()) }
    }
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let n = self.inner.write(bytes)?;
        self.hasher.update(&bytes[..n]);
        self.bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.inner.flush()
    }
}

impl<R: Read> Read for Hashing<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.inner.read(buffer)?;
        self.hasher.update(&buffer[..n]);
        self.bytes += n as u64;
        Ok(n)
    }
}

/// Computes the fingerprint of a file, reading it in chunks.
pub fn fingerprint(path: &Path) -> Result<Fingerprint> {
    fingerprint_after(&[], path)
}

/// Computes the fingerprint of `before` followed by a file.
pub fn fingerprint_after(before: &[u8], path: &Path) -> Result<Fingerprint> {
    let mut hashing = Hashing::new(before.chain(input::open(path)?));
    let mut chunk = BufWriter::with_capacity(1 << 16, std::io::sink());
    std::io::copy(&mut hashing, &mut chunk).map_err(|e| Error::read(path, e))?;
    Ok(hashing.fingerprint())
}

/// One hash for all images: the SHA-256 of the lines of `SHA256SUMS` for files in `images/`, which in a shell
/// is `grep ' images/' SHA256SUMS | sha256sum`.
pub fn images_digest(sums: &str) -> String {
    let lines = sums.lines().filter(|line| line.contains("  images/"));
    let lines: String = lines.map(|line| format!("{line}\n")).collect();
    Fingerprint::of(lines.as_bytes()).sha256.to_string()
}

/// Fingerprints of files, by path relative to `folder`; computed in parallel.
pub fn fingerprints(folder: &Path, files: &[String]) -> Result<BTreeMap<String, Fingerprint>> {
    files.par_iter().map(|file| Ok((file.clone(), fingerprint(&folder.join(file))?))).collect()
}

/// The text of `SHA256SUMS`.
pub fn write(fingerprints: &BTreeMap<String, Fingerprint>) -> String {
    fingerprints.iter().map(|(path, f)| format!("{}  {path}\n", f.sha256)).collect()
}

/// Parses `SHA256SUMS` into hashes by path; `name` is used in messages.
pub fn read(text: &str, name: &str) -> Result<BTreeMap<String, String>> {
    let mut sums = BTreeMap::new();
    for (i, line) in text.lines().enumerate() {
        let entry = line.split_once("  ").filter(|(hash, path)| {
            hash.len() == 64 && hash.bytes().all(|b| b.is_ascii_hexdigit()) && !path.is_empty()
        });
        let Some((hash, path)) = entry else {
            return Err(Error::input(format!(
                "{name}:{}: expected 64 hexadecimal digits, two spaces, a path",
                i + 1
            )));
        };
        sums.insert(path.to_owned(), hash.to_ascii_lowercase());
    }
    Ok(sums)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_format_is_that_of_sha256sum() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.txt"), "abc").unwrap();
        let text = write(&fingerprints(folder.path(), &["a.txt".to_owned()]).unwrap());
        // The digest of "abc" from FIPS 180-2.
        assert_eq!(text, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  a.txt\n");
        assert_eq!(read(&text, SHA256SUMS).unwrap().len(), 1);
        assert!(read("xyz a.txt\n", SHA256SUMS).unwrap_err().to_string().contains("SHA256SUMS:1"));
    }
}
