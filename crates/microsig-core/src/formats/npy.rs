//! NumPy arrays, in the format of `numpy.lib.format`.

use std::io::{Error as IoError, ErrorKind, Read};

use crate::error::Error;
use crate::problem::Problem;

/// Maximum header length of a `.npy` file, bytes: the limit of version 1 of the format.
const MAX_NPY_HEADER: u32 = 65_535;

/// Reads an array of floats of the shape (height, width), row by row; `size` is (width, height) and `name`
/// the name of the input in errors. Errors: [`Error::Malformed`] if the input is not such an array, or a
/// number is not finite.
pub fn read(mut source: impl Read, name: &str, size: (u32, u32)) -> Result<Vec<f64>, Error> {
    let (width, height) = (size.0 as usize, size.1 as usize);
    let malformed = |problem: Problem| Error::Malformed(vec![problem.within(name)]);
    let header = Header::read(&mut source).map_err(malformed)?;
    if header.shape != [u64::from(size.1), u64::from(size.0)] {
        let expected = format!("({height}, {width}), rows and columns");
        return Err(malformed(refused(format!("the shape {:?}", header.shape), &expected)));
    }
    let mut numbers = header.numbers(source, width * height).map_err(malformed)?;
    if header.fortran_order {
        numbers = (0..width * height).map(|i| numbers[i / width + height * (i % width)]).collect();
    }
    if let Some(at) = numbers.iter().position(|number| !number.is_finite()) {
        let found = format!("{} in column {}, row {}", numbers[at], at % width + 1, at / width + 1);
        return Err(malformed(refused(found, "a finite number")));
    }
    Ok(numbers)
}

/// The dictionary at the start of a file.
#[derive(Debug, PartialEq)]
pub struct Header {
    /// Type of the numbers: byte order, kind and size, such as `<f8`.
    descr: String,
    /// Whether the first index varies fastest.
    pub fortran_order: bool,
    /// Length along each index.
    pub shape: Vec<u64>,
}

impl Header {
    /// Reads the start of a file, up to its numbers.
    pub fn read(source: &mut impl Read) -> Result<Self, Problem> {
        let mut start = [0; 10];
        source.read_exact(&mut start).map_err(|e| broken(&e))?;
        let [0x93, b'N', b'U', b'M', b'P', b'Y', version, _, a, b] = start else {
            return Err(broken(&IoError::new(ErrorKind::InvalidData, "no magic string of NumPy")));
        };
        let length = if version < 2 {
            u32::from(u16::from_le_bytes([a, b]))
        } else {
            let mut rest = [0; 2];
            source.read_exact(&mut rest).map_err(|e| broken(&e))?;
            u32::from_le_bytes([a, b, rest[0], rest[1]])
        };
        if length > MAX_NPY_HEADER {
            let allowed = format!("at most {MAX_NPY_HEADER}");
            return Err(refused(format!("a header of {length} bytes"), &allowed));
        }
        let mut text = vec![0; length as usize];
        source.read_exact(&mut text).map_err(|e| broken(&e))?;
        let text = String::from_utf8_lossy(&text);
        let expected = "{'descr': '<f8', 'fortran_order': False, 'shape': (...), }";
        Header::parse(&text).ok_or_else(|| refused(format!("the header {:?}", text.trim()), expected))
    }

    fn parse(text: &str) -> Option<Self> {
        let value = |key: &str| Some(text.split_once(&format!("'{key}':"))?.1.trim_start());
        let shape = value("shape")?.strip_prefix('(')?.split_once(')')?.0;
        Some(Header {
            descr: value("descr")?.strip_prefix('\'')?.split_once('\'')?.0.to_owned(),
            fortran_order: match value("fortran_order")? {
                flag if flag.starts_with("True") => true,
                flag if flag.starts_with("False") => false,
                _ => return None,
            },
            // Python 2 writes long integers with an L.
            shape: (shape.split(',').map(|n| n.trim().trim_end_matches('L')))
                .filter(|n| !n.is_empty())
                .map(|n| n.parse().ok())
                .collect::<Option<_>>()?,
        })
    }

    /// Reads the numbers (f4 or f8) that follow, in their order. Errors: numbers of another type; more or
    /// fewer than `n` of them.
    pub fn numbers(&self, source: impl Read, n: usize) -> Result<Vec<f64>, Problem> {
        let size = match &*self.descr {
            "<f8" | ">f8" => 8,
            "<f4" | ">f4" => 4,
            other => return Err(refused(format!("the type {other}"), "f4 or f8")),
        };
        let mut bytes = Vec::new();
        source.take((size * n + 1) as u64).read_to_end(&mut bytes).map_err(|e| broken(&e))?;
        if bytes.len() != size * n {
            let found = if bytes.len() > size * n { "more" } else { "fewer" };
            return Err(refused(format!("{found} numbers than its shape requires"), &n.to_string()));
        }
        if self.descr.starts_with('>') {
            bytes.chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
        Ok(match size {
            8 => bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
            _ => bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b).into()).collect(),
        })
    }
}

fn refused(found: String, expected: &str) -> Problem {
    Problem::value("", found, expected)
}

fn broken(error: &IoError) -> Problem {
    refused(error.to_string(), "a NumPy array")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn npy(kind: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{kind}', 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
        [b"\x93NUMPY\x01\0", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), data].concat()
    }

    #[test]
    fn an_image_is_read_in_either_order() {
        let rows: Vec<u8> =
            [1.5f64, 2.0, 3.0, 4.0, 5.0, 6.0].into_iter().flat_map(f64::to_le_bytes).collect();
        let columns: Vec<u8> =
            [1.5f32, 4.0, 2.0, 5.0, 3.0, 6.0].into_iter().flat_map(f32::to_be_bytes).collect();
        for file in [npy("<f8", "False", "(2, 3)", &rows), npy(">f4", "True", "(2, 3)", &columns)] {
            assert_eq!(read(&file[..], "a.npy", (3, 2)).unwrap(), [1.5, 2.0, 3.0, 4.0, 5.0, 6.0]);
        }
    }

    #[test]
    fn other_arrays_are_refused() {
        let refuse = |file: &[u8]| read(file, "a.npy", (3, 2)).unwrap_err().to_string();
        let zeros = [0; 24];
        let other = refuse(&npy("<f4", "False", "(3, 2)", &zeros));
        assert_eq!(other, "a.npy: the shape [3, 2]: expected (2, 3), rows and columns");
        assert_eq!(refuse(&npy("<i4", "False", "(2, 3)", &zeros)), "a.npy: the type <i4: expected f4 or f8");
        let fewer = refuse(&npy("<f4", "False", "(2, 3)", &zeros[..20]));
        assert_eq!(fewer, "a.npy: fewer numbers than its shape requires: expected 6");
        let infinite: Vec<u8> =
            [0.0, 0.0, 0.0, 0.0, f32::INFINITY, 0.0].into_iter().flat_map(f32::to_le_bytes).collect();
        let message = refuse(&npy("<f4", "False", "(2, 3)", &infinite));
        assert_eq!(message, "a.npy: inf in column 2, row 2: expected a finite number");
        assert!(refuse(b"no array").starts_with("a.npy: "));
    }
}
