//! VTK's XML files of images (`.vti`) and rectilinear grids (`.vtr`), as ParaView, PyVista and OpenFOAM's
//! tools write them: text, base64 or appended data, uncompressed or compressed by zlib.
//!
//! Velocities are point data in um/s, coordinates are in um. A rectilinear grid must have equal steps.

use std::io::BufRead;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;
use miniz_oxide::inflate::decompress_to_vec_zlib_with_limit;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::{VelocityGrid, even_axis, fault, nodes, select};
use crate::error::{Error, Result};

const FORMAT: &str = "vtk";

fn wrong(found: impl Into<String>, expected: &str) -> Error {
    fault(FORMAT, None, found.into(), expected)
}

#[derive(Debug, Default)]
struct DataArray {
    name: String,
    kind: String,
    components: usize,
    /// `ascii`, `binary` or `appended`.
    format: String,
    offset: usize,
    text: String,
}

#[derive(Debug, Default)]
struct Header {
    grid: String,
    is_big_endian: bool,
    has_long_sizes: bool,
    compressor: Option<String>,
    extent: Vec<i64>,
    pieces: usize,
    origin: Option<DVec3>,
    spacing: Option<DVec3>,
    points: Vec<DataArray>,
    coordinates: Vec<DataArray>,
    has_cells: bool,
    is_appended_in_base64: bool,
}

impl VelocityGrid {
    /// Reads a VTK XML file of an image or of a rectilinear grid with equal steps. The velocity, in um/s, is
    /// the point data with three components, of several the array named `array`; returns its name, too.
    /// Coordinates are in um. `Err` if the file is malformed or holds something else, or names the arrays if
    /// there are several.
    pub fn from_vtk_xml(mut source: impl BufRead, array: Option<&str>) -> Result<(Self, String)> {
        let mut bytes = Vec::new();
        source.read_to_end(&mut bytes).map_err(|e| wrong(e.to_string(), "a file that can be read"))?;
        let (text, appended) = split(&bytes);
        let header = Header::read(text)?;
        let counts = header.counts()?;
        let n = nodes(&counts, 1)?;
        let vectors: Vec<&DataArray> = header.points.iter().filter(|array| array.components == 3).collect();
        let names: Vec<&str> = vectors.iter().map(|array| array.name.as_str()).collect();
        let found = vectors[select(&names, array, header.has_cells)?];
        let velocities = header.values(found, 3 * n, appended)?;
        let (origin, spacing) = header.geometry(counts, appended)?;
        let velocities = velocities.chunks(3).map(DVec3::from_slice).collect();
        Ok((VelocityGrid::oriented(origin, spacing, counts, velocities)?, found.name.clone()))
    }
}

/// The XML up to appended data, and these data after their underscore.
fn split(bytes: &[u8]) -> (&[u8], &[u8]) {
    let mark = b"<AppendedData";
    let Some(at) = bytes.windows(mark.len()).position(|window| window == mark) else { return (bytes, &[]) };
    let open = bytes[at..].iter().position(|b| *b == b'>').map_or(bytes.len(), |end| at + end + 1);
    let data =
        bytes[open..].iter().position(|b| *b == b'_').map_or(&[][..], |start| &bytes[open + start + 1..]);
    (&bytes[..open], data)
}

impl Header {
    fn read(text: &[u8]) -> Result<Self> {
        let text = String::from_utf8_lossy(text);
        let mut reader = Reader::from_str(&text);
        reader.config_mut().check_end_names = false;
        let (mut header, mut within) = (Header::default(), String::new());
        // Level below an array's element, whose own text is at 1; VTK also writes other elements in it.
        let mut level = 0;
        loop {
            let event = reader.read_event().map_err(|e| wrong(e.to_string(), "VTK's XML"))?;
            match event {
                Event::Start(element) => {
                    header.open(&element, &mut within)?;
                    let is_array = element.local_name().as_ref() == "DataArray";
                    level = if is_array { 1 } else { level + u32::from(level > 0) };
                }
                Event::Empty(element) => {
                    let before = within.clone();
                    header.open(&element, &mut within)?;
                    within = before;
                }
                Event::Text(text) if level == 1 => {
                    let array = match within.as_str() {
                        "PointData" => header.points.last_mut(),
                        "Coordinates" => header.coordinates.last_mut(),
                        _ => None,
                    };
                    if let Some(array) = array {
                        array.text.push_str(&text);
                    }
                }
                Event::End(element) => {
                    level = level.saturating_sub(1);
                    if element.local_name().as_ref() == within {
                        within.clear();
                    }
                }
                Event::Eof => break,
                _ => {}
            }
        }
        if !["ImageData", "RectilinearGrid"].contains(&header.grid.as_str()) {
            let found = if header.grid.is_empty() { "another file".to_owned() } else { header.grid };
            return Err(wrong(found, "VTKFile of type ImageData (.vti) or RectilinearGrid (.vtr)"));
        }
        match header.compressor.as_deref() {
            None | Some("" | "vtkZLibDataCompressor") => Ok(header),
            Some(other) => Err(wrong(other, "no compression, or vtkZLibDataCompressor")),
        }
    }

    fn open(&mut self, element: &BytesStart<'_>, within: &mut String) -> Result<()> {
        let get = |name: &str| {
            let found = element.try_get_attribute(name).ok().flatten()?;
            Some(found.value.into_owned())
        };
        let three = |name: &str| -> Result<Option<DVec3>> {
            let Some(text) = get(name) else { return Ok(None) };
            let numbers: Vec<f64> = text.split_whitespace().filter_map(|word| word.parse().ok()).collect();
            let numbers = <[f64; 3]>::try_from(numbers)
                .map_err(|_| wrong(format!("{name}={text:?}"), "three numbers"))?;
            Ok(Some(DVec3::from_array(numbers)))
        };
        match element.local_name().as_ref() {
            "VTKFile" => {
                self.grid = get("type").unwrap_or_default();
                self.is_big_endian = get("byte_order").as_deref() == Some("BigEndian");
                self.has_long_sizes = get("header_type").as_deref() == Some("UInt64");
                self.compressor = get("compressor");
            }
            "ImageData" | "RectilinearGrid" => {
                let extent = get("WholeExtent").unwrap_or_default();
                self.extent = extent.split_whitespace().filter_map(|word| word.parse().ok()).collect();
                (self.origin, self.spacing) = (three("Origin")?, three("Spacing")?);
                let direction = get("Direction").unwrap_or_default();
                let direction: Vec<f64> =
                    direction.split_whitespace().filter_map(|word| word.parse().ok()).collect();
                if !direction.is_empty() && direction != [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] {
                    return Err(wrong("Direction of a rotated image", "axes along x, y and z"));
                }
            }
            "Piece" => self.pieces += 1,
            "PointData" => *within = "PointData".to_owned(),
            "Coordinates" => *within = "Coordinates".to_owned(),
            "CellData" => *within = "CellData".to_owned(),
            "AppendedData" => self.is_appended_in_base64 = get("encoding").as_deref() == Some("base64"),
            "DataArray" => {
                let array = DataArray {
                    name: get("Name").unwrap_or_default(),
                    kind: get("type").unwrap_or_default(),
                    components: get("NumberOfComponents").and_then(|n| n.parse().ok()).unwrap_or(1),
                    format: get("format").unwrap_or_else(|| "ascii".to_owned()),
                    offset: get("offset").and_then(|n| n.parse().ok()).unwrap_or(0),
                    text: String::new(),
                };
                match within.as_str() {
                    "PointData" => self.points.push(array),
                    "Coordinates" => self.coordinates.push(array),
                    "CellData" => self.has_cells |= array.components == 3,
                    _ => {}
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Number of nodes along x, y and z.
    fn counts(&self) -> Result<[usize; 3]> {
        let side = |k: usize| {
            let (first, last) = (self.extent.get(2 * k)?, self.extent.get(2 * k + 1)?);
            usize::try_from(last.checked_sub(*first)?.checked_add(1)?).ok()
        };
        match (side(0), side(1), side(2), self.pieces) {
            (Some(x), Some(y), Some(z), 1) if x > 0 && y > 0 && z > 0 => Ok([x, y, z]),
            (Some(_), Some(_), Some(_), pieces) if pieces != 1 => {
                Err(wrong(format!("{pieces} pieces"), "one piece"))
            }
            _ => Err(wrong(
                format!("WholeExtent {:?}", self.extent),
                "the first and last node along x, y and z",
            )),
        }
    }

    /// Position of the first node, and steps.
    fn geometry(&self, counts: [usize; 3], appended: &[u8]) -> Result<(DVec3, DVec3)> {
        if self.grid == "ImageData" {
            let spacing = self.spacing.unwrap_or(DVec3::ONE);
            let low = DVec3::from_array([0, 2, 4].map(|k| self.extent[k] as f64));
            return Ok((self.origin.unwrap_or(DVec3::ZERO) + low * spacing, spacing));
        }
        if self.coordinates.len() != 3 {
            return Err(wrong(
                format!("{} coordinates", self.coordinates.len()),
                "three arrays of coordinates",
            ));
        }
        let (mut origin, mut spacing) = (DVec3::ZERO, DVec3::ONE);
        for (axis, array) in self.coordinates.iter().enumerate() {
            let at = self.values(array, counts[axis], appended)?;
            (origin[axis], spacing[axis]) = even_axis(axis, &at)?;
        }
        Ok((origin, spacing))
    }

    fn values(&self, array: &DataArray, n: usize, appended: &[u8]) -> Result<Vec<f64>> {
        let name = &array.name;
        let size = match array.kind.as_str() {
            "Float32" => 4,
            "Float64" => 8,
            other => return Err(wrong(format!("{name}: {other}"), "Float32 or Float64")),
        };
        let values = match array.format.as_str() {
            "ascii" => {
                let words = array.text.split_whitespace().take(n + 1);
                let numbers: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
                numbers.ok_or_else(|| wrong(format!("{name}: text"), "numbers"))?
            }
            format => {
                let bytes = match format {
                    "binary" => self.decoded(array.text.trim().as_bytes(), n * size),
                    "appended" => {
                        appended.get(array.offset..).and_then(|data| match self.is_appended_in_base64 {
                            true => self.decoded(data, n * size),
                            false => self.unpacked(data, n * size),
                        })
                    }
                    _ => None,
                };
                let bytes = bytes.ok_or_else(|| {
                    wrong(
                        format!("{name}: {format} data that end early or are damaged"),
                        &format!("{} bytes", n * size),
                    )
                })?;
                let value = |chunk: &[u8]| {
                    let fold = |bits: u64, byte: &u8| bits << 8 | u64::from(*byte);
                    let bits = match self.is_big_endian {
                        true => chunk.iter().fold(0, fold),
                        false => chunk.iter().rev().fold(0, fold),
                    };
                    if size == 8 { f64::from_bits(bits) } else { f64::from(f32::from_bits(bits as u32)) }
                };
                bytes.chunks_exact(size).map(value).collect()
            }
        };
        match values.len() == n {
            true => Ok(values),
            false => Err(wrong(format!("{name}: {} numbers", values.len()), &n.to_string())),
        }
    }

    fn word(&self) -> usize {
        if self.has_long_sizes { 8 } else { 4 }
    }

    fn size(&self, data: &[u8], k: usize) -> Option<usize> {
        let bytes = data.get(k * self.word()..(k + 1) * self.word())?;
        let fold = |bits: u64, byte: &u8| bits << 8 | u64::from(*byte);
        let size =
            if self.is_big_endian { bytes.iter().fold(0, fold) } else { bytes.iter().rev().fold(0, fold) };
        usize::try_from(size).ok()
    }

    /// Data that follow their sizes.
    fn unpacked(&self, data: &[u8], expected: usize) -> Option<Vec<u8>> {
        if self.compressor.as_deref().unwrap_or_default().is_empty() {
            let bytes = self.size(data, 0).filter(|bytes| *bytes == expected)?;
            return data.get(self.word()..self.word() + bytes).map(<[u8]>::to_vec);
        }
        let blocks = self.size(data, 0).filter(|blocks| *blocks <= data.len())?;
        self.inflated(data, data.get((3 + blocks) * self.word()..)?, blocks, expected)
    }

    /// The blocks whose sizes are at the beginning of `sizes`.
    fn inflated(&self, sizes: &[u8], mut data: &[u8], blocks: usize, expected: usize) -> Option<Vec<u8>> {
        let mut all = Vec::new();
        for block in 0..blocks {
            let (packed, rest) = data.split_at_checked(self.size(sizes, 3 + block)?)?;
            all.extend(decompress_to_vec_zlib_with_limit(packed, expected - all.len()).ok()?);
            data = rest;
        }
        (all.len() == expected).then_some(all)
    }

    /// Data in base64: the sizes of compressed blocks are encoded on their own.
    fn decoded(&self, text: &[u8], expected: usize) -> Option<Vec<u8>> {
        let decode = |text: &[u8]| STANDARD.decode(text).ok();
        let length = |bytes: usize| bytes.div_ceil(3) * 4;
        if self.compressor.as_deref().unwrap_or_default().is_empty() {
            return self.unpacked(&decode(text.get(..length(self.word() + expected))?)?, expected);
        }
        let blocks =
            self.size(&decode(text.get(..length(self.word()).max(12))?)?, 0).filter(|n| *n <= text.len())?;
        let (sizes, data) = text.split_at_checked(length((3 + blocks) * self.word()))?;
        let sizes = decode(sizes)?;
        let packed: usize = (0..blocks).map(|block| self.size(&sizes, 3 + block)).sum::<Option<usize>>()?;
        self.inflated(&sizes, &decode(data.get(..length(packed))?)?, blocks, expected)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::small;
    use super::*;
    use miniz_oxide::deflate::compress_to_vec_zlib;

    fn numbers() -> Vec<f64> {
        small().velocities.iter().flat_map(|u| u.to_array()).collect()
    }

    fn image(attributes: &str, array: &str, more: &str) -> String {
        format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" {attributes}>\n\
             <ImageData WholeExtent=\"2 4 0 1 0 1\" Origin=\"0 2 3\" Spacing=\"0.5 1 2\">\n<Piece Extent=\"2 4 0 1 0 1\">\n\
             <PointData Vectors=\"U\">\n<DataArray type=\"Float64\" Name=\"p\" format=\"ascii\"><InformationKey name=\"L2\"><Value>0</Value></InformationKey>1 2 3</DataArray>\n\
             <DataArray type=\"Float64\" Name=\"U\" NumberOfComponents=\"3\" {array}</DataArray>\n</PointData>\n\
             <CellData></CellData></Piece></ImageData>{more}</VTKFile>\n"
        )
    }

    fn read(file: &[u8]) -> std::result::Result<VelocityGrid, String> {
        VelocityGrid::from_vtk_xml(file, None).map(|(grid, _)| grid).map_err(|e| e.to_string())
    }

    #[test]
    fn images_are_read_in_all_encodings() {
        let bytes: Vec<u8> = numbers().iter().flat_map(|x| x.to_le_bytes()).collect();
        let text: Vec<String> = numbers().iter().map(f64::to_string).collect();
        let key =
            "<InformationKey name=\"L2_NORM\" length=\"1\"><Value index=\"0\">7</Value></InformationKey>";
        let ascii = image("", &format!("format=\"ascii\">{key}{}", text.join(" ")), "");
        assert_eq!(read(ascii.as_bytes()), Ok(small()));
        let plain = [&(bytes.len() as u32).to_le_bytes()[..], &bytes].concat();
        let binary = image("", &format!("format=\"binary\">\n{}\n", STANDARD.encode(&plain)), "");
        assert_eq!(read(binary.as_bytes()), Ok(small()));
        // Two blocks, the last of which is shorter.
        let cut = 200;
        let blocks = [compress_to_vec_zlib(&bytes[..cut], 6), compress_to_vec_zlib(&bytes[cut..], 6)];
        let sizes =
            [2, cut as u64, (bytes.len() - cut) as u64, blocks[0].len() as u64, blocks[1].len() as u64];
        let sizes: Vec<u8> = sizes.iter().flat_map(|n| n.to_le_bytes()).collect();
        let data = blocks.concat();
        let packed = "header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\"";
        let encoded = STANDARD.encode(&sizes) + &STANDARD.encode(&data);
        assert_eq!(read(image(packed, &format!("format=\"binary\">{encoded}"), "").as_bytes()), Ok(small()));
        let appended = |encoding: &str, attributes: &str, data: &[u8]| {
            let more = format!("<AppendedData encoding=\"{encoding}\">\n _xyz");
            let file = image(attributes, "format=\"appended\" offset=\"3\">", &more);
            let file = file.trim_end().trim_end_matches("</VTKFile>").as_bytes().to_vec();
            [&file[..], data, b"\n</AppendedData></VTKFile>"].concat()
        };
        assert_eq!(read(&appended("raw", "", &plain)), Ok(small()));
        assert_eq!(read(&appended("raw", packed, &[sizes, data].concat())), Ok(small()));
        assert_eq!(read(&appended("base64", packed, encoded.as_bytes())), Ok(small()));
        assert!(read(&appended("raw", "", &plain[..100])).unwrap_err().contains("end early"));
    }

    #[test]
    fn rectilinear_grids_need_equal_steps() {
        let text: Vec<String> = numbers().iter().map(f64::to_string).collect();
        let grid = |x: &str| {
            format!(
                "<VTKFile type=\"RectilinearGrid\" byte_order=\"BigEndian\"><RectilinearGrid WholeExtent=\"0 2 0 1 0 1\"><Piece>\
                 <PointData><DataArray type=\"Float32\" Name=\"U\" NumberOfComponents=\"3\" format=\"ascii\">{}</DataArray></PointData>\
                 <Coordinates><DataArray type=\"Float64\" format=\"ascii\">{x}</DataArray><DataArray type=\"Float64\" format=\"ascii\">2 3\
                 </DataArray><DataArray type=\"Float64\" format=\"ascii\">3 5</DataArray></Coordinates></Piece></RectilinearGrid></VTKFile>",
                text.join("\n")
            )
        };
        assert_eq!(read(grid("1 1.5 2").as_bytes()), Ok(small()));
        // Falling x: the rows of velocities are reversed.
        let falling = read(grid("2 1.5 1").as_bytes()).unwrap();
        assert_eq!((falling.origin, falling.spacing), (small().origin, small().spacing));
        assert_eq!(falling.velocities[..3], [2, 1, 0].map(|k| small().velocities[k]));
        assert!(
            read(grid("1 1.6 2").as_bytes())
                .unwrap_err()
                .contains("x = 1.6 um at node 1 where equal steps give 1.5")
        );
    }

    /// Whatever `Vectors` says: ParaView names the array last shown, which may be a vorticity.
    #[test]
    fn of_several_arrays_one_is_named() {
        let text: Vec<String> = numbers().iter().map(f64::to_string).collect();
        let data = format!("format=\"ascii\">{}", text.join(" "));
        let more = "<DataArray type=\"Float32\" Name=\"vorticity\" NumberOfComponents=\"3\" format=\"ascii\">0</DataArray>";
        let file = image("", &data, "").replace(
            "<DataArray type=\"Float64\" Name=\"U\"",
            &format!("{more}<DataArray type=\"Float64\" Name=\"U\""),
        );
        assert!(read(file.as_bytes()).unwrap_err().contains("several arrays of vectors (vorticity, U)"));
        let (grid, name) = VelocityGrid::from_vtk_xml(file.as_bytes(), Some("U")).unwrap();
        assert_eq!((grid, name.as_str()), (small(), "U"));
    }

    #[test]
    fn other_files_are_refused() {
        let refuse = |from: &str, to: &str| {
            let text: Vec<String> = numbers().iter().map(f64::to_string).collect();
            let file = image("", &format!("format=\"ascii\">{}", text.join(" ")), "");
            read(file.replace(from, to).as_bytes()).unwrap_err()
        };
        assert!(refuse("ImageData", "UnstructuredGrid").contains("UnstructuredGrid"));
        assert!(refuse("\"2 4 0 1 0 1\" Origin", "\"0 9999999 0 999999 0 9\" Origin").contains("50000000"));
        assert!(refuse("NumberOfComponents=\"3\"", "NumberOfComponents=\"2\"").contains("three components"));
        assert!(refuse("\"Float64\" Name=\"U\"", "\"Int8\" Name=\"U\"").contains("Float32 or Float64"));
        assert!(
            refuse("byte_order", "compressor=\"vtkLZ4DataCompressor\" byte_order")
                .contains("vtkZLibDataCompressor")
        );
        assert!(refuse("\"2 4 0", &format!("\"{} {} 0", i64::MIN, i64::MAX)).contains("WholeExtent"));
        assert!(read(b"P6\n").unwrap_err().contains("VTKFile"));
        assert!(read(b"<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"0 1\"/>").is_err());
    }
}
