//! Source files of a dataset: `scenario.ron`, `inputs/`, `settings.txt`, the secret key; and its license.

use microsig_core::formats::settings_file;

use super::secret;
use scenario::license::LICENSE;
use scenario::{self, SCENARIO, Scenario};
use storage::OutputFolder;
use storage::error::{Error, Result};

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
