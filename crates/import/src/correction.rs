//! Correction of frames by a dark frame and a flat field:
//! ```text
//! corrected = D + (recorded - dark) F / (flat - dark)
//! ```
//! with D and F the means of `dark` and `flat - dark`, so that the background keeps its mean and noise is not
//! clipped at 0.

use std::path::{Path, PathBuf};

use fit::chosen_channel;
use storage::error::{Error, Result};

use super::ImportOptions;
use super::frames::opened;

/// The correction of a camera's pixels; nothing if neither dark frame nor flat field are given.
#[derive(Debug, Default)]
pub(crate) struct Correction {
    /// Mean count without light of each pixel; empty without a dark frame.
    dark: Vec<f32>,
    /// Factor of each pixel; empty without a flat field.
    factor: Vec<f32>,
    /// Mean of `dark`.
    level: f32,
}

/// A pixel of the flat field must have this share of the mean, or it is dead.
const LEAST_FLAT: f32 = 0.05;

impl Correction {
    /// Reads both files, each with one page or several, which are averaged.
    pub(crate) fn read(options: &ImportOptions, size: (usize, usize)) -> Result<Self> {
        let mean = |file: &PathBuf| mean(file, options.page, size);
        let dark = options.dark.as_ref().map(mean).transpose()?.unwrap_or_default();
        let level = average(&dark);
        let Some(file) = &options.flat else { return Ok(Correction { dark, factor: Vec::new(), level }) };
        let mut light = mean(file)?;
        light.iter_mut().zip(&dark).for_each(|(light, dark)| *light -= dark);
        let whole = average(&light);
        if let Some(at) = light.iter().position(|light| *light < LEAST_FLAT * whole || *light <= 0.0) {
            let (column, row) = (at % size.0 + 1, at / size.0 + 1);
            return Err(Error::input(format!(
                "{}: column {column}, row {row} has {} counts above the dark frame where the mean is {whole}: expected at \
                 least {} % of the mean in every pixel of a flat field",
                file.display(),
                light[at],
                100.0 * LEAST_FLAT
            )));
        }
        Ok(Correction { dark, factor: light.iter().map(|light| whole / light).collect(), level })
    }

    /// Whether there is anything to correct.
    pub(crate) fn is_none(&self) -> bool {
        self.dark.is_empty() && self.factor.is_empty()
    }

    /// Corrects a frame.
    pub(crate) fn apply(&self, counts: &mut [u16]) {
        if self.is_none() {
            return;
        }
        for (i, count) in counts.iter_mut().enumerate() {
            let dark = self.dark.get(i).copied().unwrap_or(0.0);
            let factor = self.factor.get(i).copied().unwrap_or(1.0);
            let light = (f32::from(*count) - dark) * factor;
            *count = (self.level + light).round().clamp(0.0, 65_535.0) as u16;
        }
    }

    /// What it does, as a clause; empty if nothing.
    pub(crate) fn clause(&self) -> &'static str {
        match (self.dark.is_empty(), self.factor.is_empty()) {
            (true, true) => "",
            (false, true) => ", corrected by a dark frame",
            (true, false) => ", corrected by a flat field",
            (false, false) => ", corrected by a dark frame and a flat field",
        }
    }
}

fn average(values: &[f32]) -> f32 {
    if values.is_empty() {
        0.0
    } else {
        (values.iter().copied().map(f64::from).sum::<f64>() / values.len() as f64) as f32
    }
}

/// The mean over all pages of a file, or of a channel if it states several.
fn mean(file: &Path, channel: Option<usize>, (width, height): (usize, usize)) -> Result<Vec<f32>> {
    let mut pages = opened(file)?;
    let mut size = pages.size()?;
    (size.width, size.height) = (width as u32, height as u32);
    while pages.go_on()? {}
    let stated = pages.arrangement(pages.page() + 1)?;
    let channel = match stated.as_ref().map_or(1, |of| of.sizes[0]) {
        1 => 0,
        _ => chosen_channel(&file.display().to_string(), stated.as_ref(), channel)?,
    };
    pages = opened(file)?;
    let mut sum = vec![0.0f64; width * height];
    let mut n = 0.0;
    loop {
        if stated.as_ref().is_none_or(|of| of.pages[pages.page()][0] == channel) {
            sum.iter_mut().zip(pages.counts(size)?).for_each(|(sum, count)| *sum += f64::from(count));
            n += 1.0;
        }
        if !pages.go_on()? {
            return Ok(sum.into_iter().map(|sum| (sum / n) as f32).collect());
        }
    }
}
