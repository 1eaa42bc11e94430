//! Trackers on real beads: depths found in scans of beads, against the positions of the stage.
//!
//! The first bead of each microscope is the calibration, as its scan and as the model fitted to it. The
//! planes of each other bead are the frames of a recording. Beads lie at slightly different depths, so the
//! median difference of each is removed.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};
use fit::Scan;
use microsig_core::formats::tiff::{self, PixelScale};
use microsig_core::sensor::{Counts, Image};
use serde_json::Value;
use suite::process;

use super::beads::{Bead, fitted};

/// Microscopes: the bead of calibration, and the others.
const MICROSCOPES: [(&str, [&str; 3]); 2] = [
    ("astig085_0", ["astig085_1", "astig085_3", "astig085_4"]),
    ("dry095_0", ["dry095_1", "dry095_3", "dry095_4"]),
];

/// What calibrates a tracker.
#[derive(Clone, Copy, PartialEq)]
enum Calibration {
    /// The fitted model.
    Model,
    /// The scan.
    Scan,
}

/// Methods with their calibration.
const TRACKERS: [(&str, Calibration); 3] =
    [("ncc", Calibration::Model), ("mle", Calibration::Model), ("ncc", Calibration::Scan)];

/// Distance from the brightest pixel within which a found particle is the bead, px.
const NEAR_PX: f64 = 6.0;

const HEADER: [&str; 8] =
    ["bead", "method", "calibration", "planes", "found", "range_um", "sigma_z_um", "slope"];

/// Tracks all beads but those of calibration; writes `trackers.csv`.
pub(super) fn run(program: &Path, real: &Path, out: &Path) -> anyhow::Result<()> {
    let mut table = csv::Writer::from_path(out.join("trackers.csv"))?;
    table.write_record(HEADER)?;
    let place = tempfile::tempdir()?;
    for (calibration, beads) in MICROSCOPES {
        let calibration = Bead::read(&real.join(calibration))?;
        let folder = place.path().join(&calibration.name);
        let (fit, _) = fitted(program, &calibration, &folder, true)?;
        for name in beads {
            let bead = Bead::read(&real.join(name))?;
            let recording = Recording { program, folder: &folder, bead: &bead };
            let dataset = recording.dataset(&fit)?;
            for (method, by) in TRACKERS {
                if by == Calibration::Scan {
                    recording.calibrate_by(&dataset, &calibration, &fit)?;
                }
                let found = recording.track(&dataset, method)?;
                let row = summary(&bead, &recording.stage_um(&fit)?, &found)?;
                println!("{name} {method}: {row:?}");
                let kind = if by == Calibration::Scan { "scan" } else { "model" };
                table.write_record([name, method, kind].into_iter().chain(row.iter().map(String::as_str)))?;
            }
            std::fs::remove_dir_all(&dataset)?;
        }
    }
    Ok(table.flush()?)
}

/// A bead's scan as a recording, one frame for each plane.
struct Recording<'a> {
    program: &'a Path,
    /// The fit of the calibration's bead.
    folder: &'a Path,
    bead: &'a Bead,
}

impl Recording<'_> {
    /// Depths of the planes if the bead were the fitted one, um.
    fn stage_um(&self, fit: &Value) -> anyhow::Result<Vec<f64>> {
        let first_um = fit["particles"][0]["z_um"].as_f64().context("a depth")?;
        ensure!(fit["direction"].as_f64() == Some(1.0), "the stage moves away from the lens");
        Ok((0..self.bead.scan.planes.len()).map(|i| first_um + i as f64 * self.bead.step_um).collect())
    }

    /// A dataset of the fitted microscope, with the planes of the scan in place of its images.
    fn dataset(&self, fit: &Value) -> anyhow::Result<PathBuf> {
        let (scan, stage_um) = (&self.bead.scan, self.stage_um(fit)?);
        let [middle_x, middle_y] = [scan.width, scan.height].map(|size| 0.5 * (size as f64 + 1.0));
        let mut rows = "frame,track,x_px,y_px,z_um\n".to_owned();
        for (frame, z_um) in stage_um.iter().enumerate() {
            writeln!(rows, "{frame},1,{middle_x},{middle_y},{z_um:.4}")?;
        }
        std::fs::write(self.folder.join("stage.csv"), rows)?;
        let twin = std::fs::read_to_string(self.folder.join("scenario.ron"))?;
        let size = format!("lens: aplanatic, pixel_dim_x: {}, pixel_dim_y: {}", scan.width, scan.height);
        let line = |line: &str| match line.trim_start().split(':').next() {
            Some("motion") => "motion: tracks(file: \"stage.csv\"),".to_owned(),
            Some("particles") => line.replace("number: count(5), ", ""),
            Some("timing") => format!("timing: sequence(frames: {}, dt_s: 1),", stage_um.len()),
            Some("optics") => line.replace("lens: aplanatic", &size),
            _ => line.to_owned(),
        };
        let scenario = self.folder.join("recording.ron");
        std::fs::write(&scenario, twin.lines().map(line).collect::<Vec<_>>().join("\n"))?;
        let dataset = self.folder.join("dataset");
        process::run(Command::new(self.program).arg("generate").arg(&scenario).arg("--out").arg(&dataset))?;
        for (frame, plane) in scan.planes.iter().enumerate() {
            save(scan, plane, &dataset.join(format!("images/frame_{frame:05}.tif")))?;
        }
        Ok(dataset)
    }

    /// Puts the scan of a bead into the calibration folder.
    fn calibrate_by(&self, dataset: &Path, bead: &Bead, fit: &Value) -> anyhow::Result<()> {
        let at = |axis: &str| fit["particles"][0][axis].as_f64().context("a position");
        let (x_px, y_px) = (at("x_px")?, at("y_px")?);
        let folder = dataset.join("calibration");
        std::fs::remove_dir_all(folder.join("images"))?;
        std::fs::create_dir(folder.join("images"))?;
        let mut rows = "step,z_um,x_px,y_px,image,particles\n".to_owned();
        for (step, (z_um, plane)) in self.stage_um(fit)?.iter().zip(&bead.scan.planes).enumerate() {
            let image = format!("calibration/images/step_{step:04}.tif");
            save(&bead.scan, plane, &dataset.join(&image))?;
            writeln!(
                rows,
                "{step},{z_um:.4},{x_px},{y_px},{image},calibration/particles/step_{step:04}.txt"
            )?;
        }
        Ok(std::fs::write(folder.join("calibration.csv"), rows)?)
    }

    /// The depth found in each frame near the middle of the image.
    fn track(&self, dataset: &Path, method: &str) -> anyhow::Result<BTreeMap<usize, f64>> {
        let out = self.folder.join("found.csv");
        let mut command = Command::new(self.program);
        command.arg("track").arg(dataset).args(["--method", method, "--force", "--quiet", "--out"]).arg(&out);
        process::run(&mut command)?;
        let [middle_x, middle_y] =
            [self.bead.scan.width, self.bead.scan.height].map(|size| 0.5 * (size as f64 + 1.0));
        let mut nearest: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
        for row in csv::Reader::from_path(&out)?.deserialize() {
            let row: BTreeMap<String, String> = row?;
            let number = |key: &str| -> anyhow::Result<f64> { Ok(row[key].parse()?) };
            let distance = (number("x_px")? - middle_x).hypot(number("y_px")? - middle_y);
            let known = nearest.entry(row["frame"].parse()?).or_insert((NEAR_PX, f64::NAN));
            if distance < known.0 {
                *known = (distance, number("z_um")?);
            }
        }
        nearest.retain(|_, (_, z_um)| z_um.is_finite());
        Ok(nearest.into_iter().map(|(frame, (_, z_um))| (frame, z_um)).collect())
    }
}

fn save(scan: &Scan, plane: &[u16], path: &Path) -> anyhow::Result<()> {
    let (width, height, counts) = (scan.width as u32, scan.height as u32, Counts::Whole(plane.to_vec()));
    let scale = PixelScale::um_per_px(1.0);
    let image = Image { width, height, bits: 16, counts };
    Ok(tiff::write(File::create(path)?, &image, &scale, &path.display().to_string())?)
}

/// Columns of the table after the first three.
fn summary(bead: &Bead, stage_um: &[f64], found: &BTreeMap<usize, f64>) -> anyhow::Result<Vec<String>> {
    let (stage, z): (Vec<f64>, Vec<f64>) = found.iter().map(|(&frame, &z)| (stage_um[frame], z)).unzip();
    ensure!(z.len() > 2, "{}: found in {} planes", bead.name, z.len());
    let n = z.len() as f64;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / n;
    let (mean_stage, mean_z) = (mean(&stage), mean(&z));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - mean_stage) * b).sum::<f64>();
    let centered: Vec<f64> = z.iter().map(|z| z - mean_z).collect();
    let slope = product(&stage, &centered)
        / product(&stage, &stage.iter().map(|s| s - mean_stage).collect::<Vec<_>>());
    let offset = process::median(z.iter().zip(&stage).map(|(z, s)| z - s));
    let sigma_um = (z.iter().zip(&stage).map(|(z, s)| (z - s - offset).powi(2)).sum::<f64>() / n).sqrt();
    let range_um = stage[stage.len() - 1] - stage[0];
    Ok(vec![
        stage_um.len().to_string(),
        z.len().to_string(),
        format!("{range_um:.1}"),
        format!("{sigma_um:.3}"),
        format!("{slope:.3}"),
    ])
}

/// The rows as Markdown.
pub(super) fn table(file: &Path) -> anyhow::Result<String> {
    let mut lines = String::new();
    for row in
        csv::Reader::from_reader(File::open(file).with_context(|| file.display().to_string())?).records()
    {
        writeln!(lines, "| {} |", row?.iter().collect::<Vec<_>>().join(" | "))?;
    }
    Ok(lines)
}
