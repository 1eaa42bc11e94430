//! The golden hashes of datasets, with the version that generated them.
//!
//! Each line of `golden.txt` has, for one scenario, the SHA-256 of the lines of SHA256SUMS for images, the
//! SHA-256 of the whole SHA256SUMS, and the name. The first line has the version of the program that
//! generated them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};

/// Hashes of one dataset, in hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hashes {
    /// Hash of the checksums of `images/`: changes with image bits only.
    pub images: String,
    /// Hash of all checksums: changes with any byte of the dataset, including the version in its manifest.
    pub files: String,
}

/// The stored hashes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Golden {
    /// Version of the program that generated them.
    pub version: String,
    /// Hashes by name of the scenario.
    pub datasets: BTreeMap<String, Hashes>,
}

const VERSION: &str = "# microsig ";

impl Golden {
    /// The folder with the scenarios and `golden.txt`.
    pub fn folder() -> PathBuf {
        crate::data().join("golden")
    }

    /// Reads `golden.txt`.
    pub fn read() -> anyhow::Result<Self> {
        let path = Self::folder().join("golden.txt");
        let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let mut golden = Golden::default();
        for line in text.lines() {
            if let Some(version) = line.strip_prefix(VERSION) {
                version.clone_into(&mut golden.version);
                continue;
            }
            let words: Vec<&str> = line.split_whitespace().collect();
            let [images, files, name] = words[..] else { anyhow::bail!("{}: {line}", path.display()) };
            let hashes = Hashes { images: images.to_owned(), files: files.to_owned() };
            golden.datasets.insert(name.to_owned(), hashes);
        }
        ensure!(!golden.version.is_empty(), "{}: no version", path.display());
        Ok(golden)
    }

    /// Writes `golden.txt`.
    pub fn write(&self) -> anyhow::Result<()> {
        let rows = self.datasets.iter().map(|(name, h)| format!("{} {} {name}\n", h.images, h.files));
        let text = format!("{VERSION}{}\n{}", self.version, rows.collect::<String>());
        Ok(std::fs::write(Self::folder().join("golden.txt"), text)?)
    }

    /// Names of datasets whose images differ from `now`, and of datasets that differ in other
    /// files only.
    fn changed(&self, now: &Golden) -> (Vec<String>, Vec<String>) {
        let differ = |part: fn(&Hashes) -> &String| {
            let (old, new) = (&self.datasets, &now.datasets);
            let names = old.iter().filter(|(name, h)| new.get(*name).is_some_and(|n| part(n) != part(h)));
            names.map(|(name, _)| name.clone()).collect::<Vec<_>>()
        };
        let images = differ(|h| &h.images);
        let others = differ(|h| &h.files).into_iter().filter(|name| !images.contains(name)).collect();
        (images, others)
    }

    /// The reason why these hashes may not be replaced by `now`: output of a released version must
    /// not change.
    pub fn refusal(&self, now: &Golden) -> Option<String> {
        let (images, others) = self.changed(now);
        let released = !now.version.contains('-');
        (self.version == now.version && released && !(images.is_empty() && others.is_empty())).then(|| {
            format!(
                "version {} has made other bytes before (images: {}; only other files: {}): raise the version in \
                 Cargo.toml, as X.Y.Z-dev until it is released, and say in CHANGELOG.md what changed",
                now.version,
                images.join(", "),
                others.join(", "),
            )
        })
    }
}

impl Hashes {
    /// Hashes of a dataset on disk.
    pub fn of(dataset: &Path) -> anyhow::Result<Self> {
        let path = dataset.join("SHA256SUMS");
        let sums = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let images: Vec<&str> = sums.lines().filter(|line| line.contains("  images/")).collect();
        ensure!(!images.is_empty(), "{}: no images", path.display());
        Ok(Hashes {
            images: crate::sha256_of(images.join("\n").as_bytes()),
            files: crate::sha256_of(sums.as_bytes()),
        })
    }
}
