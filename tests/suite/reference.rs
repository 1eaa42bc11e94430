//! Comparison with all 81 measured images of the original program (`data/optics`): totals, centroids,
//! moments, radii and variances, and for one image of every case pixel by pixel.

use std::path::Path;

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::{RayRenderer, rays::Scratch};
use microsig_core::stream::{Purpose, Streams};
use suite::reference::{self, Check};
use suite::{error_map, measure::Measures};

/// At least twice the original's 50 images, so that its statistical error dominates.
const IMAGES: u32 = 100;

/// A fifth of the images, spread over all cases.
#[test]
fn images_of_the_original_are_met() {
    assert_met(5);
}

#[test]
#[ignore = "slow: .ci/full"]
fn every_image_of_the_original_is_met() {
    assert_eq!(assert_met(1), 15, "one picture for every case");
}

/// Compares one of `every` images; the number of those compared pixel by pixel.
fn assert_met(every: usize) -> usize {
    let mut cases = reference::cases(&suite::data().join("optics")).unwrap();
    assert_eq!(cases.len(), 81);
    cases = cases.into_iter().step_by(every).collect();
    let (mut failures, mut worst, mut pictures) = (Vec::new(), Vec::<(Check, String)>::new(), 0);
    for case in &cases {
        let label = format!("{}/{}", case.case, case.name);
        let ours = case.draw(IMAGES).unwrap();
        let mut checks = case.check_measures(&ours);
        let theirs = case.mean_image().unwrap();
        if let Some(theirs) = &theirs {
            checks.extend(case.check_image(&ours, theirs).unwrap());
            pictures += 1;
        }
        for check in checks {
            if check.used() > 1.0 {
                failures.push(format!("{label}: {check:?}"));
                if let Some(theirs) = &theirs {
                    let name = format!("{}_{}.png", case.case, case.name);
                    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
                    let z = case.differences(&ours, theirs);
                    error_map::write(&path, ours.width, &ours.mean, theirs, &z).unwrap();
                    failures.push(format!("  see {}", path.display()));
                }
            }
            match worst.iter_mut().find(|(w, _)| w.quantity == check.quantity) {
                Some(w) if w.0.used() < check.used() => *w = (check, label.clone()),
                Some(_) => {}
                None => worst.push((check, label.clone())),
            }
        }
    }
    for (check, label) in &worst {
        println!("{:6} uses {:.2} of its bar at most, in {label}", check.quantity, check.used());
    }
    assert_eq!(worst.len(), Measures::NAMES.len() + 3);
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    pictures
}

/// The original uses the same rays for equal particles of an image (the standard deviation of its
/// two-particle total is twice that of one particle). In microsig no two particles share their noise.
#[test]
fn equal_particles_of_an_image_have_rays_of_their_own() {
    let cases = reference::cases(&suite::data().join("optics")).unwrap();
    let case = cases.iter().find(|case| case.case == "set1_mono2rows").unwrap();
    let particles = case.particles().unwrap();
    let renderer = RayRenderer::new(&case.settings().unwrap(), SpheroidLaw::Original).unwrap();
    let (streams, scratch) = (Streams::new(11), &mut Scratch::default());

    let n = 200;
    let pairs: Vec<[Vec<f64>; 2]> = (0..n)
        .map(|frame| {
            [0, 1].map(|row| {
                let particle = &particles[row as usize];
                let patch = renderer.patch(particle, &streams, Purpose::Rays, frame, row, scratch).unwrap();
                patch.counts.iter().map(|&c| f64::from(c)).collect()
            })
        })
        .collect();
    let pixels = pairs[0][0].len();
    assert_eq!(pixels, pairs[0][1].len(), "both lie on pixel centres and far from the edge");
    let (mut covariance, mut variance) = (0.0, 0.0);
    for i in 0..pixels {
        let mean = [0, 1].map(|side| pairs.iter().map(|p| p[side][i]).sum::<f64>() / f64::from(n));
        for pair in &pairs {
            covariance += (pair[0][i] - mean[0]) * (pair[1][i] - mean[1]);
            variance += ((pair[0][i] - mean[0]).powi(2) + (pair[1][i] - mean[1]).powi(2)) / 2.0;
        }
    }
    // Standard error 1 / sqrt(200 images x about 50 independent bright pixels) = 0.01; shared rays would give
    // a correlation of one.
    assert!((covariance / variance).abs() < 0.05, "correlation {}", covariance / variance);
}
