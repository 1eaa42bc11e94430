//! Gridded velocities: the first byte selects .npy, .csv, .vtk or .vti. An accepted grid gives a field that
//! can be evaluated.
#![no_main]

use flows::VelocityField;
use flows::fields::{Gridded, Interpolation};
use flows::velocity_grid::{GridGeometry, VelocityGrid};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let [choice, file @ ..] = bytes else { return };
    let grid = match choice % 4 {
        0 => VelocityGrid::from_npy(file, &GridGeometry::default()),
        1 => VelocityGrid::from_csv(file),
        2 => VelocityGrid::from_vtk(file, None).map(|(grid, _)| grid),
        _ => VelocityGrid::from_vtk_xml(file, None).map(|(grid, _)| grid),
    };
    let Ok(grid) = grid else { return };
    let interpolation = if choice & 64 == 0 { Interpolation::Tricubic } else { Interpolation::Trilinear };
    if let Ok(field) = Gridded::new(&grid, interpolation, [choice & 8 != 0, choice & 16 != 0, choice & 32 != 0]) {
        let _ = field.velocity([1.0, -2.0, 3.0].into(), 0.5);
    }
});
