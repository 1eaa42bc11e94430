//! Ranges of numbers, as data: they are checked, exported to schemas, and put into words only for a reader.

use std::fmt;
use std::ops::Bound;

/// The finite numbers between two bounds.
///
/// `Display` gives it in words: `> 0`, `1 to 32768`, `> 0 and <= 1e6`, `finite`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// The lower bound.
    pub low: Bound<f64>,
    /// The upper bound.
    pub high: Bound<f64>,
}

impl Interval {
    /// All finite numbers.
    pub const FINITE: Interval = Interval { low: Bound::Unbounded, high: Bound::Unbounded };

    /// Numbers > `low`.
    pub const fn above(low: f64) -> Self {
        Interval { low: Bound::Excluded(low), ..Interval::FINITE }
    }

    /// Numbers >= `low`.
    pub const fn at_least(low: f64) -> Self {
        Interval { low: Bound::Included(low), ..Interval::FINITE }
    }

    /// The numbers that are <= `high`.
    #[must_use]
    pub const fn up_to(self, high: f64) -> Self {
        Interval { high: Bound::Included(high), ..self }
    }

    /// Whether it contains a number; infinities and NaN are in no interval.
    pub fn contains(&self, x: f64) -> bool {
        use std::ops::RangeBounds;
        x.is_finite() && (self.low, self.high).contains(&x)
    }

    /// The bounds as keywords of JSON Schema.
    pub fn keywords(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let keyword = |bound, included, excluded| match bound {
            Bound::Included(x) => Some((included, x)),
            Bound::Excluded(x) => Some((excluded, x)),
            Bound::Unbounded => None,
        };
        let low = keyword(self.low, "minimum", "exclusiveMinimum");
        low.into_iter().chain(keyword(self.high, "maximum", "exclusiveMaximum"))
    }
}

impl fmt::Display for Interval {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let low = match self.low {
            Bound::Included(x) => format!(">= {}", short(x)),
            Bound::Excluded(x) => format!("> {}", short(x)),
            Bound::Unbounded => String::new(),
        };
        let high = match self.high {
            Bound::Included(x) => format!("<= {}", short(x)),
            Bound::Excluded(x) => format!("< {}", short(x)),
            Bound::Unbounded => String::new(),
        };
        match (self.low, self.high) {
            (Bound::Unbounded, Bound::Unbounded) => write!(f, "finite"),
            (Bound::Included(low), Bound::Included(high)) => write!(f, "{} to {}", short(low), short(high)),
            (_, Bound::Unbounded) => write!(f, "{low}"),
            (Bound::Unbounded, _) => write!(f, "{high}"),
            _ => write!(f, "{low} and {high}"),
        }
    }
}

/// A number as text, in scientific notation if it is small or if that is clearly shorter: 0.01, 32768, 1e6.
pub fn short(x: f64) -> String {
    let (plain, scientific) = (format!("{x}"), format!("{x:e}"));
    if x.abs() >= 1e-4 && plain.len() < scientific.len() + 3 || x == 0.0 { plain } else { scientific }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_is_checked_exported_and_put_into_words() {
        let finite = Interval::FINITE;
        for (interval, words, keywords, inside, outside) in [
            (finite, "finite", vec![], vec![-1e300, 0.0], vec![f64::INFINITY, f64::NAN]),
            (
                Interval::above(0.0),
                "> 0",
                vec![("exclusiveMinimum", 0.0)],
                vec![1e-300, 1e300],
                vec![0.0, f64::INFINITY],
            ),
            (Interval::at_least(1.0), ">= 1", vec![("minimum", 1.0)], vec![1.0], vec![0.999]),
            (
                Interval::above(0.0).up_to(1e6),
                "> 0 and <= 1e6",
                vec![("exclusiveMinimum", 0.0), ("maximum", 1e6)],
                vec![1e6],
                vec![0.0, 1_000_001.0],
            ),
            (
                Interval::at_least(0.01).up_to(32768.0),
                "0.01 to 32768",
                vec![("minimum", 0.01), ("maximum", 32768.0)],
                vec![0.01, 32768.0],
                vec![0.0],
            ),
            (finite.up_to(2.5), "<= 2.5", vec![("maximum", 2.5)], vec![-1.0], vec![2.6]),
        ] {
            assert_eq!(interval.to_string(), words);
            assert_eq!(interval.keywords().collect::<Vec<_>>(), keywords);
            assert!(inside.iter().all(|&x| interval.contains(x)), "{words}");
            assert!(outside.iter().all(|&x| !interval.contains(x)), "{words}");
        }
        let open = Interval { low: Bound::Included(1e-9), high: Bound::Excluded(1.0) };
        assert_eq!((open.to_string().as_str(), open.contains(1.0)), (">= 1e-9 and < 1", false));
    }
}
