//! What scoring costs: a million points, and frames so dense that a gate sees hundreds of neighbours.

use std::fmt::Write as _;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::Command;

use crate::process::{machine, microsig, run};

/// A truth, a result and how they are scored.
struct Case {
    name: &'static str,
    frames: u32,
    particles: u32,
    /// Side of the square that particles are in, px.
    side: f64,
    depth: bool,
    /// Whether the result's tracks change their particle every few frames.
    confused: bool,
    gate_px: f64,
    /// Bars: CPU time, s, and peak memory, MB.
    bars: [f64; 2],
}

const CASES: [Case; 4] = [
    Case {
        name: "a million points in 3-D",
        frames: 1000,
        particles: 1000,
        side: 1000.0,
        depth: true,
        confused: false,
        gate_px: 2.0,
        bars: [10.0, 1000.0],
    },
    Case {
        name: "one frame, a gate with 4 neighbours",
        frames: 1,
        particles: 50_000,
        side: 1000.0,
        depth: false,
        confused: false,
        gate_px: 5.0,
        bars: [5.0, 1000.0],
    },
    Case {
        name: "one frame, a gate with 16 neighbours",
        frames: 1,
        particles: 50_000,
        side: 1000.0,
        depth: false,
        confused: false,
        gate_px: 10.0,
        bars: [5.0, 1000.0],
    },
    Case {
        name: "a gate with 56 neighbours (223 for HOTA), wrong identities",
        frames: 20,
        particles: 4000,
        side: 300.0,
        depth: false,
        confused: true,
        gate_px: 20.0,
        bars: [f64::INFINITY, f64::INFINITY],
    },
];

/// Numbers in [0, 1) by Knuth's linear congruences.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

impl Case {
    /// Particles that drift, and where a tracker with errors of up to 1 px finds them.
    fn write(&self, truth: &Path, result: &Path) -> anyhow::Result<()> {
        let mut state = 1;
        let mut tables =
            [truth, result].map(std::fs::File::create).into_iter().map(|f| f.map(BufWriter::new));
        let [Some(truth), Some(result)] = [tables.next(), tables.next()] else { unreachable!() };
        let (mut truth, mut result) = (truth?, result?);
        let z = |text: String| if self.depth { text } else { String::new() };
        for table in [&mut truth, &mut result] {
            writeln!(table, "frame,track,x_px,y_px{}", z(",z_um".to_owned()))?;
        }
        let places: Vec<[f64; 3]> = (0..self.particles)
            .map(|_| [self.side, self.side, 80.0].map(|size| size * random(&mut state)))
            .collect();
        for frame in 0..self.frames {
            for (track, [x, y, depth]) in places.iter().enumerate() {
                let x = x + 0.5 * f64::from(frame);
                writeln!(truth, "{frame},{track},{x:.3},{y:.3}{}", z(format!(",{depth:.3}")))?;
                let mut off = || 2.0 * random(&mut state) - 1.0;
                let [x, y, depth] = [x + off(), y + off(), depth + off()];
                // A particle has another track every five frames.
                let turn = if self.confused { frame as usize / 5 * 17 } else { 0 };
                let track = (track + turn) % places.len();
                writeln!(result, "{frame},{track},{x:.3},{y:.3}{}", z(format!(",{depth:.3}")))?;
            }
        }
        truth.flush()?;
        Ok(result.flush()?)
    }
}

/// Times all cases and writes README.md; gives whether all bars are met.
pub(crate) fn main(out: &Path) -> anyhow::Result<bool> {
    let command = microsig()?;
    let machine = machine();
    let place = tempfile::tempdir()?;
    let (truth, result) = (place.path().join("truth.csv"), place.path().join("result.csv"));
    let mut met = true;
    let mut rows = String::new();
    for case in &CASES {
        case.write(&truth, &result)?;
        let mut evaluate = Command::new(&command);
        evaluate.arg("evaluate").arg(&truth).arg(&result).args(["--threads", "1", "--json", "--quiet"]);
        evaluate.args(["--gate", if case.depth { "ellipsoid" } else { "radial" }]);
        evaluate.arg("--gate-xy").arg(case.gate_px.to_string());
        if case.depth {
            evaluate.args(["--depth", "0", "80"]);
        }
        let (usage, said) = run(&mut evaluate)?;
        let score: serde_json::Value = serde_json::from_str(&said)?;
        let value = |path: &str| score.pointer(path).and_then(|v| v.as_f64()).unwrap_or(f64::NAN);
        let [cpu, memory] = case.bars;
        met &= usage.cpu_s < cpu && usage.peak_mb < memory;
        let bar = if cpu.is_finite() { format!("{cpu} s, {memory} MB") } else { "–".to_owned() };
        let row = format!(
            "| {} | {} | {} | {} | {:.2} | {:.0} | {bar} | {:.4} | {:.4} | {:.4} | {:.4} |",
            case.name,
            case.frames,
            case.particles,
            case.gate_px,
            usage.cpu_s,
            usage.peak_mb,
            value("/detection/f1"),
            value("/links/f1"),
            value("/hota/hota"),
            value("/identity/idf1"),
        );
        println!("{row}");
        writeln!(rows, "{row}")?;
    }
    std::fs::create_dir_all(out)?;
    let text = format!(
        "# What scoring costs\n\nMade by `cargo xtask scoring --out FOLDER` with version {}.\n{machine}.\n\n\
         One run of `microsig evaluate --threads 1` for each: reading, matching at all gates, detection, links, ISBI (in 3-D \
         twice), HOTA, CLEAR, identity, GDPT, LPT, curves and all intervals. CPU time is user and system.\n\n\
         | case | frames | particles | gate, px | CPU, s | peak, MB | bar | F1 | link F1 | HOTA | IDF1 |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n{rows}",
        env!("CARGO_PKG_VERSION")
    );
    std::fs::write(out.join("README.md"), text)?;
    Ok(met)
}
