//! A first recording: two frames of a vortex under a microscope, their images, and the true particles.
//!
//! `cargo run --example first_recording` writes `frame_0.tif` and `frame_1.tif`.
#![expect(clippy::print_stdout, reason = "a program")]

use flows::fields::LambOseenParams;
use generator::setup::{Cloud, Microscope, Recording};

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scope = Microscope::setting1().sensor(512, 512).expected();
    let flow = LambOseenParams { max_speed_um_s: 800.0, ..Default::default() };
    let cloud = Cloud::count(500).diameter_um(2.0);
    let recording = Recording::pair(flow, &cloud, &scope, 0.005)?.seed(1)?;
    for frame in recording.frames()? {
        let frame = frame?;
        frame.save(format!("frame_{}.tif", frame.index()))?;
        println!("frame {}: {} particles, the first are", frame.index(), frame.particles().len());
        for particle in frame.particles().iter().take(3) {
            println!(
                "  x = {:.2} px, y = {:.2} px, z = {:.2} um",
                particle.x_px, particle.y_px, particle.z_um
            );
        }
    }
    Ok(())
}
