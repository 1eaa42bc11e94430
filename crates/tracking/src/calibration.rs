//! The calibration stacks: images of one particle at known depths, one stack for each particle size. They are
//! validated as untrusted input.

use std::io::BufReader;
use std::path::{Component, Path};

use microsig_core::Settings;
use microsig_core::formats::tiff;
use microsig_core::render::WaveOptics;

use super::gray_image::GrayImage;
use super::recording::read_image;
use rayon::prelude::*;
use storage::dataset::manifest::{OpticsFacts, RECORDING};
use storage::dataset::{CalibrationRow, DatasetPlace, Row as _};
use storage::error::{Error, Result};
use storage::input;

/// Minimum number of depths.
const LEAST_IMAGES: usize = 5;

/// Maximum number of pixels of all images together: 256 MB in memory.
const MOST_PIXELS: u64 = 1 << 26;

/// Minimum distance of the particle from the image edge, px: the minimum half width of a template.
const LEAST_ROOM_PX: f64 = 4.0;

/// Smallest side of a calibration image, px.
const LEAST_SIDE: u32 = 2 * LEAST_ROOM_PX as u32 + 1;

/// Allowed depths, um.
const DEPTHS_UM: std::ops::RangeInclusive<f64> = -1e6..=1e6;

/// The image of the particle at one depth.
#[derive(Debug, Clone)]
pub(super) struct CalibrationImage {
    pub(super) z_um: f64,
    /// Position of the particle relative to the center of the first pixel, px.
    pub(super) at: [f64; 2],
    pub(super) image: GrayImage,
}

/// A row of calibration.csv.
struct Row {
    line: u64,
    z_um: f64,
    at: [f64; 2],
    image: String,
    /// Path of the data file; empty if the table has none.
    particles: String,
    /// Diameter of the particle, um; 0 if all are of one size.
    d_um: f64,
    place: u32,
    /// Place in the frames, px from 0.
    place_at: [f64; 2],
}

/// The stacks at a place of the field of view, one for each size of particles in order of their diameters.
#[derive(Debug)]
pub(super) struct PlaceStacks {
    /// The place, px from 0; `None` if the stacks are for the whole field of view.
    pub(super) at: Option<[f64; 2]>,
    pub(super) sizes: Vec<Vec<CalibrationImage>>,
}

/// The optical settings with which a stack was made.
#[derive(Debug)]
pub(super) struct Origin {
    pub(super) settings: Settings,
    /// Diameter of the particle, um.
    pub(super) d_um: f64,
    /// Physical depth over depth in MicroSIG's data files.
    pub(super) depth_factor: f64,
    /// Depth of the stack at which the depth in data files is 0, um.
    pub(super) zero_um: f64,
    /// Light and objective if the images are diffracted.
    pub(super) waves: Option<WaveOptics>,
    /// Blur, and how the optics vary over the field of view.
    pub(super) over_field: OpticsFacts,
}

/// Reads the stacks of a dataset at all places of the field of view, sorted by depth, without duplicate
/// depths. Errors: a stack that is missing or too large, has fewer than five depths, non-finite depths,
/// images outside the dataset's folder, or a particle closer than 4 px to the edge of its image.
pub(super) fn read_field(dataset: &DatasetPlace) -> Result<Vec<PlaceStacks>> {
    let (size, stacks) = table(dataset)?;
    let has_places = stacks.iter().any(|rows| rows[0].place != stacks[0][0].place);
    let mut places: Vec<(u32, PlaceStacks)> = Vec::new();
    for rows in stacks {
        let (place, at) = (rows[0].place, has_places.then_some(rows[0].place_at));
        let images = images(dataset, rows, size)?;
        match places.last_mut().filter(|(last, _)| *last == place) {
            Some((_, stacks)) => stacks.sizes.push(images),
            None => places.push((place, PlaceStacks { at, sizes: vec![images] })),
        }
    }
    Ok(places.into_iter().map(|(_, stacks)| stacks).collect())
}

/// Reads the stacks of a dataset, one for each size of particles in order of their diameters; with several
/// places in the field of view, those at the place nearest to its middle.
pub(super) fn read(dataset: &DatasetPlace) -> Result<Vec<Vec<CalibrationImage>>> {
    let (size, stacks) = central(dataset)?;
    stacks.into_iter().map(|rows| images(dataset, rows, size)).collect()
}

/// Diameter of the particle of each size, um, as in [`read`].
pub(super) fn diameters_um(dataset: &DatasetPlace) -> Result<Vec<f64>> {
    Ok(central(dataset)?.1.iter().map(|rows| rows[0].d_um).collect())
}

fn images(dataset: &DatasetPlace, rows: Vec<Row>, size: (u32, u32)) -> Result<Vec<CalibrationImage>> {
    let image = |row: Row| {
        let image = read_image(dataset, &row.image, size)?;
        Ok(CalibrationImage { z_um: row.z_um, at: row.at, image })
    };
    rows.into_par_iter().map(image).collect()
}

/// Size of the images (px), and the rows of the stacks nearest to the middle of the field of view.
fn central(dataset: &DatasetPlace) -> Result<Stacks> {
    let (size, mut stacks) = table(dataset)?;
    let manifest = dataset.manifest().ok();
    let sensor = manifest.as_ref().and_then(|manifest| manifest.microsig.sensor.as_ref());
    let middle = sensor.map_or([0.0; 2], |s| [s.width_px, s.height_px].map(|n| 0.5 * (f64::from(n) - 1.0)));
    let away = |rows: &Vec<Row>| (rows[0].place_at[0] - middle[0]).hypot(rows[0].place_at[1] - middle[1]);
    let nearest = stacks.iter().min_by(|a, b| away(a).total_cmp(&away(b))).map(|rows| rows[0].place);
    stacks.retain(|rows| Some(rows[0].place) == nearest);
    Ok((size, stacks))
}

/// What a method makes of the stack of each size (the smallest first), without sizes that it cannot use, such
/// as particles fainter than the noise; and a warning for each of these. Errors: as for the first size if
/// none can be used.
pub(super) fn usable_sizes<T>(sizes: impl Iterator<Item = Result<T>>) -> Result<(Vec<T>, Vec<String>)> {
    let (mut usable, mut unusable) = (Vec::new(), Vec::new());
    for (k, size) in sizes.enumerate() {
        match size {
            Ok(size) => usable.push(size),
            Err(why) => unusable.push((k + 1, why)),
        }
    }
    if usable.is_empty() && !unusable.is_empty() {
        return Err(unusable.swap_remove(0).1);
    }
    let left_out =
        |(k, why)| format!("particles of diameter {k} (the smallest first) are not searched for: {why}");
    Ok((usable, unusable.into_iter().map(left_out).collect()))
}

/// Reads and checks the calibration stacks of a dataset; returns their number of images. Errors: a stack that
/// is missing or too large, has fewer than five depths, non-finite depths, images outside the dataset's
/// folder, or a particle closer than 4 px to the edge of its image.
pub fn check(dataset: &Path) -> Result<usize> {
    Ok(read_field(&dataset.into())?.iter().flat_map(|place| &place.sizes).map(Vec::len).sum())
}

/// Reads the settings and optics of the stacks, and the diameter and depths of the particle of each.
pub(super) fn origins(dataset: &DatasetPlace) -> Result<Vec<Origin>> {
    let manifest = dataset.manifest()?;
    let facts = &manifest.microsig;
    if facts.kind.as_deref() == Some(RECORDING) && facts.renderer.is_none() {
        return Err(Error::input(format!(
            "{}: a recording without a model of its optics, which this method needs; `microsig fit` finds them from the scan, \
             `microsig import --optics` puts them in; `ncc` needs no model",
            dataset.name()
        )));
    }
    let (_, stacks) = central(dataset)?;
    stacks.iter().map(|rows| origin(dataset, rows)).collect()
}

/// Depth of the calibration stacks at which the depth in data files is 0, um. Errors: a dataset whose stacks
/// have no model of the optics.
pub fn zero_um(dataset: &DatasetPlace) -> Result<f64> {
    Ok(origins(dataset)?.first().map_or(0.0, |origin| origin.zero_um))
}

fn origin(dataset: &DatasetPlace, rows: &[Row]) -> Result<Origin> {
    let particle = |row: &Row| {
        if !row.particles.is_empty() {
            return dataset.calibration_particle(&row.particles);
        }
        // A table made by hand: the data file is named after the image.
        let image = Path::new(&row.image);
        let below = image.strip_prefix("calibration/images").ok();
        let name = below.or(image.file_name().map(Path::new)).unwrap_or(image).with_extension("txt");
        dataset.calibration_particle(&format!("calibration/particles/{}", name.display()))
    };
    let (low, high) = (&rows[0], &rows[rows.len() - 1]);
    let (first, last) = (particle(low)?, particle(high)?);
    let depth_factor = (high.z_um - low.z_um) / (last.z_um - first.z_um);
    if !depth_factor.is_finite() || depth_factor <= 0.0 {
        return Err(Error::input(format!(
            "{}: depths from {} to {} um, but {} to {} um in the data files; expected both to increase",
            dataset.shown("calibration"),
            low.z_um,
            high.z_um,
            first.z_um,
            last.z_um
        )));
    }
    let manifest = dataset.manifest()?;
    let facts = &manifest.microsig;
    let waves = facts.waves.as_ref().map(|waves| waves.optics());
    let over_field = facts.optics.unwrap_or_default();
    let largest = waves.as_ref().map_or(1.0, |waves| waves.lens.largest_aperture(waves.layers.as_ref()));
    let zero_um = low.z_um - depth_factor * first.z_um;
    // In datasets both depths are 0 in the same plane, up to rounding.
    let zero_um = if zero_um.abs() < 1e-6 { 0.0 } else { zero_um };
    Ok(Origin {
        settings: settings(dataset, largest)?,
        d_um: last.d_um,
        depth_factor,
        zero_um,
        waves,
        over_field,
    })
}

/// The settings of the stack. The numerical aperture is less than `largest`, the refractive index of the
/// immersion, which is in the manifest only.
fn settings(dataset: &DatasetPlace, largest: f64) -> Result<Settings> {
    let missing = || format!("{}: missing", dataset.shown("calibration/settings.txt"));
    dataset.calibration_settings(largest)?.ok_or_else(|| Error::input(missing()))
}

/// Size of images (px), and the rows of each stack.
type Stacks = ((u32, u32), Vec<Vec<Row>>);

/// Size of the images (px) and, for each size of particles, validated rows of the table sorted by depth.
fn table(dataset: &DatasetPlace) -> Result<Stacks> {
    let table = dataset.shown(CalibrationRow::PATH);
    if !dataset.has_calibration()? {
        let hint = match dataset.manifest()?.microsig.kind.as_deref() {
            Some(RECORDING) => {
                "missing; this method needs calibration images, which `microsig import --scan` makes from a scan; `piv` and `spots` need none"
            }
            _ => "missing; this method needs the calibration stack of the dataset",
        };
        return Err(Error::input(format!("{table}: {hint}")));
    }
    let size = image_size(dataset)?;
    let wrong = |message: String| Err(Error::input(format!("{table}: {message}")));
    let least = LEAST_SIDE;
    if size.0.min(size.1) < least {
        return wrong(format!(
            "images of {} x {} px; expected at least {least} x {least} px",
            size.0, size.1
        ));
    }
    let mut rows = rows(dataset, size)?;
    rows.sort_by(|a, b| {
        a.place.cmp(&b.place).then(a.d_um.total_cmp(&b.d_um)).then(a.z_um.total_cmp(&b.z_um))
    });
    let stack = |row: &Row| (row.place, row.d_um);
    let is_same = |pair: &&[Row]| stack(&pair[0]) == stack(&pair[1]) && pair[0].z_um == pair[1].z_um;
    if let Some(pair) = rows.windows(2).find(is_same) {
        let [first, second] = [pair[0].line.min(pair[1].line), pair[0].line.max(pair[1].line)];
        return wrong(format!(
            "z_um = {} in line {first} and again in line {second}; expected each depth once",
            pair[0].z_um
        ));
    }
    if u64::from(size.0) * u64::from(size.1) * rows.len() as u64 > MOST_PIXELS {
        let (n, w, h) = (rows.len(), size.0, size.1);
        return wrong(format!("{n} images of {w} x {h} px; expected at most {MOST_PIXELS} pixels in all"));
    }
    let mut stacks: Vec<Vec<Row>> = Vec::new();
    for row in rows {
        match stacks.last_mut().filter(|rows| stack(&rows[0]) == stack(&row)) {
            Some(rows) => rows.push(row),
            None => stacks.push(vec![row]),
        }
    }
    if let Some(n) = stacks.iter().map(Vec::len).min().or(Some(0)).filter(|n| *n < LEAST_IMAGES) {
        return wrong(format!(
            "{n} images of a particle; expected at least {LEAST_IMAGES}, each at a different depth"
        ));
    }
    Ok((size, stacks))
}

/// Size of the images, px: from the settings, or of the first image if no optics are known.
fn image_size(dataset: &DatasetPlace) -> Result<(u32, u32)> {
    // The size does not depend on the immersion, whose refractive index is below 2.
    if let Some(settings) = dataset.calibration_settings(2.0)? {
        return Ok((settings.pixel_dim_x, settings.pixel_dim_y));
    }
    let mut first = None;
    dataset.calibration_rows(&["image"], |_, row| {
        if first.is_none() {
            below("image", &row.image)?;
            first = Some(row.image);
        }
        Ok(())
    })?;
    let (Some(image), DatasetPlace::Folder(folder)) = (first, dataset) else {
        return Ok((LEAST_SIDE, LEAST_SIDE));
    };
    let path = folder.join(image);
    let file = BufReader::new(input::open(&path)?);
    Ok(tiff::size(file, &path.display().to_string())?)
}

/// A path in the table if it is below the dataset's folder.
fn below<'a>(column: &str, path: &'a str) -> std::result::Result<&'a Path, String> {
    let inside = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    if path.is_empty() || !Path::new(path).components().all(inside) {
        return Err(format!("{column} = `{path}`: expected a path below the dataset's folder"));
    }
    Ok(Path::new(path))
}

/// The rows of the table, validated against the size of the images.
fn rows(dataset: &DatasetPlace, size: (u32, u32)) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    dataset.calibration_rows(&["z_um", "x_px", "y_px", "image"], |line, row| {
        let CalibrationRow { z_um, image, particles, .. } = row;
        if !DEPTHS_UM.contains(&z_um) {
            return Err(format!("z_um = {z_um}: expected -1e6 to 1e6"));
        }
        let at = [("x_px", row.x_px, size.0), ("y_px", row.y_px, size.1)].map(|(name, position, pixels)| {
            let allowed = (1.0 + LEAST_ROOM_PX)..=(f64::from(pixels) - LEAST_ROOM_PX);
            if allowed.contains(&position) {
                return Ok(position - 1.0);
            }
            Err(format!(
                "{name} = {position}: expected {} to {}, {LEAST_ROOM_PX} px inside the image of {pixels} px",
                allowed.start(),
                allowed.end(),
            ))
        });
        let [x, y] = at;
        below("image", &image)?;
        if !particles.is_empty() {
            below("particles", &particles)?;
        }
        let place_at = [row.place_x_px, row.place_y_px].map(|px| if px.is_finite() { px - 1.0 } else { 0.0 });
        let d_um = if row.d_um.is_nan() { 0.0 } else { row.d_um };
        if !(0.0..=1e6).contains(&d_um) {
            return Err(format!("d_um = {d_um}: expected a number > 0 and <= 1e6"));
        }
        rows.push(Row { line, z_um, at: [x?, y?], image, particles, d_um, place: row.place, place_at });
        Ok(())
    })?;
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use std::fmt::Write;

    use super::*;
    use microsig_core::formats::settings_file;

    /// The messages for a stack of 21 x 21 px whose table has these rows.
    fn said(rows: &[&str]) -> String {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("calibration")).unwrap();
        let settings = Settings { pixel_dim_x: 21, pixel_dim_y: 21, ..Settings::setting1() };
        let file = std::fs::File::create(folder.path().join("calibration/settings.txt")).unwrap();
        settings_file::write(file, &settings).unwrap();
        let mut table = "step,z_um,x_px,y_px,image\n".to_owned();
        rows.iter().for_each(|row| writeln!(table, "{row}").unwrap());
        std::fs::write(folder.path().join(CalibrationRow::PATH), table).unwrap();
        read(&folder.path().into()).unwrap_err().to_string()
    }

    #[test]
    fn wrong_stacks_are_refused_with_line_value_and_range() {
        let outside = said(&["0,1,11,11,a.tif", "1,2,40,11,a.tif", "2,3,11,-1e300,a.tif", "3,4,11,3,a.tif"]);
        assert!(outside.contains(":3: x_px = 40: expected 5 to 17"), "{outside}");
        assert!(outside.contains(":4: y_px = -1e300") || outside.contains(":4: y_px = -1"), "{outside}");
        assert!(outside.contains(":5: y_px = 3: expected 5 to 17"), "{outside}");
        for depth in ["NaN", "inf", "1e300", "deep"] {
            let row = format!("0,{depth},11,11,a.tif");
            let message = said(&[&row]);
            assert!(message.contains(":2: ") && message.contains("z_um"), "{depth}: {message}");
        }
        for path in ["/dev/zero", "../secret.tif", ""] {
            let row = format!("0,1,11,11,{path}");
            assert!(said(&[&row]).contains("expected a path below"), "{path}");
        }
        let few = said(&["0,1,11,11,a.tif", "1,2,11,11,a.tif"]);
        assert!(few.contains("2 images of a particle; expected at least 5"), "{few}");
        let twice = said(&["0,2,11,11,a.tif", "1,2,11,11,a.tif"]);
        assert!(twice.contains("z_um = 2 in line 2 and again in line 3"), "{twice}");
        assert!(said(&[]).contains("0 images"));
    }
}
