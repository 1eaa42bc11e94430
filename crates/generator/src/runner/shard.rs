//! Shards of a sweep: the cases that one process runs.

use std::fmt;

use serde::{Serialize, Serializer};

use storage::{Error, Result, advice};

/// Shard `k` of `n`, counted from 1: every `n`-th case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Number of the shard, 1 to `n`.
    pub k: usize,
    /// Number of shards.
    pub n: usize,
}

impl Shard {
    /// All cases.
    pub const ALL: Shard = Shard { k: 1, n: 1 };

    /// Reads `K/N`.
    pub fn parse(text: &str) -> Result<Self> {
        text.split_once('/')
            .and_then(|(k, n)| Some(Shard { k: k.trim().parse().ok()?, n: n.trim().parse().ok()? }))
            .filter(|s| s.k >= 1 && s.k <= s.n)
            .ok_or_else(|| {
                Error::option(advice!(
                    advice::option("shard").of(text),
                    ": expected K/N with K from 1 to N, or slurm"
                ))
            })
    }

    /// The shard of a Slurm array task, from its environment variables. Errors: [`Error::Input`] outside an
    /// array, if a variable is not a number, or if they are inconsistent.
    pub fn of_slurm(variable: impl Fn(&str) -> Option<String>) -> Result<Self> {
        let Some(id) = variable("SLURM_ARRAY_TASK_ID") else {
            let what = ": SLURM_ARRAY_TASK_ID is not set, so this is not a task of an array; use ";
            return Err(Error::option(advice!(
                advice::option("shard").is("slurm"),
                what,
                advice::option("shard").of("K/N")
            )));
        };
        let number = |name: &str, text: String| {
            text.trim()
                .parse::<usize>()
                .map_err(|_| Error::input(format!("{name} = {text}: expected a whole number")))
        };
        let optional =
            |name: &str, default: usize| variable(name).map_or(Ok(default), |text| number(name, text));
        let id = number("SLURM_ARRAY_TASK_ID", id)?;
        let first = optional("SLURM_ARRAY_TASK_MIN", 0)?;
        let step = optional("SLURM_ARRAY_TASK_STEP", 1)?;
        let Some(count) = variable("SLURM_ARRAY_TASK_COUNT") else {
            let what = "SLURM_ARRAY_TASK_ID is set but SLURM_ARRAY_TASK_COUNT is not; use ";
            return Err(Error::option(advice!(what, advice::option("shard").of("K/N"))));
        };
        let n = number("SLURM_ARRAY_TASK_COUNT", count)?;
        let before = id.checked_sub(first).filter(|d| step > 0 && d % step == 0).map(|d| d / step);
        match before.filter(|before| *before < n) {
            Some(before) => Ok(Shard { k: before + 1, n }),
            None => {
                let what = format!(
                    "SLURM_ARRAY_TASK_ID = {id}: expected a task of {n} from {first} in steps of {step}; use "
                );
                Err(Error::option(advice!(what, advice::option("shard").of("K/N"))))
            }
        }
    }

    /// The shard as a suffix in messages; empty for all cases.
    pub fn in_title(&self) -> String {
        if *self == Shard::ALL { String::new() } else { format!(", shard {self}") }
    }

    /// Whether a case is in this shard.
    pub fn has(&self, index: usize) -> bool {
        index % self.n == self.k - 1
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.k, self.n)
    }
}

/// As `K/N`.
impl Serialize for Shard {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl Default for Shard {
    fn default() -> Self {
        Shard::ALL
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_is_in_exactly_one_shard() {
        for n in 1..8 {
            for index in 0..20 {
                assert_eq!((1..=n).filter(|&k| Shard { k, n }.has(index)).count(), 1);
            }
        }
        assert!(Shard::parse("0/3").is_err() && Shard::parse("4/3").is_err() && Shard::parse("x").is_err());
    }

    #[test]
    fn slurm_arrays_may_have_any_first_index_and_step() {
        let slurm = |id: &str, min: &str, count: &str, step: &str| {
            let values = [id, min, count, step].map(str::to_owned);
            Shard::of_slurm(move |name| {
                let names = ["ID", "MIN", "COUNT", "STEP"];
                names.iter().position(|n| name == format!("SLURM_ARRAY_TASK_{n}")).map(|i| values[i].clone())
            })
        };
        assert_eq!(slurm("14", "10", "4", "2").unwrap(), Shard { k: 3, n: 4 });
        assert_eq!(slurm("1", "1", "7", "1").unwrap(), Shard { k: 1, n: 7 });
        assert!(slurm("13", "10", "4", "2").is_err());
        assert!(slurm("9", "10", "4", "1").is_err());
        // Found by fuzzing.
        assert!(slurm("18446744073709551615", "0", "7", "1").is_err());
        assert!(Shard::of_slurm(|_| None).unwrap_err().to_string().contains("not a task of an array"));
    }
}
