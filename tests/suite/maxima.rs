//! Fig. 3C and D of the paper: the maximum of a particle image against depth; and the two foci of an
//! astigmatic image.

use microsig_core::emission::SpheroidLaw;
use microsig_core::{Particle, Settings};
use suite::ensemble::Ensemble;
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

/// With the cylindrical lens the image is elongated along one axis and, 20 um farther, along the other.
#[test]
fn an_astigmatic_image_changes_its_direction_once_between_its_foci() {
    let settings = Settings { pixel_dim_x: 121, pixel_dim_y: 121, ..Settings::setting1a() };
    let moments: Vec<(f64, f64, f64)> = (-80..=40)
        .step_by(2)
        .map(|z| {
            let particle = Particle::sphere(61.0, 61.0, f64::from(z), 2.0);
            // The moments of one image are accurate to 0.2 %, and those along the two axes differ by factors.
            let image = Ensemble::draw(&settings, &[particle], SpheroidLaw::Original, 1, 4).unwrap();
            (f64::from(z), image.of_mean.mxx, image.of_mean.myy)
        })
        .collect();
    let index_of_least = |moment: &dyn Fn(&(f64, f64, f64)) -> f64| {
        (0..moments.len()).min_by(|&i, &j| moment(&moments[i]).total_cmp(&moment(&moments[j]))).unwrap()
    };
    let (focus_x, focus_y) = (index_of_least(&|m| m.1), index_of_least(&|m| m.2));
    println!("narrowest in x at z = {} um, in y at {} um", moments[focus_x].0, moments[focus_y].0);
    // A converging cylindrical lens moves the object plane of x toward the lens.
    assert!(focus_x < focus_y);
    let between = &moments[focus_x..=focus_y];
    let changes = between.windows(2).filter(|w| (w[0].1 > w[0].2) != (w[1].1 > w[1].2)).count();
    assert_eq!(changes, 1, "{between:?}");
}
