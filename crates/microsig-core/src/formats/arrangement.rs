//! How the pages of a TIFF file are arranged in channels, slices and times, and where on the axis they were
//! recorded, as the file's description says: OME-XML (schema 2016-06,
//! openmicroscopy.org/Schemas/OME/2016-06), ImageJ's entries (ij.io.FileSaver, FileOpener) or tifffile's shape.

use std::collections::{BTreeMap, BTreeSet};

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

/// The axes: channels, slices, times.
const AXES: [char; 3] = ['C', 'Z', 'T'];

/// How the pages of a file are arranged.
#[derive(Debug, Clone, PartialEq)]
pub struct Arrangement {
    /// The program or standard that says so.
    pub by: &'static str,
    /// Numbers of channels, slices and times.
    pub sizes: [usize; 3],
    /// Channel, slice and time of each page.
    pub pages: Vec<[usize; 3]>,
    /// Names of the files of the set that the file is part of; empty if it is whole.
    pub set: Vec<String>,
    /// The step between slices.
    step: Option<Length>,
    /// Position of each page on the axis.
    positions: Vec<Option<Length>>,
}

/// A length as a file states it.
#[derive(Debug, Clone, PartialEq)]
struct Length {
    /// Name in the file.
    key: &'static str,
    value: String,
    unit: Option<String>,
    /// Unit if there is none: the default of the standard.
    default: Option<&'static str>,
}

/// A position on the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisPosition {
    /// The position, um.
    pub um: f64,
    /// Whether the file states the unit; if not, um are assumed.
    pub has_unit: bool,
}

impl Length {
    /// The length in um.
    fn um(&self) -> Result<f64, String> {
        let Length { key, value, .. } = self;
        let number = value.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        let number = number.ok_or_else(|| format!("{key} = {value:?}: expected a finite number"))?;
        let Some(unit) = self.unit.as_deref().or(self.default) else {
            return Err(format!("{key} = {value} without a unit of length"));
        };
        let um = unit_um(unit).ok_or_else(|| format!("{key} = {value} {unit}: expected a unit of length"))?;
        Ok(number * um)
    }
}

/// A unit of length in um, by a name or symbol that ImageJ, OME or TrackMate write; `None` for others, such as
/// pixels.
pub fn unit_um(unit: &str) -> Option<f64> {
    let unit =
        unit.trim().replace("\\u00B5", "u").replace("\\u00b5", "u").replace(['\u{b5}', '\u{3bc}'], "u");
    let by_symbol = match unit.as_str() {
        "m" => 1e6,
        "dm" => 1e5,
        "cm" => 1e4,
        "mm" => 1e3,
        "um" => 1.0,
        "nm" => 1e-3,
        "pm" => 1e-6,
        "\u{c5}" | "\u{212b}" => 1e-4,
        "in" | "\"" => 25_400.0,
        "thou" | "mil" => 25.4,
        _ => f64::NAN,
    };
    let word = unit.to_lowercase();
    let by_word = match word.strip_suffix('s').unwrap_or(&word) {
        "meter" | "metre" => 1e6,
        "centimeter" | "centimetre" => 1e4,
        "millimeter" | "millimetre" => 1e3,
        "micron" | "micrometer" | "micrometre" => 1.0,
        "nanometer" | "nanometre" => 1e-3,
        "picometer" | "picometre" => 1e-6,
        "angstrom" | "\u{e5}ngstr\u{f6}m" => 1e-4,
        "inch" | "inche" => 25_400.0,
        _ => f64::NAN,
    };
    [by_symbol, by_word].into_iter().find(|um| um.is_finite())
}

impl Arrangement {
    /// Reads the description of the first page of a file with `n` pages; `file` is its name without folders.
    /// `None` if it says nothing of the kind. Errors: a statement that does not fit the pages, or that needs
    /// other files.
    pub fn read(text: &str, file: &str, n: usize) -> Result<Option<Self>, String> {
        let text = text.trim_start_matches('\u{feff}').trim_start();
        if text.starts_with('<') {
            return Ome::parse(text)?.map(|ome| ome.arranged(file, n)).transpose();
        }
        if text.starts_with("ImageJ=") {
            return image_j(text, n).map(Some);
        }
        tifffile(text, n)
    }

    /// Number of images of a file with one directory, of which ImageJ (above 4 GB) and tifffile write the
    /// others without directories; 1 if the description does not say so.
    pub(super) fn images(text: &str) -> usize {
        match (text.starts_with("ImageJ="), shape(text)) {
            (true, _) => entry(text, "images").and_then(|n| n.parse().ok()).unwrap_or(1),
            (_, Some(shape)) => product(&shape).unwrap_or(usize::MAX),
            _ => 1,
        }
    }

    /// The step between slices, um. Errors: no number, zero, or a unit that is no length.
    pub fn step_um(&self) -> Result<Option<f64>, String> {
        let Some(step) = &self.step else { return Ok(None) };
        match step.um()? {
            0.0 => Err(format!("{} = {}: expected a step between slices", step.key, step.value)),
            um => Ok(Some(um)),
        }
    }

    /// The position of a page on the axis. Errors: no number, or a unit that is no length.
    pub fn position(&self, page: usize) -> Result<Option<AxisPosition>, String> {
        let Some(position) = self.positions.get(page).and_then(Option::as_ref) else { return Ok(None) };
        let has_unit = position.unit.is_some();
        Ok(Some(AxisPosition { um: position.um()?, has_unit }))
    }

    /// Pages in the order of axes of these sizes, the one that changes from page to page first.
    fn in_order(by: &'static str, axes: [usize; 3], sizes: [usize; 3], n: usize) -> Result<Self, String> {
        if product(&sizes) != Some(n) {
            return Err(misfit(by, sizes, n));
        }
        let pages = (0..n).map(|page| place(page, axes, sizes)).collect();
        Ok(Arrangement { by, sizes, pages, set: Vec::new(), step: None, positions: vec![None; n] })
    }
}

fn misfit(by: &str, [c, z, t]: [usize; 3], n: usize) -> String {
    format!("{by} states {c} channels x {z} slices x {t} times, which are not the {n} pages of the file")
}

fn product(sizes: &[usize]) -> Option<usize> {
    sizes.iter().try_fold(1usize, |product, size| product.checked_mul(*size))
}

/// Channel, slice and time at a place in the order of axes.
fn place(mut rest: usize, axes: [usize; 3], sizes: [usize; 3]) -> [usize; 3] {
    let mut at = [0; 3];
    for axis in axes {
        at[axis] = rest % sizes[axis];
        rest /= sizes[axis];
    }
    at
}

/// An entry of ImageJ's description.
fn entry<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('=')).map(str::trim)
}

/// ImageJ's entries; pages are in the order of channels, slices and times.
fn image_j(text: &str, n: usize) -> Result<Arrangement, String> {
    let size = |key: &str| match entry(text, key).map(|value| (value, value.parse())) {
        None => Ok(None),
        Some((_, Ok(size))) if size > 0 => Ok(Some(size)),
        Some((value, _)) => Err(format!("ImageJ states {key}={value}: expected a number of at least 1")),
    };
    if let Some(images) = size("images")?.filter(|images| *images != n) {
        return Err(format!("ImageJ states {images} images, the file has {n}"));
    }
    let sizes = match (size("channels")?, size("slices")?, size("frames")?) {
        // Images of which it says no more are slices.
        (None, None, None) => [1, n, 1],
        (c, z, t) => [c, z, t].map(|size| size.unwrap_or(1)),
    };
    let mut arranged = Arrangement::in_order("ImageJ", [0, 1, 2], sizes, n)?;
    let unit = entry(text, "zunit").or(entry(text, "unit")).map(str::to_owned);
    if let Some(value) = entry(text, "spacing") {
        let step = Length { key: "spacing", value: value.to_owned(), unit, default: None };
        // The depth of slice k is (k - zorigin) spacing.
        if let Some(origin) = entry(text, "zorigin") {
            let value = value.parse::<f64>().ok().zip(origin.parse::<f64>().ok());
            let (spacing, origin) =
                value.ok_or_else(|| format!("ImageJ states spacing={value:?}, zorigin={origin}"))?;
            let at = |page: &[usize; 3]| {
                let value = (0.0 + (page[1] as f64 - origin) * spacing).to_string();
                Some(Length { key: "zorigin", value, ..step.clone() })
            };
            arranged.positions = arranged.pages.iter().map(at).collect();
        }
        arranged.step = Some(step);
    }
    Ok(arranged)
}

/// The shape that tifffile notes, without rows and columns: `{"shape": [3, 21, 96, 96], "axes": "TZYX"}`.
fn shape(text: &str) -> Option<Vec<usize>> {
    let list = text.strip_prefix("{\"shape\": [")?.split_once(']')?.0;
    let mut shape = list.split(',').map(|size| size.trim().parse().ok()).collect::<Option<Vec<usize>>>()?;
    shape.truncate(shape.len().saturating_sub(2));
    Some(shape)
}

/// Tifffile's shape; one that is of a single page says nothing about others.
fn tifffile(text: &str, n: usize) -> Result<Option<Arrangement>, String> {
    let Some(shape) = shape(text).filter(|shape| product(shape) != Some(1)) else { return Ok(None) };
    if product(&shape) != Some(n) {
        return Err(format!("tifffile states a shape of {shape:?} pages, the file has {n}"));
    }
    let named = text.split_once("\"axes\": \"").and_then(|(_, rest)| rest.split_once('"'));
    let axes: Vec<char> = named.map_or_else(Vec::new, |(axes, _)| axes.chars().take(shape.len()).collect());
    let long: Vec<usize> = (0..shape.len()).filter(|k| shape[*k] > 1).collect();
    if axes.is_empty() && long.len() == 1 {
        return Ok(None);
    }
    let (mut order, mut sizes) = (Vec::new(), [1; 3]);
    for k in long.into_iter().rev() {
        // I: images, Q: unknown.
        let name = axes.get(k).map(|name| if matches!(name, 'I' | 'Q') { 'T' } else { *name });
        match name.and_then(|name| AXES.iter().position(|axis| *axis == name)) {
            Some(axis) if !order.contains(&axis) => (order.push(axis), sizes[axis] = shape[k]).0,
            _ => {
                let axes: String = axes.iter().collect();
                return Err(format!(
                    "tifffile states a shape of {shape:?} pages with axes {axes:?}: expected the axes of channels (C), slices \
                     (Z) and times (T)"
                ));
            }
        }
    }
    order.extend((0..3).filter(|axis| sizes[*axis] == 1));
    let order = order.try_into().unwrap_or([0, 1, 2]);
    Arrangement::in_order("tifffile", order, sizes, n).map(Some)
}

/// The metadata of OME-XML.
#[derive(Default)]
struct Ome {
    uuid: Option<String>,
    images: Vec<OmeImage>,
}

/// An image of it, with any number of pages.
#[derive(Default)]
struct OmeImage {
    /// Axes, the one that changes from page to page first.
    axes: [usize; 3],
    sizes: [usize; 3],
    step: Option<Length>,
    blocks: Vec<Block>,
    positions: BTreeMap<[usize; 3], Length>,
}

/// Which pages of which file hold which channels, slices and times (`TiffData`).
struct Block {
    first: [usize; 3],
    page: Option<usize>,
    pages: Option<usize>,
    file: Option<String>,
    uuid: String,
}

/// An attribute, with its entities resolved.
fn attribute(e: &BytesStart<'_>, name: &str) -> Result<Option<String>, String> {
    let damaged = |e: &dyn std::fmt::Display| format!("OME-XML is damaged: {e}");
    let Some(found) = e.try_get_attribute(name).map_err(|e| damaged(&e))? else { return Ok(None) };
    let value = found.normalized_value(XmlVersion::Implicit1_0).map_err(|e| damaged(&e))?;
    Ok(Some(value.into_owned()))
}

/// An attribute that is a whole number.
fn whole(e: &BytesStart<'_>, name: &str) -> Result<Option<usize>, String> {
    let Some(value) = attribute(e, name)? else { return Ok(None) };
    let wrong = |_| format!("OME-XML states {name} = {value:?}: expected a whole number");
    value.trim().parse().map(Some).map_err(wrong)
}

/// Whole numbers of each axis, such as `SizeC`, `SizeZ` and `SizeT`.
fn axis_numbers(e: &BytesStart<'_>, names: [&str; 3], default: usize) -> Result<[usize; 3], String> {
    let [c, z, t] = names.map(|name| whole(e, name).map(|value| value.unwrap_or(default)));
    Ok([c?, z?, t?])
}

impl Ome {
    /// Parses XML; `None` if it is of another kind.
    fn parse(text: &str) -> Result<Option<Self>, String> {
        let mut reader = Reader::from_str(text);
        let (mut ome, mut is_ome, mut in_uuid) = (Ome::default(), false, false);
        loop {
            let event = match reader.read_event() {
                Ok(event) => event,
                Err(_) if !is_ome => return Ok(None),
                Err(e) => return Err(format!("OME-XML is damaged: {e}")),
            };
            match &event {
                Event::Start(e) | Event::Empty(e) => {
                    let name = e.local_name();
                    if !is_ome && name.as_ref() != "OME" {
                        return Ok(None);
                    }
                    is_ome = true;
                    in_uuid = name.as_ref() == "UUID" && matches!(event, Event::Start(_));
                    ome.element(name.as_ref(), e)?;
                }
                Event::Text(text) if in_uuid => {
                    if let Some(block) = ome.images.last_mut().and_then(|image| image.blocks.last_mut()) {
                        block.uuid += text.xml10_content().trim();
                    }
                }
                Event::End(_) => in_uuid = false,
                Event::Eof => return Ok(Some(ome).filter(|_| is_ome)),
                _ => {}
            }
        }
    }

    fn element(&mut self, name: &str, e: &BytesStart<'_>) -> Result<(), String> {
        match (name, self.images.last_mut()) {
            ("OME", _) => self.uuid = attribute(e, "UUID")?,
            ("BinaryOnly", _) => {
                let other = attribute(e, "MetadataFile")?.unwrap_or_default();
                return Err(format!(
                    "OME-XML is in another file, {other:?}: expected a file that has its own"
                ));
            }
            ("Pixels", _) => {
                let order = attribute(e, "DimensionOrder")?.unwrap_or_else(|| "XYCZT".to_owned());
                let axis = |name: char| AXES.iter().position(|axis| *axis == name);
                let axes: Vec<usize> = order.chars().skip(2).filter_map(axis).collect();
                let axes: [usize; 3] = axes.try_into().unwrap_or([0; 3]);
                if !order.starts_with("XY") || (0..3).any(|axis| !axes.contains(&axis)) {
                    return Err(format!("OME-XML states the order {order:?}: expected one such as XYCZT"));
                }
                let sizes = axis_numbers(e, ["SizeC", "SizeZ", "SizeT"], 1)?;
                if sizes.contains(&0) || product(&sizes).is_none() {
                    return Err(format!("OME-XML states sizes of {sizes:?}: expected at least 1 of each"));
                }
                let unit = attribute(e, "PhysicalSizeZUnit")?;
                let step = attribute(e, "PhysicalSizeZ")?;
                let step =
                    step.map(|value| Length { key: "PhysicalSizeZ", value, unit, default: Some("um") });
                self.images.push(OmeImage { axes, sizes, step, ..OmeImage::default() });
            }
            ("TiffData", Some(image)) => image.blocks.push(Block {
                first: axis_numbers(e, ["FirstC", "FirstZ", "FirstT"], 0)?,
                page: whole(e, "IFD")?,
                pages: whole(e, "PlaneCount")?,
                file: None,
                uuid: String::new(),
            }),
            ("UUID", Some(image)) => {
                if let Some(block) = image.blocks.last_mut() {
                    block.file = attribute(e, "FileName")?;
                }
            }
            ("Plane", Some(image)) => {
                if let Some(value) = attribute(e, "PositionZ")? {
                    let unit = attribute(e, "PositionZUnit")?;
                    let at = axis_numbers(e, ["TheC", "TheZ", "TheT"], 0)?;
                    let position = Length { key: "PositionZ", value, unit, default: Some("um") };
                    image.positions.insert(at, position);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// The arrangement of the `n` pages of the file with this name.
    fn arranged(self, file: &str, n: usize) -> Result<Arrangement, String> {
        let files = |image: &OmeImage| -> BTreeSet<String> {
            image.blocks.iter().filter_map(|block| block.file.clone()).collect()
        };
        // The name of an only file may have been changed since.
        let is_alone = self.images.iter().flat_map(files).collect::<BTreeSet<_>>().len() < 2;
        let is_own = |block: &Block| match &block.file {
            Some(name) if !is_alone => {
                name.rsplit(['/', '\\']).next() == Some(file)
                    || self.uuid.as_ref().is_some_and(|uuid| *uuid == block.uuid)
            }
            _ => true,
        };
        let is_in_file = |image: &&OmeImage| image.blocks.is_empty() || image.blocks.iter().any(is_own);
        let own: Vec<&OmeImage> = self.images.iter().filter(is_in_file).collect();
        let [image] = own[..] else {
            return Err(match own.len() {
                0 if self.images.is_empty() => "OME-XML has no element Pixels".to_owned(),
                0 => {
                    let all: Vec<String> = self.images.iter().flat_map(files).collect();
                    format!("OME-XML is of files with other names: {}", all.join(", "))
                }
                images => format!(
                    "OME-XML states {images} images (series, such as positions): expected one; save each in a file of its own"
                ),
            });
        };
        let (axes, sizes, set) = (image.axes, image.sizes, files(image));
        let whole = product(&sizes).unwrap_or(usize::MAX);
        let mut pages: Vec<Option<[usize; 3]>> = vec![None; n];
        let everything = Block { first: [0; 3], page: None, pages: None, file: None, uuid: String::new() };
        let blocks = if image.blocks.is_empty() { std::slice::from_ref(&everything) } else { &image.blocks };
        for block in blocks.iter().filter(|block| is_own(block)) {
            let page = block.page.unwrap_or(0);
            let count = block.pages.unwrap_or(if block.page.is_some() { 1 } else { n.saturating_sub(page) });
            let stride = |k: usize| axes[..k].iter().fold(1usize, |stride, axis| stride * sizes[*axis]);
            let first = (0..3).map(|k| block.first[axes[k]].saturating_mul(stride(k)));
            let first = first.fold(0usize, usize::saturating_add);
            let last = first.saturating_add(count);
            let is_inside = (0..3).all(|axis| block.first[axis] < sizes[axis]) && last <= whole;
            if !is_inside || page.saturating_add(count) > n {
                return Err(misfit("OME-XML", sizes, n));
            }
            for k in 0..count {
                if pages[page + k].replace(place(first + k, axes, sizes)).is_some() {
                    return Err(format!("OME-XML states page {} twice", page + k));
                }
            }
        }
        let pages = pages.into_iter().collect::<Option<Vec<[usize; 3]>>>();
        let pages = pages.ok_or_else(|| misfit("OME-XML", sizes, n))?;
        let places: BTreeSet<&[usize; 3]> = pages.iter().collect();
        if places.len() != n || (set.len() < 2 && n != whole) {
            return Err(misfit("OME-XML", sizes, n));
        }
        let positions = pages.iter().map(|page| image.positions.get(page).cloned()).collect();
        let set = if set.len() < 2 { Vec::new() } else { set.into_iter().collect() };
        Ok(Arrangement { by: "OME-XML", sizes, set, step: image.step.clone(), positions, pages })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, n: usize) -> Result<Option<Arrangement>, String> {
        Arrangement::read(text, "a.ome.tif", n)
    }

    fn ome(attributes: &str, inside: &str) -> String {
        format!(
            "<?xml version='1.0'?><!-- < --><o:OME xmlns:o='x'><o:Image><o:Pixels {attributes}>{inside}</o:Pixels></o:Image></o:OME>"
        )
    }

    #[test]
    fn pages_are_arranged_as_their_file_says() {
        let order = |order: &str| {
            let text = ome(&format!("DimensionOrder='{order}' SizeC=\"2\" SizeT='3' SizeZ='1'"), "");
            read(&text, 6).unwrap().unwrap().pages.iter().map(|[c, _, t]| (*c, *t)).collect::<Vec<_>>()
        };
        assert_eq!(order("XYTCZ"), [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]);
        assert_eq!(order("XYZCT"), [(0, 0), (1, 0), (0, 1), (1, 1), (0, 2), (1, 2)]);
        let arranged = read("ImageJ=1.53t\nimages=6\nchannels=2\nframes=3\n", 6).unwrap().unwrap();
        assert_eq!((arranged.sizes, arranged.pages[3]), ([2, 1, 3], [1, 0, 1]));
        let arranged = read("ImageJ=1.53t\nimages=6\nspacing=2\nunit=um\n", 6).unwrap().unwrap();
        assert_eq!((arranged.sizes, arranged.step_um()), ([1, 6, 1], Ok(Some(2.0))));
        // Axes of tifffile in any order; a shape of one page describes this page only.
        let arranged = read(r#"{"shape": [2, 3, 9, 9], "axes": "CZYX"}"#, 6).unwrap().unwrap();
        assert_eq!((arranged.sizes, arranged.pages[4]), ([2, 3, 1], [1, 1, 0]));
        for text in ["a camera", r#"{"shape": [9, 9]}"#, r#"{"shape": [6, 9, 9]}"#, "<a><OME/></a>", "<"] {
            assert_eq!(read(text, 6), Ok(None), "{text}");
        }
    }

    #[test]
    fn files_of_a_set_have_their_part_of_it() {
        let block = |t: usize, ifd: usize, file: &str, uuid: &str| {
            format!(
                "<TiffData FirstT='{t}' IFD='{ifd}' PlaneCount='1'><UUID FileName='{file}'>{uuid}</UUID></TiffData>"
            )
        };
        let blocks = [
            block(0, 0, "b.ome.tif", "u:b"),
            block(1, 1, "a.ome.tif", "u:a"),
            block(2, 0, "a.ome.tif", "u:a"),
        ];
        let text = ome("SizeT='3'", &blocks.concat());
        let arranged = read(&text, 2).unwrap().unwrap();
        assert_eq!((arranged.pages, arranged.set.len()), (vec![[0, 0, 2], [0, 0, 1]], 2));
        let renamed = Arrangement::read(&text, "c.tif", 2).unwrap_err();
        assert!(renamed.contains("files with other names: a.ome.tif, b.ome.tif"), "{renamed}");
        let known = text.replace("<o:OME ", "<o:OME UUID='u:b' ");
        assert_eq!(Arrangement::read(&known, "c.tif", 1).unwrap().unwrap().pages, [[0, 0, 0]]);
        // An only file may have any name.
        let alone = ome("SizeT='2'", &[block(0, 1, "b.tif", ""), block(1, 0, "b.tif", "")].concat());
        assert_eq!(read(&alone, 2).unwrap().unwrap().pages, [[0, 0, 1], [0, 0, 0]]);
    }

    #[test]
    fn statements_that_do_not_fit_the_pages_are_refused() {
        let set = "<TiffData IFD='0' PlaneCount='1'/>";
        for (text, n, found) in [
            (ome("SizeZ='21'", ""), 20, "1 channels x 21 slices x 1 times, which are not the 20 pages"),
            (ome("SizeZ='21'", "<TiffData/>"), 42, "not the 42 pages"),
            (ome("SizeZ='2'", set), 2, "not the 2 pages"),
            (ome("SizeZ='2'", &[set, set].concat()), 1, "page 0 twice"),
            (ome("SizeZ='2'", "<TiffData FirstZ='2' IFD='0'/>"), 1, "not the 1 pages"),
            (ome("SizeZ='two'", ""), 2, "SizeZ = \"two\""),
            (ome("SizeZ='0'", ""), 2, "at least 1"),
            (ome("SizeZ='2'", "").replace("XYCZT", ""), 3, "not the 3 pages"),
            (ome("DimensionOrder='XYZZT'", ""), 1, "the order \"XYZZT\""),
            (
                ome("SizeZ='2'", "").replace("</o:Image>", "</o:Image><o:Image><o:Pixels/></o:Image>"),
                2,
                "2 images",
            ),
            ("<OME><BinaryOnly MetadataFile='m.ome'/></OME>".to_owned(), 2, "another file, \"m.ome\""),
            ("<OME><Image></OME>".to_owned(), 2, "damaged"),
            ("ImageJ=1\nimages=3\nslices=3\n".to_owned(), 6, "3 images, the file has 6"),
            ("ImageJ=1\nimages=6\nslices=2\nframes=2\n".to_owned(), 6, "2 slices x 2 times"),
            (r#"{"shape": [3, 2, 9, 9]}"#.to_owned(), 6, "expected the axes"),
            (r#"{"shape": [3, 9, 9]}"#.to_owned(), 6, "the file has 6"),
        ] {
            let message = read(&text, n).unwrap_err();
            assert!(message.contains(found), "{text}: {message}");
        }
    }

    #[test]
    fn steps_and_positions_are_in_um() {
        for (unit, um) in [
            ("\u{b5}m", 1.0),
            ("\u{3bc}m", 1.0),
            ("\\u00B5m", 1.0),
            ("Micron", 1.0),
            ("micrometers", 1.0),
            ("nm", 1e-3),
            ("mm", 1e3),
            ("Nanometer", 1e-3),
            ("inch", 25_400.0),
            ("inches", 25_400.0),
            ("in", 25_400.0),
            ("m", 1e6),
        ] {
            assert_eq!(unit_um(unit), Some(um), "{unit}");
        }
        for unit in ["pixel", "", "reference frame", "Mm", "s"] {
            assert_eq!(unit_um(unit), None, "{unit}");
        }
        let step = |text: &str| read(text, 2).unwrap().unwrap().step_um();
        assert_eq!(step("ImageJ=1\nimages=2\nunit=micron\nzunit=nm\nspacing=2000.0\n"), Ok(Some(2.0)));
        assert_eq!(step("ImageJ=1\nimages=2\nunit=um\nspacing=-2\n"), Ok(Some(-2.0)));
        assert_eq!(step("ImageJ=1\nimages=2\nunit=um\n"), Ok(None));
        assert!(step("ImageJ=1\nimages=2\nspacing=2\n").unwrap_err().contains("without a unit"));
        assert!(step("ImageJ=1\nimages=2\nspacing=2\nunit=pixel\n").unwrap_err().contains("2 pixel"));
        assert_eq!(step(&ome("SizeZ='2' PhysicalSizeZ='0.5'", "")), Ok(Some(0.5)));
        assert_eq!(step(&ome("SizeZ='2' PhysicalSizeZ='2000' PhysicalSizeZUnit='nm'", "")), Ok(Some(2.0)));
        assert!(step(&ome("SizeZ='2' PhysicalSizeZ='0'", "")).unwrap_err().contains("expected a step"));
        let planes =
            "<Plane TheZ='1' PositionZ='-3' PositionZUnit='&#181;m'/><Plane TheZ='0' PositionZ='1e-3'/>";
        let arranged = read(&ome("SizeZ='2'", planes), 2).unwrap().unwrap();
        let at = |page| arranged.position(page).unwrap().map(|at| (at.um, at.has_unit));
        assert_eq!([at(0), at(1)], [Some((1e-3, false)), Some((-3.0, true))]);
        let arranged = read("ImageJ=1\nimages=2\nunit=um\nspacing=2\nzorigin=1.5\n", 2).unwrap().unwrap();
        assert_eq!([0, 1].map(|page| arranged.position(page).unwrap().unwrap().um), [-3.0, -1.0]);
    }
}
