//! The key of a dataset whose random numbers are secret, a file of the dataset. It lies beside the truth and
//! is withheld and published with it: with the key anybody can make the same bytes again.

use std::path::Path;

use microsig_core::stream::Streams;

use storage::error::{Error, Result};

/// Name of the file: 64 hexadecimal digits.
pub const KEY_FILE: &str = "secret_key.txt";

/// A new key from the operating system.
pub fn draw() -> Result<[u8; 32]> {
    let mut key = [0; 32];
    getrandom::fill(&mut key)
        .map_err(|e| Error::input(format!("the operating system gives no random numbers: {e}")))?;
    Ok(key)
}

/// The text of the file.
pub fn text(key: &[u8; 32]) -> String {
    key.iter().map(|byte| format!("{byte:02x}")).collect::<String>() + "\n"
}

/// The secret streams of a dataset; `None` if it has public ones.
///
/// # Errors
/// A key that is none.
pub fn streams(dataset: &Path) -> Result<Option<Streams>> {
    let path = dataset.join(KEY_FILE);
    if !path.exists() {
        return Ok(None);
    }
    let text = std::fs::read_to_string(&path).map_err(|e| Error::read(&path, e))?;
    let digits = text.trim_end().as_bytes();
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    let whole = digits.len() == 64 && digits.iter().all(u8::is_ascii_hexdigit);
    let key: Option<Vec<u8>> = whole.then(|| digits.chunks(2).map(byte).collect()).flatten();
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
        let place = tempfile::tempdir().unwrap();
        assert_eq!(streams(place.path()).unwrap(), None);
        let (key, path) = (draw().unwrap(), place.path().join(KEY_FILE));
        assert_ne!(key, draw().unwrap());
        std::fs::write(&path, text(&key)).unwrap();
        assert_eq!(streams(place.path()).unwrap(), Some(Streams::secret(key)));
        for wrong in ["", "12", &"g".repeat(64), &"1".repeat(63), &"1".repeat(66)] {
            std::fs::write(&path, wrong).unwrap();
            assert!(streams(place.path()).is_err(), "{wrong}");
        }
    }
}
