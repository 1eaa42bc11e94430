//! `cargo xtask scoring`: run time and memory of scoring, for a million points and for frames with many
//! neighbors within the gate.

use std::fmt::Write as _;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::Command;

use suite::process::{machine, microsig, run};
use suite::template::fill;

/// Parameters of a truth, a result and the scoring.
struct Case {
    name: &'static str,
    frames: u32,
    particles: u32,
    /// Side of the square that contains the particles, px.
    side: f64,
    depth: bool,
    /// Number of frames after which all result tracks exchange their particles; 0: never.
    exchanged: u32,
    /// Ghosts per missed particle.
    ghosts: f64,
    gate_px: f64,
    /// Limits of CPU time, s, and peak memory, MB.
    bars: [f64; 2],
}

/// Share of missed particles.
const MISSED: f64 = 0.1;
/// Probability that a track breaks between two frames.
const BROKEN: f64 = 0.05;

/// A single frame of 50,000 points.
const fn dense(name: &'static str, ghosts: f64, gate_px: f64, bars: [f64; 2]) -> Case {
    Case {
        name,
        frames: 1,
        particles: 50_000,
        side: 1000.0,
        depth: false,
        exchanged: 0,
        ghosts,
        gate_px,
        bars,
    }
}

const NO_BAR: [f64; 2] = [f64::INFINITY; 2];

const CASES: [Case; 7] = [
    Case {
        name: "a million points in 3-D",
        frames: 1000,
        particles: 1000,
        side: 1000.0,
        depth: true,
        exchanged: 0,
        ghosts: 0.8,
        gate_px: 2.0,
        bars: [10.0, 1000.0],
    },
    Case {
        name: "a million points in 3-D, a gate with 6 neighbors",
        frames: 1000,
        particles: 1000,
        side: 300.0,
        depth: true,
        exchanged: 0,
        ghosts: 0.8,
        gate_px: 20.0,
        bars: NO_BAR,
    },
    dense("one frame, a gate with 4 neighbors", 0.8, 5.0, [5.0, 1000.0]),
    dense("one frame, a gate with 16 neighbors", 0.8, 10.0, [5.0, 1000.0]),
    dense("one frame, a gate with 63 neighbors", 0.8, 20.0, NO_BAR),
    // Worst case: every point can be matched at any distance.
    dense("the same with 16, as many found as true particles", 1.0, 10.0, NO_BAR),
    Case {
        name: "a gate with 56 neighbors, wrong identities",
        frames: 20,
        particles: 4000,
        side: 300.0,
        depth: false,
        exchanged: 5,
        ghosts: 0.8,
        gate_px: 20.0,
        bars: NO_BAR,
    },
];

/// Uniform numbers in [0, 1) by Knuth's linear congruential generator.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

impl Case {
    /// Writes drifting particles as truth, and a result with errors of up to 1 px.
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
        let mut number: Vec<usize> = (0..places.len()).collect();
        let mut tracks = places.len();
        for frame in 0..self.frames {
            if self.exchanged > 0 && frame > 0 && frame % self.exchanged == 0 {
                number.rotate_left(17);
            }
            for (track, [x, y, depth]) in places.iter().enumerate() {
                let x = x + 0.5 * f64::from(frame);
                writeln!(truth, "{frame},{track},{x:.3},{y:.3}{}", z(format!(",{depth:.3}")))?;
                let mut find = |track: &str, [x, y, depth]: [f64; 3]| {
                    writeln!(result, "{frame},{track},{x:.3},{y:.3}{}", z(format!(",{depth:.3}")))
                };
                if random(&mut state) < MISSED {
                    if random(&mut state) >= self.ghosts {
                        continue;
                    }
                    find("", [self.side, self.side, 80.0].map(|size| size * random(&mut state)))?;
                    continue;
                }
                if random(&mut state) < BROKEN {
                    (number[track], tracks) = (tracks, tracks + 1);
                }
                let mut off = || 2.0 * random(&mut state) - 1.0;
                find(&number[track].to_string(), [x + off(), y + off(), depth + off()])?;
            }
        }
        truth.flush()?;
        Ok(result.flush()?)
    }
}

/// Times all cases and writes README.md; returns whether all limits are met.
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
    let values = [("version", env!("CARGO_PKG_VERSION")), ("machine", &machine), ("rows", rows.trim_end())];
    std::fs::write(out.join("README.md"), fill(include_str!("scoring.md"), &values))?;
    Ok(met)
}
