//! Calibration stacks: one particle, scanned through the depth range; a stack for each size of particles.
//!
//! The particle is on the central pixel of a sensor just large enough for the largest image. Settings and
//! noise are the dataset's, random streams are separate. Depths start at the lower end of the depth
//! range and reach its upper end; they are the same for all sizes. Stacks at several places of the field of
//! view are parts of the dataset's sensor: the renderer draws the particle at its place in the frame.

use microsig_core::formats::tiff::StackPlane;
use microsig_core::formats::{data_file, settings_file};
use microsig_core::sensor::{Image, Sensor};
use microsig_core::{Particle, Settings};
use rayon::prelude::*;
use storage::dataset::manifest::PlaceFacts;
use storage::dataset::rows::{PLACES, SIZES};
use storage::dataset::{CalibrationRow, Row, Table, write_table};

use super::Camera;
use crate::preview::depth_of_field_um;
use microsig_core::visibility::DepthScan;
use scenario::{Scenario, sensor, spec};
use storage::{Error, OutputFolder, Result};

/// The table of stacks of particles of these diameters (um), at several places of the field of view or not.
pub fn table(sizes_um: &[f64], has_places: bool) -> Table {
    let has_sizes = sizes_um.len() > 1;
    let parts: Vec<&str> =
        [(SIZES, has_sizes), (PLACES, has_places)].into_iter().filter(|p| p.1).map(|p| p.0).collect();
    let table = CalibrationRow::table(&parts);
    match (has_sizes, has_places) {
        (false, false) => table,
        (true, false) => table.described(
            "One row per image of the calibration stacks: a single particle of each size, scanned through the depth range.",
        ),
        (_, true) => table.described(
            "One row per image of the calibration stacks: a single particle (of each size) at each of several places of the field of \
             view, scanned through the depth range.",
        ),
    }
}

/// Places of the stacks for the manifest; none if there is one for the whole field of view.
pub fn places(scenario: &Scenario) -> Vec<PlaceFacts> {
    let facts = |(place, [x_px, y_px]): (u32, [f64; 2])| PlaceFacts { place, x_px, y_px, particles: None };
    (0..).zip(scenario.calibrated_px()).map(facts).collect()
}

/// Largest default step between depths, um.
const MAX_STEP_UM: f64 = 2.0;
/// Minimum numbers of default steps in the depth range and in the depth of field: with setting 1, whose depth
/// of field is 7.7 um, steps of 2 um are sufficient.
const MIN_STEPS: f64 = 40.0;
const MIN_STEPS_IN_FOCUS: f64 = 3.75;

/// The step of the stacks, um: as given, or small enough for the depth range and the depth of field of the
/// smallest size.
fn step_um(scenario: &Scenario, sizes_um: &[f64], scan: &DepthScan) -> Result<f64> {
    if let Some(step_um) = scenario.spec.calibration.as_ref().and_then(spec::Calibration::given_step_um) {
        return Ok(step_um);
    }
    let (low, high) = scenario.depth_range_um;
    let mean_um = scenario.diameters_um()[1];
    let field_um = match sizes_um.first() {
        Some(&smallest_um) if smallest_um != mean_um => {
            let scan = scenario.scan(smallest_um, scenario.depth_range_um)?;
            depth_of_field_um(scenario, smallest_um, &scan)?
        }
        _ => depth_of_field_um(scenario, mean_um, scan)?,
    };
    let field_um = field_um.unwrap_or(f64::INFINITY);
    let longest = ((high - low) / MIN_STEPS).min(field_um / MIN_STEPS_IN_FOCUS);
    let mut step_um = MAX_STEP_UM;
    // The lower limit on the step ends the loop if the depth of field is zero.
    while step_um > longest && step_um > 1e-3 * (high - low) {
        step_um *= 0.5;
    }
    Ok(step_um)
}

/// Depths of the stack, um: equal steps from the lower end of the range up to or just beyond its upper end.
fn depths_um((low, high): (f64, f64), step_um: f64) -> Vec<f64> {
    let steps = ((high - low) / step_um).ceil() as u32;
    (0..=steps).map(|k| low + step_um * f64::from(k)).collect()
}

/// The settings of the stack: the dataset's, with a sensor of odd size around the largest image.
fn settings(scenario: &Scenario, camera: &Camera, particles: &[Particle]) -> Settings {
    let largest = particles
        .iter()
        .map(|particle| camera.renderer().image_extent(particle))
        .fold(0.0f64, |largest, (x, y)| largest.max(x).max(y));
    let odd = 2 * largest.ceil() as u32 + 1;
    // No larger than the dataset's sensor, as no frame shows more.
    let side = |dataset: u32| if odd <= dataset { odd } else { dataset - (dataset + 1) % 2 };
    Settings {
        pixel_dim_x: side(scenario.settings.pixel_dim_x).max(1),
        pixel_dim_y: side(scenario.settings.pixel_dim_y).max(1),
        ..scenario.settings.clone()
    }
}

fn particle(scenario: &Scenario, d_um: f64, z_um: f64) -> Particle {
    let depth_factor = scenario.depth_factor();
    let sphere = Particle::sphere(1.0, 1.0, z_um / depth_factor, d_um);
    // Without photons, the stack's particle has `c_int` 1, whatever the dataset's particles have.
    match scenario.cloud.photons {
        Some(_) => Particle { c_int: scenario.cloud.typical_c_int(d_um), ..sphere },
        None => sphere,
    }
}

/// Left and top of the part of a sensor about its center, px from 0.
fn central(whole: &Settings, part: &Settings) -> [u32; 2] {
    [(whole.pixel_dim_x - part.pixel_dim_x) / 2, (whole.pixel_dim_y - part.pixel_dim_y) / 2]
}

/// The calibration stacks of a scenario, before they are rendered.
#[derive(Debug)]
pub struct CalibrationStack {
    /// The table.
    pub table: Table,
    /// The settings of the images.
    pub settings: Settings,
    camera: Camera,
    /// The particle of each image, as in its data file: at each depth, one size after the other, and so at each
    /// place.
    pub particles: Vec<Particle>,
    depths_um: Vec<f64>,
    /// Places in the field of view, if there are several.
    places: Vec<PlaceSensor>,
}

/// The part of the dataset's sensor around a place of the field of view.
#[derive(Debug)]
struct PlaceSensor {
    place: PlaceFacts,
    /// Its left and top, px from 0.
    corner: [u32; 2],
    sensor: Sensor,
}

impl CalibrationStack {
    /// The stacks, if the scenario has any. `camera`: camera of the dataset's frames; `scan`: noise-free
    /// images of a particle of the mean diameter through the depth range.
    pub fn of(scenario: &Scenario, camera: &Camera, scan: &DepthScan) -> Result<Option<Self>> {
        let sizes_um = scenario.calibrated_um();
        if sizes_um.is_empty() {
            return Ok(None);
        }
        let depths_um = depths_um(scenario.depth_range_um, step_um(scenario, &sizes_um, scan)?);
        let size_particles =
            |d_um: &f64| depths_um.iter().map(|z_um| particle(scenario, *d_um, *z_um)).collect::<Vec<_>>();
        let mut particles: Vec<Particle> = sizes_um.iter().flat_map(size_particles).collect();
        let settings = settings(scenario, camera, &particles);
        if !places(scenario).is_empty() {
            return CalibrationStack::over_field(scenario, settings, particles, depths_um).map(Some);
        }
        let corner = central(&scenario.settings, &settings);
        let detector = scenario
            .detector
            .as_ref()
            .map(|detector| detector.cropped(&scenario.settings, &settings, corner));
        let renderer = scenario.spec.renderer().build(&settings, &scenario.context)?;
        let camera = Camera::of_dataset(scenario, renderer, detector.as_ref())?.calibrating();
        let (x_px, y_px) = (f64::from(settings.pixel_dim_x / 2 + 1), f64::from(settings.pixel_dim_y / 2 + 1));
        particles.iter_mut().for_each(|particle| (particle.x_px, particle.y_px) = (x_px, y_px));
        camera.renderer().prepare(&[&particles]);
        Ok(Some(CalibrationStack {
            table: table(&sizes_um, false),
            settings,
            camera,
            particles,
            depths_um,
            places: Vec::new(),
        }))
    }

    /// The stacks at several places, from the particles of one of them; `settings`: of the images.
    fn over_field(
        scenario: &Scenario,
        settings: Settings,
        one: Vec<Particle>,
        depths_um: Vec<f64>,
    ) -> Result<Self> {
        let whole = &scenario.settings;
        let (mut sensors, mut particles) = (Vec::new(), Vec::new());
        for place in places(scenario) {
            // Next to the edge of the sensor, the particle is not in the middle.
            let along =
                |px: f64, part: u32, whole: u32| (px as u32 - 1).saturating_sub(part / 2).min(whole - part);
            let corner = [
                along(place.x_px, settings.pixel_dim_x, whole.pixel_dim_x),
                along(place.y_px, settings.pixel_dim_y, whole.pixel_dim_y),
            ];
            let detector =
                scenario.detector.as_ref().map(|detector| detector.cropped(whole, &settings, corner));
            let sensor =
                sensor(&settings, detector.as_ref(), scenario.spec.image_format(), &scenario.streams)?;
            let (x_px, y_px) = (place.x_px - f64::from(corner[0]), place.y_px - f64::from(corner[1]));
            particles.extend(one.iter().map(|particle| Particle { x_px, y_px, ..*particle }));
            sensors.push(PlaceSensor { place, corner, sensor });
        }
        let renderer = scenario.spec.renderer().build(whole, &scenario.context)?;
        let camera = Camera::of_dataset(scenario, renderer, scenario.detector.as_ref())?.calibrating();
        let table = table(&scenario.calibrated_um(), true);
        let stack = CalibrationStack { table, settings, camera, particles, depths_um, places: sensors };
        let drawn: Vec<Particle> = (0..stack.images()).map(|row| stack.in_frame(row)).collect();
        stack.camera.renderer().prepare(&[&drawn]);
        Ok(stack)
    }

    /// The part of the sensor that an image shows, if there are several places.
    fn place(&self, row: usize) -> Option<&PlaceSensor> {
        let rows = self.images() / self.places.len().max(1);
        self.places.get(row / rows)
    }

    /// The particle of an image at its place in the frames.
    fn in_frame(&self, row: usize) -> Particle {
        let particle = self.particles[row];
        let [left, top] = self.place(row).map_or([0.0; 2], |of| of.corner.map(f64::from));
        Particle { x_px: particle.x_px + left, y_px: particle.y_px + top, ..particle }
    }

    /// Number of images.
    pub fn images(&self) -> usize {
        self.particles.len()
    }

    /// Renders an image of the table.
    pub fn image(&self, row: usize) -> Image {
        match self.place(row) {
            None => self.camera.image(&[self.particles[row]], row as u32),
            Some(of) => {
                self.camera.part(&[self.in_frame(row)], row as u32, (&of.sensor, &self.settings), of.corner)
            }
        }
    }

    /// Whether there is a stack for each of several sizes.
    fn has_sizes(&self) -> bool {
        self.particles.len() > self.depths_um.len() * self.places.len().max(1)
    }

    /// Folders of the data files and images of a row, below the folders of the calibration.
    fn folder(&self, row: usize) -> String {
        let place = self.place(row).map_or_else(String::new, |of| format!("/place_{:02}", of.place.place));
        let size =
            if self.has_sizes() { format!("/d_{}um", self.particles[row].d_um) } else { String::new() };
        place + &size
    }

    fn paths(&self, row: usize) -> [String; 2] {
        let (folder, step) = (self.folder(row), row % self.depths_um.len());
        [
            format!("calibration/images{folder}/step_{step:04}.tif"),
            format!("calibration/particles{folder}/step_{step:04}.txt"),
        ]
    }

    /// The rows of the table.
    pub fn rows(&self) -> Vec<CalibrationRow> {
        let row = |(row, (z_um, p)): (usize, (&f64, &Particle))| {
            let [image, particles] = self.paths(row);
            let step = (row % self.depths_um.len()) as u32;
            let at =
                CalibrationRow { step, z_um: *z_um, x_px: p.x_px, y_px: p.y_px, ..CalibrationRow::default() };
            let PlaceFacts { place, x_px: place_x_px, y_px: place_y_px, .. } =
                self.place(row).map(|of| of.place).unwrap_or_default();
            CalibrationRow { image, particles, d_um: p.d_um, place, place_x_px, place_y_px, ..at }
        };
        self.depths_um.iter().cycle().zip(&self.particles).enumerate().map(row).collect()
    }
}

/// Writes the stacks into the dataset's folder, if the scenario has any. `go_on` is called before each image
/// and can stop the work by an error.
pub fn write(
    folder: &OutputFolder,
    scenario: &Scenario,
    camera: &Camera,
    scan: &DepthScan,
    go_on: impl Fn() -> Result<()> + Sync,
) -> Result<()> {
    let Some(stack) = CalibrationStack::of(scenario, camera, scan)? else { return Ok(()) };
    for row in (0..stack.images()).step_by(stack.depths_um.len()) {
        for part in ["calibration/particles", "calibration/images"] {
            folder.subfolder(&(part.to_owned() + &stack.folder(row)))?;
        }
    }
    let file = "calibration/settings.txt";
    folder
        .save(file, |w| settings_file::write(w, &stack.settings).map_err(Error::write(&folder.join(file))))?;
    (0..stack.images()).into_par_iter().try_for_each(|row| {
        go_on()?;
        let [image, data] = stack.paths(row);
        let particle = [stack.particles[row]];
        let layout = data_file::Layout::of(&particle);
        folder.save(&data, |w| {
            data_file::write(w, &particle, layout).map_err(Error::write(&folder.join(&data)))
        })?;
        let plane = StackPlane::of(&stack.depths_um, row % stack.depths_um.len());
        let name = folder.join(&image);
        folder.save(&image, |writer| stack.camera.write_tiff(writer, &stack.image(row), plane, &name))
    })?;
    write_table(folder, &stack.table, &stack.rows())
}

#[cfg(test)]
mod tests {
    use microsig_core::render::Context;
    use std::path::Path;

    use super::*;
    use scenario::{parse, resolve};

    #[test]
    fn depths_cover_the_range() {
        assert_eq!(depths_um((-80.0, 20.0), 2.0).len(), 51);
        assert_eq!(depths_um((-80.0, 20.0), 2.0)[50], 20.0);
        assert_eq!(depths_um((0.0, 3.0), 2.0), [0.0, 2.0, 4.0]);
    }

    #[test]
    #[ignore = "slow: .ci/full"]
    fn steps_fit_the_range_and_the_depth_of_field() {
        let step = |optics: &str, rest: &str| {
            let text = format!(
                "(name: \"c\", motion: flow(field: poiseuille()), timing: pairs(count: 1), optics: ({optics}), {rest})"
            );
            let scenario =
                resolve(parse(&text, "c.ron").unwrap(), Path::new("."), &Context::default()).unwrap();
            let scan = scenario.scan(2.0, scenario.depth_range_um).unwrap();
            step_um(&scenario, &scenario.calibrated_um(), &scan).unwrap()
        };
        assert_eq!(step("preset: setting1", ""), 2.0);
        assert_eq!(step("preset: setting1", "boundaries: (z_um: (-30, 10))"), 1.0);
        assert_eq!(step("preset: setting1", "calibration: every_um(3)"), 3.0);
        assert!(step("preset: setting2", "boundaries: (z_um: (-20, 5))") <= 0.5);
    }
}
