//! Coverage of the truth by 95 % intervals, over simulated scans with different noise.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::path::Path;

use anyhow::Context;
use fit::{Astigmatic, ExtraParameter, FitOptions, Given, Scan};
use suite::process::median;
use suite::scan::SimulatedScan;

use super::quantity::quantities;

/// Cases of the shared scans with rays that can be traced again; and smaller cases, made from expected images
/// with shot noise.
const CASES: [&str; 5] = ["clipped", "free", "turned", "a", "b"];

/// Depths of the small scans: number of planes and their distance, um.
const PLANES: (usize, f64) = (15, 5.0);

/// A scan to be made for each seed.
struct Case {
    truth: SimulatedScan,
    /// Mean numbers of rays, if it is made from expected images.
    mean_rays: Option<Vec<Vec<f64>>>,
    free: Vec<ExtraParameter>,
}

impl Case {
    fn new(name: &str, own: &Path) -> anyhow::Result<Case> {
        let mut truth = match name {
            "turned" | "clipped" | "free" => small(),
            _ => {
                let truth = SimulatedScan::read(&own.join(name))?;
                return Ok(Case { truth, mean_rays: None, free: Vec::new() });
            }
        };
        let mut free = Vec::new();
        match name {
            "turned" => {
                truth.settings.cyl_focal_length = 4000.0;
                truth.rotation_deg = 25.0;
                truth.beads.iter_mut().for_each(|bead| bead.z_um -= 12.0);
            }
            "clipped" => (truth.settings.background_mean, truth.settings.background_noise) = (4.0, 6.0),
            _ => free = vec![ExtraParameter::PixelSize, ExtraParameter::RiLens],
        }
        let mean_rays = Some(truth.mean_rays()?);
        Ok(Case { truth, mean_rays, free })
    }

    fn planes(&self, seed: u64) -> anyhow::Result<Vec<Vec<u16>>> {
        match &self.mean_rays {
            Some(mean_rays) => Ok(self.truth.photon_planes(mean_rays, seed)),
            None => self.truth.planes(seed),
        }
    }
}

/// Two particles on an image of 150 x 80 px.
fn small() -> SimulatedScan {
    let mut truth = SimulatedScan::tenfold(PLANES.0, PLANES.1);
    let settings = &mut truth.settings;
    (settings.pixel_dim_x, settings.pixel_dim_y) = (150, 80);
    (settings.background_mean, settings.background_noise, settings.gain) = (100.0, 5.0, 2.0);
    truth.beads.truncate(2);
    (truth.beads[0].x_px, truth.beads[0].y_px) = (38.3, 40.2);
    (truth.beads[1].x_px, truth.beads[1].y_px) = (112.6, 39.7);
    truth
}

/// The coverage should lie within these limits.
const LIMITS: std::ops::RangeInclusive<f64> = 0.85..=1.0;

/// First seed; the shared scans use lower ones.
const FIRST_SEED: u64 = 1000;

/// Fits `seeds` simulated scans of each case and writes a row for each quantity. Existing rows of the file
/// are kept, so that an interrupted run continues.
pub(super) fn run(own: &Path, seeds: u64, only: &[String], file: &Path) -> anyhow::Result<()> {
    let mut done = std::collections::BTreeSet::new();
    if file.exists() {
        for row in csv::Reader::from_path(file)?.deserialize() {
            let (case, seed, _, _, _, _, _): (String, u64, String, f64, f64, f64, bool) = row?;
            done.insert((case, seed));
        }
    } else {
        std::fs::write(file, "case,seed,quantity,truth,value,sd,covered\n")?;
    }
    for name in CASES.iter().copied().filter(|name| only.is_empty() || only.iter().any(|o| o == name)) {
        let missing: Vec<u64> = (FIRST_SEED..FIRST_SEED + seeds)
            .filter(|seed| !done.contains(&(name.to_owned(), *seed)))
            .collect();
        if missing.is_empty() {
            continue;
        }
        let case = Case::new(name, own)?;
        let truth = &case.truth;
        for seed in missing {
            let scan = Scan {
                width: truth.settings.pixel_dim_x as usize,
                height: truth.settings.pixel_dim_y as usize,
                planes: case.planes(seed)?,
                stage_um: truth.stage_um.clone(),
                full_scale: u16::MAX,
                warnings: Vec::new(),
            };
            let made = fit::fit(&scan, &options(&case), &|_| ())
                .with_context(|| format!("case {name}, seed {seed}"))?;
            let found = quantities(truth, &serde_json::to_value(&made.fitted)?);
            // Appended at once, so that an interrupted run does not leave part of a seed.
            let mut rows = csv::Writer::from_writer(Vec::new());
            for q in found.iter().filter(|q| q.counts) {
                let numbers = [q.truth, q.value, q.sd].map(|v| format!("{v:.6}"));
                let head = [name.to_owned(), seed.to_string(), q.name.clone()];
                rows.write_record(head.into_iter().chain(numbers).chain([q.is_covered().to_string()]))?;
            }
            let mut to = OpenOptions::new().append(true).open(file)?;
            std::io::Write::write_all(&mut to, &rows.into_inner()?)?;
            let covered = found.iter().filter(|q| q.counts && q.is_covered()).count();
            let all = found.iter().filter(|q| q.counts).count();
            println!("case {name}, seed {seed}: {covered} of {all} intervals cover the truth");
        }
    }
    Ok(())
}

fn options(Case { truth, free, .. }: &Case) -> FitOptions {
    FitOptions {
        given: Given {
            magnification: truth.settings.magnification,
            pixel_size_um: truth.settings.pixel_size,
            ri_medium: truth.settings.ri_medium,
            ri_lens: truth.settings.ri_lens,
            depth_factor: truth.depth_factor,
        },
        diameter_um: None,
        direction: None,
        astigmatic: Astigmatic::Auto,
        free_flux: true,
        half_window: None,
        places_px: None,
        waves: None,
        free: free.clone(),
        bootstrap: 0,
        seed: 0,
    }
}

/// The coverage of each quantity as Markdown, and the number of quantities outside the limits.
pub(super) fn table(file: &Path) -> anyhow::Result<(String, usize)> {
    type Row = (f64, f64, f64, bool);
    let mut groups: BTreeMap<(String, String), Vec<Row>> = BTreeMap::new();
    for row in csv::Reader::from_path(file)?.deserialize() {
        let (case, _, name, truth, value, sd, covered): (String, u64, String, f64, f64, f64, bool) = row?;
        // The depths of all particles are one quantity.
        let name = name.split(" of ").next().unwrap_or_default().to_owned();
        groups.entry((case, name)).or_default().push((truth, value, sd, covered));
    }
    let (mut lines, mut outside) = (String::new(), 0);
    for ((case, name), rows) in groups {
        let n = rows.len();
        let covered = rows.iter().filter(|row| row.3).count();
        let share = covered as f64 / n as f64;
        outside += usize::from(!LIMITS.contains(&share));
        let errors = || rows.iter().map(|(truth, value, ..)| value - truth);
        let bias = errors().sum::<f64>() / n as f64;
        let spread =
            (errors().map(|e| (e - bias) * (e - bias)).sum::<f64>() / (n as f64 - 1.0).max(1.0)).sqrt();
        let claimed = median(rows.iter().map(|row| row.2));
        writeln!(
            lines,
            "| {case} | {name} | {covered} of {n} | {:.0} % | {bias:+.5} | {spread:.5} | {claimed:.5} |",
            100.0 * share
        )?;
    }
    Ok((lines, outside))
}
