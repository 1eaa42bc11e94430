//! A tracker scored in memory: local maxima of each image are its particles, the nearest one in the next frame
//! continues a track. No file is written or read.
#![expect(clippy::print_stdout, reason = "a program")]

use flows::fields::PoiseuilleParams;
use generator::setup::{Cloud, Microscope, Recording};
use scoring::evaluate::{EvaluateOptions, Truth, evaluate_source};
use scoring::results::Source;
use storage::Progress;
use storage::dataset::{Columns, Values};

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scope = Microscope::setting1().sensor(256, 256).depths_um(-30.0, -10.0).expected();
    let flow = PoiseuilleParams { max_speed_um_s: Some(600.0), ..Default::default() };
    let made =
        Recording::sequence(flow, &Cloud::count(40), &scope, 6, 0.005)?.dataset(&Progress::default())?;

    let [_, height, width] = made.shape();
    let counts: Vec<f64> = made.counts().values().collect();
    let (mut rows, mut before, mut last_track) = (Vec::new(), Vec::new(), 0);
    for (number, image) in (0u32..).zip(counts.chunks(width * height)) {
        let mut here = Vec::new();
        for [x, y] in maxima(image, width) {
            let nearest = before.iter().position(|(_, [u, v]): &(i32, [f64; 2])| (x - u).hypot(y - v) < 6.0);
            last_track += i32::from(nearest.is_none());
            let id = nearest.map_or(last_track, |k| before.swap_remove(k).0);
            here.push((id, [x, y]));
            rows.push([f64::from(number), f64::from(id), x, y]);
        }
        before = here;
    }
    let names = ["frame", "track", "x_px", "y_px"].into_iter().enumerate();
    let numbers = |k: usize| Values::Numbers(rows.iter().map(|row| row[k]).collect());
    let columns = Columns(names.map(|(k, name)| (name.to_owned(), numbers(k))).collect());

    let options = EvaluateOptions::default();
    let truth = |is_field| Truth::from_memory(&made, made.scenario(), is_field, &options);
    let score = evaluate_source(truth, Source::Columns(columns), &options)?.score;
    let found = score.detection.unwrap_or_default();
    println!("found {} of {} particles, {} ghosts", found.tp, found.tp + found.missed, found.fp);
    println!("RMS error in the image plane: {:.2} px", found.rmse_xy_px.unwrap_or(f64::NAN));
    Ok(())
}

/// Pixels brighter than all others within 3 px, the first pixel being (1, 1).
fn maxima(image: &[f64], width: usize) -> Vec<[f64; 2]> {
    let height = image.len() / width;
    let is_peak = |x: usize, y: usize| {
        let (peak, mut rows) = (image[y * width + x], y - 3..=y + 3);
        peak > 700.0 && rows.all(|v| image[v * width + x - 3..][..7].iter().all(|count| *count <= peak))
    };
    let places = (3..height - 3).flat_map(|y| (3..width - 3).map(move |x| (x, y)));
    places.filter(|(x, y)| is_peak(*x, *y)).map(|(x, y)| [x as f64 + 1.0, y as f64 + 1.0]).collect()
}
