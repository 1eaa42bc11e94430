//! Parameters of fields: structs declared together with their defaults, ranges and descriptions.

/// Description of a parameter, as shown to users.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parameter {
    /// Name, with the unit as suffix (no suffix: dimensionless).
    pub name: &'static str,
    /// Default as a Rust expression; see [`Parameter::default_text`].
    pub default: &'static str,
    /// Allowed range in words.
    pub range: &'static str,
    meaning: &'static str,
}

impl Parameter {
    pub(crate) const fn new(
        name: &'static str,
        default: &'static str,
        range: &'static str,
        meaning: &'static str,
    ) -> Self {
        Parameter { name, default, range, meaning }
    }

    /// Meaning in one line.
    pub fn meaning(&self) -> &'static str {
        self.meaning.trim()
    }

    /// The default in scenario syntax: enum variants in snake_case, vectors in parentheses; "by depth range"
    /// for a default that is derived from the depth range of the scenario.
    pub fn default_text(&self) -> String {
        let choice = |text: &str| {
            let name = text.rsplit("::").next().unwrap_or(text).trim();
            let mut snake = String::new();
            for (i, letter) in name.chars().enumerate() {
                if letter.is_uppercase() && i > 0 {
                    snake.push('_');
                }
                snake.extend(letter.to_lowercase());
            }
            snake
        };
        if self.default == "None" {
            "by depth range".to_owned()
        } else if self.default.contains("::") {
            choice(self.default)
        } else {
            self.default.replace('[', "(").replace(']', ")")
        }
    }
}

/// The default in documents: `otherwise` if there is one.
pub(crate) const fn default_of(default: &'static str, otherwise: &[&'static str]) -> &'static str {
    match otherwise {
        [first, ..] => first,
        [] => default,
    }
}

/// Declares the parameters of a field: a struct of public fields, its `Default`, and the table `PARAMETERS`
/// of the same names, defaults, ranges and meanings. `#[alias = "..."]` names the key used by older
/// scenarios, which is still accepted; `#[otherwise = "..."]` says what an optional parameter without a
/// default by the depth range is unless it is given, and leaves it out of resolved scenarios then.
macro_rules! params {
    (
        $(#[$attribute:meta])*
        $name:ident {
            $(
                #[doc = $meaning:literal]
                $(#[alias = $alias:literal])?
                $(#[otherwise = $otherwise:literal])?
                $field:ident: $type:ty = $default:expr, $range:literal;
            )*
        }
    ) => {
        $(#[$attribute])*
        #[derive(Debug, Clone, PartialEq)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
        #[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
        pub struct $name {
            $(
                #[doc = $meaning]
                ///
                #[doc = concat!("Default `", stringify!($default), "`; ", $range, ".")]
                $(#[cfg_attr(feature = "serde", serde(alias = $alias))])?
                $(
                    #[doc = concat!("Unless given ", $otherwise, ".")]
                    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
                )?
                #[cfg_attr(feature = "schema", schemars(description = $meaning, extend("x-range" = $range)))]
                $(#[cfg_attr(feature = "schema", schemars(extend("x-formerly" = [$alias])))])?
                pub $field: $type,
            )*
        }

        impl Default for $name {
            fn default() -> Self {
                $name { $($field: $default),* }
            }
        }

        impl $name {
            /// Names, defaults, ranges and meanings.
            pub const PARAMETERS: &'static [crate::params::Parameter] = &[
                $(crate::params::Parameter::new(
                    stringify!($field),
                    crate::params::default_of(stringify!($default), &[$($otherwise)?]),
                    $range,
                    $meaning,
                )),*
            ];
        }
    };
}
pub(crate) use params;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_read_as_in_a_scenario() {
        let text = |default| Parameter::new("p", default, "", "").default_text();
        assert_eq!(text("[-80.0, 20.0]"), "(-80.0, 20.0)");
        assert_eq!(text("Geometry::HeleShaw"), "hele_shaw");
        assert_eq!(text("1290.0"), "1290.0");
        assert_eq!(text("None"), "by depth range");
    }
}
