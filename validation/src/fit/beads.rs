//! Real beads near focus: geometrical optics must report that it does not describe them; wave optics must
//! describe them.

use std::fmt::Write as _;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Context;
use fit::{Scan, StagePositions};
use serde_json::Value;

use super::montage::montage;

/// Maximum chi2 per pixel of a fit by waves, with the noise estimated from its residuals.
const LARGEST_CHI2: f64 = 1.25;

/// Minimum fraction of the light that a fit by waves explains, and the fraction that rays must not reach,
/// because they do not describe these beads.
const LEAST_R2: f64 = 0.94;
const RAYS_R2: f64 = 0.9;

/// Beads for which a picture is made.
const SHOWN: [&str; 2] = ["astig085_0", "dry095_0"];

/// Fits all scans below `real` by waves; writes `beads.csv` with a row for each, and pictures of some.
pub(super) fn run(program: &Path, real: &Path, out: &Path) -> anyhow::Result<()> {
    let mut folders: Vec<_> = std::fs::read_dir(real)
        .with_context(|| real.display().to_string())?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.is_dir())
        .collect();
    folders.sort();
    let mut table = csv::Writer::from_path(out.join("beads.csv"))?;
    table.write_record(HEADER)?;
    let place = tempfile::tempdir()?;
    for folder in folders {
        let bead = Bead::read(&folder)?;
        let (fit, model) = fitted(program, &bead, &place.path().join(&bead.name), true)?;
        if SHOWN.contains(&bead.name.as_str()) {
            let by_rays = place.path().join(format!("{} by rays", bead.name));
            let (_, rays) = fitted(program, &bead, &by_rays, false)?;
            montage(&[&folder.join(SCAN), &rays, &model], out, &bead.name)?;
        }
        let parameter = |name: &str| {
            let all = fit["parameters"].as_array().into_iter().flatten();
            all.clone().find(|p| p["name"] == name).and_then(|p| p["value"].as_f64()).unwrap_or(f64::NAN)
        };
        let compared = |model: &str, key: &str| fit["comparison"][model][key].as_f64().unwrap_or(f64::NAN);
        let astigmatism = parameter("astigmatism").hypot(parameter("astigmatism_45"));
        let coma = parameter("coma_x").hypot(parameter("coma_y"));
        let numbers = [
            compared("geometric", "chi2"),
            compared("geometric", "r2"),
            compared("waves", "chi2"),
            compared("waves", "chi2_of_fitted_noise"),
            compared("waves", "r2"),
            compared("geometric", "bic") - compared("waves", "bic"),
            bead.nominal_na,
            parameter("numerical_aperture"),
            parameter("particle_diameter_um"),
            parameter("spherical_aberration"),
            astigmatism,
            coma,
        ];
        println!("{}: {numbers:?}", bead.name);
        table.write_record([bead.name].into_iter().chain(numbers.map(|v| format!("{v:.4}"))))?;
    }
    Ok(table.flush()?)
}

/// The file with the planes.
const SCAN: &str = "scan.tif";

/// The scan of a bead.
pub(super) struct Bead {
    pub(super) name: String,
    pub(super) scan: Scan,
    file: PathBuf,
    um_per_px: f64,
    pub(super) step_um: f64,
    wavelength_um: f64,
    nominal_na: f64,
}

impl Bead {
    pub(super) fn read(folder: &Path) -> anyhow::Result<Self> {
        let name = folder.file_name().and_then(|n| n.to_str()).context("a name")?.to_owned();
        let given: Value = serde_json::from_reader(File::open(folder.join("given.json"))?)?;
        let given = |key: &str| given["given"][key].as_f64().with_context(|| format!("{name}: {key}"));
        let (file, step_um) = (folder.join(SCAN), given("z_step_um")?);
        Ok(Bead {
            scan: Scan::read(&file, &StagePositions::Step(step_um), None)?,
            file,
            um_per_px: given("um_per_px")?,
            step_um,
            wavelength_um: given("emission_um")?,
            nominal_na: given("nominal_numerical_aperture")?,
            name,
        })
    }
}

/// Fits the scan of a bead into the folder `out`; `fit.json` and the file of fitted images.
pub(super) fn fitted(
    program: &Path,
    bead: &Bead,
    out: &Path,
    by_waves: bool,
) -> anyhow::Result<(Value, PathBuf)> {
    let mut command = Command::new(program);
    command.arg("fit").arg(&bead.file).args([
        "--magnification",
        "1",
        "--pixel-size",
        &bead.um_per_px.to_string(),
    ]);
    command.args(["--z-step", &bead.step_um.to_string()]);
    if by_waves {
        // Polystyrene beads are dyed throughout.
        command.args(["--model", "waves", "--emission", "volume"]);
        command.args(["--wavelength", &bead.wavelength_um.to_string()]);
    }
    // Exit code 1: the fit is poor, but it was written.
    let output = command.arg("--out").arg(out).output()?;
    let said = || String::from_utf8_lossy(&output.stderr).into_owned();
    let fit = serde_json::from_reader(File::open(out.join("fit.json")).with_context(said)?)?;
    Ok((fit, out.join("model.tif")))
}

const HEADER: [&str; 13] = [
    "bead",
    "rays_chi2",
    "rays_r2",
    "waves_chi2",
    "waves_chi2_of_fitted_noise",
    "waves_r2",
    "bic_gain",
    "nominal_na",
    "na",
    "diameter_um",
    "spherical",
    "astigmatism",
    "coma",
];

/// The beads as Markdown, and the number of limits exceeded.
pub(super) fn table(file: &Path) -> anyhow::Result<(String, usize)> {
    let (mut lines, mut above) = (String::new(), 0);
    for row in csv::Reader::from_path(file)?.deserialize() {
        let (name, numbers): (String, [f64; 12]) = row?;
        let [rays_chi2, rays_r2, chi2, fitted_noise, r2, gain, more @ ..] = numbers;
        let [nominal, na, diameter, spherical, astigmatism, coma] = more;
        let bars = [fitted_noise < LARGEST_CHI2, r2 >= LEAST_R2, rays_r2 < RAYS_R2, gain > 0.0];
        above += bars.into_iter().filter(|is_met| !is_met).count();
        writeln!(
            lines,
            "| {name} | {rays_chi2:.2} | {rays_r2:.3} | {chi2:.3} | {fitted_noise:.3} | {r2:.3} | {gain:.0} | {nominal:.2} | {na:.3} | {diameter:.2} | {spherical:+.3} | \
             {astigmatism:.3} | {coma:.3} |"
        )?;
    }
    Ok((lines, above))
}
