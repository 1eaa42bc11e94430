//! The key file of a dataset with secret random numbers. It is withheld and published together with the
//! truth: with the key, anybody can generate the same bytes again.

use std::path::Path;

use microsig_core::stream::Streams;

use crate::error::{Error, Result};

/// Name of the file: 64 hexadecimal digits.
pub const KEY_FILE: &str = "secret_key.txt";

/// Draws a new key from the operating system's random number generator.
pub fn draw() -> Result<[u8; 32]> {
    let mut key = [0; 32];
    getrandom::fill(&mut key)
        .map_err(|e| Error::input(format!("the operating system provides no random numbers: {e}")))?;
    Ok(key)
}

/// The text of the file.
pub fn text(key: &[u8; 32]) -> String {
    key.iter().map(|byte| format!("{byte:02x}")).collect::<String>() + "\n"
}

/// The secret random number streams of a dataset; `None` if its streams are public.
pub fn streams(dataset: &Path) -> Result<Option<Streams>> {
    let path = dataset.join(KEY_FILE);
    if !path.exists() {
        return Ok(None);
    }
    let text = crate::read_text(&path)?;
    let digits = text.trim_end().as_bytes();
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    let is_valid = digits.len() == 64 && digits.iter().all(u8::is_ascii_hexdigit);
    let key: Option<Vec<u8>> = is_valid.then(|| digits.chunks(2).map(byte).collect()).flatten();
    match key.and_then(|key| <[u8; 32]>::try_from(key).ok()) {
        Some(key) => Ok(Some(Streams::secret(key))),
        None => Err(Error::input(format!("{}: expected 64 hexadecimal digits", path.display()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_survives_the_round_trip_and_others_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(streams(folder.path()).unwrap(), None);
        let (key, path) = (draw().unwrap(), folder.path().join(KEY_FILE));
        assert_ne!(key, draw().unwrap());
        std::fs::write(&path, text(&key)).unwrap();
        assert_eq!(streams(folder.path()).unwrap(), Some(Streams::secret(key)));
        for wrong in ["", "12", &"g".repeat(64), &"1".repeat(63), &"1".repeat(66)] {
            std::fs::write(&path, wrong).unwrap();
            assert!(streams(folder.path()).is_err(), "{wrong}");
        }
    }
}
