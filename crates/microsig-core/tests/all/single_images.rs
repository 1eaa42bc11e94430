//! Images computed one by one, without tables, against finer ones.
#![expect(clippy::print_stdout, reason = "the margins of a test are shown when it fails, or on request")]

use microsig_core::emission::SpheroidLaw;
use microsig_core::optics::{FieldComa, FieldOptics};
use microsig_core::render::expected::DEFAULT_TOLERANCE;
use microsig_core::render::waves::{Cylinder, Lens, WaveOptics, WavesRenderer};
use microsig_core::render::{Context, RenderMethod, Renderer, RendererSpec};
use microsig_core::{Particle, Settings};

/// Optics and particles: numerical aperture, magnification, depth, diameter, focal length of the cylindrical lens.
const CASES: [[f64; 5]; 12] = [
    [0.3, 10.0, -50.0, 2.0, 0.0],
    [0.3, 10.0, -12.3, 2.0, 0.0],
    [0.3, 10.0, 0.7, 1.0, 0.0],
    [0.2, 10.0, -40.0, 3.0, 0.0],
    [0.4, 20.0, -20.0, 1.3, 0.0],
    [0.45, 20.0, 15.0, 2.0, 0.0],
    [0.15, 5.0, -80.0, 5.0, 0.0],
    [0.6, 40.0, -10.0, 1.0, 0.0],
    [0.3, 10.0, -50.0, 2.0, 4000.0],
    [0.3, 10.0, -25.0, 2.0, 3000.0],
    [0.2, 10.0, -10.0, 3.0, 4000.0],
    [0.4, 20.0, -15.0, 1.0, 4000.0],
];

fn settings([na, magnification, _, _, cylinder]: [f64; 5]) -> Settings {
    Settings {
        numerical_aperture: na,
        magnification,
        cyl_focal_length: cylinder,
        pixel_dim_x: 64,
        pixel_dim_y: 64,
        ..Settings::setting1()
    }
}

fn build(method: RenderMethod, settings: &Settings, context: &Context) -> Renderer {
    RendererSpec::from(method).with_single_images(true).build(settings, context).unwrap()
}

/// The largest value of the image of a particle.
fn peak(truth: &Renderer, at: &Particle) -> f64 {
    truth.mean_patch(at).unwrap().counts.into_iter().fold(0.0, f64::max)
}

/// Root mean square and largest deviation of the images of a particle on the sensor, over a peak.
fn deviation(ours: &Renderer, truth: &Renderer, at: &Particle, peak: f64) -> [f64; 2] {
    let image = |renderer: &Renderer| {
        let mut image = vec![0.0; 64 * 64];
        let patch = renderer.mean_patch(at).unwrap();
        let window = patch.window;
        for (i, counts) in patch.counts.iter().enumerate() {
            let x = window.x0 as usize + i % window.width - 1;
            let y = window.y0 as usize + i / window.width - 1;
            image[y * 64 + x] = *counts;
        }
        image
    };
    let (ours, truth) = (image(ours), image(truth));
    let lit = ours.iter().zip(&truth).filter(|(_, b)| **b > 0.0).map(|(a, b)| (a - b) / peak);
    let (n, squares, most) =
        lit.fold((0.0, 0.0, 0.0f64), |(n, s, most), d| (n + 1.0, s + d * d, most.max(d.abs())));
    [libm::sqrt(squares / n), most]
}

/// The particle of a case, in the sensor and beyond its edge.
fn particles([_, _, z_um, d_um, _]: [f64; 5]) -> [Particle; 2] {
    [Particle::sphere(31.3, 33.8, z_um, d_um), Particle::sphere(-3.4, 40.1, z_um, d_um)]
}

#[test]
fn expected_images_meet_the_tolerance() {
    let spheroids = SpheroidLaw::Original;
    for case in CASES {
        let with = |tolerance: f64| {
            let method = RenderMethod::Expected { spheroids, tolerance };
            build(method, &settings(case), &Context::default())
        };
        let (ours, truth) = (with(DEFAULT_TOLERANCE), with(2e-4));
        assert!(!ours.needs_tables());
        let [inside, _] = particles(case);
        let peak = peak(&truth, &inside);
        for at in particles(case).iter().filter(|at| truth.patch_window(at).area() > 0) {
            let [rms, most] = deviation(&ours, &truth, at, peak);
            println!("{case:?}: {rms:.1e} {most:.1e}");
            assert!(rms < DEFAULT_TOLERANCE && most < 4.0 * DEFAULT_TOLERANCE, "{case:?}: {rms} {most}");
        }
    }
}

/// Optics by waves: MicroSIG's lens, and the corrected one, which has a cylindrical lens before the camera.
fn waves(lens: Lens, cylinder: f64) -> WaveOptics {
    let real = Cylinder::of_planes(-20.0, 0.9, 10.0).filter(|_| cylinder > 0.0 && lens == Lens::Aplanatic);
    WaveOptics { lens, cylinder: real, ..WaveOptics::new(0.52) }
}

/// All images share kernels, too.
#[test]
fn images_by_waves_meet_the_tolerance() {
    let context = Context::default();
    for (lens, case) in CASES.into_iter().flat_map(|case| [(Lens::Microsig, case), (Lens::Aplanatic, case)]) {
        let mut settings = settings(case);
        if lens == Lens::Aplanatic {
            settings.cyl_focal_length = 0.0;
        } else if case[0] > 0.4 {
            // Most of the light of such an aperture lands far away.
            continue;
        }
        let with = |tolerance: f64, context: &Context| {
            let method = RenderMethod::Waves { optics: waves(lens, case[4]), tolerance };
            build(method, &settings, context)
        };
        let (ours, truth) = (with(DEFAULT_TOLERANCE, &context), with(2e-4, &Context::default()));
        let [inside, _] = particles(case);
        let [_, most] = deviation(&ours, &truth, &inside, peak(&truth, &inside));
        println!("{lens:?} {case:?}: {most:.1e}");
        assert!(most < DEFAULT_TOLERANCE, "{lens:?} {case:?}: {most}");
    }
}

/// With optics that vary over the field, single images equal those from tables.
#[test]
fn images_of_a_field_are_those_of_its_tables() {
    let coma = FieldComa { per_mm: 0.5, ..FieldComa::default() };
    let optics = WaveOptics {
        lens: Lens::Aplanatic,
        field: FieldOptics { coma, ..FieldOptics::default() },
        ..WaveOptics::new(0.52)
    };
    let settings = settings([0.3, 10.0, 0.0, 0.0, 0.0]);
    let tables = WavesRenderer::new(&settings, &optics, DEFAULT_TOLERANCE).unwrap();
    let method = RenderMethod::Waves { optics, tolerance: DEFAULT_TOLERANCE };
    let ours = build(method, &settings, &Context::default());
    let (tables, at) = (Renderer::from(tables), Particle::sphere(50.3, 12.2, -14.0, 1.0));
    let [_, most] = deviation(&ours, &tables, &at, peak(&tables, &at));
    assert!(most < 2.0 * DEFAULT_TOLERANCE, "{most}");
}

/// Derivatives with respect to depth are differences of images.
#[test]
fn gradients_have_derivatives_with_depth() {
    let at = Particle::sphere(31.3, 33.8, -18.0, 2.0);
    let expected = RenderMethod::Expected { spheroids: SpheroidLaw::Original, tolerance: 3e-4 };
    let by_waves = RenderMethod::Waves { optics: WaveOptics::new(0.52), tolerance: 1e-3 };
    for method in [expected, by_waves] {
        let renderer = build(method, &settings([0.3, 10.0, 0.0, 0.0, 0.0]), &Context::default());
        let gradient = renderer.gradient(&at, None).unwrap();
        let window = Some(gradient.window);
        let value = |z_um: f64| renderer.gradient(&Particle { z_um, ..at }, window).unwrap();
        let [low, high] = [value(-18.1), value(-17.9)];
        let steepest = gradient.pixels.iter().fold(0.0f64, |most, pixel| most.max(pixel[3].abs()));
        for (i, [.., by_z]) in gradient.pixels.iter().enumerate() {
            let difference = (high.pixels[i][0] - low.pixels[i][0]) / 0.2;
            assert!((by_z - difference).abs() < 0.1 * steepest, "{i}: {by_z}, not {difference}");
        }
    }
}
