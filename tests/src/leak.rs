//! Searches the public part of a test split for its (known) truth.
//!
//! The decompressed bytes of every file are searched for numbers of the truth as text (also rounded) and as
//! f32 and f64 of either byte order; keys and seeds as text and as u64; names that occur in the truth only;
//! row orders and columns that correlate with depth, track or number of particles.

use std::collections::{BTreeMap, HashSet};
use std::io::Read;
use std::path::Path;

use anyhow::{Context, ensure};

/// Files by path, decompressed.
pub type Files = BTreeMap<String, Vec<u8>>;

/// All files of a zip archive.
pub fn unzip(path: &Path) -> anyhow::Result<Files> {
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path)?)?;
    let mut files = Files::new();
    for i in 0..archive.len() {
        let mut entry = archive.by_index(i)?;
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes)?;
        files.insert(entry.name()?.to_string(), bytes);
    }
    Ok(files)
}

#[derive(Debug, Clone, Copy)]
struct Particle {
    frame: u32,
    track: f64,
    x_px: f64,
    y_px: f64,
    z_um: f64,
}

/// Secrets that the package must not reveal.
#[derive(Debug)]
pub struct Known {
    /// Numbers with enough digits not to occur by chance, sorted.
    numbers: Vec<f64>,
    particles: Vec<Particle>,
    visible: Vec<f64>,
    /// Seeds, and the key in blocks of eight bytes.
    words: Vec<u64>,
    texts: Vec<String>,
}

/// Number of digits that excludes a coincidence.
const DIGITS: usize = 7;

impl Known {
    /// Reads the withheld dataset; `seeds` are the related ones.
    pub fn of(dataset: &Path, seeds: &[u64]) -> anyhow::Result<Self> {
        let mut known = Known {
            numbers: Vec::new(),
            particles: Vec::new(),
            visible: Vec::new(),
            words: seeds.to_vec(),
            texts: Vec::new(),
        };
        for table in ["truth/tracks.csv", "truth/displacements.csv"] {
            for record in csv::Reader::from_path(dataset.join(table))?.records() {
                known.numbers.extend(
                    record?.iter().filter(|t| digits(t) >= DIGITS).filter_map(|t| t.parse::<f64>().ok()),
                );
            }
        }
        known.numbers.sort_by(f64::total_cmp);
        known.numbers.dedup();
        // A secret key may draw few particles.
        ensure!(known.numbers.len() > 5, "too little truth to look for: {}", dataset.display());
        for row in rows(&std::fs::read(dataset.join("truth/tracks.csv"))?) {
            let at = |name: &str| row.get(name).copied().context("a column of the truth");
            let frame = at("frame")? as u32;
            let (track, x_px, y_px, z_um) = (at("track")?, at("x_px")?, at("y_px")?, at("z_um")?);
            known.particles.push(Particle { frame, track, x_px, y_px, z_um });
        }
        for row in rows(&std::fs::read(dataset.join("truth/frames.csv"))?) {
            known.visible.push(row["n_visible"]);
        }
        if let Ok(key) = std::fs::read_to_string(dataset.join("secret_key.txt")) {
            let key = key.trim().to_owned();
            for piece in key.as_bytes().chunks(16) {
                known.words.push(u64::from_str_radix(std::str::from_utf8(piece)?, 16)?);
                known.texts.push(String::from_utf8(piece.to_vec())?);
            }
        }
        known.texts.extend(seeds.iter().flat_map(|seed| [seed.to_string(), format!("{seed:016x}")]));
        Ok(known)
    }

    /// All secrets found in the files.
    pub fn told_by(&self, files: &Files) -> Vec<String> {
        let mut found = Vec::new();
        for (path, bytes) in files {
            let mut say = |what: String| found.push(format!("{path}: {what}"));
            names(path, bytes).into_iter().for_each(&mut say);
            self.as_text(bytes).into_iter().for_each(&mut say);
            self.as_binary(bytes).into_iter().for_each(&mut say);
            if path.ends_with(".csv") {
                self.by_order(bytes).into_iter().for_each(&mut say);
            }
        }
        let mut sizes: Vec<usize> = files
            .iter()
            .filter(|(p, _)| p.contains("/images/") && !p.contains("calibration"))
            .map(|(_, b)| b.len())
            .collect();
        sizes.dedup();
        if sizes.len() > 1 {
            found.push("images differ in size".to_owned());
        }
        found
    }

    fn as_text(&self, bytes: &[u8]) -> Vec<String> {
        let text = String::from_utf8_lossy(bytes);
        let mut found: Vec<String> = self
            .texts
            .iter()
            .filter(|t| t.len() >= DIGITS && text.contains(*t))
            .map(|t| format!("{t} as text"))
            .collect();
        let part = |c: char| c.is_ascii_alphanumeric() || ".+-".contains(c);
        for token in text.split(|c| !part(c)).filter(|t| digits(t) >= DIGITS) {
            let Ok(value) = token.parse::<f64>() else { continue };
            let decimals =
                token.split_once('.').map_or(0, |(_, d)| d.bytes().take_while(u8::is_ascii_digit).count());
            // Half a unit of the last digit: finds rounded numbers too.
            let near = 0.5000001 * 10f64.powi(-(decimals as i32));
            let next = self.numbers.partition_point(|n| *n < value - near);
            if self.numbers.get(next).is_some_and(|n| *n <= value + near) {
                found.push(format!("{token} as text"));
            }
        }
        found
    }

    fn as_binary(&self, bytes: &[u8]) -> Vec<String> {
        let both = |w: u64| [w, w.swap_bytes()];
        let words: HashSet<u64> =
            self.words.iter().filter(|w| **w > 1 << 32).flat_map(|w| both(*w)).collect();
        let doubles: HashSet<u64> = self.numbers.iter().flat_map(|n| both(n.to_bits())).collect();
        let singles = |factor: f64| -> HashSet<u32> {
            let bits = self.numbers.iter().map(|n| ((n * factor) as f32).to_bits());
            bits.flat_map(|w| [w, w.swap_bytes()]).collect()
        };
        // Four bytes may match by chance, so the number of matches is compared with the matches of unrelated
        // numbers.
        let (true_singles, others) = (singles(1.0), singles(1.000_123));
        let mut hits = [0usize; 4];
        for window in bytes.windows(8) {
            let word = u64::from_le_bytes(window.try_into().unwrap_or_default());
            hits[0] += usize::from(words.contains(&word));
            hits[1] += usize::from(doubles.contains(&word));
        }
        for window in bytes.windows(4) {
            let word = u32::from_le_bytes(window.try_into().unwrap_or_default());
            hits[2] += usize::from(true_singles.contains(&word));
            hits[3] += usize::from(others.contains(&word));
        }
        let mut found = Vec::new();
        if hits[0] > 0 {
            found.push(format!("{} seeds or parts of the key as u64", hits[0]));
        }
        if hits[1] > 0 {
            found.push(format!("{} numbers of the truth as f64", hits[1]));
        }
        if hits[2] > 3 * hits[3] + 5 {
            found.push(format!("{} numbers of the truth as f32, {} of others", hits[2], hits[3]));
        }
        found
    }

    /// Rows in the order of depth or track; columns that correlate with the number of particles in a frame.
    fn by_order(&self, bytes: &[u8]) -> Vec<String> {
        let mut found = Vec::new();
        let table = rows(bytes);
        let matched: Vec<Particle> = table
            .iter()
            .filter_map(|row| {
                let (frame, x, y) = (*row.get("frame")? as u32, *row.get("x_px")?, *row.get("y_px")?);
                // Positions may be rounded or slightly off.
                let is_it =
                    |p: &&Particle| p.frame == frame && (p.x_px - x).abs() < 0.5 && (p.y_px - y).abs() < 0.5;
                self.particles.iter().find(is_it).copied()
            })
            .collect();
        let order: Vec<f64> = (0..matched.len()).map(|i| i as f64).collect();
        for (what, values) in [
            ("depth", matched.iter().map(|p| p.z_um).collect::<Vec<f64>>()),
            ("track", matched.iter().map(|p| p.track).collect()),
        ] {
            let rho = spearman(&order, &values);
            if is_no_chance(rho, matched.len()) {
                found.push(format!("rows in the order of {what}, rank correlation {rho:.2}"));
            }
        }
        if table.len() == self.visible.len() && table.len() >= 8 {
            for name in table[0].keys() {
                let column: Vec<f64> = table.iter().filter_map(|row| row.get(name).copied()).collect();
                // Frame numbers and times increase in any case.
                let grows = column.windows(2).all(|w| w[0] < w[1]);
                if column.len() == table.len()
                    && !grows
                    && is_no_chance(spearman(&column, &self.visible), column.len())
                {
                    found.push(format!("column {name} goes with the number of particles"));
                }
            }
        }
        found
    }
}

/// Names that occur in the truth only.
fn names(path: &str, bytes: &[u8]) -> Vec<String> {
    let mut found = Vec::new();
    let secret = ["truth/", "scenario", "secret", "salt", "preview", "inputs/"].into_iter();
    found.extend(secret.filter(|s| path.contains(s)).map(|s| format!("{s} in the name of a file")));
    // The calibration stack's particle is public.
    if path.contains("particles/") && !path.contains("calibration/") {
        found.push("a data file".to_owned());
    }
    let text = String::from_utf8_lossy(bytes);
    let header: Vec<&str> = text.lines().next().unwrap_or_default().split(',').collect();
    let told = [
        "seed",
        "n_p",
        "n_ppp",
        "n_s",
        "n_visible",
        "n_rendered",
        "max_displacement_px",
        "snr",
        "energy",
        "motion",
    ];
    found.extend(told.into_iter().filter_map(|name| {
        let is_key = path.ends_with(".json") && text.contains(&format!("\"{name}\":"));
        let is_column = path.ends_with(".csv") && header.contains(&name);
        (is_key || is_column).then(|| format!("`{name}`"))
    }));
    found
}

fn digits(token: &str) -> usize {
    let mantissa = token.split(['e', 'E']).next().unwrap_or_default();
    let all: String = mantissa.chars().filter(char::is_ascii_digit).collect();
    all.trim_start_matches('0').len()
}

/// The rows of a table: numbers by column name.
fn rows(bytes: &[u8]) -> Vec<BTreeMap<String, f64>> {
    let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(bytes);
    let header: Vec<String> =
        reader.headers().map(|h| h.iter().map(str::to_owned).collect()).unwrap_or_default();
    let numbers = |record: csv::StringRecord| {
        header.iter().zip(record.iter()).filter_map(|(n, t)| Some((n.clone(), t.parse().ok()?))).collect()
    };
    reader.records().filter_map(Result::ok).map(numbers).collect()
}

/// Spearman's rank correlation; ties share their mean rank, 0 without variation.
fn spearman(a: &[f64], b: &[f64]) -> f64 {
    let ranks = |values: &[f64]| -> Vec<f64> {
        let rank = |v: &f64| {
            let below = values.iter().filter(|w| w < &v).count();
            let equal = values.iter().filter(|w| w == &v).count();
            below as f64 + 0.5 * (equal as f64 - 1.0)
        };
        values.iter().map(rank).collect()
    };
    let (a, b) = (ranks(a), ranks(b));
    let mean = (a.len() as f64 - 1.0) / 2.0;
    let sum = |f: &dyn Fn(f64, f64) -> f64| a.iter().zip(&b).map(|(x, y)| f(x - mean, y - mean)).sum::<f64>();
    let (ab, aa, bb) = (sum(&|x, y| x * y), sum(&|x, _| x * x), sum(&|_, y| y * y));
    if aa * bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

/// Whether a rank correlation differs from zero by four standard errors (Fisher's transformation; Fieller et
/// al. 1957).
fn is_no_chance(rho: f64, n: usize) -> bool {
    n >= 8 && rho.clamp(-1.0, 1.0).abs().atanh() * ((n as f64 - 3.0) / 1.06).sqrt() > 4.0
}
