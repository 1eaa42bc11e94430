//! The particles of a scan that are fitted: windows around them, with masks of what neighbors light.

use microsig_core::Settings;
use microsig_core::optics::FieldOptics;

use super::frames::Frames;
use super::local::{FOCUS, Instrument, Local, NA};
use super::particle::{self, Subject};
use super::{distance, evenly, median};
use crate::particles::{self, Candidate, Window};
use crate::scan::Scan;
use storage::error::{Error, Result};

/// Number of planes that are used.
const PLANES: usize = 17;

/// Up to `most` particles to fit, nearest to the center first and spread over the field, chosen from the first `fitted`
/// candidates; and the number of candidates that can be fitted.
pub(super) fn of<'a>(
    scan: &Scan,
    frames: &'a Frames,
    instrument: &'a Instrument,
    (candidates, fitted): (&[Candidate], usize),
    half: usize,
    most: usize,
) -> Result<(Vec<Subject<'a>>, usize)> {
    let settings = Settings {
        pixel_dim_x: scan.width as u32,
        pixel_dim_y: scan.height as u32,
        ..instrument.settings.clone()
    };
    let subject = |window: Window| {
        let [x, y] = FieldOptics::place(&settings, window.column as f64 + 1.0, window.row as f64 + 1.0);
        let r = libm::hypot(x, y);
        Subject {
            instrument,
            frames,
            noise: frames.noise,
            window,
            half,
            planes: evenly(frames.planes.len(), PLANES),
            place_mm: [x, y],
            toward: if r > 0.0 { [x / r, y / r] } else { [1.0, 0.0] },
            masks: Vec::new(),
        }
    };
    let (windows, [cut, saturated]) = windows(scan, &candidates[..fitted], half);
    let mut all: Vec<Subject> = windows.into_iter().map(subject).collect();
    let rough = rough(&all, candidates);
    for subject in &mut all {
        let masks = subject.planes.iter().map(|plane| mask(subject, candidates, *plane, &rough));
        subject.masks = masks.collect();
    }
    let uncut = all.len();
    all.retain(Subject::is_clear);
    if all.is_empty() {
        return Err(Error::option(particles::smaller(format!(
            "none of {} particles can be used with windows of {2} x {2} px ({cut} cut by the edge of the image, {saturated} saturated, \
             {} too close to others): ",
            fitted,
            uncut,
            2 * half + 1
        ))));
    }
    let radius = |subject: &Subject| distance(subject.place_mm, [0.0; 2]);
    all.sort_by(|a, b| radius(a).total_cmp(&radius(b)));
    let found = all.len();
    let kept = spread_out(&all.iter().map(|subject| subject.place_mm).collect::<Vec<_>>(), most);
    let mut number = 0..;
    all.retain(|_| number.next().is_some_and(|k| kept.binary_search(&k).is_ok()));
    Ok((all, found))
}

/// Windows around all particles that are far enough from the edge and not saturated, and the numbers of those
/// that are cut by the edge and saturated.
fn windows(scan: &Scan, candidates: &[Candidate], half: usize) -> (Vec<Window>, [usize; 2]) {
    let reach = half as isize;
    let pixels = |column: usize, row: usize| -> Vec<(usize, [f64; 2])> {
        let offsets = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)));
        let at = |(dx, dy): (isize, isize)| {
            (row as isize + dy) as usize * scan.width + (column as isize + dx) as usize
        };
        offsets.map(|(dx, dy)| (at((dx, dy)), [dx as f64, dy as f64])).collect()
    };
    let mut windows = Vec::new();
    let (mut cut, mut saturated) = (0, 0);
    for candidate in candidates {
        let (column, row) = (candidate.x.round() as usize, candidate.y.round() as usize);
        if column < half || row < half || column + half >= scan.width || row + half >= scan.height {
            cut += 1;
            continue;
        }
        let window = Window::new([column, row], pixels(column, row));
        let full = |plane: &Vec<u16>| {
            let full = window.pixels.iter().filter(|(at, _)| plane[*at] >= scan.full_scale);
            full.count() >= particles::SATURATED_PIXELS
        };
        if scan.planes.iter().any(full) {
            saturated += 1;
            continue;
        }
        windows.push(window);
    }
    (windows, [cut, saturated])
}

/// How large images are: stage position in focus (um) and growth (px/um).
struct Rough {
    focus_um: f64,
    growth: f64,
}

/// From the moments of the particles that have no neighbors, or of all.
fn rough(subjects: &[Subject], candidates: &[Candidate]) -> Rough {
    let alone =
        |subject: &&Subject| neighbors(&subject.window, candidates, 2.0 * subject.half as f64).is_empty();
    let mut usable: Vec<&Subject> = subjects.iter().filter(alone).collect();
    if usable.is_empty() {
        usable = subjects.iter().collect();
    }
    let starts: Vec<Local> = usable.into_iter().map(particle::start).collect();
    let of = |quantity: usize| median(starts.iter().map(|start| start[quantity]).collect());
    let na = of(NA);
    let per_px = subjects.first().map_or(1.0, |subject| subject.instrument.px_per_um());
    Rough { focus_um: of(FOCUS), growth: na / libm::sqrt(1.0 - na * na) * per_px }
}

/// Offsets of other particles within a distance of the middle of a window, px.
fn neighbors(window: &Window, candidates: &[Candidate], within: f64) -> Vec<[f64; 2]> {
    let offset = |other: &Candidate| [other.x - window.column as f64, other.y - window.row as f64];
    let near = |[x, y]: &[f64; 2]| (OWN..within).contains(&libm::hypot(*x, *y));
    candidates.iter().map(offset).filter(near).collect()
}

/// Distance within which a maximum is the particle's own, px.
const OWN: f64 = 2.0;

/// Radius of images in focus, and margin around geometric images, px.
const MARGIN_PX: f64 = 4.0;

/// The pixels of a window to which no neighbor gives light in a plane.
fn mask(subject: &Subject, candidates: &[Candidate], plane: usize, rough: &Rough) -> Vec<bool> {
    let defocus_um = (subject.frames.stage_um[plane] - rough.focus_um).abs();
    let radius = defocus_um * rough.growth + MARGIN_PX;
    let others = neighbors(&subject.window, candidates, 2.0 * subject.half as f64 + radius);
    let is_clear =
        |&(_, [dx, dy]): &(usize, [f64; 2])| others.iter().all(|[x, y]| libm::hypot(dx - x, dy - y) > radius);
    subject.window.pixels.iter().map(is_clear).collect()
}

/// So many places that cover the field: each next one is that farthest from those before.
fn spread_out(places: &[[f64; 2]], most: usize) -> Vec<usize> {
    let mut kept: Vec<usize> = Vec::new();
    let mut left: Vec<usize> = (0..places.len()).collect();
    while kept.len() < most && !left.is_empty() {
        let apart =
            |i: usize| kept.iter().map(|k| distance(places[*k], places[i])).fold(f64::INFINITY, f64::min);
        let next = if kept.is_empty() {
            0
        } else {
            (0..left.len()).max_by(|a, b| apart(left[*a]).total_cmp(&apart(left[*b]))).unwrap_or(0)
        };
        kept.push(left.remove(next));
    }
    kept.sort_unstable();
    kept
}
