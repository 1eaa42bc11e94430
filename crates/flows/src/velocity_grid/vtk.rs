//! Legacy VTK structured points.

use super::{MAX_NODES, VelocityGrid, fault, nodes};
use crate::error::Result;
use glam::DVec3;
use std::io::{BufRead, Read};

impl VelocityGrid {
    /// Reads a legacy VTK file of structured points, ASCII or binary; the first vector point attribute is the
    /// velocity in um/s, origin and spacing are in um. `Err` names the line if the file is malformed.
    pub fn from_vtk(mut source: impl BufRead) -> Result<Self> {
        let mut reader = VtkLines { source: &mut source, line: 0 };
        if !reader.next()?.starts_with("# vtk DataFile") {
            return Err(fault("vtk", Some(1), "a different header".to_owned(), "# vtk DataFile Version"));
        }
        reader.next()?;
        let binary = match reader.next()?.trim() {
            "ASCII" => false,
            "BINARY" => true,
            other => return Err(fault("vtk", Some(3), format!("{other:?}"), "ASCII or BINARY")),
        };
        let (mut counts, mut origin, mut spacing) = (None, DVec3::ZERO, DVec3::ONE);
        loop {
            let text = reader.next()?;
            let line = reader.line;
            let words: Vec<&str> = text.split_whitespace().collect();
            let Some(keyword) = words.first() else { continue };
            let three = || -> Result<DVec3> {
                let numbers: Vec<f64> = words[1..].iter().filter_map(|word| word.parse().ok()).collect();
                <[f64; 3]>::try_from(numbers)
                    .map(DVec3::from_array)
                    .map_err(|_| fault("vtk", Some(line), text.trim().to_owned(), "three numbers"))
            };
            match *keyword {
                "DATASET" if words.get(1) != Some(&"STRUCTURED_POINTS") => {
                    return Err(fault(
                        "vtk",
                        Some(line),
                        text.trim().to_owned(),
                        "DATASET STRUCTURED_POINTS",
                    ));
                }
                "DIMENSIONS" => {
                    let sizes = three()?;
                    if sizes.min_element() < 1.0
                        || sizes.max_element() > MAX_NODES as f64
                        || sizes != sizes.floor()
                    {
                        return Err(fault(
                            "vtk",
                            Some(line),
                            text.trim().to_owned(),
                            "three whole numbers >= 1",
                        ));
                    }
                    counts = Some(sizes.to_array().map(|n| n as usize));
                }
                "ORIGIN" => origin = three()?,
                "SPACING" | "ASPECT_RATIO" => spacing = three()?,
                "VECTORS" => {
                    let counts = counts.ok_or_else(|| {
                        fault("vtk", Some(line), "VECTORS".to_owned(), "DIMENSIONS before it")
                    })?;
                    let number = 3 * nodes(&counts, 1)?;
                    let double = match words.get(2) {
                        Some(&"double") => true,
                        Some(&"float") => false,
                        other => {
                            return Err(fault("vtk", Some(line), format!("{other:?}"), "float or double"));
                        }
                    };
                    let numbers =
                        if binary { reader.binary(number, double)? } else { reader.ascii(number)? };
                    let velocities = numbers.chunks(3).map(DVec3::from_slice).collect();
                    return VelocityGrid::new(origin, spacing, counts, vec![0.0], velocities);
                }
                "SCALARS"
                | "NORMALS"
                | "TENSORS"
                | "FIELD"
                | "CELL_DATA"
                | "COLOR_SCALARS"
                | "TEXTURE_COORDINATES" => {
                    return Err(fault(
                        "vtk",
                        Some(line),
                        (*keyword).to_owned(),
                        "VECTORS as the first attribute",
                    ));
                }
                _ => {}
            }
        }
    }
}

/// Reader of a VTK file that counts lines.
struct VtkLines<'a, R: BufRead> {
    source: &'a mut R,
    line: usize,
}

impl<R: BufRead> VtkLines<'_, R> {
    /// The next line, truncated to 64 KiB.
    fn next(&mut self) -> Result<String> {
        let mut bytes = Vec::new();
        self.line += 1;
        let broken = |error: std::io::Error| fault("vtk", Some(self.line), error.to_string(), "a line");
        (&mut *self.source).take(65_536).read_until(b'\n', &mut bytes).map_err(broken)?;
        if bytes.is_empty() {
            return Err(fault("vtk", Some(self.line), "the end".to_owned(), "VECTORS"));
        }
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    fn ascii(&mut self, number: usize) -> Result<Vec<f64>> {
        let mut numbers = Vec::new();
        while numbers.len() < number {
            let text = self.next()?;
            for word in text.split_whitespace() {
                let value = word.parse().ok().filter(|value: &f64| value.is_finite());
                numbers.push(
                    value.ok_or_else(|| fault("vtk", Some(self.line), word.to_owned(), "a finite number"))?,
                );
            }
        }
        if numbers.len() == number {
            Ok(numbers)
        } else {
            Err(fault("vtk", Some(self.line), format!("{} numbers", numbers.len()), &number.to_string()))
        }
    }

    fn binary(&mut self, number: usize, double: bool) -> Result<Vec<f64>> {
        let size = if double { 8 } else { 4 };
        let mut bytes = Vec::new();
        let limit = (number * size) as u64;
        let broken = |error: std::io::Error| fault("vtk", None, error.to_string(), "binary data");
        (&mut *self.source).take(limit).read_to_end(&mut bytes).map_err(broken)?;
        if bytes.len() < number * size {
            return Err(fault("vtk", None, format!("{} bytes", bytes.len()), &(number * size).to_string()));
        }
        // Big-endian.
        let value = |chunk: &[u8]| {
            let bits = chunk.iter().fold(0_u64, |bits, byte| bits << 8 | u64::from(*byte));
            if double { f64::from_bits(bits) } else { f64::from(f32::from_bits(bits as u32)) }
        };
        Ok(bytes.chunks(size).map(value).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::small;
    use super::*;

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
        assert_eq!(VelocityGrid::from_vtk(file.as_bytes()).unwrap(), small());
        let mut file = head("BINARY", "double").into_bytes();
        file.extend(numbers.iter().flat_map(|u| u.to_be_bytes()));
        assert_eq!(VelocityGrid::from_vtk(file.as_slice()).unwrap(), small());
        let mut file = head("BINARY", "float").into_bytes();
        file.extend(numbers.iter().flat_map(|u| (*u as f32).to_be_bytes()));
        assert_eq!(VelocityGrid::from_vtk(file.as_slice()).unwrap(), small());
        let fault = |file: &str| VelocityGrid::from_vtk(file.as_bytes()).unwrap_err().to_string();
        assert!(fault(&head("ASCII", "float")).contains("the end"));
        assert!(fault(&(head("ASCII", "float") + "1 2 three")).contains("three"));
        assert!(fault(&head("ASCII", "int")).contains("float or double"));
        assert!(fault("P6\n").contains("vtk, line 1"));
        let huge = head("ASCII", "float").replace("3 2 2", "9999999 9999999 9999999");
        assert!(fault(&huge).contains("50000000"));
    }
}
