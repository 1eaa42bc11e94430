//! Files that are there whole or not at all.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::error::{Error, Result};

/// What names of unfinished files begin with: a later run recognises by it what an interrupted one left behind.
pub(crate) const TEMPORARY: &str = ".unfinished-";

/// Bytes that are written at a time.
const BUFFER: usize = 1 << 16;

/// Writes a file so that it is there whole or not at all.
pub(crate) fn save(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> Result<()>) -> Result<()> {
    replace(path, |file| {
        let mut writer = BufWriter::with_capacity(BUFFER, file);
        write(&mut writer)?;
        writer.flush().map_err(Error::write(path))
    })
}

/// [`save`] for what is in memory already.
pub(crate) fn save_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    replace(path, |mut file| file.write_all(bytes).map_err(Error::write(path)))
}

fn replace(path: &Path, write: impl FnOnce(&File) -> Result<()>) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let file = tempfile::Builder::new()
        .prefix(TEMPORARY)
        .tempfile_in(folder)
        .map_err(|e| Error::write(path)(bare(e)))?;
    write(file.as_file())?;
    make_readable(file.as_file()).map_err(Error::write(path))?;
    file.persist(path).map_err(|e| Error::Write { path: path.to_owned(), source: e.error })?;
    Ok(())
}

/// The system's error in one of `tempfile`, whose text names a file that the user does not know.
fn bare(error: std::io::Error) -> std::io::Error {
    let inner = error.get_ref().and_then(|e| e.source()).and_then(|e| e.downcast_ref::<std::io::Error>());
    match inner.and_then(std::io::Error::raw_os_error) {
        Some(code) => std::io::Error::from_raw_os_error(code),
        None => error,
    }
}

/// Temporary files are made for their owner alone; results are for everybody, as if made by `File::create`.
#[cfg(unix)]
fn make_readable(file: &File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn make_readable(_: &File) -> std::io::Result<()> {
    Ok(())
}
