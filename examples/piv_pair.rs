//! A PIV pair: dense Gaussian spots in a uniform flow; the cross-correlation of one interrogation window shows
//! the displacement that the truth states.
#![expect(clippy::print_stdout, reason = "a program")]

use flows::fields::UniformParams;
use generator::setup::{Cloud, Microscope, Recording};
use microsig_core::sensor::Image;
use scenario::spec::Gaussian;

const WINDOW_PX: usize = 48;
const SEARCH_PX: i32 = 8;

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scope = Microscope::setting1().sensor(128, 128).background(100.0, 5.0);
    scope.optics.gaussian = Some(Gaussian::default());
    // 5 px to the right and 3 px up in 5 ms; a pixel is 0.645 um.
    let flow = UniformParams { velocity_um_s: [5.0 * 129.0, -3.0 * 129.0, 0.0] };
    let recording = Recording::pair(flow, &Cloud::ppp(0.02), &scope, 0.005)?;
    let frames = recording.frames()?.collect::<Result<Vec<_>, _>>()?;

    let [dx, dy] = displacement(&frames[0].image(), &frames[1].image());
    let truth = frames[1].truth()?.displacements;
    let mean = |d: fn(&storage::dataset::DisplacementRow) -> f64| {
        truth.iter().map(d).sum::<f64>() / truth.len() as f64
    };
    println!("correlation: {dx} px, {dy} px");
    println!("truth:       {:.3} px, {:.3} px", mean(|row| row.dx_px), mean(|row| row.dy_px));
    Ok(())
}

/// The shift (whole px) at which a window in the middle of two images correlates best.
fn displacement(a: &Image, b: &Image) -> [i32; 2] {
    let (width, [a, b]) = (a.width as usize, [a, b].map(|image| image.counts.values().collect::<Vec<f64>>()));
    let mean = a.iter().sum::<f64>() / a.len() as f64;
    let corner = (width - WINDOW_PX) / 2;
    let correlation = |dx: i32, dy: i32| -> f64 {
        let places =
            (corner..corner + WINDOW_PX).flat_map(|y| (corner..corner + WINDOW_PX).map(move |x| (x, y)));
        let shifted = |from: usize, by: i32| from.strict_add_signed(by as isize);
        places
            .map(|(x, y)| (a[y * width + x] - mean) * (b[shifted(y, dy) * width + shifted(x, dx)] - mean))
            .sum()
    };
    let shifts = (-SEARCH_PX..=SEARCH_PX).flat_map(|dy| (-SEARCH_PX..=SEARCH_PX).map(move |dx| [dx, dy]));
    shifts.max_by(|p, q| correlation(p[0], p[1]).total_cmp(&correlation(q[0], q[1]))).unwrap_or_default()
}
