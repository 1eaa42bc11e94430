//! Fig. 3C and D of the paper: the maximum of a particle image against depth; and the two foci of an
//! astigmatic image.

use microsig_core::Settings;
use suite::maxima::{self, Maximum};

fn compare(settings: &Settings, d_um: f64, reference: &str, peak_within_um: f64) {
    let theirs = maxima::read(&suite::data().join("optics").join(reference)).unwrap();
    let depths: Vec<f64> = theirs.iter().map(|m| m.z_um).collect();
    let ours = maxima::curve(settings, d_um, &depths, 1, 15).unwrap();

    let away = |a: &Maximum, b: &Maximum| (a.mean - b.mean).abs();
    let share = |met: &dyn Fn(&Maximum, &Maximum) -> bool| {
        ours.iter().zip(&theirs).filter(|(a, b)| met(a, b)).count() as f64 / ours.len() as f64
    };
    let images = share(&|a, b| away(a, b) <= 3.0 * a.deviation.hypot(b.deviation));
    let means = share(&|a, b| away(a, b) <= 3.0 * a.standard_error().hypot(b.standard_error()));
    let bias: f64 = ours
        .iter()
        .zip(&theirs)
        .map(|(a, b)| (a.mean - b.mean) / a.standard_error().hypot(b.standard_error()))
        .sum::<f64>()
        / ours.len() as f64;
    let (our_peak, their_peak) = (maxima::peak(&ours), maxima::peak(&theirs));
    println!(
        "{reference}: within 3 standard deviations {images}, errors of the mean {means}, mean deviation {bias:.2} \
         errors; peak {our_peak:.2} and {their_peak:.2} um"
    );
    assert!(images >= 0.95, "single images agree at {images} of the depths");
    // With standard errors estimated from 10 images, 1.5 % of depths lie outside 3 standard errors by chance.
    assert!(means >= 0.95, "means agree at {means} of the depths");
    // The mean over 61 or 46 depths has a standard error of 0.15.
    assert!(bias.abs() < 0.54, "ours differ by {bias} standard errors on average");
    assert!((our_peak - their_peak).abs() < peak_within_um, "peak at {our_peak}, theirs at {their_peak} um");
}

#[test]
fn maxima_of_setting_1_follow_figure_3c() {
    compare(&Settings::setting1(), 2.0, "fig3c.csv", 2.0);
}

#[test]
fn maxima_of_setting_2_follow_figure_3d() {
    compare(&Settings::setting2(), 1.0, "fig3d.csv", 1.0);
}
