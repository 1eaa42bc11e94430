//! Cost of advection in CPU time on one core: `cargo run --release -p microsig-flows --example bars`.
//!
//! 100,000 particles over 100 frames of 5 ms in a Lamb-Oseen vortex and in 200 Kraichnan modes, without file
//! output; then every field of the registry, in ns per particle and frame. On Linux the time is the CPU time
//! of the thread from the scheduler, hardly affected by other load; elsewhere it is wall-clock time.
#![expect(clippy::print_stdout, reason = "an example that reports")]

use std::time::Instant;

use flows::integrate::advance;
use flows::registry::{ENTRIES, find};
use flows::{Region, Result, VelocityField};
use glam::DVec3;

const DT_S: f64 = 0.005;

fn points(number: u32) -> Vec<DVec3> {
    let view = Region::new(DVec3::new(-239.0, -118.0, -79.0), DVec3::new(239.0, 118.0, 19.0));
    let view = view.expect("the corners are in order");
    let unit = |i: f64| DVec3::new(i * 0.819_172 % 1.0, i * 0.671_044 % 1.0, i * 0.549_700 % 1.0);
    (0..number).map(|i| view.at(unit(f64::from(i)))).collect()
}

/// CPU time of this thread, s; wall-clock time since `start` where it is not available.
fn cpu_s(start: Instant) -> f64 {
    let counted = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let ns = counted.and_then(|text| text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()));
    ns.map_or(start.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Advects the points over `frames` frames and returns the CPU time, s.
fn run(field: &dyn VelocityField, points: &mut [DVec3], frames: u32) -> Result<f64> {
    let start = Instant::now();
    let before = cpu_s(start);
    for frame in 0..frames {
        let t = DT_S * f64::from(frame);
        for x in points.iter_mut() {
            *x = advance(field, *x, t, t + DT_S)?;
        }
    }
    Ok(cpu_s(start) - before)
}

fn main() -> Result<()> {
    println!("100,000 particles x 100 frames, one core:");
    for name in ["lamb_oseen", "kraichnan"] {
        let field = (find(name).expect("it is in the registry").make)()?;
        let seconds = run(field.as_ref(), &mut points(100_000), 100)?;
        println!("  {name}: {seconds:.2} s");
    }
    println!("\nns per particle and frame:");
    for entry in ENTRIES {
        let all = std::iter::once((entry.name.to_owned(), entry.make));
        let variants = entry.variants.iter().map(|(v, make)| (format!("{}: {v}", entry.name), *make));
        for (name, make) in all.chain(variants) {
            let field = make()?;
            // The scheduler's clock advances in ticks of a few ms.
            let (mut seconds, mut runs) = (0.0, 0.0);
            let start = Instant::now();
            let before = cpu_s(start);
            while seconds < 0.2 {
                run(field.as_ref(), &mut points(2000), 1)?;
                runs += 1.0;
                seconds = cpu_s(start) - before;
            }
            println!("{:8.0}  {name}", seconds / runs / 2000.0 * 1e9);
        }
    }
    Ok(())
}
