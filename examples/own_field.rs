//! A field of one's own: particles in a shear layer, u = U tanh(y / delta), which is not built in. A velocity
//! and a bound of the speed are enough; gradient and trajectories follow from them numerically.
#![expect(clippy::print_stdout, reason = "a program")]

use flows::{Region, VelocityField};
use generator::setup::{Cloud, Microscope, Recording};
use glam::DVec3;
use scenario::spec::Motion;

#[derive(Debug)]
struct ShearLayer {
    speed_um_s: f64,
    thickness_um: f64,
}

impl VelocityField for ShearLayer {
    fn velocity(&self, x: DVec3, _t: f64) -> DVec3 {
        DVec3::X * self.speed_um_s * (x.y / self.thickness_um).tanh()
    }

    fn is_divergence_free(&self) -> bool {
        true
    }

    fn is_steady(&self) -> bool {
        true
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        self.speed_um_s
    }
}

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scope = Microscope::setting1().sensor(128, 128).expected();
    let flow = Motion::own(ShearLayer { speed_um_s: 600.0, thickness_um: 10.0 });
    let recording = Recording::sequence(flow, &Cloud::count(30), &scope, 3, 0.005)?;
    for frame in recording.frames()? {
        let frame = frame?;
        let brightest = frame.image().counts.values().fold(0.0, f64::max);
        println!("frame {}: t = {} s, brightest pixel {brightest} counts", frame.index(), frame.t_s());
        for row in frame.truth()?.displacements.iter().filter(|row| row.visible_a).take(4) {
            println!("  track {}: y = {:.1} px, moved by {:.3} px along x", row.track, row.y_px, row.dx_px);
        }
    }
    Ok(())
}
