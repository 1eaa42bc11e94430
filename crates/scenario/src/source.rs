//! Where the text of a scenario or sweep comes from: a file, standard input, or the scenarios in the program.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::language::schema::nearest;
use super::shipped::{SHIPPED, Shipped, shipped, shipped_suites};
use storage::{Error, InputFile, Result, TemporaryFolder};

/// Maximum length of a scenario or sweep, bytes.
const MAX_BYTES: u64 = 16_000_000;

/// Reads the text of a scenario or sweep. Errors: a path that is not a regular file; text that is not UTF-8
/// or longer than 16 MB.
pub fn read_text(file: impl Into<InputFile>) -> Result<String> {
    let file = file.into();
    let refuse = |expected: &str| Error::input(format!("{}: expected {expected}", file.display()));
    let open = file.open()?;
    let mut bytes = Vec::new();
    open.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(|e| Error::read(&file, e))?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(refuse("at most 16 MB of text"));
    }
    let text = String::from_utf8(bytes).map_err(|_| refuse("UTF-8 text in RON or JSON"))?;
    // Some editors write a byte order mark.
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// The text of a scenario or sweep: of a file, or a shipped one.
#[derive(Debug)]
pub struct ScenarioText {
    /// The text.
    pub text: String,
    /// Its name in messages.
    pub name: String,
    /// The folder that paths in it are relative to.
    pub folder: PathBuf,
    /// The folder, if it is temporary.
    _unpacked: Option<TemporaryFolder>,
}

impl ScenarioText {
    /// Whether its folder is temporary, with all shipped files, and is removed with the text.
    pub fn is_unpacked(&self) -> bool {
        self._unpacked.is_some()
    }

    /// Reads a file or, if there is none, the shipped scenario or sweep of this name. Errors: as for
    /// [`read_text`]; a name that is not shipped.
    pub fn open(file: impl Into<InputFile>) -> Result<Self> {
        let file = file.into();
        let name = file.display().to_string();
        let is_name = file.components().count() == 1 && file.extension().is_none();
        if is_name && !file.exists() && !file.is_standard() {
            return Self::shipped(name);
        }
        let folder = file.parent().unwrap_or(Path::new(".")).to_owned();
        let text = read_text(&file).map_err(|e| match file.file_stem().and_then(|stem| stem.to_str()) {
            Some(stem) if !file.exists() && Shipped::named(stem).is_some() => {
                Error::input(format!("{e}; the shipped scenario is found by its name, `{stem}`"))
            }
            _ => e,
        })?;
        Ok(ScenarioText { text, name, folder, _unpacked: None })
    }

    fn shipped(name: String) -> Result<Self> {
        let Some(found) = Shipped::named(&name) else {
            if shipped_suites().contains(&name.as_str()) {
                return Err(Error::input(format!("{name}: is a suite; see `microsig suite list {name}`")));
            }
            let near = nearest(&name, shipped().iter().map(|known| known.name));
            let hint = near.map(|near| format!("did you mean `{near}`? ")).unwrap_or_default();
            return Err(Error::input(format!(
                "{name}: no such file, folder or shipped scenario; {hint}`microsig new --list` lists them"
            )));
        };
        let text = found.text.to_owned();
        if found.files().next().is_none() {
            return Ok(ScenarioText { text, name, folder: PathBuf::from("."), _unpacked: None });
        }
        let place = TemporaryFolder::new()?;
        SHIPPED.extract(place.path()).map_err(Error::write(place.path()))?;
        let folder = place.path().to_owned();
        Ok(ScenarioText { text, name, folder, _unpacked: Some(place) })
    }
}

#[cfg(test)]
mod tests {
    use microsig_core::render::Context;

    use super::*;

    #[test]
    fn shipped_names_are_read_with_the_files_that_they_refer_to() {
        let text = ScenarioText::open(Path::new("quickstart")).unwrap();
        assert_eq!((text.name.as_str(), text.folder.as_path()), ("quickstart", Path::new(".")));
        let folder = ScenarioText::open(Path::new("recorded_tracks")).unwrap().folder;
        assert!(!folder.exists(), "removed with the text");
        for name in ["recorded_tracks", "piv_bias"] {
            crate::load(Path::new(name), &[], None, &Context::default()).unwrap();
        }
        let sweep = ScenarioText::open(Path::new("gdpt_1_sweep")).unwrap();
        crate::parse_sweep(&sweep.text, &sweep.name, &sweep.folder, None).unwrap();
        let said = |name: &str| ScenarioText::open(Path::new(name)).unwrap_err().to_string();
        assert!(
            said("quikstart")
                .contains("quikstart: no such file, folder or shipped scenario; did you mean `quickstart`?")
        );
        assert!(said("odpc1").contains("is a suite"));
        assert!(said("./quickstart").starts_with("./quickstart: "), "a path is not a name");
        assert!(
            said("nowhere/quickstart.ron")
                .ends_with("the shipped scenario is found by its name, `quickstart`")
        );
    }
}
