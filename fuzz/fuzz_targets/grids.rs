//! Gridded velocities: the first byte chooses .npy, .csv or .vtk. A grid that is accepted makes a field that can be asked.
#![no_main]

use flows::VelocityField;
use flows::fields::{Gridded, Interpolation};
use flows::grid::{Geometry, Grid};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let [choice, file @ ..] = bytes else { return };
    let grid = match choice % 3 {
        0 => Grid::from_npy(file, &Geometry::default()),
        1 => Grid::from_csv(file),
        _ => Grid::from_vtk(file),
    };
    let Ok(grid) = grid else { return };
    let interpolation = if choice & 64 == 0 { Interpolation::Tricubic } else { Interpolation::Trilinear };
    if let Ok(field) = Gridded::new(&grid, interpolation, [choice & 8 != 0, choice & 16 != 0, choice & 32 != 0]) {
        let _ = field.velocity([1.0, -2.0, 3.0].into(), 0.5);
    }
});
