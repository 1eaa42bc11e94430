//! Atomic creation of folders: built as `NAME.partial`, renamed when complete.
//!
//! During the build the process holds a lock, and a journal lists the files. When an interrupted run or, with
//! `--force`, an earlier result is replaced, only listed files are removed; any other file stops the run.
//! A process that is killed, or aborts as an allocation fails (`ulimit -v`), cannot remove its folders: the next run does.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;

use super::checksums::SHA256SUMS;
use super::interrupt::Temporary;
use super::journal::{self, JOURNAL, Journal, Listing};
use super::lock::FolderLock;
use super::output::OutputFolder;
pub use super::removal::remove_own;
use super::removal::{plan, remove_temporaries};
pub use super::walk::FilesBelow;
pub use super::walk::files_below;
use crate::advice::{Advice, flag};
use crate::{Error, Result, advice};

/// A folder under construction.
#[derive(Debug)]
pub struct Partial {
    output: OutputFolder,
    path: PathBuf,
    remove_on_drop: bool,
    journal: Arc<Journal>,
    /// Journal of an interrupted run.
    before: Listing,
    // Fields are dropped in this order: the lock last.
    temporary: Temporary,
    lock: FolderLock,
}

/// Path of a folder under construction.
pub fn partial_name(path: &Path) -> PathBuf {
    beside(path, "", ".partial")
}

/// Path to which a folder is moved when a new one replaces it, until its files are removed.
fn replaced_name(path: &Path) -> PathBuf {
    beside(path, ".", ".replaced")
}

fn beside(path: &Path, before: &str, after: &str) -> PathBuf {
    let mut name = std::ffi::OsString::from(before);
    name.push(path.file_name().unwrap_or_default());
    name.push(after);
    path.with_file_name(name)
}

/// Whether a folder is an unfinished dataset: it has the name of one, and a journal or no checksums yet.
pub fn is_partial(path: &Path) -> bool {
    let is_complete = || path.join(SHA256SUMS).is_file() && !path.join(JOURNAL).exists();
    path.extension().is_some_and(|e| e == "partial") && !is_complete()
}

/// Permission to create a folder: the process holds its lock.
#[derive(Debug)]
pub struct FolderClaim {
    path: PathBuf,
    lock: FolderLock,
}

impl FolderClaim {
    /// Takes the lock of the folder `path`, and completes a replacement that a crash interrupted. Errors:
    /// [`Error::Busy`] if another process is writing it; a link of that name.
    pub fn take(path: &Path) -> Result<Self> {
        if path.is_symlink() {
            let hint = "is a link; give the folder that it points to";
            return Err(Error::input(format!("{}: {hint}", path.display())));
        }
        let lock = FolderLock::take(path)?;
        let replaced = replaced_name(path);
        if replaced.exists() {
            if path.exists() && (!is_empty(path) || is_empty(&replaced)) {
                remove_own(&replaced)?;
            } else {
                // Only an empty folder is removed.
                let _ = std::fs::remove_dir(path);
                std::fs::rename(&replaced, path).map_err(Error::write(path))?;
            }
        }
        Ok(FolderClaim { path: path.to_owned(), lock })
    }

    /// Warning if the file system has no locks.
    pub fn warning(&self) -> Option<&str> {
        self.lock.warning.as_deref()
    }

    /// Journal of an interrupted run (empty if it has none); `None` if no run was interrupted. Errors: a
    /// folder with files that are not in its journal.
    pub fn left_over(&self) -> Result<Option<Listing>> {
        let partial = partial_name(&self.path);
        if !partial.exists() {
            return Ok(None);
        }
        plan(&partial)?;
        Ok(Some(journal::read(&partial)?.unwrap_or_default()))
    }

    /// Continues the folder of an interrupted run, or starts it. It is kept if not finished.
    pub fn resume(self) -> Result<Partial> {
        let before = self.left_over()?.unwrap_or_default();
        let partial = self.begin(before, false)?;
        remove_temporaries(partial.output.path())?;
        Ok(partial)
    }

    /// Starts the folder from scratch. With `remove_on_drop` it is removed if not finished. Errors: files not
    /// written by microsig in the folder of an interrupted run; an I/O error.
    pub fn start(self, remove_on_drop: bool) -> Result<Partial> {
        let partial = partial_name(&self.path);
        if partial.exists() {
            remove_own(&partial)?;
        }
        self.begin(Listing::default(), remove_on_drop)
    }

    /// Removes the folder of an interrupted run. Errors: files in it that microsig did not write; an I/O
    /// error.
    pub fn discard(self) -> Result<()> {
        let partial = partial_name(&self.path);
        if partial.exists() { remove_own(&partial) } else { Ok(()) }
    }

    fn begin(self, before: Listing, remove_on_drop: bool) -> Result<Partial> {
        let FolderClaim { path, lock } = self;
        let partial = partial_name(&path);
        std::fs::create_dir_all(&partial).map_err(Error::write(&partial))?;
        let temporary = Temporary::partial(&partial, !remove_on_drop);
        let journal = Journal::open(&partial)?;
        let output = OutputFolder::with_journal(&partial, Arc::clone(&journal));
        Ok(Partial { output, path, remove_on_drop, journal, before, temporary, lock })
    }
}

impl Partial {
    /// Starts the folder `path` from scratch; if it is not finished, it is removed. Errors: [`Error::Busy`]
    /// if another process is writing it; files not written by microsig in a folder to be removed; an I/O
    /// error.
    pub fn start(path: &Path) -> Result<Self> {
        FolderClaim::take(path)?.start(true)
    }

    /// The folder to write into.
    pub fn folder(&self) -> &OutputFolder {
        &self.output
    }

    /// Warning if the file system has no locks.
    pub fn warning(&self) -> Option<&str> {
        self.lock.warning.as_deref()
    }

    /// Records the inputs of the folder: hashes by name.
    pub fn source(&self, hashes: &BTreeMap<String, String>) -> Result<()> {
        self.journal.source(hashes)
    }

    /// Whether this process has written or reused a file, given its path in the folder.
    pub fn lists(&self, file: &str) -> bool {
        self.journal.lists(file)
    }

    /// Journal of an interrupted run.
    pub fn before(&self) -> &Listing {
        &self.before
    }

    /// Syncs the files to disk and renames the folder to its final name, replacing what `earlier` allows.
    /// Errors: as [`check_replaceable`]; an I/O error.
    pub fn finish(self, earlier: Earlier) -> Result<()> {
        let partial = self.output.path();
        // A file that is not in the journal could not be removed later. Files of the system are no reason to fail.
        debug_assert!(plan(partial).is_ok(), "written past the folder: {:?}", plan(partial));
        journal::keep_list(partial)?;
        self.give_name(earlier, || Ok(()))
    }

    /// [`Partial::finish`] for folders that do not keep a journal: datasets, whose checksums list their
    /// files, and images, which are never removed.
    pub fn finish_without_journal(self, earlier: Earlier) -> Result<()> {
        let journal = self.output.join(JOURNAL);
        // As late as possible: without the journal, an interrupted run cannot be resumed.
        self.give_name(earlier, || std::fs::remove_file(&journal).map_err(Error::write(&journal)))
    }

    /// `last` is what an interruption may no longer undo.
    fn give_name(mut self, earlier: Earlier, last: impl FnOnce() -> Result<()>) -> Result<()> {
        check_replaceable(&self.path, earlier)?;
        let partial = self.output.path();
        sync_below(partial)?;
        if is_empty(&self.path) {
            // If the user created the folder for the result, its permissions are kept.
            let of = std::fs::metadata(&self.path).map_err(Error::write(&self.path))?.permissions();
            std::fs::set_permissions(partial, of).map_err(Error::write(partial))?;
        }
        let replaced = replaced_name(&self.path);
        let replaces = self.path.exists();
        self.temporary.complete(&replaced, || {
            last()?;
            if replaces {
                std::fs::rename(&self.path, &replaced).map_err(Error::write(&self.path))?;
            }
            std::fs::rename(partial, &self.path).map_err(|e| {
                // Best effort: otherwise the next run restores it.
                let _ = if replaces { std::fs::rename(&replaced, &self.path) } else { Ok(()) };
                Error::write(&self.path)(e)
            })
        })?;
        self.remove_on_drop = false;
        sync(self.path.parent().unwrap_or(Path::new(".")));
        if replaces { remove_own(&replaced) } else { Ok(()) }
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        if self.remove_on_drop {
            // Best effort: on failure the name still marks the folder as unfinished.
            let _ = remove_own(self.output.path());
        }
    }
}

/// Flushes all files to disk, so that a crash after renaming cannot leave incomplete files.
fn sync_below(folder: &Path) -> Result<()> {
    let files: Vec<String> = FilesBelow::new(folder)?.collect::<Result<_>>()?;
    files.par_iter().for_each(|file| sync(&folder.join(file)));
    let folders: BTreeSet<&Path> = files.iter().filter_map(|file| Path::new(file).parent()).collect();
    folders.into_iter().for_each(|within| sync(&folder.join(within)));
    sync(folder);
    Ok(())
}

/// Ignores file systems without sync; a full disk has been reported when the file was written.
fn sync(path: &Path) {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    let _ = File::open(path).and_then(|file| file.sync_all());
}

/// What may exist at the path of a folder to be created, besides an empty folder.
#[derive(Debug, Clone, Copy)]
pub struct Earlier {
    /// File that identifies an earlier result of the same kind.
    pub mark: &'static str,
    /// Whether it is replaced.
    pub force: bool,
    /// Whether the verb has `--resume`, which leaves a complete result unchanged; for messages.
    pub resumable: bool,
}

impl Earlier {
    /// A result that this file identifies, to be replaced if `force`.
    pub fn new(mark: &'static str, force: bool) -> Self {
        Earlier { mark, force, resumable: false }
    }
}

/// Whether a path is a folder without files.
pub fn is_empty(path: &Path) -> bool {
    std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none())
}

/// Checks that a folder may be created: the path does not exist, or is an empty folder, or an earlier result
/// that is to be replaced. Errors: [`Error::Exists`], which states whether `--force` would replace the
/// existing result: it does if microsig wrote it and it contains no other files; `.` and `..`, which cannot
/// be replaced from within.
pub fn check_replaceable(path: &Path, earlier: Earlier) -> Result<()> {
    let refuse = |hint: Advice| Err(Error::Exists { path: path.to_owned(), hint });
    if path.file_name().is_none() {
        let hint = "expected a folder that can be renamed; run from another folder and give its name";
        return Err(Error::input(format!("{}: {hint}", path.display())));
    }
    if !path.exists() || is_empty(path) {
        return Ok(());
    }
    if !path.is_dir() {
        return refuse(advice!("is a file; expected a new or empty folder"));
    }
    if !path.join(earlier.mark).is_file() {
        let what = format!("is not empty and has no {}: it is not replaced, with or without ", earlier.mark);
        return refuse(advice!(what, flag("force"), "; expected a new or empty folder"));
    }
    plan(path)?;
    match (earlier.force, earlier.resumable) {
        (true, _) => Ok(()),
        (false, true) => refuse(advice!(
            "already exists; ",
            flag("force"),
            " replaces it, ",
            flag("resume"),
            " keeps it if it is the same"
        )),
        (false, false) => Err(Error::exists(path)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Replaces nothing.
    const NONE: Earlier = Earlier { mark: "a", force: false, resumable: false };

    #[test]
    fn a_folder_has_its_name_only_when_it_is_finished() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("set.v1");
        let partial = Partial::start(&path).unwrap();
        assert!(is_partial(partial.folder().path()) && !path.exists());
        assert!(matches!(Partial::start(&path), Err(Error::Busy { .. })));
        partial.folder().save_bytes("a", b"0").unwrap();
        drop(partial);
        assert!(!partial_name(&path).exists());

        let partial = Partial::start(&path).unwrap();
        partial.folder().save_bytes("a", b"1").unwrap();
        partial.finish(NONE).unwrap();
        assert_eq!(files_below(&path).unwrap(), [JOURNAL, "a"]);

        let other = Partial::start(&path).unwrap();
        let message = other.finish(Earlier::new("mark", true)).unwrap_err().to_string();
        assert!(message.ends_with("set.v1: is not empty and has no mark: it is not replaced, with or without --force; expected a new or empty folder"), "{message}");
        assert_eq!(files_below(&path).unwrap(), [JOURNAL, "a"], "nothing was removed");

        let again = Partial::start(&path).unwrap();
        let message = again.finish(NONE).unwrap_err().to_string();
        assert!(message.ends_with("set.v1: already exists; --force replaces it"), "{message}");
        assert_eq!(
            std::fs::read_dir(place.path()).unwrap().count(),
            1,
            "no lock, nothing unfinished is left"
        );
    }

    #[test]
    fn an_empty_folder_is_as_good_as_none_and_keeps_its_permissions() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("set");
        std::fs::create_dir(&path).unwrap();
        #[cfg(unix)]
        let mode = {
            use std::os::unix::fs::PermissionsExt;
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o700)).unwrap();
            |path: &Path| path.metadata().unwrap().permissions().mode() & 0o777
        };
        check_replaceable(&path, NONE).unwrap();
        let partial = Partial::start(&path).unwrap();
        partial.folder().save_bytes("a", b"1").unwrap();
        partial.finish(NONE).unwrap();
        assert_eq!(files_below(&path).unwrap(), [JOURNAL, "a"]);
        #[cfg(unix)]
        assert_eq!(mode(&path), 0o700);
        assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 1);
        // The message depends on what exists, not on the option.
        for force in [false, true] {
            let message = check_replaceable(&path, Earlier::new("b", force)).unwrap_err().to_string();
            assert!(message.contains("is not empty and has no b"), "{message}");
            let message =
                check_replaceable(&path.join("a"), Earlier::new("b", force)).unwrap_err().to_string();
            assert!(message.contains("a: is a file; expected a new or empty folder"), "{message}");
            assert!(check_replaceable(Path::new("."), Earlier::new("b", force)).is_err());
        }
        let resumable = Earlier { resumable: true, ..NONE };
        let message = check_replaceable(&path, resumable).unwrap_err().to_string();
        assert!(message.contains("--force replaces it, --resume keeps it"), "{message}");
    }

    #[test]
    fn only_files_of_this_program_are_removed() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("set");
        let make = |content: &[u8]| {
            let partial = Partial::start(&path)?;
            partial.folder().subfolder("images").unwrap();
            partial.folder().save_bytes("images/a", content).unwrap();
            partial.finish(Earlier::new("images/a", true))
        };
        make(b"1").unwrap();
        make(b"2").unwrap();
        std::fs::write(path.join("images/notes.txt"), "three years of work").unwrap();
        let message = make(b"3").unwrap_err().to_string();
        assert!(message.contains("images/notes.txt"), "{message}");
        assert_eq!(std::fs::read(path.join("images/a")).unwrap(), b"2");

        // A folder not written by microsig with the name of the partial one.
        let left_over = place.path().join("other.partial");
        std::fs::create_dir(&left_over).unwrap();
        std::fs::write(left_over.join("thesis.txt"), "").unwrap();
        let message = Partial::start(&place.path().join("other")).unwrap_err().to_string();
        assert!(message.contains("thesis.txt") && left_over.join("thesis.txt").exists(), "{message}");

        // A datapackage.json (Frictionless standard) alone does not identify a folder as written by microsig.
        let package = place.path().join("package");
        std::fs::create_dir(&package).unwrap();
        std::fs::write(package.join("datapackage.json"), "{}").unwrap();
        assert!(check_replaceable(&package, Earlier::new("datapackage.json", true)).is_err());
    }

    #[test]
    #[should_panic(expected = "written past the folder")]
    fn a_file_that_was_not_written_through_the_folder_is_noticed() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("set");
        let partial = Partial::start(&path).unwrap();
        partial.folder().save_bytes("a", b"1").unwrap();
        std::fs::write(partial.folder().join("b"), "2").unwrap();
        let _ = partial.finish(NONE);
    }

    #[test]
    fn the_lock_of_a_folder_within_that_a_killed_run_left_is_its_own() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("set");
        let outer = FolderClaim::take(&path).unwrap().start(false).unwrap();
        let within = outer.folder().subfolder("withheld").unwrap().nested("test").unwrap();
        let inner = FolderClaim::take(&within).unwrap().start(false).unwrap();
        inner.folder().save_bytes("a", b"1").unwrap();
        drop((inner, outer));
        std::fs::write(within.with_file_name(".test.lock"), "process 1 on elsewhere\n").unwrap();
        drop(Partial::start(&path).unwrap());
        assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 0);
    }

    /// The signal comes when the folder is complete except for its name.
    #[test]
    fn an_interruption_waits_until_a_complete_folder_has_its_name() {
        use crate::interrupt::{clean_up, places};
        let place = tempfile::tempdir().unwrap();
        for name in ["set", "set", "other"] {
            let path = place.path().join(name);
            let partial = Partial::start(&path).unwrap();
            partial.folder().save_bytes("a", b"1").unwrap();
            partial.folder().save_bytes("b", b"2").unwrap();
            let (begin, begins) = std::sync::mpsc::channel();
            let handler = std::thread::spawn({
                let within = format!("{}", place.path().display());
                move || {
                    begins.recv().unwrap();
                    let places = places();
                    // Those of other tests are none of its business.
                    let own = places.iter().filter(|place| format!("{place:?}").contains(&within));
                    clean_up(&own.cloned().collect::<Vec<_>>());
                }
            });
            let window = || {
                begin.send(()).unwrap();
                std::thread::sleep(std::time::Duration::from_millis(200));
                Ok(())
            };
            let named = partial.give_name(Earlier::new("a", true), window);
            handler.join().unwrap();
            named.unwrap();
            assert_eq!(files_below(&path).unwrap(), [JOURNAL, "a", "b"]);
            assert!(!replaced_name(&path).exists() && !partial_name(&path).exists());
        }
    }

    #[test]
    fn a_replacement_that_a_crash_cut_off_is_ended() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("set");
        let make = || {
            let partial = Partial::start(&path).unwrap();
            partial.folder().save_bytes("a", b"1").unwrap();
            partial.finish(Earlier::new("a", true)).unwrap();
        };
        make();
        // A crash between the two renames.
        std::fs::rename(&path, replaced_name(&path)).unwrap();
        drop(FolderClaim::take(&path).unwrap());
        assert!(path.join("a").is_file());
        // The same, and somebody made an empty folder of that name.
        std::fs::rename(&path, replaced_name(&path)).unwrap();
        std::fs::create_dir(&path).unwrap();
        drop(FolderClaim::take(&path).unwrap());
        assert!(path.join("a").is_file() && !replaced_name(&path).exists());
        // A crash before the old files were removed.
        std::fs::rename(&path, replaced_name(&path)).unwrap();
        std::fs::create_dir(&path).unwrap();
        std::fs::write(path.join("new"), "").unwrap();
        drop(FolderClaim::take(&path).unwrap());
        assert!(path.join("new").is_file() && !replaced_name(&path).exists());
    }

    /// A dataset that was complete except for its name and whose resumed run was also killed.
    #[test]
    fn a_dataset_killed_at_its_end_and_again_while_it_is_resumed_is_known() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("set");
        let folder = partial_name(&path);
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(folder.join("datapackage.json"), r#"{"microsig": {"generator": "microsig"}}"#)
            .unwrap();
        let sums = ["a", "datapackage.json"].map(|file| format!("{:064x}  {file}\n", 0)).concat();
        std::fs::write(folder.join("SHA256SUMS"), sums).unwrap();
        std::fs::write(folder.join("a"), "1").unwrap();
        for _ in 0..2 {
            drop(FolderClaim::take(&path).unwrap().resume().unwrap());
            assert!(folder.join(JOURNAL).is_file());
        }
        std::fs::write(folder.join("notes"), "").unwrap();
        let message = FolderClaim::take(&path).unwrap().resume().unwrap_err().to_string();
        assert!(message.contains("notes") && !message.contains("more"), "{message}");
    }
}
