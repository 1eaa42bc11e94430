//! NumPy arrays, in the format of `numpy.lib.format`.

use super::{GridGeometry, VelocityGrid, fault, nodes};
use crate::error::{Error, Result};
use glam::DVec3;
use microsig_core::formats::npy::Header;
use microsig_core::problem::Problem;
use std::io::Read;

impl VelocityGrid {
    /// Reads a NumPy array of floats (f4 or f8, C or Fortran order) of the shape (z, y, x, 3) or, with
    /// several times, (time, z, y, x, 3), in um/s. `Err` if type, shape or values are not allowed.
    pub fn from_npy(mut source: impl Read, geometry: &GridGeometry) -> Result<Self> {
        let header = Header::read(&mut source).map_err(refused)?;
        let shape = &header.shape;
        let timed = shape.len() == 5;
        if !(4..=5).contains(&shape.len()) || shape.last() != Some(&3) {
            return Err(fault(
                "npy",
                None,
                format!("the shape {shape:?}"),
                "(z, y, x, 3) or (time, z, y, x, 3)",
            ));
        }
        let size = |i: usize| usize::try_from(shape[i]).unwrap_or(usize::MAX);
        let first = usize::from(timed);
        let counts = [size(first + 2), size(first + 1), size(first)];
        let layers = if timed { size(0) } else { 1 };
        let times_s =
            if geometry.times_s.is_empty() && layers == 1 { vec![0.0] } else { geometry.times_s.clone() };
        if times_s.len() != layers {
            return Err(fault(
                "npy",
                None,
                format!("{layers} times"),
                &format!("{}, as times_s has", times_s.len()),
            ));
        }
        let nodes = nodes(&counts, layers)?;
        let numbers = header.numbers(source, 3 * nodes).map_err(refused)?;
        let [nx, ny, nz] = counts;
        let at = |node: usize, component: usize| {
            if !header.fortran_order {
                return numbers[3 * node + component];
            }
            // Fortran order, the first index varies fastest: time, z, y, x, component.
            let (i, rest) = (node % nx, node / nx);
            let (j, rest) = (rest % ny, rest / ny);
            let (k, layer) = (rest % nz, rest / nz);
            numbers[layer + layers * (k + nz * (j + ny * (i + nx * component)))]
        };
        let velocities = (0..nodes).map(|node| DVec3::new(at(node, 0), at(node, 1), at(node, 2))).collect();
        let (origin, spacing) =
            (DVec3::from_array(geometry.origin_um), DVec3::from_array(geometry.spacing_um));
        VelocityGrid::new(origin, spacing, counts, times_s, velocities)
    }
}

fn refused(problem: Problem) -> Error {
    Error::Data { format: "npy", line: None, problem: problem.into() }
}

#[cfg(test)]
mod tests {
    use super::super::tests::small;
    use super::*;

    fn geometry() -> GridGeometry {
        GridGeometry { origin_um: [1.0, 2.0, 3.0], spacing_um: [0.5, 1.0, 2.0], times_s: vec![] }
    }

    /// A NumPy file with a hand-written header.
    fn npy(kind: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
        let order = if fortran { "True" } else { "False" };
        let mut header = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}, }}");
        while (10 + header.len() + 1) % 64 != 0 {
            header.push(' ');
        }
        header.push('\n');
        let mut file = b"\x93NUMPY\x01\x00".to_vec();
        file.extend((header.len() as u16).to_le_bytes());
        file.extend(header.bytes());
        file.extend(data);
        file
    }

    #[test]
    fn numpy_arrays_are_read_in_either_order_and_precision() {
        let doubles: Vec<u8> =
            small().velocities.iter().flat_map(|u| u.to_array()).flat_map(f64::to_le_bytes).collect();
        let file = npy("<f8", false, "(2, 2, 3, 3)", &doubles);
        assert_eq!(VelocityGrid::from_npy(file.as_slice(), &geometry()).unwrap(), small());
        let mut floats = Vec::new();
        for component in 0..3 {
            for i in 0..3 {
                for j in 0..2 {
                    for k in 0..2 {
                        floats.extend(
                            (small().velocities[i + 3 * (j + 2 * k)][component] as f32).to_le_bytes(),
                        );
                    }
                }
            }
        }
        let file = npy("<f4", true, "(2, 2, 3, 3)", &floats);
        assert_eq!(VelocityGrid::from_npy(file.as_slice(), &geometry()).unwrap(), small());
        let big_endian: Vec<u8> = doubles.chunks(8).flat_map(|b| b.iter().rev().copied()).collect();
        let file = npy(">f8", false, "(2L, 2L, 3L, 3L)", &big_endian);
        assert_eq!(VelocityGrid::from_npy(file.as_slice(), &geometry()).unwrap(), small());
        let timed = GridGeometry { times_s: vec![0.0, 1.0], ..geometry() };
        let twice: Vec<u8> = doubles.iter().chain(&doubles).copied().collect();
        let file = npy("<f8", false, "(2, 2, 2, 3, 3)", &twice);
        assert_eq!(VelocityGrid::from_npy(file.as_slice(), &timed).unwrap().times_s(), [0.0, 1.0]);
    }

    #[test]
    fn bad_numpy_arrays_are_refused() {
        let read = |file: &[u8]| VelocityGrid::from_npy(file, &geometry()).unwrap_err().to_string();
        // Found by fuzzing: 4 GB were allocated.
        assert!(
            read(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{'descr': '<f8'")
                .contains("a header of 4294967295 bytes")
        );
        assert!(read(b"hello").contains("npy"));
        let message = read(&npy("<f8", false, "(2, 2)", &[0; 32]));
        assert_eq!(message, "npy: the shape [2, 2]: expected (z, y, x, 3) or (time, z, y, x, 3)");
        assert!(read(&npy("<f8", false, "(99999, 99999, 99999, 3)", &[])).contains("50000000"));
        assert!(read(&npy("<i4", false, "(1, 1, 1, 3)", &[0; 12])).contains("f4 or f8"));
        let nan: Vec<u8> = [1.0, f64::NAN, 2.0].into_iter().flat_map(f64::to_le_bytes).collect();
        assert!(read(&npy("<f8", false, "(1, 1, 1, 3)", &nan)).contains("at node (0, 0, 0)"));
        let message = read(&npy("<f8", false, "(1, 1, 1, 3)", &nan[..20]));
        assert_eq!(message, "npy: fewer numbers than its shape requires: expected 3");
        assert!(read(&npy("<f8", false, "(1, 1, 1, 3)", &[0; 32])).contains("more numbers"));
        assert!(read(&npy("<f8", false, "[1, 1, 1, 3]", &[0; 24])).contains("the header"));
        assert!(read(&npy("<f8", false, "(1, 1, -1, 3)", &[0; 24])).contains("the header"));
    }
}
