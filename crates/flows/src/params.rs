//! Parameters of fields: structs declared together with their defaults, ranges and descriptions.

use crate::error::{ParameterCheck, Result};
use microsig_core::Interval;

/// Description of a parameter, as shown to users.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name, with the unit as suffix (no suffix: dimensionless).
    pub name: &'static str,
    /// Default as a Rust expression, or in words; see [`Parameter::default_text`].
    pub default: &'static str,
    /// Allowed numbers; none for a choice.
    pub range: Option<Interval>,
    /// Further requirement, or the choices; empty if there is none.
    pub condition: &'static str,
    meaning: &'static str,
}

impl Parameter {
    pub(crate) const fn new(
        name: &'static str,
        default: &'static str,
        range: Option<Interval>,
        condition: &'static str,
        meaning: &'static str,
    ) -> Self {
        Parameter { name, default, range, condition, meaning }
    }

    /// Meaning in one line.
    pub fn meaning(&self) -> &'static str {
        self.meaning.trim()
    }

    /// The allowed values in words.
    pub fn allowed(&self) -> String {
        match self.range {
            None => self.condition.to_owned(),
            Some(range) if self.condition.is_empty() => range.to_string(),
            Some(range) => format!("{range}; {}", self.condition),
        }
    }

    /// The default in scenario syntax: enum variants in snake_case, vectors in parentheses; in words, for one
    /// that depends on the depth range of the scenario or on other parameters.
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
        if self.default.contains("::") {
            choice(self.default)
        } else {
            self.default.replace('[', "(").replace(']', ")")
        }
    }
}

/// The first of `texts`; `otherwise` if there is none.
pub(crate) const fn first_of(texts: &[&'static str], otherwise: &'static str) -> &'static str {
    match texts {
        [first, ..] => first,
        [] => otherwise,
    }
}

/// The numbers of a parameter.
pub(crate) trait Numbers {
    fn numbers(&self) -> Vec<f64>;

    /// Checks that they are in `range`.
    fn check(&self, check: ParameterCheck, name: &'static str, range: Option<Interval>) -> Result<()> {
        let (numbers, range) = (self.numbers(), range.unwrap_or(Interval::FINITE));
        let Some(wrong) = numbers.iter().find(|number| !range.contains(**number)) else { return Ok(()) };
        if range == Interval::FINITE && numbers.len() > 1 {
            return Err(check.fault(name, format!("{numbers:?}"), "finite numbers"));
        }
        check.number(name, *wrong, range).map(drop)
    }
}

impl Numbers for f64 {
    fn numbers(&self) -> Vec<f64> {
        vec![*self]
    }
}

impl Numbers for u32 {
    fn numbers(&self) -> Vec<f64> {
        vec![f64::from(*self)]
    }
}

impl Numbers for u64 {
    fn numbers(&self) -> Vec<f64> {
        vec![*self as f64]
    }
}

impl<T: Numbers> Numbers for Option<T> {
    fn numbers(&self) -> Vec<f64> {
        self.iter().flat_map(T::numbers).collect()
    }
}

impl<T: Numbers, const N: usize> Numbers for [T; N] {
    fn numbers(&self) -> Vec<f64> {
        self.iter().flat_map(T::numbers).collect()
    }
}

/// Adds range and condition to the schema of a parameter.
pub(crate) fn restricted(
    range: Option<Interval>,
    condition: &'static str,
) -> impl FnMut(&mut schemars::Schema) {
    move |schema| {
        for (keyword, bound) in range.iter().flat_map(Interval::keywords) {
            schema.insert(keyword.to_owned(), bound.into());
        }
        if !condition.is_empty() {
            schema.insert("x-condition".to_owned(), condition.into());
        }
    }
}

/// The range of a parameter: `finite`, `> 0`, `>= 0`, `1 to 10`; `one of` for what is not a number.
macro_rules! range_of {
    (one of) => {
        None
    };
    (finite) => {
        Some(microsig_core::Interval::FINITE)
    };
    (> $low:literal) => {
        Some(microsig_core::Interval::above($low as f64))
    };
    (>= $low:literal) => {
        Some(microsig_core::Interval::at_least($low as f64))
    };
    ($low:literal to $high:literal) => {
        Some(microsig_core::Interval::at_least($low as f64).up_to($high as f64))
    };
}
pub(crate) use range_of;

/// Checks a parameter against its range ([`range_of`]).
macro_rules! check_range {
    ($check:expr, $name:expr, $value:expr, one of) => {};
    ($check:expr, $name:expr, $value:expr, $($range:tt)+) => {
        crate::params::Numbers::check(&$value, $check, $name, crate::params::range_of!($($range)+))?;
    };
}
pub(crate) use check_range;

/// Declares the parameters of a field and the name that it has in messages: a struct of public fields, its
/// `Default`, the check of its ranges, and the table `PARAMETERS` of the same names, defaults, ranges ([`range_of`], with a condition after a comma) and meanings.
/// `#[alias = "..."]` names the key used by older scenarios, which is still accepted; `#[otherwise = "..."]`
/// says what an optional parameter is unless it is given; it is left out of written scenarios then.
macro_rules! params {
    (
        $(#[$attribute:meta])*
        $name:ident($owner:literal) {
            $(
                #[doc = $meaning:literal]
                $(#[alias = $alias:literal])?
                $(#[otherwise = $otherwise:literal])?
                $field:ident: $type:ty = $default:expr, [$($range:tt)+] $(, $condition:literal)?;
            )*
        }
    ) => {
        $(#[$attribute])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        #[serde(default)]
        pub struct $name {
            $(
                #[doc = $meaning]
                ///
                #[doc = concat!("Default `", stringify!($default), "`; ", stringify!($($range)+), $(" ", $condition,)? ".")]
                $(#[serde(alias = $alias)])?
                $(
                    #[doc = concat!("Unless given: ", $otherwise, ".")]
                    #[schemars(extend("x-default" = $otherwise))]
                    #[serde(skip_serializing_if = "Option::is_none")]
                )?
                #[schemars(
                    description = $meaning,
                    transform = crate::params::restricted(
                        crate::params::range_of!($($range)+),
                        concat!($($condition)?),
                    ),
                )]
                $(#[schemars(extend("x-formerly" = [$alias]))])?
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
                    crate::params::first_of(&[$($otherwise)?], stringify!($default)),
                    crate::params::range_of!($($range)+),
                    concat!($($condition)?),
                    $meaning,
                )),*
            ];

            pub(crate) const CHECK: crate::error::ParameterCheck = crate::error::ParameterCheck($owner);

            /// These parameters, if all are within their ranges.
            pub(crate) fn checked(&self) -> crate::error::Result<Self> {
                $(crate::params::check_range!(Self::CHECK, stringify!($field), self.$field, $($range)+);)*
                Ok(self.clone())
            }
        }
    };
}
pub(crate) use params;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_read_as_in_a_scenario() {
        let text = |default| Parameter::new("p", default, None, "", "").default_text();
        assert_eq!(text("[-80.0, 20.0]"), "(-80.0, 20.0)");
        assert_eq!(text("Geometry::HeleShaw"), "hele_shaw");
        assert_eq!(text("1290.0"), "1290.0");
    }

    #[test]
    fn range_and_condition_are_worded_together() {
        let text = |range, condition| Parameter::new("p", "1.0", range, condition, "").allowed();
        assert_eq!(text(range_of!(> 0), ""), "> 0");
        assert_eq!(text(range_of!(1 to 100_000), "even"), "1 to 1e5; even");
        assert_eq!(text(range_of!(one of), "x, y or z"), "x, y or z");
    }
}
