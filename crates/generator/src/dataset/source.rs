//! Source files of a dataset: `scenario.ron`, `inputs/`, `settings.txt`, the secret key; and its license.

use std::path::Path;

use microsig_core::formats::settings_file;

use super::secret;
use scenario::license::LICENSE;
use scenario::{self, SCENARIO, Scenario};
use storage::error::{Error, Result};
use storage::{save_bytes, save_private};

/// Writes these files into a dataset's folder.
pub fn write(folder: &Path, scenario: &Scenario) -> Result<()> {
    save_bytes(&folder.join(SCENARIO), scenario::write(&scenario.spec)?.as_bytes())?;
    if let Some(key) = scenario.streams.key() {
        save_private(&folder.join(secret::KEY_FILE), secret::text(&key).as_bytes())?;
    }
    for input in &scenario.inputs {
        let path = folder.join(&input.path);
        if let Some(within) = path.parent() {
            std::fs::create_dir_all(within).map_err(Error::write(within))?;
        }
        save_bytes(&path, &input.bytes)?;
    }
    let mut settings = Vec::new();
    settings_file::write(&mut settings, &scenario.settings).map_err(Error::write(folder))?;
    save_bytes(&folder.join("settings.txt"), &settings)?;
    let license = scenario.license.text(&format!("The dataset {}", scenario.spec.name));
    save_bytes(&folder.join(LICENSE), license.as_bytes())
}
