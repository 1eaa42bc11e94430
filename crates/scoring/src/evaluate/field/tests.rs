//! Fields as OpenPIV, PIVlab, DaVis and TSI Insight write them, read and scored, and the hints for those that are
//! read in another way than they are meant.

use super::FieldScore;
use super::true_field::{TrueField, TrueFields};
use crate::evaluate::{EvaluateOptions, Score, Truth, evaluate_source};
use crate::results::{Conventions, FlowVector, Limits, Origin, PairChoice, Position, Source};
use storage::dataset::RecordingFacts;

const WIDTH: f64 = 100.0;
const HEIGHT: f64 = 86.0;
const UM: f64 = 0.5;
const DT: f64 = 0.02;

/// A flow without symmetry.
fn flow(x: f64, y: f64) -> [f64; 2] {
    [1.0 + 0.02 * x - 0.01 * y, -2.0 + 0.005 * x + 0.03 * y]
}

fn truth() -> Truth {
    let facts = RecordingFacts {
        sensor_px: Some((WIDTH, HEIGHT)),
        um_per_px: Some(UM),
        dt_s: Some(DT),
        frames: Some(4),
        pairs: true,
        ..RecordingFacts::default()
    };
    let node = |x: u32, y: u32| {
        let at = Position { x_px: f64::from(x), y_px: f64::from(y), z_um: 0.0 };
        let [u, v] = flow(at.x_px, at.y_px);
        FlowVector { at, moved: [u, v, 0.0], ..FlowVector::default() }
    };
    let nodes: Vec<FlowVector> =
        (1..=86).step_by(5).flat_map(|y| (1..=100).step_by(3).map(move |x| node(x, y))).collect();
    let fields = vec![(None, TrueField::new(&nodes))];
    Truth {
        fields: Some(TrueFields { fields, facts: facts.clone(), ..TrueFields::default() }),
        facts,
        ..Truth::default()
    }
}

/// Positions of vectors, not symmetric in the image: x, y, u, v in px, y downward, first center at (1, 1).
fn vectors() -> Vec<[f64; 4]> {
    let at = |k: u32| 8.0 * f64::from(k);
    let all = (1..=9).flat_map(|j| (1..=11).map(move |i| (at(i), at(j) + 2.0)));
    all.map(|(x, y)| (x, y, flow(x, y))).map(|(x, y, [u, v])| [x, y, u, v]).collect()
}

/// Rows of numbers below a header.
fn table(header: &str, separator: &str, row: impl Fn([f64; 4]) -> Vec<f64>) -> String {
    let line = |v| row(v).iter().map(|n| format!("{n:.9e}")).collect::<Vec<_>>().join(separator) + "\n";
    format!("{header}\n{}", vectors().into_iter().map(line).collect::<String>())
}

fn score_of(files: &[(&str, String)], given: &str, conventions: Conventions) -> Result<Score, String> {
    let place = tempfile::tempdir().unwrap();
    for (name, text) in files {
        std::fs::write(place.path().join(name), text).unwrap();
    }
    let options = EvaluateOptions { conventions, ..EvaluateOptions::default() };
    let facts = crate::evaluate::measurement::with_given(truth().facts, &conventions);
    let truth = Truth { facts, ..truth() };
    Source::at(place.path().join(given).into())
        .and_then(|source| evaluate_source(|_| Ok((truth, Limits::default())), source, &options))
        .map(|evaluation| evaluation.score)
        .map_err(|e| e.messages().join("\n"))
}

fn scored(name: &str, text: &str, conventions: Conventions) -> Score {
    score_of(&[(name, text.to_owned())], name, conventions).unwrap()
}

fn rms(score: &Score) -> f64 {
    let FieldScore { main, n_outside, .. } = score.field.as_ref().unwrap();
    assert_eq!(*n_outside, 0);
    main.epe_rms_px.unwrap()
}

const NONE: Conventions = Conventions {
    unit: None,
    format: None,
    origin: None,
    y_up: None,
    shift_px: [0.0; 2],
    frame_base: None,
    um_per_px: None,
    dt_s: None,
    stated: (None, None),
    pair: None,
    pairs: None,
    depth_um: None,
    width_px: None,
    height_px: None,
    limits: Limits { bytes: 1 << 20, rows: 1 << 20 },
};
const UP: Conventions = Conventions { y_up: Some(true), ..NONE };

fn openpiv(length: f64, speed: f64, is_up: bool) -> String {
    // Rows from 10 to 74 px.
    let y = |y: f64| if is_up { 84.0 - y } else { y };
    table("# x\ty\tu\tv\tflags\tmask", "\t", |[x, at, u, v]| {
        let v = if is_up { -v } else { v };
        vec![length * x, length * y(at), speed * u, speed * v, 0.0, 0.0]
    })
}

fn pivlab(units: [&str; 2], factors: Option<[f64; 2]>, row: impl Fn([f64; 4]) -> Vec<f64>) -> String {
    let factors = factors.map_or(String::new(), |[xy, uv]| {
        format!(
            "PIVlab, ASCII chart output - 01-Jan-2026\nFRAME: 2, filenames: a & b, conversion factor xy (px -> m): {xy}, \
             conversion factor uv (px/frame -> m/s): {uv}\n"
        )
    });
    let [length, speed] = units;
    let header = format!(
        "{factors}x [{length}],y [{length}],u [{speed}],v [{speed}],Vector type [-],vorticity [1/s],uncertainty [{speed}]"
    );
    table(&header, ",", row)
}

/// What each program writes, and the options with which it is read.
#[test]
fn fields_are_read_in_the_units_and_axes_of_each_program() {
    let (m, m_s) = (1e-6 * UM, 1e-6 * UM / DT);
    let all =
        |f: f64, g: f64| move |[x, y, u, v]: [f64; 4]| vec![f * x, f * y, g * u, g * v, 1.0, 0.0, 0.1 * g];
    let scale = Conventions { um_per_px: Some(UM), ..NONE };
    let both = Conventions { dt_s: Some(DT), ..scale };
    let insight = |names: &str, more: &str| {
        format!(
            "TITLE=\"a1.vec\" VARIABLES={names}, \"CHC\", DATASETAUXDATA Application=\"PIV\" {more} ZONE I=11, J=9, F=POINT"
        )
    };
    let scales = "DATASETAUXDATA MicrometersPerPixelX=\"0.5\" DATASETAUXDATA OriginInImageX=\"30\" DATASETAUXDATA \
                  OriginInImageY=\"20\" DATASETAUXDATA MicrosecondsPerDeltaT=\"20000\"";
    let tecplot = "# PIVlab by W.Th. & E.J.S., TECPLOT output\n# FRAME: 2, filenames: a & b, conversion factor xy (px -> m): 1, \
                   conversion factor uv (px/frame -> m/s): 1\n# x [px] y [px] u [px/frame] v [px/frame] isNaN?\n\
                   TITLE = \"PIVlab frame: 2\"\nVARIABLES = \"x\", \"y\", \"u\", \"v\", \"isNaN\"\nZONE I=11, J=9, K=1, F=POINT, T=\"2\"";
    let davis = |length: &str, quantity: &str| {
        format!(
            "#DaVis 8.4.0 2D-vector 8 9 11 \"position\" \"{length}\" \"position\" \"{length}\" {quantity}"
        )
    };
    let cases = [
        ("openpiv px", openpiv(1.0, 1.0, false), NONE),
        ("openpiv up", openpiv(1.0, 1.0, true), UP),
        ("openpiv m, m/s, up", openpiv(m, m_s, true), Conventions { y_up: Some(true), ..both }),
        ("openpiv mm, mm/s", openpiv(1e3 * m, 1e3 * m_s, false), both),
        ("openpiv um per frame", openpiv(UM, UM, false), scale),
        ("openpiv px/s", openpiv(1.0, 1.0 / DT, false), Conventions { dt_s: Some(DT), ..NONE }),
        ("pivlab px", pivlab(["px", "px/frame"], Some([1.0; 2]), all(1.0, 1.0)), NONE),
        ("pivlab m/s", pivlab(["m", "m/s"], Some([m, m_s]), all(m, m_s)), NONE),
        ("pivlab m/frame", pivlab(["m", "m/frame"], Some([m, m]), all(m, m)), NONE),
        ("pivlab without factors", pivlab(["m", "m/s"], None, all(m, m_s)), NONE),
        (
            "pivlab up",
            pivlab(["m", "m/s"], Some([m, m_s]), |[x, y, u, v]| {
                vec![m * x, m * (HEIGHT - y), m_s * u, -m_s * v, 1.0, 0.0, 0.1 * m_s]
            }),
            UP,
        ),
        (
            "pivlab to the left",
            pivlab(["m", "m/s"], Some([m, -m_s]), |[x, y, u, v]| {
                vec![m * (WIDTH - x), m * y, -m_s * u, m_s * v, 1.0, 0.0, 0.1 * m_s]
            }),
            NONE,
        ),
        (
            "pivlab px to the left",
            pivlab(["px", "px/frame"], Some([1.0, -1.0]), |[x, y, u, v]| {
                vec![WIDTH - x, y, -u, v, 1.0, 0.0, 0.1]
            }),
            NONE,
        ),
        ("pivlab tecplot", table(tecplot, " ", |[x, y, u, v]| vec![x, y, u, v, 0.0]), NONE),
        (
            "insight px",
            table(
                &insight("\"X pixel\", \"Y pixel\", \"U pixel\", \"V pixel\"", ""),
                ", ",
                |[x, y, u, v]| vec![x - 1.0, y - 1.0, u, v, 1.0],
            ),
            NONE,
        ),
        (
            "insight mm",
            table(&insight("\"X mm\", \"Y mm\", \"U m/s\", \"V m/s\"", scales), ", ", |[x, y, u, v]| {
                vec![1e3 * m * (x - 31.0), 1e3 * m * (y - 21.0), m_s * u, m_s * v, 1.0]
            }),
            NONE,
        ),
        (
            "davis mm",
            table(&davis("mm", "\"velocity\" \"m/s\""), "\t", |[x, y, u, v]| {
                vec![1e3 * m * (x - 1.0), 1e3 * m * (y - 1.0), m_s * u, m_s * v]
            }),
            NONE,
        ),
        (
            "davis px",
            table(&davis("pixel", "\"displacement\" \"pixel\""), "\t", |[x, y, u, v]| {
                vec![x - 1.0, y - 1.0, u, v]
            }),
            NONE,
        ),
    ];
    for (name, text, given) in cases {
        let score = scored("f.txt", &text, given);
        // Nine decimals of positions in m, and bilinear interpolation of a linear flow.
        assert!(rms(&score) < 1e-6, "{name}: {} {:?}", rms(&score), score.hints);
        assert!(score.hints.is_empty(), "{name}: {:?}", score.hints);
        if name.starts_with("pivlab") && !name.contains("tecplot") {
            let claimed = score.field.unwrap().main.uncertainty.u.unwrap().bins[0].claimed_rms;
            assert!((claimed - 0.1).abs() < 1e-6, "{name}: {claimed}");
            assert!(score.assumptions.iter().any(|a| a == "columns not used: vorticity"), "{name}");
        }
    }
}

/// The options that a hint names give the error that it promises.
#[test]
fn hints_promise_what_their_options_give() {
    let (m, m_s) = (1e-6 * UM, 1e-6 * UM / DT);
    let both = Conventions { um_per_px: Some(UM), dt_s: Some(DT), ..NONE };
    let pivlab_up = pivlab(["m", "m/s"], Some([m, m_s]), |[x, y, u, v]| {
        vec![m * x, m * (HEIGHT - y), m_s * u, -m_s * v, 1.0, 0.0, 0.1 * m_s]
    });
    let noisy = |text: String| text.replace("1.060000000e0", "1.300000000e0");
    for (text, question, options, given) in [
        (noisy(openpiv(1.0, 1.0, true)), "y grows upward?", "--y up", UP),
        (pivlab_up, "y grows upward?", "--y up", UP),
        (openpiv(m, m_s, false), "x and y in m, u and v in m/s?", "--um-per-px 0.5 --dt 0.02", both),
        (
            openpiv(1e3 * m, 1e3 * m_s, false),
            "x and y in mm, u and v in mm/s?",
            "--um-per-px 0.5 --dt 0.02",
            both,
        ),
        (
            openpiv(1.0, 1.0 / DT, false),
            "u and v in px/s?",
            "--dt 0.02",
            Conventions { dt_s: Some(DT), ..NONE },
        ),
        (
            openpiv(m, m_s, true),
            "x and y in m, u and v in m/s; y grows upward?",
            "--um-per-px 0.5 --dt 0.02 --y up",
            Conventions { y_up: Some(true), ..both },
        ),
        (
            table("# x\ty\tu\tv\tflags\tmask", "\t", |[x, y, u, v]| vec![x - 1.0, y - 1.0, u, v, 0.0, 0.0]),
            "positions off by +1 px?",
            "--origin center0",
            Conventions { origin: Some(Origin::Center0), ..NONE },
        ),
    ] {
        let found = scored("f.txt", &text, NONE);
        let hint = found.hints.iter().find(|hint| hint.question == question);
        let hint = hint.unwrap_or_else(|| panic!("{question}: {:?}", found.hints));
        assert!(hint.what.ends_with(options), "{}", hint.what);
        let then = scored("f.txt", &text, given);
        // Origins are promised by the errors of inliers; here all are.
        assert!((rms(&then) - hint.rms_px.unwrap()).abs() < 1e-6, "{question}: {} {hint:?}", rms(&then));
        assert!(!then.hints.iter().any(|hint| hint.question == question), "{question}: {:?}", then.hints);
    }
    // Another time between frames than the dataset's.
    let found = scored("f.txt", &openpiv(1e3 * m, 250.0 * m_s, false), NONE).hints.remove(0);
    assert!(found.what.ends_with("px; --um-per-px 0.5 --dt 0.08"), "{found:?}");
    let text = table(
        "#DaVis 8.4.0 2D-vector 8 9 11 \"position\" \"mm\" \"position\" \"mm\" \"velocity\" \"m/s\"",
        "\t",
        |[x, y, u, v]| vec![1e3 * m * (x - 1.0), 1e3 * m * (y - 1.0), 0.25 * m_s * u, 0.25 * m_s * v],
    );
    let found = scored("f.txt", &text, NONE).hints.remove(0);
    assert!(found.what.ends_with("px; --dt 0.08") && found.rms_px < Some(1e-6), "{found:?}");
    // An origin of its own within the image.
    let own = pivlab(["m", "m/frame"], Some([m, m]), |[x, y, u, v]| {
        vec![m * (x + 4.6), m * y, m * u, m * v, 1.0, 0.0, 0.1]
    });
    let found = scored("f.txt", &own, NONE).hints.remove(0);
    assert!(found.question.contains("an origin of their own"), "{found:?}");
    assert!(found.what.ends_with("; --shift -4.6 0") && found.argument == "shift_px=(-4.6, 0)", "{found:?}");
    let then = scored("f.txt", &own, Conventions { shift_px: [-4.6, 0.0], ..NONE });
    assert!((rms(&then) - found.rms_px.unwrap()).abs() < 1e-6 && then.hints.is_empty(), "{found:?}");
    // Damped displacements are no unit.
    let damped = scored("f.txt", &openpiv(1.0, 0.5, false), NONE).hints;
    assert!(!damped.iter().any(|hint| hint.question.contains("u and v")), "{damped:?}");
    // Without an option: what to write.
    let sign = table("# x\ty\tu\tv\tflags\tmask", "\t", |[x, y, u, v]| vec![x, y, u, -v, 0.0, 0.0]);
    let hints = scored("f.txt", &sign, NONE).hints;
    assert!(hints[0].question == "v has the wrong sign?" && hints[0].rms_px < Some(1e-6), "{hints:?}");
}

#[test]
fn files_are_image_pairs() {
    let text = openpiv(1.0, 1.0, false);
    let files = |names: &[&'static str]| names.iter().map(|name| (*name, text.clone())).collect::<Vec<_>>();
    let two = files(&["f2.txt", "f10.txt"]);
    let pairs =
        |score: &Score| score.field.as_ref().map(|field| (field.n_total, field.n_pairs_missing)).unwrap();
    for given in [".", "f*.txt"] {
        let score = score_of(&two, given, NONE).unwrap();
        assert_eq!((pairs(&score), score.warnings.len()), ((198, 0), 0));
        assert!(score.assumptions.iter().any(|a| a.contains("f2.txt to f10.txt")), "{:?}", score.assumptions);
    }
    let of = |pair| Conventions { pair: Some(pair), ..NONE };
    // One file: the first pair, and a question.
    let one = scored("f.txt", &text, NONE);
    assert_eq!(pairs(&one), (99, 1));
    assert!(one.warnings[0].contains("--pair all for a field of all pairs"), "{:?}", one.warnings);
    let second = scored("f.txt", &text, of(PairChoice::First(1)));
    assert_eq!((pairs(&second), second.warnings.len()), ((99, 1), 1));
    let ensemble = scored("f.txt", &text, of(PairChoice::All));
    assert_eq!((pairs(&ensemble), ensemble.warnings.len()), ((99, 0), 0));
    let half = |score: &Score| score.field.as_ref().unwrap().nodes.covered.unwrap();
    assert!((half(&ensemble) - 2.0 * half(&one)).abs() < 1e-12);
    // PIVlab states the number of the pair.
    let stated = pivlab(["px", "px/frame"], Some([1.0; 2]), |[x, y, u, v]| vec![x, y, u, v, 1.0, 0.0, 0.1]);
    let stated = scored("f.txt", &stated, NONE);
    assert!(stated.warnings.len() == 1 && stated.assumptions.iter().any(|a| a.contains("FRAME: 2")));
    let said =
        |files: &[(&str, String)], pair| score_of(files, ".", Conventions { pair, ..NONE }).unwrap_err();
    let three = files(&["a.txt", "b.txt", "c.txt"]);
    assert!(said(&three, None).contains("3 files of a field for 2 image pairs"), "{}", said(&three, None));
    assert!(said(&two, Some(PairChoice::All)).contains("the result has 2 files"));
    assert!(said(&files(&["a.txt", "b.dat"]), None).contains("several kinds"));
    assert!(said(&files(&["a.png"]), None).contains("no results"));
    assert!(
        said(&[("a.csv", "frame,track,x_px,y_px\n0,0,1,1\n".to_owned())], None)
            .contains("particles in several")
    );
}

#[test]
fn places_of_vectors_are_distinct_and_in_the_image() {
    let text = openpiv(1.0, 1.0, false);
    let first = text.lines().nth(1).unwrap();
    let said = |text: String, given| score_of(&[("f.txt", text)], "f.txt", given).unwrap_err();
    let twice = said(format!("{text}{first}\n"), NONE);
    assert!(twice.contains("f.txt:101: a second vector at (8, 10) px"), "{twice}");
    // An origin of its own.
    let m = 1e-6 * UM;
    let own = pivlab(["m", "m/frame"], Some([m, m]), |[x, y, u, v]| {
        vec![m * (x - 60.0), m * y, m * u, m * v, 1.0, 0.0, 0.1]
    });
    assert!(said(own.clone(), NONE).contains("an origin of its own (--shift, in Python shift_px)"));
    let moved = scored("f.txt", &own, Conventions { shift_px: [60.0, 0.0], ..NONE });
    assert!(rms(&moved) < 1e-6 && moved.assumptions[0].contains("; shifted by (60, 0) px"), "{moved:?}");
    let px = said(text.clone(), Conventions { um_per_px: Some(UM), ..NONE });
    assert!(px.contains("beyond the image in m, mm and um"), "{px}");
    // Rounding of positions does not make a grid into scattered vectors.
    let jitter = table("# x\ty\tu\tv\tflags\tmask", "\t", |[x, y, u, v]| {
        vec![x + 1e-7 * (37.0 * y).sin(), y + 1e-7 * (53.0 * x).cos(), u, v, 0.0, 0.0]
    });
    let covered = |text: &str| scored("f.txt", text, NONE).field.unwrap().nodes.covered;
    assert_eq!(covered(&jitter), covered(&text));
    assert!(covered(&text) > Some(0.49));
}
