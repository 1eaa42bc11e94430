//! Values that vary from sample to sample.

use microsig_core::stream::{Purpose, Streams};

use storage::error::{Error, Result};

/// Distribution of a value.
#[derive(Debug, Clone, PartialEq)]
pub enum Distribution {
    /// Uniform between two numbers.
    Uniform {
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
    },
    /// Log-uniform between two positive numbers.
    LogUniform {
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
    },
    /// Integers with equal probability, including both ends.
    Integers {
        /// Smallest value.
        low: i64,
        /// Largest value.
        high: i64,
    },
    /// One of several values with equal probability, each written as in a scenario.
    Choice(Vec<String>),
}

/// A drawn value, as text and as a number.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawn {
    /// As written in a scenario.
    pub text: String,
    /// The value as a number, if it is one.
    pub number: Option<f64>,
}

impl Drawn {
    fn number(number: f64) -> Self {
        // Debug format, which reads back as the same number and has a decimal point or exponent.
        Drawn { text: format!("{number:?}"), number: Some(number) }
    }

    fn integer(number: i64) -> Self {
        Drawn { text: number.to_string(), number: Some(number as f64) }
    }

    fn written(text: &str) -> Self {
        Drawn { text: text.to_owned(), number: scenario::number(text) }
    }
}

impl Distribution {
    /// Checks the bounds; `path` is the key that varies.
    pub fn check(&self, path: &str) -> Result<()> {
        let refuse = |allowed: &str| Err(Error::input(format!("vary {path}: expected {allowed}")));
        match self {
            Distribution::Uniform { low, high } if !(low <= high && low.is_finite() && high.is_finite()) => {
                refuse("two finite numbers, the lower one first")
            }
            Distribution::LogUniform { low, high } if !(*low > 0.0 && low <= high && high.is_finite()) => {
                refuse("two positive numbers, the lower one first")
            }
            Distribution::Integers { low, high } if low > high => {
                refuse("two whole numbers, the lower one first")
            }
            Distribution::Choice(values) if values.is_empty() => refuse("at least one value"),
            _ => Ok(()),
        }
    }

    /// The values at the ends of the range, or all choices: if these are valid, all values are.
    pub fn ends(&self) -> Vec<Drawn> {
        match self {
            Distribution::Uniform { low, high } | Distribution::LogUniform { low, high } => {
                vec![Drawn::number(*low), Drawn::number(*high)]
            }
            Distribution::Integers { low, high } => [low, high].map(|end| Drawn::integer(*end)).to_vec(),
            Distribution::Choice(values) => values.iter().map(|value| Drawn::written(value)).collect(),
        }
    }

    pub(super) fn count(&self) -> u64 {
        match self {
            Distribution::Uniform { .. } | Distribution::LogUniform { .. } => u64::MAX,
            Distribution::Integers { low, high } => high.abs_diff(*low).saturating_add(1),
            Distribution::Choice(values) => values.len() as u64,
        }
    }

    /// The value for a sample; it depends only on the sample's seed and the path of the key.
    pub fn draw(&self, seed: u64, path: &str) -> Drawn {
        let address = fnv(path);
        let mut stream =
            Streams::new(seed).stream(Purpose::Variation, address as u32, (address >> 32) as u32);
        let share = stream.uniform();
        let of = |n: u64| ((share * n as f64) as u64).min(n - 1);
        match self {
            Distribution::Uniform { low, high } => {
                Drawn::number((low + (high - low) * share).clamp(*low, *high))
            }
            Distribution::LogUniform { low, high } => {
                let value = low * libm::exp(share * libm::log(high / low));
                Drawn::number(value.clamp(*low, *high))
            }
            Distribution::Integers { low, high } => {
                Drawn::integer(low.wrapping_add(of(high.abs_diff(*low).saturating_add(1)) as i64))
            }
            Distribution::Choice(values) => Drawn::written(&values[of(values.len() as u64) as usize]),
        }
    }
}

/// A hash of a path that never changes between versions (FNV-1a, 64 bit).
fn fnv(path: &str) -> u64 {
    path.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_lie_within_their_bounds_and_reach_all_of_them() {
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut counts = [0; 4];
        for seed in 0..4000 {
            let number =
                |distribution: Distribution, path: &str| distribution.draw(seed, path).number.unwrap();
            let value = number(Distribution::Uniform { low: -2.0, high: 6.0 }, "a.b");
            (least, most) = (least.min(value), most.max(value));
            counts[number(Distribution::Integers { low: 3, high: 6 }, "n") as usize - 3] += 1;
            let value = number(Distribution::LogUniform { low: 0.1, high: 10.0 }, "x");
            assert!((0.1..=10.0).contains(&value));
        }
        assert!((-2.0..-1.9).contains(&least) && (5.9..=6.0).contains(&most), "{least} {most}");
        assert!(counts.iter().all(|n| (850..1150).contains(n)), "{counts:?}");
    }

    #[test]
    fn what_is_drawn_depends_on_the_path_and_reads_back() {
        let distribution = Distribution::Uniform { low: 0.0, high: 1.0 };
        assert_ne!(distribution.draw(1, "a"), distribution.draw(1, "b"));
        assert_eq!(distribution.draw(1, "a"), distribution.draw(1, "a"));
        let drawn = distribution.draw(1, "a");
        assert_eq!(drawn.text.parse::<f64>().ok(), drawn.number);
        let any = Distribution::Integers { low: i64::MIN, high: i64::MAX }.draw(1, "a").text;
        assert!(any.parse::<i64>().is_ok(), "{any}");
        assert!(Distribution::Choice(Vec::new()).check("a").is_err());
        assert!(
            Distribution::Uniform { low: 2.0, high: 1.0 }
                .check("a")
                .unwrap_err()
                .to_string()
                .contains("vary a")
        );
    }
}
