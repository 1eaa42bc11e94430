//! Readers of tracker output, one file per format.
//!
//! Every reader converts to px with the first pixel's center at (1, 1), y downward, z in um, frames from 0,
//! and notes how it interpreted the file. Files are untrusted: no allocation depends on sizes claimed in a
//! header, the lengths of lines and tables are limited, and values must be finite and within plausible
//! bounds.
//!
//! To add a format (OpenPTV and MyPTV are wanted), add a file to this folder and, in `mod.rs`,
//! a variant of [`Format`] and its cases in [`detect`] and [`read`].

mod canonical;
mod cells;
mod coco;
mod conventions;
mod defocustracker;
mod fields;
mod flo;
mod openpiv;
mod pivlab;
mod programs;
pub mod sheet;
mod table;
mod tecplot;
mod text;
mod xml;

use std::io::Read;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::Deserialize;
use sheet::TextTable;
use storage::dataset::Columns;

pub(crate) use canonical::PARTICLES;
pub use canonical::{field as read_field, points as read_points};
use cells::Cells;
pub use conventions::{Conventions, LengthUnit, Limits, Origin, PairChoice};
pub(crate) use conventions::{Converter, DroppedRows, FormatDefaults};
pub(crate) use fields::LENGTHS;
use storage::InputFile;
use storage::advice;
use storage::advice::option;
use storage::error::{Error, Result};
use storage::walk;
pub use table::{
    BoxSize, Field, FlowVector, Placement, Points, Position, Reversal, TrackRow, TrackerResult, Velocities,
    VelocityUnit,
};
use text::{HEAD, Text};

/// Result formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// microsig's own CSV of particles.
    Canonical,
    /// trackpy's data frame as CSV.
    Trackpy,
    /// TrackMate's table of spots.
    TrackmateSpots,
    /// TrackMate's XML, saved or of exported tracks.
    TrackmateXml,
    /// XML of the ISBI challenge.
    Isbi,
    /// DefocusTracker's table as CSV.
    Defocustracker,
    /// DefocusTracker's text file.
    DefocustrackerAscii,
    /// Boxes of a detector as COCO's list of results.
    Coco,
    /// napari's tracks as CSV.
    Napari,
    /// Tecplot's text of the LPT and DA challenges.
    LptDa,
    /// microsig's own CSV of a displacement field.
    Field,
    /// OpenPIV's text file.
    Openpiv,
    /// PIVlab's text file.
    Pivlab,
    /// DaVis's text, its own or Tecplot's.
    Davis,
    /// TSI Insight's `.vec`.
    Insight,
    /// Middlebury's dense flow.
    Flo,
}

impl Format {
    /// Whether results in this format are displacement fields.
    pub fn is_field(self) -> bool {
        use Format::{Davis, Field, Flo, Insight, Openpiv, Pivlab};
        matches!(self, Field | Openpiv | Pivlab | Davis | Insight | Flo)
    }
}

/// Where a result is.
#[derive(Debug)]
pub enum Source {
    /// In a file.
    File(InputFile),
    /// A field in files of a folder or with names of a pattern, one for each image pair.
    Files(PathBuf, Vec<InputFile>),
    /// In columns of one length, named as in a table that a program writes.
    Columns(Columns),
}

/// Extensions of the files of a folder that are read.
const EXTENSIONS: [&str; 5] = ["txt", "dat", "csv", "vec", "flo"];

impl Source {
    /// A file, or all of a folder or pattern (`*` is any text, `?` any character), in natural order.
    /// Errors: a folder that cannot be read, that has no or several kinds of results; a pattern that fits no name.
    pub fn at(path: InputFile) -> Result<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let is_pattern = name.contains(['*', '?']) && !path.exists();
        if path.is_standard() || !(path.is_dir() || is_pattern) {
            return Ok(Source::File(path));
        }
        let wrong = |what: &str| Error::input(format!("{}: {what}", path.display()));
        let extension = |file: &str| {
            let own = Path::new(file).extension()?.to_str()?.to_ascii_lowercase();
            EXTENSIONS.into_iter().find(|extension| *extension == own)
        };
        let folder = if is_pattern { path.parent() } else { Some(&*path) };
        let folder = folder.filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let files = walk::names(folder, |file| {
            let is_wanted = if is_pattern { walk::fits(&name, file) } else { extension(file).is_some() };
            is_wanted && !file.starts_with('.')
        })?;
        if !is_pattern && files.iter().any(|file| extension(file) != extension(&files[0])) {
            return Err(wrong("files of several kinds; give a pattern such as \"folder/field_*.txt\""));
        }
        if files.is_empty() {
            let names = EXTENSIONS.join(", .");
            return Err(wrong(&format!(
                "no results; expected files .{names} of a field, one for each image pair"
            )));
        }
        Ok(Source::Files(
            path.to_path_buf(),
            files.iter().map(|file| InputFile::from(folder.join(file))).collect(),
        ))
    }

    /// Name of the result.
    pub fn name(&self) -> String {
        match self {
            Source::Files(path, _) => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            Source::File(path) => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            Source::Columns(_) => "result.csv".to_owned(),
        }
    }

    /// The format, detected unless `given`.
    pub fn format(&self, given: &Conventions) -> Result<Format> {
        match (given.format, self) {
            (Some(format), _) => Ok(format),
            (None, Source::File(path)) => detect(path),
            (None, Source::Files(_, files)) => detect(&files[0]),
            (None, Source::Columns(columns)) => {
                let names: Vec<&str> = columns.0.iter().map(|(name, _)| name.as_str()).collect();
                detect_header(COLUMNS, &names.join(","), &names)
            }
        }
    }

    /// Reads the result.
    /// Errors: everything that is wrong with it, with line numbers.
    pub fn read(self, format: Format, given: &Conventions) -> Result<TrackerResult> {
        let how = if given.format.is_some() { "format given" } else { "format detected from the header" };
        let given = &Conventions { format: Some(format), ..*given };
        let mut is_one = true;
        let (name, mut found) = match self {
            Source::File(path) => (path.display().to_string(), read_file(&path, format, given)?),
            Source::Files(path, files) => {
                is_one = false;
                (path.display().to_string(), TrackerResult::Field(read_pairs(&files, format, given)?))
            }
            Source::Columns(columns) => {
                let table = TextTable::from_columns(COLUMNS, columns);
                let found = read_table(table, format, given)?.ok_or_else(|| {
                    Error::input(format!("{COLUMNS}: results of this format are files; give the path of one"))
                })?;
                (COLUMNS.to_owned(), found)
            }
        };
        let notes = match &mut found {
            TrackerResult::Points(points) => {
                unique(&name, points)?;
                &mut points.notes
            }
            TrackerResult::Field(field) => {
                if is_one {
                    one_pair(field, format, given)?;
                }
                &mut field.notes
            }
        };
        if let Some(first) = notes.first_mut() {
            *first = format!("{first} ({how})");
        }
        Ok(found)
    }
}

/// Name of columns in memory in messages.
const COLUMNS: &str = "result";

/// Reads a result file; the format is detected unless `given`.
/// Errors: all problems of the file, with line numbers; an unknown format.
pub fn read(path: impl Into<InputFile>, given: &Conventions) -> Result<TrackerResult> {
    let source = Source::at(path.into())?;
    let format = source.format(given)?;
    source.read(format, given)
}

fn read_file(path: &InputFile, format: Format, given: &Conventions) -> Result<TrackerResult> {
    given.limits.check(path, path.open()?.metadata().map_err(|e| Error::read(path, e))?.len())?;
    Ok(match format {
        Format::TrackmateXml | Format::Isbi => TrackerResult::Points(xml::read(path, format, given)?),
        Format::DefocustrackerAscii => TrackerResult::Points(defocustracker::ascii(path, given)?),
        Format::Coco => TrackerResult::Points(coco::read(path, given)?),
        Format::Openpiv => TrackerResult::Field(openpiv::read(path, given)?),
        Format::Pivlab => TrackerResult::Field(pivlab::read(path, given)?),
        Format::LptDa => TrackerResult::Points(tecplot::points(path, given)?),
        Format::Davis | Format::Insight => TrackerResult::Field(tecplot::field(path, given)?),
        Format::Flo => TrackerResult::Field(flo::read(path, given)?),
        _ => {
            let table = TextTable::open(path, 1)?.at_most(given.limits.rows);
            let found = read_table(table, format, given)?;
            found.ok_or_else(|| Error::input(format!("{}: not a table", path.display())))?
        }
    })
}

/// The number of the only image pair of a file, or of none.
fn own_pair(field: &Field) -> std::result::Result<Option<u32>, ()> {
    let first = field.vectors.first().and_then(|v| v.pair);
    if field.vectors.iter().all(|v| v.pair == first) { Ok(first) } else { Err(()) }
}

/// The image pair `k` places after another.
fn pair_after(first: u32, k: u32, given: &Conventions) -> u32 {
    match given.pairs {
        // The last of four frames of a burst begins no pair.
        Some((_, true)) => {
            let place = first / 4 * 3 + first % 4 + k;
            place / 3 * 4 + place % 3
        }
        _ => first + k,
    }
}

/// Gives a field of one file its image pair, unless the file states it: the first, or the one asked for. A
/// canonical table without pairs counts for all of them.
fn one_pair(field: &mut Field, format: Format, given: &Conventions) -> Result<()> {
    let Ok(own) = own_pair(field) else {
        return match given.pair {
            Some(_) => Err(Error::option(advice!(option("pair"), ": the file states several image pairs"))),
            None => Ok(()),
        };
    };
    let pair = match given.pair {
        Some(PairChoice::All) => None,
        Some(PairChoice::First(pair)) => Some(pair),
        None if own.is_some() || format == Format::Field => return Ok(()),
        None => {
            let Some((n, _)) = given.pairs.filter(|(n, _)| *n > 1) else { return Ok(()) };
            let asks = advice!(
                format!("one file without its number for {n} image pairs: taken as pair 0; give "),
                option("pair").of("N"),
                " for another, ",
                option("pair").is("all"),
                " for a field of all pairs (ensemble correlation), or a folder with a file for each pair"
            );
            field.warnings.push(asks.to_string());
            Some(0)
        }
    };
    field.vectors.iter_mut().for_each(|v| v.pair = pair);
    field
        .notes
        .push(pair.map_or("a field of all image pairs".to_owned(), |pair| format!("image pair {pair}")));
    Ok(())
}

/// Reads a field from one file for each image pair: the pairs that the files state, if these differ, otherwise
/// in their order.
fn read_pairs(files: &[InputFile], format: Format, given: &Conventions) -> Result<Field> {
    let name = |file: &InputFile| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut fields = Vec::new();
    for file in files {
        let TrackerResult::Field(field) = read_file(file, format, given)? else {
            let what = "particles in several files; expected one table with frames";
            return Err(Error::input(format!("{}: {what}", file.display())));
        };
        fields.push(field);
    }
    let mut pairs = Vec::new();
    for (field, file) in fields.iter().zip(files) {
        pairs.push(own_pair(field).map_err(|()| {
            Error::input(format!("{}: several image pairs in one of {} files", file.display(), files.len()))
        })?);
    }
    let mut stated: Vec<u32> = pairs.iter().flatten().copied().collect();
    stated.sort_unstable();
    stated.dedup();
    let first = match given.pair {
        Some(PairChoice::All) => {
            let what = format!(": one field for all image pairs; the result has {} files", files.len());
            return Err(Error::option(advice!(option("pair").is("all"), what)));
        }
        Some(PairChoice::First(first)) => Some(first),
        None if stated.len() == files.len() => None,
        None => match given.pairs {
            Some((n, _)) if (n as usize) < files.len() => {
                let what = format!("{} files of a field for {n} image pairs", files.len());
                return Err(Error::input(format!("{}: {what}", name(&files[0]))));
            }
            Some((n, _)) if n as usize > files.len() => {
                let what = format!("{} files for {n} image pairs; give ", files.len());
                return Err(Error::option(advice!(what, option("pair"), ", the pair of the first file")));
            }
            _ => Some(0),
        },
    };
    let mut whole = Field::default();
    for ((k, field), own) in (0..).zip(fields).zip(pairs) {
        let pair = first.map_or(own, |first| Some(pair_after(first, k, given)));
        whole.vectors.extend(field.vectors.into_iter().map(|v| FlowVector { pair, ..v }));
        whole.n_nan += field.n_nan;
        whole.placement = field.placement;
        whole.notes.extend(field.notes.into_iter().filter(|note| k == 0 || note.contains("dropped")));
    }
    let (from, to) = (name(&files[0]), name(&files[files.len() - 1]));
    let by = if first.is_some() { "in this order" } else { "by the numbers in them" };
    whole.notes.push(format!("{} files, one for each image pair {by}: {from} to {to}", files.len()));
    Ok(whole)
}

/// Reads a table with a header of column names; `None` if that is not the format.
fn read_table(table: TextTable, format: Format, given: &Conventions) -> Result<Option<TrackerResult>> {
    let points = match format {
        Format::Canonical => canonical::points_of(table, given)?,
        Format::Trackpy | Format::TrackmateSpots | Format::Napari => programs::read(table, format, given)?,
        Format::Defocustracker => defocustracker::csv(table, given)?,
        Format::Field => return Ok(Some(TrackerResult::Field(canonical::field_of(table, given)?))),
        _ => return Ok(None),
    };
    Ok(Some(TrackerResult::Points(points)))
}

/// Refuses tracks with two points in one frame.
fn unique(name: &str, points: &Points) -> Result<()> {
    let mut linked: Vec<(i64, u32, u32)> = (0..points.rows.len() as u32)
        .map(|i| (points.rows[i as usize].track, points.rows[i as usize].frame, i))
        .filter(|(track, ..)| *track >= 0)
        .collect();
    linked.sort_unstable();
    let line = |i: u32| points.lines.get(i as usize).map_or(String::new(), |line| format!(":{line}"));
    let mut twice: Vec<String> = linked
        .windows(2)
        .filter(|w| (w[0].0, w[0].1) == (w[1].0, w[1].1))
        .map(|w| format!("{name}{}: track {} appears twice in frame {}", line(w[1].2), w[0].0, w[0].1))
        .collect();
    sheet::shorten(&mut twice);
    if twice.is_empty() { Ok(()) } else { Err(Error::Input(twice)) }
}

/// Detects the format of a file from its first lines.
/// Errors: an empty file; a header that matches no format.
pub fn detect(path: impl Into<InputFile>) -> Result<Format> {
    let path = &path.into();
    let name = path.display();
    let mut magic = Vec::new();
    path.open()?.take(4).read_to_end(&mut magic).map_err(|e| Error::read(path, e))?;
    if magic.is_empty() {
        return Err(Error::input(format!("{name}: empty; expected at least a header")));
    }
    if magic == b"PIEH" {
        return Ok(Format::Flo);
    }
    let instead = |what: &str, columns: &str| {
        let message = format!("{name}: {what} files cannot be read; write a CSV with the columns {columns}");
        Err(Error::Unsupported(vec![message]))
    };
    let later = |what: &str| instead(what, "frame, track, x_px, y_px, z_um");
    let later_field = |what: &str| instead(what, "x_px, y_px, dx_px, dy_px, flag [, pair]");
    if magic == b"\x89PNG" {
        return later_field("PNG (KITTI flow)");
    }
    let head = Text::head(path)?;
    if head.len() == HEAD && !head.iter().any(|b| b"\n\r".contains(b)) && !b"<[".contains(&head[0]) {
        return Err(Error::input(format!("{name}:1: the first line is longer than {HEAD} bytes")));
    }
    let text = String::from_utf8_lossy(&head).replace("\r\n", "\n").replace('\r', "\n");
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).take(4).collect();
    let [first, second] = [0, 1].map(|k| lines.get(k).copied().unwrap_or_default());
    let (start, lower) = (first.trim_start(), text.to_ascii_lowercase());
    let is_tecplot = start.to_ascii_lowercase().starts_with("title");
    let is_field = ["\"vx", "velocity u", "displacement"].iter().any(|name| lower.contains(name));
    let known = [
        (start.starts_with('['), Format::Coco),
        (text.contains("<TrackContestISBI2012"), Format::Isbi),
        (text.contains("<Tracks") || text.contains("<TrackMate"), Format::TrackmateXml),
        (
            start.starts_with("PIVlab")
                || start.starts_with("# PIVlab")
                || lines.iter().any(|l| l.starts_with("x [")),
            Format::Pivlab,
        ),
        (second.trim_start().starts_with("scaling"), Format::DefocustrackerAscii),
        (is_tecplot && lower.contains("\"chc\""), Format::Insight),
        (is_tecplot && is_field || start.starts_with("#DaVis"), Format::Davis),
        (is_tecplot, Format::LptDa),
        (start.starts_with('#') && first.contains('x') && first.contains('u'), Format::Openpiv),
    ];
    if let Some((_, format)) = known.iter().find(|(is, _)| *is) {
        return Ok(*format);
    }
    if start.starts_with('<') {
        return Err(Error::input(format!("{name}: XML, but neither TrackMate's tracks nor ISBI's")));
    }
    // Numbers without a header: OpenPTV begins with the number of rows, MyPTV is tab-separated.
    let numbers = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        if words.iter().all(|word| word.parse::<f64>().is_ok()) { words.len() } else { 0 }
    };
    match (numbers(first), numbers(second)) {
        (1, 5 | 8) => return later("OpenPTV"),
        (6.., _) if first.contains('\t') => return later("MyPTV"),
        _ => {}
    }
    let columns = sheet::names(first.as_bytes(), sheet::delimiter(first.as_bytes()));
    detect_header(&name.to_string(), first, &columns.iter().map(String::as_str).collect::<Vec<_>>())
}

/// Detects the format of a table from the names of its columns; `first` is its first line.
fn detect_header(name: &str, first: &str, columns: &[&str]) -> Result<Format> {
    let has = |names: &[&str]| names.iter().all(|n| columns.contains(n));
    match () {
        () if has(&["POSITION_X", "POSITION_Y", "FRAME"]) => Ok(Format::TrackmateSpots),
        () if has(&["fr", "X", "Y"]) => Ok(Format::Defocustracker),
        () if has(&["x_px", "y_px", "dx_px", "dy_px"]) && !has(&["frame"]) => Ok(Format::Field),
        () if has(&["x_px", "y_px", "frame"]) => Ok(Format::Canonical),
        () if has(&["track_id", "t", "y", "x"]) || has(&["axis-0", "axis-1", "axis-2"]) => Ok(Format::Napari),
        () if has(&["x", "y", "frame"])
            && ["particle", "mass", "track_id"].iter().any(|name| columns.contains(name)) =>
        {
            Ok(Format::Trackpy)
        }
        () if has(&["x", "y"]) => {
            let what = format!(
                "{name}:1: columns {first:?} have no units: name them frame, track, x_px, y_px, z_um (or x_px, y_px, dx_px, \
                 dy_px of a field), or say with "
            );
            Err(Error::option(advice!(what, option("format"), " which program wrote them")))
        }
        () => {
            let what = format!(
                "{name}:1: header {:?} fits no format; expected columns frame, track, x_px, y_px, z_um (without z_um if depth \
                 is not measured), or x_px, y_px, dx_px, dy_px of a field, or give ",
                shown(first)
            );
            Err(Error::option(advice!(what, option("format"), ", the program that wrote it")))
        }
    }
}

/// A line shortened to 80 characters for messages.
pub fn shown(line: &str) -> String {
    let short: String = line.chars().take(80).collect();
    if short.len() < line.len() { short + "..." } else { short }
}
