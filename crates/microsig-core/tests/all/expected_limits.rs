//! Limits of the `expected` renderer: what it rejects and warns about.

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::DEFAULT_TOLERANCE;
use microsig_core::render::{ExpectedRenderer, RayRenderer, Render};
use microsig_core::{Particle, Settings};

#[test]
fn cylinders_that_would_take_unbounded_work_are_refused() {
    for cyl_focal_length in [1e-6, -1e-12] {
        let settings = Settings { cyl_focal_length, ..Settings::setting1() };
        let error = ExpectedRenderer::new(&settings, SpheroidLaw::Original, DEFAULT_TOLERANCE).unwrap_err();
        let message = error.to_string();
        assert!(message.contains(&format!("cyl_focal_length = {cyl_focal_length:e}: expected")), "{message}");
    }
    let refused = |numerical_aperture: f64, tolerance: f64| {
        let settings = Settings { numerical_aperture, ..Settings::setting1a() };
        let renderer = ExpectedRenderer::new(&settings, SpheroidLaw::Original, tolerance).unwrap();
        renderer.check(&Particle::sphere(376.0, 183.0, 0.0, 2.0)).map_err(|error| error.to_string())
    };
    assert_eq!(refused(0.3, 1e-3), Ok(None));
    let message = refused(0.7, 1e-3).unwrap_err();
    assert!(message.contains("numerical_aperture = 0.7 with cyl_focal_length = 4000"), "{message}");
}

#[test]
fn few_rays_are_warned_of() {
    let warning = |n_rays, numerical_aperture| {
        let settings = Settings { n_rays, numerical_aperture, ..Settings::setting1() };
        let expected = ExpectedRenderer::new(&settings, SpheroidLaw::Original, DEFAULT_TOLERANCE).unwrap();
        let rays = RayRenderer::new(&settings, SpheroidLaw::Original).unwrap();
        (rays.warning().is_some(), expected.warning().is_some())
    };
    assert_eq!(warning(59, 0.13), (true, true));
    assert_eq!((warning(99, 0.3), warning(100, 0.3)), ((true, false), (false, false)));
}
