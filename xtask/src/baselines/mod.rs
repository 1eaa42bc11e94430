//! `cargo xtask baselines`: scores of the baseline trackers for different densities, noise levels and optics.

mod plot;

use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use anyhow::Context;
use serde_json::Value;

use suite::process::{machine, microsig, run};

/// Template of the record.
const TEXT: &str = include_str!("README.md");

/// A dataset and the trackers to run on it.
struct Case {
    group: &'static str,
    scenario: &'static str,
    set: Vec<String>,
    /// Standard deviation of the background noise, counts.
    noise: f64,
    /// Particles per frame, or per pixel if less than 1.
    particles: f64,
    trackers: &'static [&'static str],
}

/// A tracker's score.
struct Scored {
    group: &'static str,
    noise: f64,
    particles: f64,
    /// Source density of the dataset.
    n_s: f64,
    snr: Option<f64>,
    tracker: &'static str,
    score: Value,
    cpu_s_per_frame: f64,
}

impl Scored {
    fn value(&self, path: &str) -> Option<f64> {
        self.score.pointer(path).and_then(Value::as_f64)
    }
}

/// Numbers of defocused particles in frames of 752 x 366 px.
const COUNTS: [u32; 5] = [12, 46, 92, 150, 230];

fn cases() -> Vec<Case> {
    let defocused = [
        ("spherical", "quickstart", &["ncc", "mle"][..]),
        ("astigmatic", "quickstart_astigmatic", &["ncc", "mle", "aptv"][..]),
    ];
    let mut cases = Vec::new();
    for (group, scenario, trackers) in defocused {
        for noise in [10.0, 50.0] {
            for count in COUNTS {
                let set = vec![
                    format!("particles.number=count({count})"),
                    "timing=pairs(count:10,dt_s:0.005)".into(),
                ];
                cases.push(Case { group, scenario, set, noise, particles: f64::from(count), trackers });
            }
        }
    }
    for noise in [10.0, 50.0] {
        for ppp in [0.001, 0.003, 0.01, 0.03] {
            let set = vec![format!("particles.number=ppp({ppp})")];
            let (group, scenario) = ("in focus", "piv_gaussian");
            cases.push(Case { group, scenario, set, noise, particles: ppp, trackers: &["spots"] });
        }
        for ppp in [0.01, 0.03, 0.1] {
            let set = vec![format!("particles.number=ppp({ppp})")];
            let (group, scenario) = ("field", "piv_gaussian");
            cases.push(Case { group, scenario, set, noise, particles: ppp, trackers: &["piv", "static"] });
        }
    }
    let anchors = &["truth-noise", "offset", "empty"];
    let (group, scenario) = ("anchors", "quickstart");
    cases.push(Case { group, scenario, set: Vec::new(), noise: 10.0, particles: 46.0, trackers: anchors });
    cases
}

/// Runs the whole grid and writes runs.csv, plots and README.md.
pub(crate) fn main(out: &Path) -> anyhow::Result<()> {
    let command = microsig()?;
    let before = machine();
    let place = tempfile::tempdir()?;
    let scenarios =
        Path::new(env!("CARGO_MANIFEST_DIR")).parent().context("xtask has a parent")?.join("scenarios");
    let mut scored = Vec::new();
    for case in cases() {
        let dataset = place.path().join("dataset");
        let mut generate = Command::new(&command);
        generate.arg("generate").arg(scenarios.join(format!("{}.ron", case.scenario)));
        generate.arg("--out").arg(&dataset).args(["--force", "--quiet", "--set"]);
        generate.arg(format!("optics.background_noise={}", case.noise));
        for set in &case.set {
            generate.args(["--set", set]);
        }
        run(&mut generate)?;
        let manifest: Value = serde_json::from_slice(&std::fs::read(dataset.join("datapackage.json"))?)?;
        for tracker in case.trackers {
            let score = track(&command, &dataset, &case, tracker, &manifest)?;
            println!("{}", row(&score));
            scored.push(score);
        }
    }
    std::fs::create_dir_all(out)?;
    table(&out.join("runs.csv"), &scored)?;
    plot::write(out, &scored)?;
    std::fs::write(out.join("README.md"), readme(&before, &scored))?;
    Ok(())
}

fn track(
    command: &Path,
    dataset: &Path,
    case: &Case,
    tracker: &'static str,
    manifest: &Value,
) -> anyhow::Result<Scored> {
    let result = dataset.with_file_name("result.csv");
    let scores = dataset.with_file_name("score");
    let mut track = Command::new(command);
    track.arg("track").arg(dataset).args(["--method", tracker, "--force", "--json", "--out"]).arg(&result);
    let (usage, said) = run(&mut track)?;
    let frames = serde_json::from_str::<Value>(&said)?["frames"]
        .as_f64()
        .context("track reports its number of frames")?;
    let mut evaluate = Command::new(command);
    evaluate.arg("evaluate").arg(dataset).arg(&result).args(["--force", "--quiet", "--out"]).arg(&scores);
    run(&mut evaluate)?;
    let number =
        |key: &str| find(manifest, key).and_then(|v| v.as_f64().or_else(|| find(v, "median")?.as_f64()));
    Ok(Scored {
        group: case.group,
        noise: case.noise,
        particles: case.particles,
        n_s: number("n_s").unwrap_or(f64::NAN),
        snr: number("snr"),
        tracker,
        score: serde_json::from_slice(&std::fs::read(scores.join("score.json"))?)?,
        cpu_s_per_frame: usage.cpu_s / frames,
    })
}

/// The first value with this key in a JSON tree.
fn find<'a>(tree: &'a Value, key: &str) -> Option<&'a Value> {
    match tree {
        Value::Object(map) => map.get(key).or_else(|| map.values().find_map(|v| find(v, key))),
        Value::Array(list) => list.iter().find_map(|v| find(v, key)),
        _ => None,
    }
}

/// Score columns of runs.csv and their paths in score.json.
const COLUMNS: [(&str, &str); 20] = [
    ("precision", "/detection/precision"),
    ("recall", "/detection/recall"),
    ("f1", "/detection/f1"),
    ("rmse_x_px", "/detection/rmse_x_px"),
    ("rmse_y_px", "/detection/rmse_y_px"),
    ("bias_x_px", "/detection/bias_x_px"),
    ("bias_y_px", "/detection/bias_y_px"),
    ("rmse_z_um", "/detection/rmse_z_um"),
    ("bias_z_um", "/detection/bias_z_um"),
    ("p95_xy_px", "/detection/p95_xy_px"),
    ("phi", "/gdpt/phi"),
    ("sigma_z_over_h", "/gdpt/sigma_z_over_h"),
    ("link_f1", "/links/f1"),
    ("aee_px", "/field/aee_px"),
    ("u_rms_px", "/field/u/rms_px"),
    ("u_inliers_rms_px", "/field/u_inliers/rms_px"),
    ("v_inliers_rms_px", "/field/v_inliers/rms_px"),
    ("outlier_fraction", "/field/outlier_fraction"),
    ("valid_vector_probability", "/field/valid_vector_probability"),
    ("data_yield", "/field/data_yield"),
];

fn table(path: &Path, scored: &[Scored]) -> anyhow::Result<()> {
    let mut table = csv::Writer::from_path(path)?;
    let named = ["group", "tracker", "noise", "particles", "n_s", "snr", "cpu_s_per_frame"];
    table.write_record(named.into_iter().chain(COLUMNS.map(|c| c.0)))?;
    for s in scored {
        let number = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
        let mut cells = vec![s.group.to_owned(), s.tracker.to_owned(), s.noise.to_string()];
        cells.push(s.particles.to_string());
        cells.extend([number(Some(s.n_s)), number(s.snr), format!("{:.3}", s.cpu_s_per_frame)]);
        cells.extend(COLUMNS.map(|(_, path)| number(s.value(path))));
        table.write_record(&cells)?;
    }
    Ok(table.flush()?)
}

/// A row of the tables, in Markdown.
fn row(s: &Scored) -> String {
    let number = |path: &str, digits: usize, unit: f64| {
        s.value(path).map_or("–".to_owned(), |v| format!("{:.digits$}", unit * v))
    };
    let n_s = if s.n_s.is_finite() { format!("{:.3}", s.n_s) } else { "–".to_owned() };
    let head = format!("| {} | {} | {} | {n_s} |", s.tracker, s.noise, s.particles);
    let tail = if s.score["field"].is_null() {
        format!(
            " {} | {} | {} | {} | {} | {} |",
            number("/detection/precision", 3, 1.0),
            number("/detection/recall", 3, 1.0),
            number("/detection/rmse_x_px", 3, 1.0),
            number("/detection/rmse_y_px", 3, 1.0),
            number("/gdpt/sigma_z_over_h", 2, 100.0),
            number("/links/f1", 3, 1.0),
        )
    } else {
        format!(
            " {} | {} | {} | {} | {} |",
            number("/field/aee_px", 3, 1.0),
            number("/field/u_inliers/rms_px", 3, 1.0),
            number("/field/v_inliers/rms_px", 3, 1.0),
            number("/field/outlier_fraction", 3, 1.0),
            number("/field/valid_vector_probability", 3, 1.0),
        )
    };
    format!("{head}{tail} {:.2} |", s.cpu_s_per_frame)
}

fn readme(machine: &str, scored: &[Scored]) -> String {
    let mut text = TEXT.replace("{machine}", machine).replace("{version}", env!("CARGO_PKG_VERSION"));
    for group in ["spherical", "astigmatic", "in focus", "field", "anchors"] {
        let mut rows = String::new();
        for s in scored.iter().filter(|s| s.group == group) {
            writeln!(rows, "{}", row(s)).expect("a string takes everything");
        }
        text = text.replace(&format!("{{{group}}}\n"), &rows);
    }
    text
}
