//! The licences that a scenario can choose for its dataset, by their SPDX identifiers.

/// A licence of data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct License {
    /// SPDX identifier.
    pub id: &'static str,
    /// Its full name.
    pub title: &'static str,
    /// Where its summary and its text are.
    pub url: &'static str,
}

/// Name of the file.
pub const LICENSE: &str = "LICENSE";

/// All of them; the first is the default.
pub const LICENSES: [License; 4] = [
    License {
        id: "CC-BY-4.0",
        title: "Creative Commons Attribution 4.0 International",
        url: "https://creativecommons.org/licenses/by/4.0/",
    },
    License {
        id: "CC-BY-SA-4.0",
        title: "Creative Commons Attribution-ShareAlike 4.0 International",
        url: "https://creativecommons.org/licenses/by-sa/4.0/",
    },
    License {
        id: "CC-BY-NC-4.0",
        title: "Creative Commons Attribution-NonCommercial 4.0 International",
        url: "https://creativecommons.org/licenses/by-nc/4.0/",
    },
    License {
        id: "CC0-1.0",
        title: "Creative Commons Zero 1.0 Universal",
        url: "https://creativecommons.org/publicdomain/zero/1.0/",
    },
];

impl License {
    /// The licence of that identifier.
    pub fn find(id: &str) -> Option<Self> {
        LICENSES.into_iter().find(|license| license.id == id)
    }

    /// The file `LICENSE` of something.
    pub fn text(&self, what: &str) -> String {
        let License { id, title, url } = self;
        let terms = match *id {
            "CC0-1.0" => {
                format!("To the extent possible under law, all rights in {what} are waived under {title}.")
            }
            _ => format!("{what} is licensed under {title}."),
        };
        format!("SPDX-License-Identifier: {id}\n\n{terms}\nThe text of the licence: {url}legalcode\n")
    }
}
