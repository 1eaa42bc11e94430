//! `SHA256SUMS`, in the format of `sha256sum`.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};

/// Name of the file.
pub const SHA256SUMS: &str = "SHA256SUMS";

/// Size and SHA-256 of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fingerprint {
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256 in hexadecimal.
    pub sha256: String,
}

/// Takes the fingerprint of a file, reading it piece by piece.
pub fn fingerprint(path: &Path) -> Result<Fingerprint> {
    fingerprint_after(&[], path)
}

/// Takes the fingerprint of a file with other bytes before it.
pub fn fingerprint_after(before: &[u8], path: &Path) -> Result<Fingerprint> {
    let failed = |e| Error::read(path, e);
    let mut file = std::fs::File::open(path).map_err(failed)?;
    let (mut hasher, mut buffer, mut bytes) = (Sha256::new(), vec![0u8; 1 << 16], before.len() as u64);
    hasher.update(before);
    loop {
        let n = file.read(&mut buffer).map_err(failed)?;
        if n == 0 {
            break;
        }
        hasher.update(&buffer[..n]);
        bytes += n as u64;
    }
    Ok(Fingerprint { bytes, sha256: hexadecimal(&hasher.finalize()) })
}

/// SHA-256 of bytes in memory.
pub fn sha256(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

fn hexadecimal(digest: &[u8]) -> String {
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// One hash for all images: the SHA-256 of those lines of `SHA256SUMS` that name files in `images/`. In a shell it is
/// `grep '  images/' SHA256SUMS | sha256sum`.
pub fn images_digest(sums: &str) -> String {
    let lines = sums.lines().filter(|line| line.contains("  images/"));
    sha256(lines.map(|line| format!("{line}\n")).collect::<String>().as_bytes())
}

/// Fingerprints of many files, by path relative to `folder`.
pub fn fingerprints(folder: &Path, files: &[String]) -> Result<BTreeMap<String, Fingerprint>> {
    files.par_iter().map(|file| Ok((file.clone(), fingerprint(&folder.join(file))?))).collect()
}

/// The text of `SHA256SUMS`.
pub fn write(fingerprints: &BTreeMap<String, Fingerprint>) -> String {
    fingerprints.iter().map(|(path, f)| format!("{}  {path}\n", f.sha256)).collect()
}

/// Reads `SHA256SUMS`: hash by path.
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
