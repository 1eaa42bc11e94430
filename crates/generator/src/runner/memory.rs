//! A dataset in memory, which can be saved to a folder.

use std::io::Write;
use std::path::Path;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use flows::Frame;
use microsig_core::sensor::{Counts, Image, ImageFormat};
use microsig_core::{Particle, Settings};
use rayon::prelude::*;

use super::cost::Cost;
use super::frames::{self, in_batches};
use super::generate::{GenerateOptions, Generated, assemble, camera, folders};
use crate::dataset::Camera;
use crate::dataset::calibration::CalibrationStack;
use crate::dataset::manifest::{bit_depth, manifest};
use crate::dataset::truth::{FrameTruth, Totals, Truth, depth, field, tracks};
use microsig_core::visibility::DepthScan;
use scenario::{Scenario, ScenarioFlow};
use storage::Progress;
use storage::checksums::Hashing;
use storage::dataset::manifest::{MANIFEST, Manifest, Resource, resource};
use storage::dataset::{
    BoxRow, CalibrationRow, Columns, DatasetInMemory, DepthRow, DisplacementRow, FieldRow, FrameRow, Row,
    Table, TrackRow, TrueFlow,
};
use storage::error::{Error, Result};
use storage::folder::{Earlier, FolderClaim, check_replaceable};

/// A dataset in memory.
#[derive(Debug)]
pub struct MemoryDataset {
    scenario: Arc<Scenario>,
    camera: Camera,
    /// Images of the mean diameter over depth, made when first needed.
    scan: OnceLock<DepthScan>,
    truths: Vec<FrameTruth>,
    counts: Counts,
    /// Made when first needed, as the next.
    calibration: OnceLock<Option<CalibrationStack>>,
    manifest: OnceLock<Manifest>,
}

/// Calibration stacks in memory.
#[derive(Debug)]
pub struct Calibration {
    /// The table `calibration/calibration.csv`.
    pub table: (Table, Columns),
    /// The images of its rows.
    pub images: Vec<Image>,
}

impl MemoryDataset {
    /// Computes all frames of a scenario. Errors: a dataset that does not fit into memory; a trajectory that
    /// cannot be integrated; [`Error::Interrupted`].
    pub fn take(scenario: Scenario, progress: &Progress) -> Result<Self> {
        // Images are kept in memory instead of written to disk.
        let cost = Cost::of(&scenario, Path::new("."))?;
        let (disk_bytes, disk_free_bytes) = (0, None);
        let memory_bytes = cost.memory_bytes + cost.disk_bytes;
        Cost { memory_bytes, disk_bytes, disk_free_bytes, ..cost }.check_resources(&scenario)?;
        let camera = camera(&scenario)?;
        let frames = scenario.recordings.frames() as usize;
        let mut truths = Vec::new();
        let pixels = scenario.settings.pixel_dim_x as usize * scenario.settings.pixel_dim_y as usize;
        // Reserved at once: growing the vector would need twice the memory.
        let mut counts = match scenario.spec.image_format() {
            ImageFormat::Integer => Counts::Whole(Vec::with_capacity(frames * pixels)),
            ImageFormat::Float32 => Counts::Unrounded(Vec::with_capacity(frames * pixels)),
        };
        let truth = Truth::new(&scenario, camera.renderer())?;
        let take = |frame: &Frame, before: Option<&Frame>| {
            let truth = truth.frame(frame, before)?;
            let image = camera.image(&truth.particles, frame.index);
            camera.renderer().shortfall()?;
            Ok((truth, image))
        };
        let add = |taken: Vec<(FrameTruth, Image)>| {
            for (truth, image) in taken {
                truths.push(truth);
                counts.extend(&image.counts);
            }
            Ok(())
        };
        in_batches(&scenario, &truth, progress, take, add)?;
        drop(truth);
        Ok(MemoryDataset {
            scenario: Arc::new(scenario),
            camera,
            scan: OnceLock::new(),
            truths,
            counts,
            calibration: OnceLock::new(),
            manifest: OnceLock::new(),
        })
    }

    /// The scenario of the dataset.
    pub fn scenario(&self) -> &Arc<Scenario> {
        &self.scenario
    }

    /// Warnings of the scenario and of its images.
    pub fn warnings(&self) -> Vec<String> {
        self.scenario
            .warnings
            .iter()
            .cloned()
            .chain(self.camera.renderer().shortfall().ok().flatten())
            .collect()
    }

    /// Counts of all images, an array of shape (frames, rows, columns).
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Numbers of frames, rows and columns.
    pub fn shape(&self) -> [usize; 3] {
        let settings = &self.scenario.settings;
        [self.truths.len(), settings.pixel_dim_y as usize, settings.pixel_dim_x as usize]
    }

    /// Bit depth of the images.
    pub fn bits(&self) -> u8 {
        bit_depth(&self.scenario)
    }

    fn frame(&self, frame: usize) -> Image {
        let (width, height) = (self.scenario.settings.pixel_dim_x, self.scenario.settings.pixel_dim_y);
        let pixels = width as usize * height as usize;
        let counts = self.counts.slice(frame * pixels..(frame + 1) * pixels);
        Image { width, height, bits: self.bits(), counts }
    }

    fn scan(&self) -> Result<&DepthScan> {
        once(&self.scan, || self.scenario.scan_of_mean())
    }

    fn made_manifest(&self) -> Result<Manifest> {
        let (table, mut totals) = (tracks(&self.scenario), Totals::default());
        let mut sum = Hashing::new(std::io::sink());
        let mut hash =
            |text: &str| sum.write_all(text.as_bytes()).map_err(Error::write(Path::new(TrackRow::PATH)));
        hash(&table.header())?;
        for truth in &self.truths {
            totals.add(&Totals::of(truth));
            hash(&table.text(&truth.tracks))?;
        }
        let (_, image) = depth::measure(&self.scenario, self.scan()?)?;
        let images = self
            .truths
            .iter()
            .map(|truth| Resource { path: truth.frame.image.clone(), ..Resource::default() });
        let resources = images.chain([resource(TrackRow::PATH, &sum.fingerprint(), &[table])]).collect();
        Ok(Manifest { resources, ..manifest(&self.scenario, &totals, &image, &[]) })
    }

    /// The tables `truth/frames.csv`, `truth/tracks.csv`, `truth/displacements.csv` and, if the scenario has
    /// it, `truth/boxes.csv`.
    pub fn tables(&self) -> Vec<(Table, Columns)> {
        let truths = self.truths.iter();
        let mut tables = vec![
            by_column(FrameRow::table(&[]), truths.clone().map(|truth| &truth.frame)),
            by_column(tracks(&self.scenario), truths.clone().flat_map(|truth| &truth.tracks)),
            by_column(DisplacementRow::table(&[]), truths.clone().flat_map(|truth| &truth.displacements)),
        ];
        if self.scenario.spec.truth.boxes {
            tables.push(by_column(BoxRow::table(&[]), truths.flat_map(|truth| &truth.boxes)));
        }
        tables
    }

    /// The tables `truth/depth.csv` and, if the scenario has it, `truth/field.csv`.
    pub fn field_tables(&self) -> Result<Vec<(Table, Columns)>> {
        let scan = self.scan()?;
        let (rows, _) = depth::measure(&self.scenario, scan)?;
        let depths = by_column(DepthRow::table(&[]), rows.iter());
        let field = field::in_memory(&self.scenario, scan).map(|(table, rows)| by_column(table, rows.iter()));
        Ok(std::iter::once(depths).chain(field).collect())
    }

    /// The calibration stack before it is rendered, if the scenario has one.
    fn calibration_stack(&self) -> Result<Option<&CalibrationStack>> {
        let make = || CalibrationStack::of(&self.scenario, &self.camera, self.scan()?);
        Ok(once(&self.calibration, make)?.as_ref())
    }

    /// The calibration stack, if the scenario has one. Errors: settings that cannot be rendered;
    /// [`Error::Interrupted`].
    pub fn calibration(&self, progress: &Progress) -> Result<Option<Calibration>> {
        let Some(stack) = self.calibration_stack()? else { return Ok(None) };
        let rows = (0..stack.images()).into_par_iter();
        let images = rows.map(|row| {
            progress.check()?;
            Ok(stack.image(row))
        });
        let table = by_column(stack.table.clone(), stack.rows().iter());
        Ok(Some(Calibration { table, images: images.collect::<Result<_>>()? }))
    }

    /// Writes the dataset: the same files as [`super::generate()`]. Nothing is left behind if writing fails.
    /// Errors: an existing dataset or interrupted run, unless `options.force`; `options.resume`; writing;
    /// [`Error::Interrupted`].
    pub fn save(&self, options: &GenerateOptions) -> Result<Generated> {
        if options.resume {
            return Err(Error::input("a dataset in memory is complete: there is nothing to resume"));
        }
        let start = Instant::now();
        let claim = FolderClaim::take(&options.out)?;
        check_replaceable(&options.out, Earlier::new(MANIFEST, options.force))?;
        let partial = claim.start(true)?;
        folders(&partial)?;
        let (scenario, camera, progress) = (&self.scenario, &self.camera, &options.progress);
        let generated = assemble(partial, scenario, options, (camera, self.scan()?), |partial| {
            frames::write_from_memory(
                partial,
                scenario,
                camera,
                &self.truths,
                |frame| self.frame(frame),
                progress,
            )
        })?;
        Ok(Generated { seconds: start.elapsed().as_secs_f64(), ..generated })
    }
}

impl DatasetInMemory for MemoryDataset {
    fn manifest(&self) -> Result<&Manifest> {
        once(&self.manifest, || self.made_manifest())
    }

    fn frames(&self) -> Vec<FrameRow> {
        self.truths.iter().map(|truth| truth.frame.clone()).collect()
    }

    fn tracks(&self) -> Box<dyn Iterator<Item = &TrackRow> + '_> {
        Box::new(self.truths.iter().flat_map(|truth| &truth.tracks))
    }

    fn boxes(&self) -> Option<Vec<BoxRow>> {
        let rows = || self.truths.iter().flat_map(|truth| truth.boxes.iter().cloned());
        self.scenario.spec.truth.boxes.then(|| rows().collect())
    }

    fn field(&self) -> Result<Option<Vec<FieldRow>>> {
        Ok(field::in_memory(&self.scenario, self.scan()?).map(|(_, rows)| rows))
    }

    fn flow(&self) -> Result<Option<Arc<dyn TrueFlow>>> {
        ScenarioFlow::of(Arc::clone(&self.scenario), Some(self.scan()?))
    }

    fn image(&self, path: &str) -> Result<Option<Image>> {
        if let Some(frame) = self.truths.iter().position(|truth| truth.frame.image == path) {
            return Ok(Some(self.frame(frame)));
        }
        let row = |stack: &CalibrationStack| stack.rows().iter().position(|row| row.image == path);
        Ok(self.calibration_stack()?.and_then(|stack| Some(stack.image(row(stack)?))))
    }

    fn calibration_rows(&self) -> Result<Option<Vec<CalibrationRow>>> {
        Ok(self.calibration_stack()?.map(CalibrationStack::rows))
    }

    fn calibration_settings(&self) -> Result<Option<Settings>> {
        Ok(self.calibration_stack()?.map(|stack| stack.settings.clone()))
    }

    fn calibration_particle(&self, path: &str) -> Result<Option<Particle>> {
        let row = |stack: &CalibrationStack| stack.rows().iter().position(|row| row.particles == path);
        Ok(self.calibration_stack()?.and_then(|stack| stack.particles.get(row(stack)?).copied()))
    }
}

/// The value of a cell, which is made when it is first needed.
fn once<T>(cell: &OnceLock<T>, make: impl FnOnce() -> Result<T>) -> Result<&T> {
    if let Some(made) = cell.get() {
        return Ok(made);
    }
    let made = make()?;
    Ok(cell.get_or_init(|| made))
}

fn by_column<'r, R: Row + 'r>(table: Table, rows: impl Iterator<Item = &'r R> + Clone) -> (Table, Columns) {
    let columns = table.by_column(rows);
    (table, columns)
}
