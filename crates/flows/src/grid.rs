//! Velocities on a regular grid, and the readers of files that hold them: NumPy arrays, CSV, legacy VTK structured points.
//!
//! Readers take anything that can be read, never a path; an array is refused before it is allocated if its header asks for more
//! than [`MAX_NODES`].

use crate::error::{Check, Error, Result};
use glam::DVec3;
use std::io::{BufRead, Read};

const CHECK: Check = Check("grid");

/// Longest header of a `.npy` file, bytes; version 1 of the format allows no longer one.
const MAX_NPY_HEADER: u32 = 65_535;

/// Most nodes of all times together.
pub const MAX_NODES: usize = 50_000_000;

/// Velocities at the nodes of a regular grid, at one or more times.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    origin: DVec3,
    spacing: DVec3,
    counts: [usize; 3],
    times_s: Vec<f64>,
    velocities: Vec<DVec3>,
}

/// Where the nodes of an array are that knows nothing but its values.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct Geometry {
    /// The first node, um.
    pub origin_um: [f64; 3],
    /// Distances of the nodes, um.
    pub spacing_um: [f64; 3],
    /// Times of the layers, s, increasing; none for a single layer.
    pub times_s: Vec<f64>,
}

impl Default for Geometry {
    /// The default channel from its corner, every 10 um.
    fn default() -> Self {
        Geometry { origin_um: [-240.0, -120.0, -80.0], spacing_um: [10.0; 3], times_s: Vec::new() }
    }
}

impl Grid {
    /// The grid of `counts` nodes along x, y and z from `origin` (um) at the distances `spacing` (um, > 0), at increasing times (s), with the
    /// velocities (um/s, finite) at every node: x fastest, then y, z and time.
    pub fn new(
        origin: DVec3,
        spacing: DVec3,
        counts: [usize; 3],
        times_s: Vec<f64>,
        velocities: Vec<DVec3>,
    ) -> Result<Self> {
        CHECK.finite_vector("origin_um", origin)?;
        for axis in 0..3 {
            CHECK.positive("spacing_um", spacing[axis])?;
        }
        for (i, t) in times_s.iter().enumerate() {
            CHECK.finite("times_s", *t)?;
            if i > 0 && *t <= times_s[i - 1] {
                return Err(CHECK.fault("times_s", t, &format!("a time after {}", times_s[i - 1])));
            }
        }
        let nodes = nodes(&counts, times_s.len())?;
        if velocities.len() != nodes {
            let allowed = format!("{nodes}: {counts:?} nodes at {} times", times_s.len());
            return Err(CHECK.fault("number of velocities", velocities.len(), &allowed));
        }
        if let Some(at) = velocities.iter().position(|u| !u.is_finite()) {
            let (i, rest) = (at % counts[0], at / counts[0]);
            let (j, k) = (rest % counts[1], rest / counts[1] % counts[2]);
            let value = format!("{} at node ({i}, {j}, {k})", velocities[at]);
            return Err(CHECK.fault("velocity", value, "three finite numbers"));
        }
        Ok(Grid { origin, spacing, counts, times_s, velocities })
    }

    /// The first node, um.
    pub fn origin_um(&self) -> DVec3 {
        self.origin
    }

    /// Distances of the nodes, um.
    pub fn spacing_um(&self) -> DVec3 {
        self.spacing
    }

    /// Nodes along x, y and z.
    pub fn counts(&self) -> [usize; 3] {
        self.counts
    }

    /// The times of the layers, s.
    pub fn times_s(&self) -> &[f64] {
        &self.times_s
    }

    /// The velocities, um/s: x fastest, then y, z and time.
    pub fn velocities(&self) -> &[DVec3] {
        &self.velocities
    }

    /// A NumPy array of floats (f4 or f8, C or Fortran order) of the shape (z, y, x, 3) or, with times, (time, z, y, x, 3), in um/s.
    pub fn from_npy(mut source: impl Read, geometry: &Geometry) -> Result<Self> {
        let broken = |error: std::io::Error| fault("npy", None, error.to_string(), "a NumPy array");
        let mut start = Vec::new();
        source.by_ref().take(12).read_to_end(&mut start).map_err(broken)?;
        // The reader makes room for a header of any length that the file claims.
        if let [0x93, b'N', b'U', b'M', b'P', b'Y', version, _, a, b, c, d] = start[..] {
            let length = if version < 2 { 0 } else { u32::from_le_bytes([a, b, c, d]) };
            if length > MAX_NPY_HEADER {
                let allowed = format!("at most {MAX_NPY_HEADER}");
                return Err(fault("npy", None, format!("a header of {length} bytes"), &allowed));
            }
        }
        let file = npyz::NpyFile::new(start.as_slice().chain(source)).map_err(broken)?;
        let shape: Vec<u64> = file.shape().to_vec();
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
        let fortran = file.order() == npyz::Order::Fortran;
        let kind = file.dtype().descr();
        let numbers: Vec<f64> = if kind.contains("f8") {
            file.into_vec().map_err(broken)?
        } else if kind.contains("f4") {
            file.into_vec::<f32>().map_err(broken)?.into_iter().map(f64::from).collect()
        } else {
            return Err(fault("npy", None, format!("the type {kind}"), "f4 or f8"));
        };
        if numbers.len() != 3 * nodes {
            return Err(fault("npy", None, format!("{} numbers", numbers.len()), &format!("{}", 3 * nodes)));
        }
        let [nx, ny, nz] = counts;
        let at = |node: usize, component: usize| {
            if !fortran {
                return numbers[3 * node + component];
            }
            // The first index runs fastest: time, z, y, x, component.
            let (i, rest) = (node % nx, node / nx);
            let (j, rest) = (rest % ny, rest / ny);
            let (k, layer) = (rest % nz, rest / nz);
            numbers[layer + layers * (k + nz * (j + ny * (i + nx * component)))]
        };
        let velocities = (0..nodes).map(|node| DVec3::new(at(node, 0), at(node, 1), at(node, 2))).collect();
        let (origin, spacing) =
            (DVec3::from_array(geometry.origin_um), DVec3::from_array(geometry.spacing_um));
        Grid::new(origin, spacing, counts, times_s, velocities)
    }

    /// A CSV table with a header and the columns x_um, y_um, z_um, u_um_s, v_um_s, w_um_s and optionally t_s, in any order: one row for every
    /// node at every time, in any order. Missing z_um and w_um_s are zero.
    pub fn from_csv(source: impl BufRead) -> Result<Self> {
        let mut lines = source.lines().enumerate();
        let header = match lines.next() {
            Some((_, line)) => line.map_err(|error| fault("csv", Some(1), error.to_string(), "text"))?,
            None => return Err(fault("csv", Some(1), "nothing".to_owned(), "a header")),
        };
        let header = header.trim_start_matches('\u{feff}');
        let names: Vec<&str> = header.split(',').map(str::trim).collect();
        let column = |name: &str| names.iter().position(|found| *found == name);
        let required = |name: &str| {
            column(name)
                .ok_or_else(|| fault("csv", Some(1), format!("the columns {}", names.join(", ")), name))
        };
        let columns = [
            column("t_s"),
            column("z_um"),
            Some(required("y_um")?),
            Some(required("x_um")?),
            Some(required("u_um_s")?),
            Some(required("v_um_s")?),
            column("w_um_s"),
        ];
        let mut rows: Vec<[f64; 7]> = Vec::new();
        for (i, line) in lines {
            let line = line.map_err(|error| fault("csv", Some(i + 1), error.to_string(), "text"))?;
            if line.trim().is_empty() {
                continue;
            }
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            if cells.len() != names.len() {
                let found = format!("{} columns", cells.len());
                return Err(fault("csv", Some(i + 1), found, &format!("{}, as in the header", names.len())));
            }
            let mut row = [0.0; 7];
            for (value, column) in row.iter_mut().zip(columns) {
                let Some(column) = column else { continue };
                let number = cells[column].parse().ok().filter(|number: &f64| number.is_finite());
                *value = number.ok_or_else(|| {
                    fault("csv", Some(i + 1), format!("{:?}", cells[column]), "a finite number")
                })?;
            }
            if rows.len() == MAX_NODES {
                return Err(fault("csv", Some(i + 1), "one more row".to_owned(), "at most 50000000"));
            }
            rows.push(row);
        }
        let node = |row: &[f64; 7]| [row[0], row[1], row[2], row[3]];
        let order = |a: &[f64; 7], b: &[f64; 7]| {
            let pairs = node(a).into_iter().zip(node(b));
            pairs
                .map(|(a, b)| a.total_cmp(&b))
                .find(|order| order.is_ne())
                .unwrap_or(std::cmp::Ordering::Equal)
        };
        rows.sort_by(order);
        let ticks: Vec<Vec<f64>> = (0..4)
            .map(|axis| {
                let mut ticks: Vec<f64> = rows.iter().map(|row| row[axis]).collect();
                ticks.sort_by(f64::total_cmp);
                ticks.dedup();
                ticks
            })
            .collect();
        let [times, z, y, x] = [&ticks[0], &ticks[1], &ticks[2], &ticks[3]];
        if rows.is_empty() || rows.len() != times.len() * z.len() * y.len() * x.len() {
            let found = format!("{} rows", rows.len());
            let expected = format!(
                "one for each of {} x {} x {} nodes at {} times",
                x.len(),
                y.len(),
                z.len(),
                times.len()
            );
            return Err(fault("csv", None, found, &expected));
        }
        if let Some(pair) = rows.windows(2).find(|pair| order(&pair[0], &pair[1]).is_eq()) {
            return Err(fault("csv", None, format!("two rows for the node {:?}", node(&pair[0])), "one"));
        }
        let spacing = DVec3::new(even(x, "x_um")?, even(y, "y_um")?, even(z, "z_um")?);
        let velocities = rows.iter().map(|row| DVec3::new(row[4], row[5], row[6])).collect();
        let counts = [x.len(), y.len(), z.len()];
        Grid::new(DVec3::new(x[0], y[0], z[0]), spacing, counts, times.clone(), velocities)
    }

    /// A legacy VTK file of structured points, ASCII or binary, with a vector attribute of the points in um/s; the first one is
    /// taken. Origin and spacing in um.
    pub fn from_vtk(mut source: impl BufRead) -> Result<Self> {
        let mut reader = VtkLines { source: &mut source, line: 0 };
        if !reader.next()?.starts_with("# vtk DataFile") {
            return Err(fault("vtk", Some(1), "another header".to_owned(), "# vtk DataFile Version"));
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
                    return Grid::new(origin, spacing, counts, vec![0.0], velocities);
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

/// The lines of a VTK file.
struct VtkLines<'a, R: BufRead> {
    source: &'a mut R,
    line: usize,
}

impl<R: BufRead> VtkLines<'_, R> {
    /// The next line, at most 64 KiB of it.
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

fn fault(format: &'static str, line: Option<usize>, found: String, expected: &str) -> Error {
    Error::Data { format, line, found, expected: expected.to_owned() }
}

/// The number of nodes at all times.
fn nodes(counts: &[usize; 3], layers: usize) -> Result<usize> {
    let product = counts.iter().chain([&layers]).try_fold(1_usize, |product, n| product.checked_mul(*n));
    match product {
        Some(number @ 1..=MAX_NODES) => Ok(number),
        _ => Err(CHECK.fault("nodes", format!("{counts:?} at {layers} times"), "1 to 50000000 in all")),
    }
}

/// The distance of evenly spaced values; 1 for a single one.
fn even(ticks: &[f64], column: &str) -> Result<f64> {
    let (Some(first), Some(last)) = (ticks.first(), ticks.last()) else { return Ok(1.0) };
    if ticks.len() == 1 {
        return Ok(1.0);
    }
    let step = (last - first) / (ticks.len() - 1) as f64;
    // Written with six digits or more.
    let odd =
        ticks.iter().enumerate().find(|(i, tick)| (first + step * *i as f64 - **tick).abs() > 1e-5 * step);
    match odd {
        None => Ok(step),
        Some((_, tick)) => {
            Err(fault("csv", None, format!("{column} = {tick}"), &format!("nodes every {step}")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small() -> Grid {
        let velocities = (0..12).map(|n| DVec3::new(f64::from(n), -0.5, 2.0 * f64::from(n))).collect();
        Grid::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.5, 1.0, 2.0), [3, 2, 2], vec![0.0], velocities)
            .unwrap()
    }

    fn geometry() -> Geometry {
        Geometry { origin_um: [1.0, 2.0, 3.0], spacing_um: [0.5, 1.0, 2.0], times_s: vec![] }
    }

    /// A NumPy file with a header of its own making.
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
        assert_eq!(Grid::from_npy(file.as_slice(), &geometry()).unwrap(), small());
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
        assert_eq!(Grid::from_npy(file.as_slice(), &geometry()).unwrap(), small());
        let timed = Geometry { times_s: vec![0.0, 1.0], ..geometry() };
        let twice: Vec<u8> = doubles.iter().chain(&doubles).copied().collect();
        let file = npy("<f8", false, "(2, 2, 2, 3, 3)", &twice);
        assert_eq!(Grid::from_npy(file.as_slice(), &timed).unwrap().times_s(), [0.0, 1.0]);
    }

    #[test]
    fn bad_numpy_arrays_are_refused() {
        let read = |file: &[u8]| Grid::from_npy(file, &geometry()).unwrap_err().to_string();
        // Found by fuzzing: room was made for 4 GB.
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
        read(&npy("<f8", false, "(1, 1, 1, 3)", &nan[..20]));
    }

    #[test]
    fn tables_are_read_in_any_order() {
        let mut rows: Vec<String> = Vec::new();
        for (n, u) in small().velocities.iter().enumerate() {
            let (i, j, k) = (n % 3, n / 3 % 2, n / 6);
            let (x, y, z) = (1.0 + 0.5 * i as f64, 2.0 + j as f64, 3.0 + 2.0 * k as f64);
            rows.push(format!("{},{},{z},{y},{x},{}\n", u.z, u.x, u.y));
        }
        rows.reverse();
        let table = format!("w_um_s,u_um_s,z_um,y_um,x_um,v_um_s\n{}", rows.concat());
        assert_eq!(Grid::from_csv(table.as_bytes()).unwrap(), small());
        let fault = |table: &str| Grid::from_csv(table.as_bytes()).unwrap_err().to_string();
        assert_eq!(
            fault("x_um,u_um_s,v_um_s\n"),
            "csv, line 1: the columns x_um, u_um_s, v_um_s: expected y_um"
        );
        let header = "x_um,y_um,u_um_s,v_um_s\n";
        assert_eq!(fault(&format!("{header}1,2,NaN,4\n")), "csv, line 2: \"NaN\": expected a finite number");
        assert!(fault(&format!("{header}1,2,3\n")).contains("3 columns"));
        assert!(fault(&format!("{header}1,1,0,0\n2,1,0,0\n1,2,0,0\n")).contains("3 rows"));
        assert!(fault(&format!("{header}1,1,0,0\n2,1,0,0\n4,1,0,0\n")).contains("nodes every 1.5"));
        assert!(fault(header).contains("0 rows") && fault("").contains("nothing"));
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
        assert_eq!(Grid::from_vtk(file.as_bytes()).unwrap(), small());
        let mut file = head("BINARY", "double").into_bytes();
        file.extend(numbers.iter().flat_map(|u| u.to_be_bytes()));
        assert_eq!(Grid::from_vtk(file.as_slice()).unwrap(), small());
        let mut file = head("BINARY", "float").into_bytes();
        file.extend(numbers.iter().flat_map(|u| (*u as f32).to_be_bytes()));
        assert_eq!(Grid::from_vtk(file.as_slice()).unwrap(), small());
        let fault = |file: &str| Grid::from_vtk(file.as_bytes()).unwrap_err().to_string();
        assert!(fault(&head("ASCII", "float")).contains("the end"));
        assert!(fault(&(head("ASCII", "float") + "1 2 three")).contains("three"));
        assert!(fault(&head("ASCII", "int")).contains("float or double"));
        assert!(fault("P6\n").contains("vtk, line 1"));
        let huge = head("ASCII", "float").replace("3 2 2", "9999999 9999999 9999999");
        assert!(fault(&huge).contains("50000000"));
    }
}
