//! Registry of the velocity fields: name, formula, parameters, source, and an instance of each in the default
//! scene.
//!
//! The list shown to users and the conformance tests use the same table, so that every listed field is
//! tested. The default scene is a channel 100 um deep (z from -80 to 20 um) imaged at 0.645 um per px with 5
//! ms between frames: 1290 um/s is 10 px per frame.

pub use crate::entry::{DepthRange, FieldConstructor, FieldEntry, FieldParameters, PlotPlane};
use crate::fields::{self, composition, gridded};

/// The field with this name in scenarios.
pub fn find(name: &str) -> Option<&'static FieldEntry> {
    ENTRIES.iter().find(|entry| entry.name == name)
}

macro_rules! entries {
    ($($field:ident($parameters:ident),)*) => {
        /// All fields: those with a formula of their own, the gridded field, then the compositions.
        pub const ENTRIES: &[FieldEntry] = &[
            $(<fields::$parameters as FieldParameters>::ENTRY,)*
            gridded::ENTRY,
            composition::SUM,
            composition::SCALED,
            composition::TRANSLATED,
            composition::ROTATED,
            composition::MOVING,
            composition::MODULATED,
            composition::MIRRORED,
        ];
    };
}
crate::for_each_field!(entries);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_everything_is_said() {
        for (i, entry) in ENTRIES.iter().enumerate() {
            assert!(ENTRIES[i + 1..].iter().all(|other| other.name != entry.name), "{}", entry.name);
            assert!(!entry.formula.is_empty() && !entry.source.is_empty(), "{}", entry.name);
            for parameter in entry.parameters {
                let said = [parameter.meaning(), &parameter.allowed(), parameter.default];
                assert!(said.iter().all(|text| !text.is_empty()), "{} {parameter:?}", entry.name);
                assert_ne!(parameter.default, "None", "{} {parameter:?}", entry.name);
            }
        }
        assert!(find("lamb_oseen").is_some() && find("lamb").is_none());
    }
}
