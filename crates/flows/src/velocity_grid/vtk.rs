//! Legacy VTK files of structured points and rectilinear grids.

use super::{VelocityGrid, even_axis, fault, nodes, select};
use crate::error::{Error, Result};
use glam::DVec3;
use std::io::{BufRead, Read};

impl VelocityGrid {
    /// Reads a legacy VTK file of structured points or of a rectilinear grid with equal steps, ASCII or binary.
    /// The velocity, in um/s, is the point data with three components, of several the one named `array`;
    /// returns its name, too. Coordinates are in um. `Err` names the line if the file is malformed, or the
    /// arrays if there are several.
    pub fn from_vtk(mut source: impl BufRead, array: Option<&str>) -> Result<(Self, String)> {
        let mut reader = VtkLines { source: &mut source, line: 0, is_binary: false };
        if !reader.next()?.is_some_and(|line| line.starts_with("# vtk DataFile")) {
            return Err(fault("vtk", Some(1), "a different header".to_owned(), "# vtk DataFile Version"));
        }
        reader.next()?;
        reader.is_binary = match reader.next()?.unwrap_or_default().trim() {
            "ASCII" => false,
            "BINARY" => true,
            other => return Err(fault("vtk", Some(3), format!("{other:?}"), "ASCII or BINARY")),
        };
        let (mut counts, mut origin, mut spacing) = (None, DVec3::ZERO, DVec3::ONE);
        // Number of values of each array; 0 before the data, whose fields give their own.
        let (mut tuples, mut is_of_points) = (0, false);
        let (mut arrays, mut has_cells) = (Vec::new(), false);
        while let Some(text) = reader.next()? {
            let line = reader.line;
            let words: Vec<&str> = text.split_whitespace().collect();
            let Some(keyword) = words.first() else { continue };
            let wrong = |expected: &str| fault("vtk", Some(line), text.trim().to_owned(), expected);
            let word = |k: usize| words.get(k).copied().unwrap_or_default();
            let whole = |k: usize| word(k).parse::<usize>().map_err(|_| wrong("a whole number"));
            let three = || -> Result<DVec3> {
                let numbers: Vec<f64> = words[1..].iter().filter_map(|word| word.parse().ok()).collect();
                let numbers = <[f64; 3]>::try_from(numbers).map_err(|_| wrong("three numbers"))?;
                Ok(DVec3::from_array(numbers))
            };
            let axis = ["X_COORDINATES", "Y_COORDINATES", "Z_COORDINATES"].iter().position(|k| k == keyword);
            // Components and type of an attribute.
            let attribute = match *keyword {
                "VECTORS" | "NORMALS" => Some((3, word(2))),
                "TENSORS" => Some((9, word(2))),
                "TEXTURE_COORDINATES" => Some((whole(2)?, word(3))),
                "SCALARS" => Some((if words.len() > 3 { whole(3)? } else { 1 }, word(2))),
                "COLOR_SCALARS" => {
                    Some((whole(2)?, if reader.is_binary { "unsigned_char" } else { "float" }))
                }
                _ => None,
            };
            match *keyword {
                "DATASET" if !["STRUCTURED_POINTS", "RECTILINEAR_GRID"].contains(&word(1)) => {
                    return Err(wrong("DATASET STRUCTURED_POINTS or RECTILINEAR_GRID"));
                }
                "DIMENSIONS" => {
                    let sizes = [whole(1)?, whole(2)?, whole(3)?];
                    nodes(&sizes, 1)?;
                    counts = Some(sizes);
                }
                "ORIGIN" => origin = three()?,
                "SPACING" | "ASPECT_RATIO" => spacing = three()?,
                "POINT_DATA" | "CELL_DATA" => (tuples, is_of_points) = (whole(1)?, *keyword == "POINT_DATA"),
                "LOOKUP_TABLE" if words.len() > 2 => {
                    let kind = if reader.is_binary { "unsigned_char" } else { "float" };
                    reader.numbers(4, whole(2)?, kind)?;
                }
                // Names of components, until an empty line.
                "METADATA" => reader.skip_metadata()?,
                "FIELD" => {
                    for (name, values) in reader.field(whole(2)?)? {
                        has_cells |= !is_of_points;
                        if is_of_points {
                            arrays.push((name, values));
                        }
                    }
                }
                _ => {}
            }
            if let Some(axis) = axis {
                let values = reader.numbers(1, whole(1)?, word(2))?;
                if counts.is_none_or(|counts| counts[axis] != values.len()) {
                    return Err(wrong("as many coordinates as DIMENSIONS has nodes"));
                }
                (origin[axis], spacing[axis]) = even_axis(axis, &values)?;
            }
            if let Some((components, kind)) = attribute {
                if *keyword == "SCALARS" {
                    // LOOKUP_TABLE.
                    reader.next()?;
                }
                let values = reader.numbers(components, tuples, kind)?;
                if components == 3 && *keyword != "NORMALS" {
                    has_cells |= !is_of_points;
                    if is_of_points {
                        arrays.push((word(1).to_owned(), values));
                    }
                }
            }
        }
        let counts = counts.ok_or_else(|| fault("vtk", None, "no DIMENSIONS".to_owned(), "DIMENSIONS"))?;
        let names: Vec<&str> = arrays.iter().map(|(name, _)| name.as_str()).collect();
        let (name, values) = arrays.swap_remove(select(&names, array, has_cells)?);
        let velocities = values.chunks(3).map(DVec3::from_slice).collect();
        Ok((VelocityGrid::oriented(origin, spacing, counts, velocities)?, name))
    }
}

/// Reader of a VTK file that counts lines.
struct VtkLines<'a, R: BufRead> {
    source: &'a mut R,
    line: usize,
    is_binary: bool,
}

impl<R: BufRead> VtkLines<'_, R> {
    /// The next line, truncated to 64 KiB; `None` at the end.
    fn next(&mut self) -> Result<Option<String>> {
        let mut bytes = Vec::new();
        self.line += 1;
        let broken = |error: std::io::Error| fault("vtk", Some(self.line), error.to_string(), "a line");
        (&mut *self.source).take(65_536).read_until(b'\n', &mut bytes).map_err(broken)?;
        Ok((!bytes.is_empty()).then(|| String::from_utf8_lossy(&bytes).into_owned()))
    }

    /// Skips names of components, which end with an empty line.
    fn skip_metadata(&mut self) -> Result<()> {
        while self.next()?.is_some_and(|line| !line.trim().is_empty()) {}
        Ok(())
    }

    /// The arrays of a field that have three components.
    fn field(&mut self, mut left: usize) -> Result<Vec<(String, Vec<f64>)>> {
        let mut vectors = Vec::new();
        while left > 0 {
            let entry = self.next()?;
            let wrong = |found: &str| {
                fault(
                    "vtk",
                    Some(self.line),
                    found.to_owned(),
                    "name, components, number and type of an array",
                )
            };
            let entry = entry.ok_or_else(|| wrong("the end"))?;
            let words: Vec<&str> = entry.split_whitespace().collect();
            match words[..] {
                [name, components, number, kind] => {
                    let size = |text: &str| text.parse().map_err(|_| wrong(entry.trim()));
                    let (components, number) = (size(components)?, size(number)?);
                    let values = self.numbers(components, number, kind)?;
                    if components == 3 {
                        vectors.push((name.to_owned(), values));
                    }
                    left -= 1;
                }
                [] => {}
                ["METADATA"] => self.skip_metadata()?,
                _ => return Err(wrong(entry.trim())),
            }
        }
        Ok(vectors)
    }

    /// The values of an array. Only vectors and coordinates are kept, which must be finite.
    fn numbers(&mut self, components: usize, tuples: usize, kind: &str) -> Result<Vec<f64>> {
        let wrong = |line: usize, found: String, expected: &str| -> Error {
            fault("vtk", Some(line), found, expected)
        };
        let number = nodes(&[components, tuples, 1], 1)?;
        let is_kept = [1, 3].contains(&components);
        let size = match kind.to_ascii_lowercase().as_str() {
            "char" | "unsigned_char" => 1,
            "short" | "unsigned_short" => 2,
            "float" | "int" | "unsigned_int" => 4,
            "double" | "long" | "unsigned_long" | "vtkidtype" | "vtktypeint64" => 8,
            _ => return Err(wrong(self.line, format!("{kind:?}"), "float or double")),
        };
        let is_real = matches!(kind, "float" | "double");
        if components == 3 && !is_real {
            return Err(wrong(self.line, format!("{kind:?}"), "float or double"));
        }
        let mut numbers = Vec::new();
        if self.is_binary {
            let mut bytes = Vec::new();
            let limit = (number * size) as u64;
            let broken = |error: std::io::Error| fault("vtk", None, error.to_string(), "binary data");
            (&mut *self.source).take(limit).read_to_end(&mut bytes).map_err(broken)?;
            if bytes.len() < number * size {
                return Err(fault(
                    "vtk",
                    None,
                    format!("{} bytes", bytes.len()),
                    &(number * size).to_string(),
                ));
            }
            if is_kept && is_real {
                // Big-endian.
                let value = |chunk: &[u8]| {
                    let bits = chunk.iter().fold(0_u64, |bits, byte| bits << 8 | u64::from(*byte));
                    if size == 8 { f64::from_bits(bits) } else { f64::from(f32::from_bits(bits as u32)) }
                };
                numbers = bytes.chunks(size).map(value).collect();
            }
            return Ok(numbers);
        }
        let mut read = 0;
        while read < number {
            let text = self.next()?;
            let text =
                text.ok_or_else(|| wrong(self.line, "the end".to_owned(), &format!("{number} numbers")))?;
            for word in text.split_whitespace() {
                read += 1;
                if is_kept {
                    let value = word.parse().ok().filter(|value: &f64| value.is_finite() || components != 3);
                    numbers.push(value.ok_or_else(|| wrong(self.line, word.to_owned(), "a finite number"))?);
                }
            }
        }
        if read == number {
            Ok(numbers)
        } else {
            Err(wrong(self.line, format!("{read} numbers"), &number.to_string()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::small;
    use super::*;

    fn velocity() -> (VelocityGrid, String) {
        (small(), "velocity".to_owned())
    }

    /// As VTK 9 and PyVista write point data: fields, scalars and metadata before the vectors, and falling
    /// axes of a rectilinear grid.
    #[test]
    fn vectors_are_found_among_other_data() {
        let rows = |from: &VelocityGrid, is_reversed: bool| -> Vec<f64> {
            let rows = from.velocities.chunks(3).flat_map(|row| {
                let mut row = row.to_vec();
                if is_reversed {
                    row.reverse();
                }
                row
            });
            rows.flat_map(|u| u.to_array()).collect()
        };
        let geometry = "DATASET RECTILINEAR_GRID\nDIMENSIONS 3 2 2\nX_COORDINATES 3 float\n";
        let more = ["SCALARS p float\nLOOKUP_TABLE default\n", "FIELD FieldData 2\nid 1 12 int\n"];
        for (is_binary, is_field) in [(false, false), (false, true), (true, false), (true, true)] {
            let mut file = format!(
                "# vtk DataFile Version 5.1\nvtk output\n{}\n{geometry}",
                if is_binary { "BINARY" } else { "ASCII" }
            )
            .into_bytes();
            let put = |file: &mut Vec<u8>, values: &[f64], kind: &str| {
                for v in values {
                    match (is_binary, kind) {
                        (false, _) => file.extend(format!("{v} ").bytes()),
                        (true, "int") => file.extend((*v as i32).to_be_bytes()),
                        (true, "float") => file.extend((*v as f32).to_be_bytes()),
                        (true, _) => file.extend(v.to_be_bytes()),
                    }
                }
                file.push(b'\n');
            };
            put(&mut file, &[2.0, 1.5, 1.0], "float");
            file.extend(b"Y_COORDINATES 2 float\n");
            put(&mut file, &[2.0, 3.0], "float");
            file.extend(b"Z_COORDINATES 2 double\n");
            put(&mut file, &[3.0, 5.0], "double");
            file.extend(b"METADATA\nINFORMATION 0\n\nPOINT_DATA 12\n");
            let other: Vec<f64> = (0..12).map(f64::from).collect();
            file.extend(more[usize::from(is_field)].bytes());
            put(&mut file, &other, if is_field { "int" } else { "float" });
            let entry = if is_field { "velocity 3 12 double\n" } else { "VECTORS velocity double\n" };
            file.extend(entry.bytes());
            put(&mut file, &rows(&small(), true), "double");
            assert_eq!(VelocityGrid::from_vtk(file.as_slice(), None).unwrap(), velocity());
            file.extend(b"VECTORS vorticity double\n");
            put(&mut file, &rows(&small(), false), "double");
            let said = VelocityGrid::from_vtk(file.as_slice(), None).unwrap_err().to_string();
            assert!(said.contains("velocity, vorticity") && said.contains("array"), "{said}");
            assert_eq!(VelocityGrid::from_vtk(file.as_slice(), Some("velocity")).unwrap(), velocity());
            let other = VelocityGrid::from_vtk(file.as_slice(), Some("vorticity")).unwrap().0;
            assert_eq!(other.velocities[0], small().velocities[2]);
            assert!(
                VelocityGrid::from_vtk(file.as_slice(), Some("U")).unwrap_err().to_string().contains("\"U\"")
            );
        }
    }

    #[test]
    fn vtk_files_are_read_as_text_and_binary() {
        let head = |kind: &str, number: &str| {
            format!(
                "# vtk DataFile Version 3.0\nflow\n{kind}\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 2 2\nORIGIN 1 2 3\n\
                 SPACING 0.5 1 2\nPOINT_DATA 12\nVECTORS velocity {number}\n"
            )
        };
        let numbers: Vec<f64> = small().velocities.iter().flat_map(|u| u.to_array()).collect();
        let text: Vec<String> = numbers.iter().map(f64::to_string).collect();
        let file = head("ASCII", "float") + &text.join(" ");
        assert_eq!(VelocityGrid::from_vtk(file.as_bytes(), None).unwrap(), velocity());
        let mut file = head("BINARY", "double").into_bytes();
        file.extend(numbers.iter().flat_map(|u| u.to_be_bytes()));
        assert_eq!(VelocityGrid::from_vtk(file.as_slice(), None).unwrap(), velocity());
        let mut file = head("BINARY", "float").into_bytes();
        file.extend(numbers.iter().flat_map(|u| (*u as f32).to_be_bytes()));
        assert_eq!(VelocityGrid::from_vtk(file.as_slice(), None).unwrap(), velocity());
        let fault = |file: &str| VelocityGrid::from_vtk(file.as_bytes(), None).unwrap_err().to_string();
        assert!(fault(&head("ASCII", "float")).contains("the end"));
        assert!(fault(&(head("ASCII", "float") + "1 2 three")).contains("three"));
        assert!(fault(&head("ASCII", "int")).contains("float or double"));
        assert!(fault("P6\n").contains("vtk, line 1"));
        let huge = head("ASCII", "float").replace("3 2 2", "9999999 9999999 9999999");
        assert!(fault(&huge).contains("50000000"));
    }
}
