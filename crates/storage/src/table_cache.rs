//! Renderer tables cached on disk between runs: a folder of files named by the hash of their description.
//!
//! A file contains the description, the table and a checksum; a file whose checksum does not match is removed
//! and computed again. Files first get a temporary name, so that several processes can use the folder at
//! once. When the total size exceeds the limit, the least recently used files are removed.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

use microsig_core::render::TableStore;
use sha2::{Digest, Sha256};

use crate::checksums::Fingerprint;
use crate::{Error, Result, input};

/// First bytes of each file.
const MARK: &[u8] = b"microsig table 1\n";
/// Length of a checksum.
const CHECKSUM: usize = 32;
/// Size limit of the folder unless `MICROSIG_CACHE_MB` sets another: 2 GB.
const MOST_MB: u64 = 2000;
/// Extension of files.
const EXTENSION: &str = "table";
/// Age at which temporary files count as left over, s.
const LEFT_OVER_S: u64 = 3600;

/// The folder.
#[derive(Debug)]
pub struct TableFolder {
    folder: PathBuf,
    /// The program that computed the tables; another program may compute different ones.
    program: String,
    most_bytes: u64,
    count: AtomicU64,
}

impl TableFolder {
    /// The user's cache: `MICROSIG_CACHE`, or `microsig/tables` in the system's cache folder; `None` if
    /// neither exists. Errors: a limit that is not a number; a folder given by `MICROSIG_CACHE` that cannot
    /// be created.
    pub fn for_user() -> Result<Option<Self>> {
        let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
        let caches = || {
            set("XDG_CACHE_HOME")
                .map(PathBuf::from)
                .or_else(|| Some(PathBuf::from(set("HOME")?).join(".cache")))
        };
        let asked = set("MICROSIG_CACHE").map(PathBuf::from);
        if let Some(folder) = &asked {
            let failed = |source| Error::Write { path: folder.clone(), source };
            std::fs::create_dir_all(folder).map_err(failed)?;
        }
        let most_mb = match set("MICROSIG_CACHE_MB") {
            Some(mb) => mb.to_str().and_then(|mb| mb.parse().ok()).ok_or_else(|| {
                let mb = mb.display();
                Error::input(format!("MICROSIG_CACHE_MB = {mb}: expected a whole number of megabytes"))
            })?,
            None => MOST_MB,
        };
        let folder = asked.or_else(|| Some(caches()?.join("microsig/tables")));
        Ok(folder
            .zip(program())
            .map(|(folder, program)| TableFolder::new(folder, &program, most_mb.saturating_mul(1_000_000))))
    }

    fn new(folder: PathBuf, program: &str, most_bytes: u64) -> Self {
        TableFolder { folder, program: program.to_owned(), most_bytes, count: AtomicU64::new(0) }
    }

    fn path(&self, description: &str) -> PathBuf {
        let name = Fingerprint::of(format!("{}\0{description}", self.program).as_bytes()).sha256;
        self.folder.join(name.to_string()).with_extension(EXTENSION)
    }

    fn write(&self, path: &Path, description: &str, bytes: &[u8]) -> std::io::Result<()> {
        std::fs::create_dir_all(&self.folder)?;
        let number = self.count.fetch_add(1, Ordering::Relaxed);
        let temporary = path.with_extension(format!("{}-{number}.partial", std::process::id()));
        let mut file = std::fs::File::create_new(&temporary)?;
        let written = (|| {
            file.write_all(MARK)?;
            file.write_all(&(description.len() as u64).to_le_bytes())?;
            file.write_all(description.as_bytes())?;
            file.write_all(bytes)?;
            file.write_all(&Sha256::digest(bytes))
        })();
        written.and_then(|()| std::fs::rename(&temporary, path)).inspect_err(|_| {
            let _ = std::fs::remove_file(&temporary);
        })
    }

    /// Removes the least recently used files until the rest fits, and the temporary files of writers that
    /// have died.
    fn tidy(&self) -> std::io::Result<()> {
        let mut files = Vec::new();
        for entry in std::fs::read_dir(&self.folder)? {
            let entry = entry?;
            let Ok(facts) = entry.metadata() else { continue };
            let used = facts.modified().unwrap_or(SystemTime::UNIX_EPOCH);
            let path = entry.path();
            let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
            match ending {
                EXTENSION => files.push((used, facts.len(), path)),
                "partial" if used.elapsed().is_ok_and(|age| age.as_secs() > LEFT_OVER_S) => {
                    let _ = std::fs::remove_file(path);
                }
                _ => {}
            }
        }
        files.sort();
        let mut total: u64 = files.iter().map(|(_, bytes, _)| bytes).sum();
        for (_, bytes, path) in files {
            if total <= self.most_bytes {
                break;
            }
            // Another process may have removed it.
            let _ = std::fs::remove_file(path);
            total -= bytes;
        }
        Ok(())
    }
}

impl TableStore for TableFolder {
    fn load(&self, description: &str) -> Option<Vec<u8>> {
        let path = self.path(description);
        let bytes = input::read(&path).ok()?;
        let content = content(&bytes, description).map(<[u8]>::to_vec);
        match content {
            Some(_) => {
                let now = SystemTime::now();
                let _ =
                    std::fs::File::options().append(true).open(&path).and_then(|file| file.set_modified(now));
            }
            None => drop(std::fs::remove_file(&path)),
        }
        content
    }

    fn save(&self, description: &str, bytes: &[u8]) {
        // Tables that cannot be stored are computed again.
        if bytes.len() as u64 <= self.most_bytes {
            let _ = self.write(&self.path(description), description, bytes).and_then(|()| self.tidy());
        }
    }
}

/// The table in a file, if it is complete and matches the description.
fn content<'a>(bytes: &'a [u8], description: &str) -> Option<&'a [u8]> {
    let (length, rest) = bytes.strip_prefix(MARK)?.split_first_chunk::<8>()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    let (found, rest) = rest.split_at_checked(length)?;
    let (table, checksum) = rest.split_at_checked(rest.len().checked_sub(CHECKSUM)?)?;
    (found == description.as_bytes() && Sha256::digest(table)[..] == *checksum).then_some(table)
}

/// The program that computed the tables: version, commit, and the program file, which differs between builds.
fn program() -> Option<String> {
    let file = std::env::current_exe().ok()?.metadata().ok()?;
    let built = file.modified().ok()?.duration_since(SystemTime::UNIX_EPOCH).ok()?;
    let (version, commit) = (crate::VERSION, crate::COMMIT);
    Some(format!("{version} {commit} {} {}", file.len(), built.as_nanos()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_come_back_unless_they_are_damaged_or_of_another_program() {
        let place = tempfile::tempdir().unwrap();
        let store = TableFolder::new(place.path().join("a/b"), "one", 1_000_000);
        assert_eq!(store.load("x"), None);
        store.save("x", b"table of x");
        store.save("y", b"");
        assert_eq!(store.load("x").as_deref(), Some(&b"table of x"[..]));
        assert_eq!(store.load("y").as_deref(), Some(&b""[..]));
        assert_eq!(TableFolder::new(place.path().join("a/b"), "two", 1_000_000).load("x"), None);
        let path = store.path("x");
        let mut bytes = std::fs::read(&path).unwrap();
        let middle = bytes.len() - CHECKSUM - 3;
        bytes[middle] ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!((store.load("x"), path.exists()), (None, false));
        std::fs::write(&path, b"microsig table 1\n\xff\xff\xff\xff\xff\xff\xff\xff").unwrap();
        assert_eq!(store.load("x"), None);
    }

    #[test]
    fn the_folder_stays_below_its_bound_and_the_oldest_go_first() {
        let place = tempfile::tempdir().unwrap();
        let store = TableFolder::new(place.path().to_owned(), "one", 3500);
        let old = SystemTime::now() - std::time::Duration::from_secs(100);
        for (i, name) in ["a", "b", "c"].into_iter().enumerate() {
            store.save(name, &[0; 1000]);
            let file = std::fs::File::options().append(true).open(store.path(name)).unwrap();
            file.set_modified(old + std::time::Duration::from_secs(i as u64)).unwrap();
        }
        // Used again.
        assert!(store.load("a").is_some());
        store.save("d", &[0; 1000]);
        let there = ["a", "b", "c", "d"].map(|name| store.path(name).exists());
        assert_eq!(there, [true, false, true, true]);
        store.save("too large", &[0; 4000]);
        assert!(!store.path("too large").exists());
    }

    #[test]
    fn several_writers_do_not_disturb_each_other() {
        let place = tempfile::tempdir().unwrap();
        let stores: Vec<_> =
            (0..2).map(|_| TableFolder::new(place.path().to_owned(), "one", 1_000_000)).collect();
        std::thread::scope(|scope| {
            for store in &stores {
                scope.spawn(move || {
                    for _ in 0..50 {
                        store.save("x", &[7; 10_000]);
                        assert!(store.load("x").is_none_or(|bytes| bytes == [7; 10_000]));
                    }
                });
            }
        });
        assert_eq!(stores[0].load("x").map(|bytes| bytes.len()), Some(10_000));
    }
}
