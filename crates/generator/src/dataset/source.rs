//! Source files of a dataset: `scenario.ron`, `inputs/`, `settings.txt`, the secret key; its license; and copies of whole datasets.

use std::path::Path;

use microsig_core::formats::settings_file;

use scenario::license::LICENSE;
use scenario::{self, SCENARIO, Scenario};
use storage::checksums::{self, SHA256SUMS};
use storage::dataset::manifest::MANIFEST;
use storage::dataset::secret;
use storage::folder::{Earlier, Partial, check_replaceable};
use storage::{Error, OutputFolder, Result, read_text};

/// Writes these files into a dataset's folder.
pub fn write(folder: &OutputFolder, scenario: &Scenario) -> Result<()> {
    folder.save_bytes(SCENARIO, scenario::write(&scenario.spec)?)?;
    if let Some(key) = scenario.streams.key() {
        folder.save_private(secret::KEY_FILE, secret::text(&key).as_bytes())?;
    }
    for input in &scenario.inputs {
        if let Some((within, _)) = input.path.rsplit_once('/') {
            folder.subfolder(within)?;
        }
        folder.save_bytes(&input.path, &input.bytes)?;
    }
    let mut settings = Vec::new();
    settings_file::write(&mut settings, &scenario.settings).map_err(Error::write(folder.path()))?;
    folder.save_bytes("settings.txt", &settings)?;
    let license = scenario.license.text(&format!("The dataset {}", scenario.spec.name));
    folder.save_bytes(LICENSE, license)
}

/// Copies the files listed in a dataset's checksums into a new folder, which is written atomically. Errors: a
/// folder that is not a dataset; an existing folder at `out`, unless `force`; reading; writing.
pub fn copy(dataset: &Path, out: &Path, force: bool) -> Result<()> {
    let earlier = Earlier::new(MANIFEST, force);
    let sums = read_text(&dataset.join(SHA256SUMS))?;
    check_replaceable(out, earlier)?;
    let partial = Partial::start(out)?;
    let files = checksums::read(&sums, SHA256SUMS)?;
    for file in files.keys().map(String::as_str).chain([SHA256SUMS]) {
        if let Some((within, _)) = file.rsplit_once('/') {
            partial.folder().subfolder(within)?;
        }
        partial.folder().place(file, &dataset.join(file), false)?;
    }
    partial.finish_without_journal(earlier)
}
