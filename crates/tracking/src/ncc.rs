//! GDPT: depth by correlation with the calibration stack.
//!
//! The images of the stack serve as templates (Barnkob, Kaehler & Rossi 2015, Lab Chip 15, 3556); they are
//! denoised (`stack`, `denoise`) and interpolated between pixels and depths (`templates`). Correlation maps
//! give candidates (`search`), whose positions, depths and brightnesses are finally fitted jointly
//! (`joint_fit`). With stacks at several places of the field of view, the search uses the nearest one, and the
//! final fit interpolates between them (`field_images`).

use super::calibration::{self, CalibrationImage, PlaceStacks};
use super::denoise::{PixelNoise, RecordedNoise};
use super::field_images::{FieldImages, FieldPlaces};
use super::locate::Locator;
use super::shape_correlation;
use super::stack::{Stack, brightest};
use super::templates::Templates;
use super::{Method, ParticleShape};

/// Relative error of the templates.
const TEMPLATE_ERROR: f32 = 0.02;

pub(super) const METHOD: Method = Method {
    name: "ncc",
    about: "Depth by correlation with the calibration stack (GDPT), linked",
    run: |job| {
        if let ParticleShape::Spheroid { aspect } = job.options.shape {
            return shape_correlation::particles(job, aspect);
        }
        let places = calibration::read_field(job.dataset)?;
        let recorded = RecordedNoise::read(job.dataset)?;
        let is_field = places.iter().any(|place| place.at.is_some());
        if !is_field && recorded.is_none() {
            let stacks = places.into_iter().next().map_or_else(Vec::new, |place| place.sizes);
            return locator(&stacks).with_classes(calibration::diameters_um(job.dataset)?).particles(job);
        }
        if is_field {
            job.note(format!(
                "images interpolated between the calibration stacks of {} places",
                places.len()
            ));
        }
        field_locator(places, recorded).with_classes(calibration::diameters_um(job.dataset)?).particles(job)
    },
};

/// From the stacks of each size of particles at several places, or of a recording.
fn field_locator(places: Vec<PlaceStacks>, recorded: Option<RecordedNoise>) -> Locator<FieldImages> {
    let at = FieldPlaces::new(places.iter().map(|place| place.at.unwrap_or_default()).collect());
    let known = recorded.and_then(RecordedNoise::stack_noise);
    let mut sizes: Vec<Vec<Templates>> = Vec::new();
    let mut stack_noise = None;
    for place in places {
        let stacks: Vec<Stack> = place.sizes.iter().map(|steps| Stack::off_axis(steps, known)).collect();
        stack_noise.get_or_insert(brightest(&stacks).noise);
        for (size, stack) in stacks.into_iter().enumerate() {
            let templates = Templates::new(stack.depths_um, stack.images, stack.noise);
            match sizes.get_mut(size) {
                Some(size_templates) => size_templates.push(templates),
                None => sizes.push(vec![templates]),
            }
        }
    }
    let stack_noise = stack_noise.unwrap_or(PixelNoise::new(1.0, 0.0));
    let noise = recorded.map_or(stack_noise, |recorded| recorded.frame_noise(stack_noise));
    let images =
        sizes.iter().map(|size_templates| FieldImages::new(at.clone(), size_templates.clone())).collect();
    // The search uses the stack that is nearest.
    let nearest = (0..at.len())
        .map(|k| sizes.iter().map(|size_templates| size_templates[k].clone()).collect())
        .collect();
    Locator::over_field(nearest, at, images, TEMPLATE_ERROR, noise)
}

/// From the stack of each size of particles.
fn locator(stacks: &[Vec<CalibrationImage>]) -> Locator<Templates> {
    let stacks: Vec<Stack> = stacks.iter().map(|steps| Stack::new(steps)).collect();
    let noise = brightest(&stacks).noise;
    let sizes = stacks.into_iter().map(|stack| {
        let templates = Templates::new(stack.depths_um, stack.images, stack.noise);
        (templates.clone(), templates)
    });
    Locator::new(sizes.collect(), TEMPLATE_ERROR, noise)
}
#[cfg(test)]
mod tests {
    use super::super::Localization;
    use super::super::gray_image::{GrayImage, normal};
    use super::*;

    /// Adds a ring whose radius grows with depth.
    fn ring(image: &mut GrayImage, [cx, cy]: [f64; 2], z_um: f64, brightness: f32) {
        let radius = 3.0 + 0.1 * z_um;
        for y in 0..image.height {
            for x in 0..image.width {
                let r = (x as f64 - cx).hypot(y as f64 - cy);
                image.counts[y * image.width + x] +=
                    brightness * (-0.5 * ((r - radius) / 1.5).powi(2)).exp() as f32;
            }
        }
    }

    fn noise(size: usize) -> GrayImage {
        GrayImage::from_fn((size, size), |x, y| 300.0 + ((x * 7 + y * 13 + x * y) % 9) as f32)
    }

    fn stack() -> Locator<Templates> {
        let step = |k: i32| {
            let mut image = noise(61);
            ring(&mut image, [30.0, 30.0], 3.0 * f64::from(k), 200.0);
            CalibrationImage { z_um: 3.0 * f64::from(k), at: [30.0, 30.0], image }
        };
        locator(&[(0..40).map(step).collect()])
    }

    #[test]
    fn rings_are_found_once_and_at_their_depth() {
        let truth = [([40.3, 50.6], 22.0, 150.0), ([110.8, 42.1], 80.5, 260.0), ([75.0, 110.4], 51.3, 200.0)];
        let mut image = noise(150);
        for (at, z, brightness) in truth {
            ring(&mut image, at, z, brightness);
        }
        let found = stack().find(&image, None).0;
        assert_eq!(found.len(), 3, "{found:?}");
        for ([x, y], z, _) in truth {
            let off = |f: &&Localization| (f.x_px - 1.0 - x).hypot(f.y_px - 1.0 - y);
            let nearest = found.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
            assert!(off(&nearest) < 0.1, "{nearest:?}");
            assert!((nearest.z_um.unwrap() - z).abs() < 0.5, "{nearest:?} for {z}");
        }
    }

    /// In experimental stacks, the particle is not centered on a pixel and drifts during the scan.
    #[test]
    fn stacks_whose_particle_drifts_are_centered() {
        let image = |k: i32| {
            let at = [28.3 + 0.07 * f64::from(k), 33.6 - 0.11 * f64::from(k)];
            let mut image = noise(71);
            ring(&mut image, at, 3.0 * f64::from(k), 200.0);
            CalibrationImage { z_um: 3.0 * f64::from(k), at, image }
        };
        let stack = locator(&[(0..40).map(image).collect()]);
        let mut frame = noise(100);
        ring(&mut frame, [50.2, 47.9], 55.0, 200.0);
        let found = stack.find(&frame, None).0;
        assert_eq!(found.len(), 1, "{found:?}");
        assert!((found[0].x_px - 51.2).abs() < 0.1 && (found[0].y_px - 48.9).abs() < 0.1, "{found:?}");
        assert!((found[0].z_um.unwrap() - 55.0).abs() < 0.7, "{found:?}");
    }

    #[test]
    fn rings_that_overlap_are_found_apart() {
        let mut image = noise(120);
        ring(&mut image, [50.0, 60.0], 60.0, 200.0);
        ring(&mut image, [62.0, 60.0], 30.0, 250.0);
        assert_eq!(stack().find(&image, None).0.len(), 2);
    }

    #[test]
    fn noise_holds_no_particles() {
        assert_eq!(stack().find(&noise(100), None).0, []);
    }

    /// The noise of many pixels exceeds the light of a faint image, which is significant nevertheless.
    #[test]
    fn faint_images_are_found_in_noise() {
        let noise = |size: (usize, usize), seed: usize| {
            GrayImage::from_fn(size, |x, y| 600.0 + 30.0 * normal((seed * 300 + y) * 300 + x))
        };
        let step = |k: i32| {
            let mut image = noise((201, 201), k as usize);
            ring(&mut image, [100.0, 100.0], 3.0 * f64::from(k), 45.0);
            image.counts.iter_mut().for_each(|c| *c = c.round());
            CalibrationImage { z_um: 3.0 * f64::from(k), at: [100.0, 100.0], image }
        };
        let stack = locator(&[(0..40).map(step).collect()]);
        let mut frame = noise((300, 150), 50);
        ring(&mut frame, [80.2, 70.9], 40.0, 45.0);
        ring(&mut frame, [210.4, 80.1], 80.0, 45.0);
        let (found, _) = stack.find(&frame, None);
        assert_eq!(found.len(), 2, "{found:?}");
        let (empty, rejections) = stack.find(&noise((100, 100), 51), None);
        assert_eq!(empty, []);
        assert!(rejections.warning().contains("no particles found"));
    }
}
