//! The licenses that a scenario can choose for its dataset, by SPDX identifier.

/// A data license.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct License {
    /// SPDX identifier.
    pub id: &'static str,
    /// Full name.
    pub title: &'static str,
    /// URL of its summary, with which the URL of its full text begins.
    pub url: &'static str,
}

/// Name of the license file in a dataset.
pub const LICENSE: &str = "LICENSE";

/// All licenses; the first is the default.
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
    /// The license with this identifier.
    pub fn find(id: &str) -> Option<Self> {
        LICENSES.into_iter().find(|license| license.id == id)
    }

    /// The text of the file `LICENSE` for `what`.
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
