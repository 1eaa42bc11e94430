//! CSV tables with one row per grid node.

use super::{MAX_NODES, VelocityGrid, fault};
use crate::error::Result;
use glam::DVec3;
use std::io::BufRead;

impl VelocityGrid {
    /// Reads a CSV table with a header and the columns x_um, y_um, z_um, u_um_s, v_um_s, w_um_s and
    /// optionally t_s, in any order: one row for every node at every time, in any order. Missing columns z_um
    /// and w_um_s are taken as zero. `Err` names the line if a cell is not a finite number or the rows do not
    /// form a complete regular grid.
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
        VelocityGrid::new(DVec3::new(x[0], y[0], z[0]), spacing, counts, times.clone(), velocities)
    }
}

/// The spacing of equidistant values; 1 for a single value.
fn even(ticks: &[f64], column: &str) -> Result<f64> {
    let (Some(first), Some(last)) = (ticks.first(), ticks.last()) else { return Ok(1.0) };
    if ticks.len() == 1 {
        return Ok(1.0);
    }
    let step = (last - first) / (ticks.len() - 1) as f64;
    // Tolerance for coordinates written with six digits.
    let odd =
        ticks.iter().enumerate().find(|(i, tick)| (first + step * *i as f64 - **tick).abs() > 1e-5 * step);
    match odd {
        None => Ok(step),
        Some((_, tick)) => Err(fault(
            "csv",
            None,
            format!("{column} = {tick}"),
            &format!("nodes every {step} from the first"),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::small;
    use super::*;

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
        assert_eq!(VelocityGrid::from_csv(table.as_bytes()).unwrap(), small());
        let fault = |table: &str| VelocityGrid::from_csv(table.as_bytes()).unwrap_err().to_string();
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
}
