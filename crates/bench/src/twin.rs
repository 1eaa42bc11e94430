//! The digital twin of a recording: images of particles like the recorded ones, with known positions, on which trackers run as
//! on the recording.
//!
//! The twin is generated with the optics of a scenario, imported with a twin of its calibration scan, tracked and scored
//! like the recording.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use arena::report::{OnBoth, TrackerScores, TwinAbout, twin_page};
use fit::StagePositions;
use generator::runner::{GenerateOptions, generate};
use import::{ImportOptions, import};
use microsig_core::formats::tiff::{self, PixelScale};
use microsig_core::render::Context;
use microsig_core::sensor::{Counts, Image};
use microsig_core::stream::{Purpose, Streams};
use scenario::{Assignment, Scenario};
use scoring::evaluate::{EvaluateOptions, Evaluation, evaluate_files};
use scoring::results::{self, Conventions, TrackerResult};
use serde::Serialize;
use storage::dataset::manifest::{Manifest, RECORDING};
use storage::dataset::{
    CalibrationRow, DatasetPlace, FrameRow, PlaneRow, RecordingFacts, Row, ScanParticleRow, TrackRow,
    read_rows,
};
use storage::error::{Error, Result};
use storage::{InputFile, Progress};
use tracking::{GrayImage, METHODS, TrackOptions, track};

/// The page and the numbers.
const PAGE: &str = "report.html";
const NUMBERS: &str = "twin.json";

/// Scan particles this close to a known position are the same, px.
const SAME_PX: f64 = 3.0;

/// Number of particles whose median light is that of a single one in their surroundings.
const AROUND: usize = 9;

/// Most particles of a cluster, which touch on a hexagonal lattice.
const MOST_IN_CLUSTER: usize = 37;

/// Track numbers of particles that the scan does not contain.
const OTHERS: u64 = 10_000_000;

/// Share of the depth range about the focus in which images hardly depend on depth.
const NEAR: f64 = 0.1;

/// Variance of rounding to whole counts, which the twin does itself.
const ROUNDING: f64 = 1.0 / 12.0;

/// Frames in the report, and edge of their parts, px.
const SHOWN: usize = 5;
const EDGE: usize = 200;

/// A tracker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TwinTracker {
    /// One of microsig's.
    Method(&'static str),
    /// A command of the shell with `{images}` (or `{dataset}`) and `{out}`.
    Command(String),
}

impl TwinTracker {
    /// Reads a list: names of methods, the last of which may be a command, which may contain commas.
    ///
    /// # Errors
    /// A text that is neither a method nor a command with `{out}`.
    pub fn list(text: &str) -> std::result::Result<Vec<Self>, String> {
        let (first, rest) = text.split_once(',').map_or((text, None), |(first, rest)| (first, Some(rest)));
        if let Some(method) = METHODS.iter().find(|method| method.name == first.trim()) {
            let mut all = vec![TwinTracker::Method(method.name)];
            all.extend(rest.map_or(Ok(Vec::new()), Self::list)?);
            return Ok(all);
        }
        let has_images = text.contains("{images}") || text.contains("{dataset}");
        if has_images && text.contains("{out}") {
            return Ok(vec![TwinTracker::Command(text.to_owned())]);
        }
        let names: Vec<&str> = METHODS.iter().map(|method| method.name).collect();
        Err(format!(
            "expected one of {}, or a command with {{images}} (a folder) or {{dataset}} (the recording's folder), and {{out}} (a CSV file)",
            names.join(", ")
        ))
    }

    fn name(&self) -> &str {
        match self {
            TwinTracker::Method(name) => name,
            TwinTracker::Command(_) => "your tracker",
        }
    }
}

/// Options of [`twin`].
#[derive(Debug)]
pub struct TwinOptions {
    /// The folder of the recording.
    pub recording: PathBuf,
    /// A scenario with its optics and camera, such as `microsig fit --field` writes.
    pub optics: InputFile,
    /// Trackers to run; if empty, `ncc`, and `mle` if the recording has optics.
    pub run: Vec<TwinTracker>,
    /// The folder to write.
    pub out: PathBuf,
    /// Whether to replace an earlier one.
    pub force: bool,
    /// Seed of the twin's random numbers.
    pub seed: u64,
    /// Progress display.
    pub progress: Progress,
    /// Where renderers keep their tables.
    pub context: Context,
}

/// What was made.
#[derive(Debug, Serialize)]
pub struct Twinned {
    /// The folder.
    pub out: PathBuf,
    /// The scores of each tracker on both.
    pub trackers: Vec<TrackerScores>,
    /// How the twin was made, and what it does not show.
    pub notes: Vec<String>,
    /// Warnings.
    #[serde(skip)]
    pub warnings: Vec<String>,
}

struct Recorded {
    place: PathBuf,
    manifest: Manifest,
    facts: RecordingFacts,
    frames: usize,
    size: (u32, u32),
    /// Depths of the calibration scan, without repetitions; none without a scan.
    depths_um: Vec<f64>,
    /// Position of the stage at z = 0 of the optics.
    zero_um: f64,
    planes: Vec<PlaneRow>,
    known: Vec<TrackRow>,
    /// Columns of the table of known particles.
    has_tracks: bool,
    scan: Vec<ScanParticleRow>,
    /// Mean and standard deviation of the background of the first frame, counts.
    background: [f64; 2],
    /// The same of the scan.
    scan_background: [f64; 2],
    /// What varies over the first frame's background, counts.
    uneven: Vec<f32>,
}

fn rows_if_any<T: Row>(folder: &Path, needed: &[&str]) -> Result<Vec<T>> {
    if folder.join(T::PATH).exists() { read_rows(folder, needed) } else { Ok(Vec::new()) }
}

impl Recorded {
    fn read(folder: &Path) -> Result<Self> {
        let facts = RecordingFacts::read(folder)?;
        let manifest = Manifest::read(folder)?;
        let name = folder.display();
        if manifest.microsig.kind.as_deref() != Some(RECORDING) {
            return Err(Error::input(format!(
                "{name}: expected a recording, as `microsig import` makes it; this is a dataset"
            )));
        }
        let Some((width, height)) = facts.sensor_px else {
            return Err(Error::input(format!("{name}: the manifest lacks the size of the images")));
        };
        let size = (width as u32, height as u32);
        let rows: Vec<CalibrationRow> = rows_if_any(folder, &["step", "z_um"])?;
        let mut depths_um: Vec<f64> = rows.iter().map(|row| row.z_um).collect();
        depths_um.sort_by(f64::total_cmp);
        depths_um.dedup();
        let scan: Vec<ScanParticleRow> = rows_if_any(folder, &["x_px", "y_px", "light"])?;
        if !depths_um.is_empty() && scan.is_empty() {
            return Err(Error::input(format!(
                "{name}: {} is missing; import the recording again",
                ScanParticleRow::PATH
            )));
        }
        let place = DatasetPlace::from(folder);
        let zero_um = if depths_um.is_empty() {
            0.0
        } else {
            tracking::zero_um(&place).map_err(|e| {
                Error::input(format!(
                    "{name}: {e}; import the recording with --optics, so that z = 0 of the optics is known"
                ))
            })?
        };
        let known: Vec<TrackRow> = rows_if_any(folder, &["frame", "x_px", "y_px"])?;
        let header = manifest.resource(TrackRow::PATH).and_then(|table| table.schema.as_ref());
        let has = |column: &str| {
            header.is_some_and(|schema| schema.fields.iter().any(|field| field.name == column))
        };
        let frames: Vec<FrameRow> = read_rows(folder, &["frame", "image"])?;
        let Some(first) = frames.first() else { return Err(Error::input(format!("{name}: no frames"))) };
        let first = gray(&place, &first.image, size)?;
        let mut background = <[f32; 2]>::from(first.background()).map(f64::from);
        let mut scan_background = background;
        if let Some(noise) = &manifest.microsig.noise {
            // Over time, which is finer than the deviation over pixels: that of whole counts is whole counts.
            let variance = |signal: f64| noise.variance.iter().rev().fold(0.0, |sum, c| sum * signal + c);
            let deviation = |signal: f64| (variance(signal) - ROUNDING).max(0.0).sqrt();
            scan_background = [noise.background_counts, deviation(0.0)];
            if noise.repeats > 1 {
                background[1] = deviation((background[0] - noise.background_counts).max(0.0));
            }
        }
        Ok(Recorded {
            place: folder.to_owned(),
            frames: frames.len(),
            size,
            depths_um,
            zero_um,
            planes: rows_if_any(folder, &["frame", "z_um"])?,
            // Without depths, positions do not tell what to draw.
            known: if has("z_um") { known } else { Vec::new() },
            has_tracks: has("track"),
            scan,
            background,
            scan_background,
            uneven: first.unevenness(),
            manifest,
            facts,
        })
    }

    fn all_particles(&self) -> bool {
        self.facts.has_all_particles
    }

    /// Planes across each side of the field of view with a calibration stack, and most particles of a stack.
    fn stacks(&self) -> (usize, usize) {
        let places = &self.manifest.microsig.calibration_places;
        let last = places.iter().map(|place| place.place).max().unwrap_or(0);
        let side = (1..=ImportOptions::LARGEST_FIELD).find(|n| (n * n) as u32 > last);
        let particles = places.iter().filter_map(|place| place.particles).max();
        (side.unwrap_or(1), particles.map_or(ImportOptions::PARTICLES, |n| n as usize))
    }
}

fn gray(place: &DatasetPlace, path: &str, size: (u32, u32)) -> Result<GrayImage> {
    let image = place.image(path, size)?;
    Ok(GrayImage {
        width: size.0 as usize,
        height: size.1 as usize,
        counts: image.whole().iter().map(|count| f32::from(*count)).collect(),
    })
}

/// A particle or cluster of the twin in a frame, in the coordinates of the recording.
#[derive(Debug, Clone, Copy)]
struct Center {
    frame: u32,
    id: u64,
    at: [f64; 2],
    z_um: f64,
    light: Light,
}

/// The light of a particle or cluster.
#[derive(Debug, Clone, Copy)]
struct Light {
    /// In units of the mean single particle in the center of the field.
    light: f64,
    /// Number of touching spheres.
    spheres: usize,
}

/// The brightness of the particles of the scan.
struct Lights {
    scan: Vec<([f64; 2], Light)>,
    streams: Streams,
}

impl Lights {
    fn of(recorded: &Recorded, base: &Scenario, seed: u64) -> Self {
        // What the optics do to the light is not the particles'.
        let per_mm2 = base.spec.optics.field.map_or(0.0, |field| field.light_per_mm2);
        let mm_per_px = 1e-3 * um_per_px(recorded, base);
        let middle = [recorded.size.0, recorded.size.1].map(|size| 0.5 * f64::from(size) + 0.5);
        let of = |row: &ScanParticleRow| {
            let r = mm_per_px * (row.x_px - middle[0]).hypot(row.y_px - middle[1]);
            let shade = (1.0 + per_mm2 * r * r).max(0.05);
            ([row.x_px, row.y_px], Light { light: row.light / shade, spheres: 1 })
        };
        let scan = recorded.scan.iter().map(of).collect();
        let mut lights = Lights { scan, streams: Streams::new(seed) };
        let spheres: Vec<usize> = lights.scan.iter().map(|(at, of)| lights.spheres(*at, of.light)).collect();
        lights.scan.iter_mut().zip(spheres).for_each(|((_, of), spheres)| of.spheres = spheres);
        let singles = lights.scan.iter().filter(|(_, of)| of.spheres == 1).map(|(_, of)| of.light);
        let single = singles.clone().sum::<f64>() / singles.count().max(1) as f64;
        lights.scan.iter_mut().for_each(|(_, of)| of.light = (of.light / single).max(0.05));
        lights
    }

    /// The light of a single particle here: illumination is not uniform.
    fn single(&self, at: [f64; 2]) -> f64 {
        let away = |of: &[f64; 2]| (of[0] - at[0]).hypot(of[1] - at[1]);
        let mut near: Vec<(f64, f64)> = self.scan.iter().map(|(of, light)| (away(of), light.light)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(AROUND);
        near.sort_by(|a, b| a.1.total_cmp(&b.1));
        near.get(near.len() / 2).map_or(1.0, |(_, light)| *light)
    }

    /// Number of spheres of a spot.
    fn spheres(&self, at: [f64; 2], light: f64) -> usize {
        ((light / self.single(at)).round() as usize).clamp(1, MOST_IN_CLUSTER)
    }

    /// The nearest particle of the scan.
    fn near(&self, at: [f64; 2]) -> Option<usize> {
        let away = |k: &usize| (self.scan[*k].0[0] - at[0]).hypot(self.scan[*k].0[1] - at[1]);
        (0..self.scan.len()).min_by(|a, b| away(a).total_cmp(&away(b))).filter(|k| away(k) < SAME_PX)
    }

    /// That of a particle of this number here: of any particle of the scan.
    fn drawn(&self, id: u64, at: [f64; 2]) -> Light {
        let mut stream = self.streams.stream(Purpose::Intensity, u32::MAX, id as u32);
        let k = (stream.uniform() * self.scan.len() as f64) as usize;
        let drawn = self.scan.get(k.min(self.scan.len().saturating_sub(1)));
        drawn.map_or(Light { light: 1.0, spheres: 1 }, |(from, of)| Light {
            light: of.light * self.single(at) / self.single(*from),
            ..*of
        })
    }
}

/// The rows of a table of tracks: clusters as touching spheres that share the light.
fn spheres(centers: &[Center], diameter_px: f64, zero_um: f64) -> Vec<TrackRow> {
    let mut lattice: Vec<[f64; 2]> = (-4..=4)
        .flat_map(|i| {
            (-4..=4).map(move |j| [f64::from(i) + 0.5 * f64::from(j), f64::from(j) * 0.75f64.sqrt()])
        })
        .collect();
    let length2 = |[x, y]: &[f64; 2]| ((x * x + y * y) * 1e6).round();
    lattice.sort_by(|a, b| length2(a).total_cmp(&length2(b)));
    let mut rows = Vec::new();
    for center in centers {
        let n = center.light.spheres;
        let part = &lattice[..n];
        let middle = [0, 1].map(|axis| part.iter().map(|at| at[axis]).sum::<f64>() / n as f64);
        // Directions that do not repeat.
        let (sine, cosine) = (center.id as f64 * 2.399_963).sin_cos();
        rows.extend(part.iter().enumerate().map(|(k, at)| {
            let [x, y] = [0, 1].map(|axis| diameter_px * (at[axis] - middle[axis]));
            TrackRow {
                frame: center.frame,
                track: center.id * 100 + k as u64,
                x_px: center.at[0] + cosine * x - sine * y,
                y_px: center.at[1] + sine * x + cosine * y,
                z_um: center.z_um - zero_um,
                c_int: center.light.light / n as f64,
                ..TrackRow::default()
            }
        }));
    }
    rows
}

/// Where the particles of the twin come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    /// Known positions and depths.
    Known,
    /// Those of the scan, at the heights of planes.
    Planes,
    /// What the first tracker found on the recording.
    Found,
    /// The scenario itself.
    Scenario,
}

/// The twin, its scores and its page.
///
/// # Errors
/// A folder that is no recording, or was imported without what the twin needs; an existing folder, unless `force`; a
/// tracker that fails; a twin that cannot be rendered.
pub fn twin(options: &TwinOptions) -> Result<Twinned> {
    let out = &options.out;
    storage::outside_datasets(out)?;
    let is_earlier = out.join(NUMBERS).exists();
    if out.exists() && !storage::folder::is_empty(out) && !(options.force && is_earlier) {
        return Err(Error::exists(out));
    }
    let recorded = Recorded::read(&options.recording)?;
    let base = scenario::load(options.optics.clone(), &[], None, &options.context)?;
    let has_scan = !recorded.depths_um.is_empty();
    let trackers = match options.run.is_empty() {
        true => {
            let mle = recorded.manifest.microsig.renderer.is_some();
            [Some("ncc"), mle.then_some("mle")].into_iter().flatten().map(TwinTracker::Method).collect()
        }
        false => options.run.clone(),
    };
    std::fs::create_dir_all(out).map_err(Error::write(out))?;
    let mut warnings = Vec::new();
    let under_way = options.progress.spinner("twin");
    // On the recording: those that need a calibration cannot run without a scan.
    let mut of_recording = Vec::new();
    for (k, tracker) in trackers.iter().enumerate() {
        let can_run = has_scan || !matches!(tracker, TwinTracker::Method("ncc" | "mle" | "aptv"));
        under_way.set_message(format!("{} on the recording", tracker.name()));
        let result = can_run
            .then(|| run(tracker, k, &recorded.place, "recorded", options, &mut warnings))
            .transpose()?;
        of_recording.push(result);
    }
    let source = match () {
        () if !recorded.known.is_empty() => Source::Known,
        () if has_scan && !recorded.planes.is_empty() => Source::Planes,
        () if of_recording.first().is_some_and(Option::is_some) => Source::Found,
        () => Source::Scenario,
    };
    under_way.set_message("images of the twin");
    let made = Made::new(&recorded, &base, source, of_recording.first().and_then(Option::as_deref), options)?;
    let place = made.import(&recorded, &base, options, &mut warnings)?;
    let mut both = Vec::new();
    let is_known = !recorded.planes.is_empty() || recorded.place.join(TrackRow::PATH).exists();
    for ((k, tracker), of_recording) in trackers.iter().enumerate().zip(&of_recording) {
        under_way.set_message(format!("{} on the twin", tracker.name()));
        let result = run(tracker, k, &place, "twin", options, &mut warnings)?;
        let score = |folder: &Path, result: &Path| -> Result<Evaluation> {
            evaluate_files(folder, InputFile::from(result), &EvaluateOptions::default())
        };
        let on_recording = match of_recording {
            Some(result) if is_known => Some(score(&recorded.place, result)?),
            _ => None,
        };
        let found = of_recording.as_deref().map(|result| found_points(result, &recorded)).transpose()?;
        both.push(OnBoth {
            tracker: tracker.name().to_owned(),
            recorded: on_recording,
            found_per_frame: found.map(|rows| rows.len() as f64 / recorded.frames as f64),
            twin: score(&place, &result)?,
        });
    }
    under_way.finish();
    let notes = made.notes(&recorded, &base, trackers.first());
    let [low, high] = recorded.facts.depth_um.map_or([-1.0, 1.0], |(low, high)| [low, high]);
    let about = TwinAbout {
        recording: recorded.manifest.name.clone(),
        notes: notes.clone(),
        focus_um: recorded.facts.focus_um.unwrap_or(recorded.zero_um),
        near_um: NEAR * (high - low),
        frames: frames(&recorded, &place)?,
    };
    let (trackers, page) = twin_page(&about, &both)?;
    let twinned = Twinned { out: out.clone(), trackers, notes, warnings };
    storage::save_bytes(&out.join(PAGE), page.as_bytes())?;
    storage::save_bytes(&out.join(NUMBERS), arena::report::json(&twinned)?.as_bytes())?;
    Ok(twinned)
}

/// Runs a tracker on the recording or the twin; returns its result.
fn run(
    tracker: &TwinTracker,
    number: usize,
    folder: &Path,
    of: &str,
    options: &TwinOptions,
    warnings: &mut Vec<String>,
) -> Result<PathBuf> {
    let result = options.out.join(format!(
        "{of}-{}.csv",
        match tracker {
            TwinTracker::Method(name) => (*name).to_owned(),
            TwinTracker::Command(_) => format!("tracker{}", number + 1),
        }
    ));
    match tracker {
        TwinTracker::Method(name) => {
            let options = TrackOptions {
                force: options.force,
                seed: options.seed,
                context: options.context.clone(),
                ..TrackOptions::of(name, options.progress.clone())
            };
            warnings.extend(
                track(folder, result.clone(), &options)?
                    .warnings
                    .into_iter()
                    .map(|w| format!("{of}, {name}: {w}")),
            );
        }
        TwinTracker::Command(text) => {
            if result.exists() {
                std::fs::remove_file(&result).map_err(Error::write(&result))?;
            }
            let quoted = |path: &Path| format!("'{}'", path.display().to_string().replace('\'', r"'\''"));
            let text = text
                .replace("{images}", &quoted(&folder.join("images")))
                .replace("{dataset}", &quoted(folder))
                .replace("{out}", &quoted(&result));
            // Standard output is for the numbers.
            let status = Command::new("sh").arg("-c").arg(&text).stdout(std::io::stderr()).status();
            let status = status.map_err(|e| Error::input(format!("{text}: {e}")))?;
            if !status.success() || !result.exists() {
                let wrote = if result.exists() { "" } else { ", without a result" };
                return Err(Error::Failed(vec![format!("{text}: ended with {status}{wrote}")]));
            }
        }
    }
    Ok(result)
}

fn found_points(result: &Path, recorded: &Recorded) -> Result<Vec<results::TrackRow>> {
    match results::read(InputFile::from(result), &Conventions::default().completed(&recorded.facts))? {
        TrackerResult::Points(points) => Ok(points.rows),
        TrackerResult::Field(_) => {
            Err(Error::input(format!("{}: expected particles, not a field", result.display())))
        }
    }
}

/// The images of the twin before they are imported.
struct Made {
    source: Source,
    /// Particles and clusters.
    centers: Vec<Center>,
    /// Numbers of frames of the scan at each depth.
    repeats: usize,
    is_scatter_left_out: bool,
}

impl Made {
    fn new(
        recorded: &Recorded,
        base: &Scenario,
        source: Source,
        found: Option<&Path>,
        options: &TwinOptions,
    ) -> Result<Self> {
        let lights = Lights::of(recorded, base, options.seed);
        let centers = match source {
            Source::Known => known(recorded, &lights),
            Source::Planes => planes(recorded, &lights, &[]),
            Source::Found => found.map_or(Ok(Vec::new()), |found| found_centers(found, recorded, &lights))?,
            Source::Scenario => Vec::new(),
        };
        let out = &options.out;
        let repeats =
            recorded.manifest.microsig.noise.as_ref().map_or(1, |noise| noise.repeats.max(1) as usize);
        // The film that the scan's particles lie on is not in a flow.
        let scatter = base.spec.optics.field.map_or(0.0, |field| field.focus.scatter_um);
        let is_scatter_left_out = source == Source::Found && scatter > 0.0;
        let mut set = camera(recorded, base, recorded.background, &out.join("background.tif"))?;
        if is_scatter_left_out {
            set.push(("optics.field.focus.scatter_um".to_owned(), "0".to_owned()));
        }
        if source != Source::Scenario {
            let rows = spheres(&centers, diameter_px(recorded, base), recorded.zero_um);
            set.extend(tracks(&out.join("particles.csv"), &rows, recorded.frames, base)?);
        }
        images(&out.join("generated"), set, options)?;
        if !recorded.depths_um.is_empty() {
            let stage = recorded.depths_um.iter().flat_map(|z_um| std::iter::repeat_n(*z_um, repeats));
            let centers: Vec<Center> = stage
                .enumerate()
                .flat_map(|(frame, z_um)| {
                    let center = move |(id, (at, light)): (usize, &([f64; 2], Light))| Center {
                        frame: frame as u32,
                        id: id as u64,
                        at: *at,
                        z_um,
                        light: *light,
                    };
                    lights.scan.iter().enumerate().map(center)
                })
                .collect();
            let rows = spheres(&centers, diameter_px(recorded, base), recorded.zero_um);
            let frames = recorded.depths_um.len() * repeats;
            let background = out.join("scan_background.tif");
            let mut set = camera(recorded, base, recorded.scan_background, &background)?;
            set.extend(tracks(&out.join("scan_particles.csv"), &rows, frames, base)?);
            images(&out.join("generated_scan"), set, options)?;
        }
        Ok(Made { source, centers, repeats, is_scatter_left_out })
    }

    /// Imports the twin like the recording; returns its folder.
    fn import(
        &self,
        recorded: &Recorded,
        base: &Scenario,
        options: &TwinOptions,
        warnings: &mut Vec<String>,
    ) -> Result<PathBuf> {
        let out = &options.out;
        let generated = out.join("generated");
        if recorded.depths_um.is_empty() {
            return Ok(generated);
        }
        let mut truth = Vec::new();
        // The recording's own tables score both.
        if self.source == Source::Known {
            truth.push(InputFile::from(recorded.place.join(TrackRow::PATH)));
        } else {
            let row = |center: &Center| TrackRow {
                frame: center.frame,
                track: center.id,
                x_px: center.at[0],
                y_px: center.at[1],
                z_um: center.z_um,
                ..TrackRow::default()
            };
            let (width, height) = (f64::from(recorded.size.0) + 0.5, f64::from(recorded.size.1) + 0.5);
            let is_inside =
                |row: &TrackRow| (0.5..width).contains(&row.x_px) && (0.5..height).contains(&row.y_px);
            let rows: Vec<TrackRow> = self.centers.iter().map(row).filter(is_inside).collect();
            let file = out.join("known.csv");
            save_tracks(&file, &rows, &[])?;
            truth.push(InputFile::from(file));
        }
        if !recorded.planes.is_empty() {
            truth.push(InputFile::from(recorded.place.join(PlaneRow::PATH)));
        }
        let (field, particles) = recorded.stacks();
        let stage = recorded.depths_um.iter().flat_map(|z_um| std::iter::repeat_n(*z_um, self.repeats));
        let timing = &recorded.manifest.microsig.timing;
        let place = out.join("twin");
        let made = import(
            &place,
            &ImportOptions {
                images: vec![generated.join("images")],
                pages_per_time: None,
                page: None,
                scan: Some(out.join("generated_scan/images")),
                positions: StagePositions::Given(stage.collect()),
                toward_lens: false,
                optics: Some(options.optics.clone()),
                um_per_px: Some(base.scale.um_per_px()),
                dt_s: timing.dt_s(),
                pairs: timing.are_pairs(),
                truth,
                all_particles: self.source != Source::Known || recorded.all_particles(),
                dark: None,
                flat: None,
                field,
                particles,
                window_px: recorded.side_px(),
                copy: false,
                force: options.force,
                progress: options.progress.clone(),
                context: options.context.clone(),
            },
        )?;
        warnings.extend(made.warnings.into_iter().map(|warning| format!("twin: {warning}")));
        Ok(place)
    }

    /// What a reader of the page should know.
    fn notes(&self, recorded: &Recorded, base: &Scenario, first: Option<&TwinTracker>) -> Vec<String> {
        let frames = recorded.frames;
        let per_frame = self.centers.len() as f64 / frames as f64;
        let clusters = self.centers.iter().filter(|center| center.light.spheres > 1).count();
        let share = 100.0 * clusters as f64 / self.centers.len().max(1) as f64;
        let particles = match self.source {
            Source::Known => "at the known positions".to_owned(),
            Source::Planes => {
                "at the positions of the particles of the scan and the known heights".to_owned()
            }
            Source::Found => format!(
                "where {} found them on the recording: what it missed is missing, so the true density is higher, and ghosts are particles",
                first.map_or("the first tracker", TwinTracker::name)
            ),
            Source::Scenario => "of the scenario: nothing is known of the recorded ones".to_owned(),
        };
        let mut notes = vec![match self.source {
            Source::Scenario => format!("The twin has the particles {particles}."),
            _ => format!(
                "The twin has {per_frame:.1} particles or clusters in a frame ({share:.0} % clusters), {particles}; their brightness is that \
                 of the scan's, a spot as bright as n particles is a cluster of n touching spheres. Background: {:.1} counts.",
                recorded.background[0]
            ),
        }];
        if !recorded.planes.is_empty() {
            notes.push("Errors of z are distances from a plane fitted to the points of each height (tilt and height), on both.".to_owned());
        }
        if recorded.depths_um.is_empty() {
            notes.push(
                "No scan: the optics are those of a data sheet. Blur, aberrations, their variation over the field and the scatter of \
                 the focus of particles are unknown unless the scenario has them, so the errors on the recording are larger."
                    .to_owned(),
            );
        } else {
            let scatter = base.spec.optics.field.map_or(0.0, |field| field.focus.scatter_um);
            notes.push(match (self.is_scatter_left_out, scatter > 0.0) {
                (true, _) => format!(
                    "The focus of the scan's particles scatters by {scatter} um, because the film is rough or because particles differ: \
                     a scan cannot tell. Particles of the recording have none here; if they differ, their depths scatter as much."
                ),
                (false, true) => format!("The focus of particles scatters by {scatter} um, as in the scan."),
                (false, false) => "The optics have no scatter of the focus of particles (optics.field.focus.scatter_um): trackers that fit \
                                   the optics are more accurate on the twin than on the recording."
                    .to_owned(),
            });
        }
        notes
    }
}

impl Recorded {
    /// Width of the calibration images, px.
    fn side_px(&self) -> Option<usize> {
        let images = self.manifest.resources.iter().find(|of| of.path.starts_with("calibration/images/"))?;
        images.width_px.map(|width| width as usize)
    }
}

fn diameter_px(recorded: &Recorded, base: &Scenario) -> f64 {
    let [_, d_um, _] = base.diameters_um();
    d_um / um_per_px(recorded, base)
}

fn um_per_px(recorded: &Recorded, base: &Scenario) -> f64 {
    recorded.facts.um_per_px.unwrap_or_else(|| base.scale.um_per_px())
}

/// Positions that are known, with other particles of the same slide.
fn known(recorded: &Recorded, lights: &Lights) -> Vec<Center> {
    let mut used = BTreeSet::new();
    let center = |(number, row): (usize, &TrackRow)| {
        let at = [row.x_px, row.y_px];
        let near = lights.near(at);
        let id = match near {
            _ if recorded.has_tracks => OTHERS + row.track,
            Some(k) if used.insert((row.frame, k)) => k as u64,
            _ => 2 * OTHERS + number as u64,
        };
        let light = near.map_or_else(|| lights.drawn(id, at), |k| lights.scan[k].1);
        Center { frame: row.frame, id, at, z_um: row.z_um, light }
    };
    let mut centers: Vec<Center> = recorded.known.iter().enumerate().map(center).collect();
    let on_slide = centers.iter().filter(|center| lights.near(center.at).is_some()).count();
    if !recorded.all_particles() && !recorded.planes.is_empty() && 2 * on_slide > centers.len() {
        let others = planes(recorded, lights, &centers);
        centers.extend(others);
    }
    centers
}

/// The particles of the scan at the heights of planes, without those that are known.
fn planes(recorded: &Recorded, lights: &Lights, known: &[Center]) -> Vec<Center> {
    let mut centers = Vec::new();
    for plane in &recorded.planes {
        let taken: BTreeSet<usize> =
            known.iter().filter(|of| of.frame == plane.frame).filter_map(|of| lights.near(of.at)).collect();
        let new = (0..lights.scan.len()).filter(|k| !taken.contains(k));
        centers.extend(new.map(|k| {
            let (at, light) = lights.scan[k];
            Center { frame: plane.frame, id: k as u64, at, z_um: plane.z_um, light }
        }));
    }
    centers
}

/// What a tracker found.
fn found_centers(result: &Path, recorded: &Recorded, lights: &Lights) -> Result<Vec<Center>> {
    let rows = found_points(result, recorded)?;
    if rows.is_empty() {
        return Err(Error::input(format!(
            "{}: no particles were found on the recording: nothing is known from which to make a twin",
            result.display()
        )));
    }
    let mut used = BTreeSet::new();
    let center = |(number, row): (usize, &results::TrackRow)| {
        let is_new = row.track >= 0 && used.insert((row.frame, row.track));
        let id = if is_new { OTHERS + row.track as u64 } else { 2 * OTHERS + number as u64 };
        Center {
            frame: row.frame,
            id,
            at: [row.at.x_px, row.at.y_px],
            z_um: row.at.z_um,
            light: lights.drawn(id, [row.at.x_px, row.at.y_px]),
        }
    };
    Ok(rows.iter().enumerate().map(center).collect())
}

/// Size of the images, and mean, unevenness (in a file) and standard deviation of the background.
fn camera(
    recorded: &Recorded,
    base: &Scenario,
    [level, deviation]: [f64; 2],
    file: &Path,
) -> Result<Vec<(String, String)>> {
    let mut set = [("optics.pixel_dim_x", recorded.size.0), ("optics.pixel_dim_y", recorded.size.1)]
        .map(|(path, value)| (path.to_owned(), value.to_string()))
        .to_vec();
    let mut put = |path: &str, value: f64| set.push((path.to_owned(), format!("{value:?}")));
    match &base.spec.sensor {
        Some(sensor) if sensor.maps.is_none() => {
            put("sensor.offset_counts", 0.0);
            put("sensor.read_noise_e", deviation / sensor.gain_counts_per_e);
            let (width, height) = recorded.size;
            let counts = Counts::Unrounded(recorded.uneven.iter().map(|v| level as f32 + v).collect());
            let image = Image { width, height, bits: Image::FLOAT_BITS, counts };
            let scale = PixelScale::um_per_px(um_per_px(recorded, base));
            let mut bytes = std::io::Cursor::new(Vec::new());
            tiff::write(&mut bytes, &image, &scale, &file.display().to_string())?;
            storage::save_bytes(file, bytes.get_ref())?;
            let path = file.canonicalize().map_err(|e| Error::read(file, e))?;
            set.push(("sensor.maps".to_owned(), format!("(offset: {:?})", path.display().to_string())));
        }
        Some(_) => {}
        None => {
            put("optics.background_mean", level);
            put("optics.background_noise", deviation);
        }
    }
    Ok(set)
}

fn save_tracks(file: &Path, rows: &[TrackRow], more: &[&str]) -> Result<()> {
    let columns = [&["frame", "track", "x_px", "y_px", "z_um"], more].concat();
    let table = TrackRow::table(&[]).only(&columns);
    storage::save_bytes(file, (table.header() + &table.text(rows)).as_bytes())
}

/// Writes a table of tracks, and what makes a scenario use it.
fn tracks(file: &Path, rows: &[TrackRow], frames: usize, base: &Scenario) -> Result<Vec<(String, String)>> {
    save_tracks(file, rows, &["c_int"])?;
    let path = file.canonicalize().map_err(|e| Error::read(file, e))?;
    let [_, d_um, _] = base.diameters_um();
    let depths = rows.iter().map(|row| row.z_um);
    let (low, high) =
        (depths.clone().fold(f64::INFINITY, f64::min) - 1.0, depths.fold(f64::NEG_INFINITY, f64::max) + 1.0);
    Ok([
        ("motion", format!("tracks(file: {:?})", path.display().to_string())),
        ("particles", format!("(diameter_um: constant({d_um:?}))")),
        ("boundaries", format!("(z_um: ({low:?}, {high:?}))")),
        ("timing", format!("sequence(frames: {frames}, dt_s: 1)")),
        ("calibration", "none".to_owned()),
    ]
    .map(|(path, value)| (path.to_owned(), value))
    .to_vec())
}

/// Generates the images of the scenario with changes.
fn images(out: &Path, set: Vec<(String, String)>, options: &TwinOptions) -> Result<()> {
    let set: Vec<Assignment> = set.into_iter().map(|(path, value)| Assignment { path, value }).collect();
    let scenario = scenario::load(options.optics.clone(), &set, Some(options.seed), &options.context)?;
    let (force, progress) = (options.force, options.progress.clone());
    generate(&scenario, &GenerateOptions { out: out.to_owned(), force, resume: false, progress })?;
    Ok(())
}

/// Name of a frame, width, and its light in recording and twin.
type ShownFrame = (String, usize, [Vec<f32>; 2]);

/// Some frames of both, as square roots of the counts above the background.
fn frames(recorded: &Recorded, twin: &Path) -> Result<Vec<ShownFrame>> {
    let places = [recorded.place.as_path(), twin];
    let tables: Vec<Vec<FrameRow>> =
        places.iter().map(|place| read_rows(place, &["frame", "image"])).collect::<Result<_>>()?;
    let n = tables.iter().map(Vec::len).min().unwrap_or(0);
    let edge = EDGE.min(recorded.size.0.min(recorded.size.1) as usize);
    let [left, top] = [recorded.size.0, recorded.size.1].map(|size| (size as usize - edge) / 2);
    let heights: BTreeMap<u32, f64> = recorded.planes.iter().map(|row| (row.frame, row.z_um)).collect();
    let shown = (0..SHOWN.min(n)).map(|i| i * (n - 1) / (SHOWN.min(n) - 1).max(1));
    shown
        .map(|frame| {
            let part = |of: usize| -> Result<Vec<f32>> {
                let image = gray(&DatasetPlace::from(places[of]), &tables[of][frame].image, recorded.size)?;
                let (level, _) = image.background();
                let at = |i: usize| image.counts[(top + i / edge) * image.width + left + i % edge];
                Ok((0..edge * edge).map(|i| (at(i) - level).max(0.0).sqrt()).collect())
            };
            let title = heights
                .get(&(frame as u32))
                .map_or(format!("frame {frame}"), |z_um| format!("z = {z_um} um"));
            Ok((title, edge, [part(0)?, part(1)?]))
        })
        .collect()
}
