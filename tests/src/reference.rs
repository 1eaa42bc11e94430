//! Comparison of images with the original program's, one row of `summary.csv` at a time.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use microsig_core::emission::SpheroidLaw;
use microsig_core::{Particle, Settings};

use crate::ensemble::Ensemble;
use crate::measure::Measures;
use crate::npy;

/// One image of the original program.
#[derive(Debug, Clone)]
pub struct Case {
    /// Folder.
    pub case: String,
    /// Name within the folder.
    pub name: String,
    /// Number of images averaged.
    pub images: u32,
    /// Measures of the mean image.
    pub mean_measures: Measures,
    /// Their standard errors.
    pub standard_errors: Measures,
    /// Fano factor: variance over mean of its pixels.
    pub fano: f64,
    folder: PathBuf,
}

/// A quantity of our image and of the original's.
#[derive(Debug, Clone)]
pub struct Check {
    /// What is compared.
    pub quantity: &'static str,
    /// Our value.
    pub ours: f64,
    /// The original's value.
    pub theirs: f64,
    /// Largest difference allowed.
    pub allowed: f64,
}

impl Check {
    /// The difference in units of the tolerance; at most 1 if the check passes.
    pub fn used(&self) -> f64 {
        (self.ours - self.theirs).abs() / self.allowed
    }
}

/// All rows of `summary.csv` in a folder.
pub fn cases(folder: &Path) -> anyhow::Result<Vec<Case>> {
    let path = folder.join("summary.csv");
    let mut reader = csv::Reader::from_path(&path).with_context(|| path.display().to_string())?;
    let mut cases = Vec::new();
    for row in reader.deserialize() {
        let row: HashMap<String, String> = row?;
        let text = |key: &str| row.get(key).with_context(|| format!("{}: no column {key}", path.display()));
        let number = |key: &str| -> anyhow::Result<f64> { Ok(text(key)?.parse()?) };
        let measures = |suffix: &str| -> anyhow::Result<Measures> {
            let mut values = [0.0; 8];
            for (value, name) in values.iter_mut().zip(Measures::NAMES) {
                *value = number(&format!("{name}{suffix}"))?;
            }
            Ok(Measures::from_values(values))
        };
        cases.push(Case {
            images: number("K")? as u32,
            mean_measures: measures("")?,
            standard_errors: measures("_se")?,
            fano: number("fano")?,
            folder: folder.join(text("case")?),
            case: text("case")?.clone(),
            name: text("name")?.clone(),
        });
    }
    Ok(cases)
}

impl Case {
    /// The settings of the image.
    pub fn settings(&self) -> anyhow::Result<Settings> {
        crate::settings(&self.folder.join("settings.txt"))
    }

    /// The particles in the image.
    pub fn particles(&self) -> anyhow::Result<Vec<Particle>> {
        crate::particles(&self.folder.join(format!("{}.txt", self.name)))
    }

    /// The original's mean image, counts, where it is stored (as `_mean.npy`, or as the sum `_sum.npy` of its
    /// images).
    pub fn mean_image(&self) -> anyhow::Result<Option<Vec<f64>>> {
        let file = |suffix: &str| self.folder.join(format!("{}{suffix}", self.name));
        if file("_mean.npy").exists() {
            return Ok(Some(npy::read(&file("_mean.npy"))?.values));
        }
        if file("_sum.npy").exists() {
            let sum = npy::read(&file("_sum.npy"))?.values;
            return Ok(Some(sum.iter().map(|v| v / f64::from(self.images)).collect()));
        }
        Ok(None)
    }

    /// Renders images of the case. Random numbers differ between rows, so that rows fail independently.
    pub fn draw(&self, images: u32) -> anyhow::Result<Ensemble> {
        let label = format!("{}/{}", self.case, self.name);
        let seed = label.bytes().fold(1u64, |seed, byte| seed.wrapping_mul(1_000_003) ^ u64::from(byte));
        Ensemble::draw(&self.settings()?, &self.particles()?, SpheroidLaw::Original, seed, images)
    }

    /// Compares the scalar measures.
    ///
    /// Tolerances: total 0.5 %; centroid 0.01 px; second moments 1 % (the mixed one, which vanishes for round
    /// images, 1 % of the root of the product of the other two); radii 1 % or 0.08 px, whichever is more;
    /// each plus 3 combined standard errors. Variance over mean: 0.1; its own statistical error is 0.01 to
    /// 0.04 (few bright pixels, 20 images).
    pub fn check_measures(&self, ours: &Ensemble) -> Vec<Check> {
        let t = &self.mean_measures;
        let bars = [
            0.005 * t.total,
            0.01,
            0.01,
            0.01 * t.mxx,
            0.01 * t.myy,
            0.01 * (t.mxx * t.myy).sqrt(),
            (0.01 * t.r50).max(0.08),
            (0.01 * t.r90).max(0.08),
        ];
        let mut checks: Vec<Check> = (0..8)
            .map(|i| {
                let combined = self.standard_errors.values()[i].hypot(ours.standard_errors.values()[i]);
                Check {
                    quantity: Measures::NAMES[i],
                    ours: ours.mean_measures.values()[i],
                    theirs: t.values()[i],
                    allowed: bars[i] + 3.0 * combined,
                }
            })
            .collect();
        checks.push(Check { quantity: "fano", ours: ours.fano(), theirs: self.fano, allowed: 0.1 });
        checks
    }

    /// Compares the mean images.
    ///
    /// `rms`: root mean square difference over the lit pixels beyond the statistical error of both means; at
    /// most 0.5 % of the peak, plus 3 standard errors of the mean square (which is uncertain if there are few
    /// bright pixels). `chi2`: mean squared difference in units of the variance, 1 for equal distributions.
    /// The variance is modeled with a single Fano factor for all pixels of an image, while the factor of dim pixels
    /// is 1: chi2 may therefore be up to 1/fano (times c_int, which scales both) plus 4 standard deviations
    /// of chi-square.
    pub fn check_image(&self, ours: &Ensemble, theirs: &[f64]) -> anyhow::Result<Vec<Check>> {
        let comparison = self.compare(ours, theirs);
        let peak = theirs.iter().copied().fold(0.0, f64::max);
        let c_int = self.particles()?.iter().map(|p| p.c_int).fold(0.0, f64::max);
        let n = comparison.degrees_of_freedom;
        Ok(vec![
            Check {
                quantity: "rms",
                ours: comparison.excess.max(0.0).sqrt(),
                theirs: 0.0,
                allowed: ((0.005 * peak).powi(2) + 3.0 * comparison.excess_error).sqrt(),
            },
            Check {
                quantity: "chi2",
                ours: comparison.chi2 / n,
                theirs: 1.0,
                allowed: (c_int / self.fano - 1.0).abs() + 4.0 * (2.0 / n).sqrt(),
            },
        ])
    }

    fn compare(&self, ours: &Ensemble, theirs: &[f64]) -> Comparison {
        let (mut squares, mut expected, mut expected_squares, mut lit) = (0.0, 0.0, 0.0, 0.0);
        let (mut chi2, mut degrees_of_freedom) = (0.0, 0.0);
        // Pixels with few counts are not normally distributed: neighbors in a row are pooled until they have
        // 10 counts in all images.
        let (mut pooled_difference, mut pooled_mean) = (0.0, 0.0);
        let images = f64::from(ours.images + self.images);
        for (&a, &b) in ours.mean.iter().zip(theirs) {
            if a == 0.0 && b == 0.0 {
                continue;
            }
            let mean = self.pooled_mean(ours, a, b);
            squares += (a - b) * (a - b);
            expected += self.spread(ours, mean);
            expected_squares += self.spread(ours, mean).powi(2);
            lit += 1.0;
            pooled_difference += a - b;
            pooled_mean += mean;
            if pooled_mean * images >= 10.0 {
                chi2 += pooled_difference * pooled_difference / self.spread(ours, pooled_mean);
                degrees_of_freedom += 1.0;
                (pooled_difference, pooled_mean) = (0.0, 0.0);
            }
        }
        Comparison {
            excess: (squares - expected) / lit,
            excess_error: (2.0 * expected_squares).sqrt() / lit,
            chi2,
            degrees_of_freedom,
        }
    }

    /// The best estimate of a pixel's expectation, assumed equal for both.
    fn pooled_mean(&self, ours: &Ensemble, a: f64, b: f64) -> f64 {
        let (n, k) = (f64::from(ours.images), f64::from(self.images));
        (n * a + k * b) / (n + k)
    }

    /// Variance of the difference of the two means; the variance of a pixel is the original's Fano factor
    /// times its expectation.
    fn spread(&self, ours: &Ensemble, mean: f64) -> f64 {
        self.fano * mean * (1.0 / f64::from(ours.images) + 1.0 / f64::from(self.images))
    }
}

struct Comparison {
    /// Mean square difference beyond the statistical error, counts^2.
    excess: f64,
    /// Its standard error.
    excess_error: f64,
    chi2: f64,
    degrees_of_freedom: f64,
}
