//! Comparison with all 81 measured images of the original program (`data/optics`): totals, centroids,
//! moments, radii and variances, and for one image of every case pixel by pixel.

use suite::measure::Measures;
use suite::reference::{self, Check};

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
