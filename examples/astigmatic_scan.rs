//! An astigmatic scan: a particle seen through a cylindrical lens at increasing depth. Its image is narrow along
//! x in one focal plane and along y in the other, which is how astigmatic PTV measures depth.
#![expect(clippy::print_stdout, reason = "a program")]

use flows::fields::UniformParams;
use generator::setup::{Cloud, Microscope, Recording};
use microsig_core::sensor::Image;
use scenario::spec::Calibration;

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scope = Microscope::setting1a().expected().depths_um(-80.0, 20.0).background(100.0, 0.0);
    scope.calibration = Some(Calibration::EveryUm(10.0));
    // The frames are not needed, only the calibration stack of the setup.
    let cloud = Cloud::count(1).diameter_um(2.0);
    let recording = Recording::pair(UniformParams::default(), &cloud, &scope, 0.005)?;
    println!("z (um)  width x (px)  width y (px)");
    for (row, image) in recording.calibration()? {
        let [x, y] = widths(&image, 100.0);
        println!("{:6}  {x:12.2}  {y:12.2}", row.z_um);
    }
    Ok(())
}

/// Standard deviations of an image along x and y, px.
fn widths(image: &Image, background: f64) -> [f64; 2] {
    let (mut sum, mut first, mut second) = (0.0, [0.0; 2], [0.0; 2]);
    for (k, count) in image.counts.values().enumerate() {
        let (light, at) = (count - background, [k % image.width as usize, k / image.width as usize]);
        sum += light;
        for axis in 0..2 {
            first[axis] += light * at[axis] as f64;
            second[axis] += light * (at[axis] * at[axis]) as f64;
        }
    }
    [0, 1].map(|axis| (second[axis] / sum - (first[axis] / sum).powi(2)).sqrt())
}
