//! Opens image files, exports and the metadata of a release with the programs they are intended for.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};

use suite::process;
use suite::python::Python;
use suite::template::fill;

/// The scenario of the exported dataset; its displacements are nonuniform.
const SCENARIO: &str = r#"(
    name: "exported",
    seed: 3,
    optics: (pixel_dim_x: 256, pixel_dim_y: 192),
    motion: flow(field: lamb_oseen()),
    particles: (number: count(12)),
    timing: sequence(frames: 20, dt_s: 0.002),
)"#;

/// Generates a dataset, exports it to every format, releases it, and runs the scripts in
/// `validation/exports`.
///
/// `imagej`: path of `ij.jar`, to open images with ImageJ too.
pub(crate) fn run(out: &Path, imagej: Option<&Path>) -> anyhow::Result<()> {
    let place = tempfile::tempdir()?;
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("exports");
    let python = Python::with("exports", &folder.join("requirements.txt"))?;

    let scenario = place.path().join("exported.ron");
    std::fs::write(&scenario, SCENARIO)?;
    let (dataset, exports, release) =
        (place.path().join("dataset"), place.path().join("exports"), place.path().join("release"));
    std::fs::create_dir(&exports)?;
    let program = process::microsig()?;
    let microsig = |arguments: &[&str]| call(Command::new(&program).args(arguments)).map(drop);
    microsig(&["generate", "--quiet", text(&scenario)?, "--out", text(&dataset)?])?;
    let mut formats = vec!["isbi", "trackpy", "defocustracker", "trackmate-spots", "napari"];
    if dataset.join("truth/field.csv").exists() {
        formats.extend(["flo", "openpiv"]);
    }
    for format in formats {
        microsig(&["export", text(&dataset)?, "--format", format, "--out", text(&exports.join(format))?])?;
    }
    microsig(&["release", "--quiet", text(&dataset)?, "--out", text(&release)?, "--creator", "Doe, Jane"])?;

    let mut table = String::from("| what | opened with | found |\n|---|---|---|\n");
    let scale = format!("{}", 6.45 / 10.0);
    table += &call(python.command(&folder.join("export.py")).arg(&dataset).arg(&exports).arg(scale))?;
    table += &call(python.command(&folder.join("release.py")).arg(release.join("public")))?;
    if let Some(jar) = imagej {
        let image = dataset.join("images/frame_00000.tif");
        let show = folder.join("ImageScale.java");
        let headless = "-Djava.awt.headless=true";
        table += &call(
            Command::new("java")
                .arg(headless)
                .arg("-cp")
                .arg(jar)
                .arg(show)
                .args([image, dataset.join("images")]),
        )?;
    }
    let values = [("out", &*out.display().to_string()), ("table", table.trim_end())];
    let readme = fill(include_str!("exports.md"), &values);
    std::fs::create_dir_all(out)?;
    std::fs::write(out.join("README.md"), &readme)?;
    println!("{readme}");
    Ok(())
}

fn text(path: &Path) -> anyhow::Result<&str> {
    path.to_str().context("a path that is not UTF-8")
}

/// Runs a command and returns its standard output.
fn call(command: &mut Command) -> anyhow::Result<String> {
    let output = command.output().with_context(|| format!("{command:?}"))?;
    ensure!(output.status.success(), "{command:?}:\n{}", String::from_utf8_lossy(&output.stderr));
    Ok(String::from_utf8(output.stdout)?)
}
