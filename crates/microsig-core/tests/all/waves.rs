//! Wave-optical images against an independent program (tests/data/waves/README.md), and against
//! known physical properties.
#![expect(clippy::print_stdout, reason = "the margins of a test are shown when it fails, or on request")]

use microsig_core::emission::{SpheroidLaw, sphere_points};
use microsig_core::optics::{FieldComa, FieldOptics};
use microsig_core::render::InstructionSet;
use microsig_core::render::expected::ExpectedRenderer;
use microsig_core::render::waves::{Emission, Lens, Mask, Pinhole, WaveOptics, WavesRenderer};
use microsig_core::render::{Render, Tables, TablesState, Window};
use microsig_core::{Particle, Settings};

/// One row of cases.csv with its image.
struct Case {
    name: String,
    settings: Settings,
    optics: WaveOptics,
    z_um: f64,
    d_um: f64,
    width_px: usize,
    /// Position of the particle relative to the central pixel, px.
    offset_px: [f64; 2],
    sum: f64,
    /// The whole window, row by row.
    image: Vec<f64>,
}

impl Case {
    fn all() -> Vec<Case> {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/waves/");
        let table = std::fs::read_to_string(format!("{folder}cases.csv")).unwrap();
        table.lines().skip(1).map(|line| Case::read(folder, line)).collect()
    }

    fn read(folder: &str, line: &str) -> Case {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |i: usize| fields[i].parse::<f64>().unwrap();
        let settings = match fields[1] {
            "1" => Settings::setting1(),
            "1a" => Settings::setting1a(),
            _ => Settings::setting2(),
        };
        let mut optics = WaveOptics::new(number(5));
        optics.bandwidth_um = number(6);
        optics.emission = if fields[7] == "volume" { Emission::Volume } else { Emission::Surface };
        // Z5:0.1 Z6:-0.2
        for term in fields[10].split_whitespace() {
            let (j, waves) = term[1..].split_once(':').unwrap();
            optics.pupil.zernike.push((j.parse().unwrap(), waves.parse().unwrap()));
        }
        // x/y/r x/y/r
        let holes = fields[12].split_whitespace().map(|hole| {
            let numbers: Vec<f64> = hole.split('/').map(|n| n.parse().unwrap()).collect();
            Pinhole { x: numbers[0], y: numbers[1], r: numbers[2] }
        });
        if !fields[12].is_empty() {
            optics.pupil.mask = Mask::Pinholes(holes.collect());
        }
        if !fields[11].is_empty() {
            optics.pupil.mask = Mask::Annulus { inner: number(11) };
        }
        let width_px = number(4) as usize;
        let bytes = std::fs::read(format!("{folder}{}.f32", fields[0])).unwrap();
        let stored: Vec<f64> =
            bytes.as_chunks::<4>().0.iter().map(|&b| f64::from(f32::from_le_bytes(b))).collect();
        let half = width_px / 2;
        let image = (0..width_px * width_px).map(|i| {
            let (column, row) = (i % width_px, i / width_px);
            // Of symmetric images only the lower right quadrant is stored.
            if stored.len() == width_px * width_px {
                stored[i]
            } else {
                stored[row.abs_diff(half) * (half + 1) + column.abs_diff(half)]
            }
        });
        Case {
            name: fields[0].to_owned(),
            settings,
            z_um: number(2),
            d_um: number(3),
            width_px,
            offset_px: [number(8), number(9)],
            sum: number(13),
            image: image.collect(),
            optics,
        }
    }

    /// Factor from the fraction of the light emitted into the half space to counts.
    fn counts(&self) -> f64 {
        // The image of a point is stored as a fraction.
        if self.d_um == 0.0 {
            return 1.0;
        }
        sphere_points(&self.settings, self.d_um) as f64 * (f64::from(self.settings.n_rays) + 1.0)
    }

    /// Positions of the pixels of the window relative to the particle, px.
    fn places(&self) -> Vec<[f64; 2]> {
        let half = (self.width_px / 2) as f64;
        let [dx, dy] = self.offset_px;
        (0..self.width_px * self.width_px)
            .map(|i| [(i % self.width_px) as f64 - half - dx, (i / self.width_px) as f64 - half - dy])
            .collect()
    }

    /// Allowed difference relative to the peak. A different taper alone changes images of setting 2 by 2e-3.
    /// Fringes at a wavelength of 0.1 um have four cycles per px, too many for the 6 x 6 points per pixel of
    /// the reference: with 20 x 20 points the difference is 3e-3.
    fn allowed(&self) -> f64 {
        match self.settings == Settings::setting2() {
            true => 4e-3,
            false if self.optics.wavelength_um < 0.2 => 6e-3,
            false => 2e-3,
        }
    }

    fn largest_difference(&self, image: &[f64]) -> f64 {
        let peak = self.image.iter().copied().fold(0.0, f64::max);
        let differences = image.iter().zip(&self.image).map(|(a, b)| (a - b).abs());
        differences.fold(0.0, f64::max) / peak
    }
}

#[test]
fn images_are_those_of_an_independent_program() {
    let mut faults = Vec::new();
    for case in Case::all() {
        let renderer = WavesRenderer::new(&case.settings, &case.optics, 1e-3).unwrap();
        let shares = renderer.share_at(case.z_um, case.d_um, &case.places());
        let image: Vec<f64> = shares.iter().map(|share| share * case.counts()).collect();
        let (difference, total) =
            (case.largest_difference(&image), image.iter().sum::<f64>() / case.sum - 1.0);
        println!("{:20} {difference:.1e} of the peak, total {total:+.1e}", case.name);
        // The taper redistributes light within the wide images of setting 2.
        let allowed_total = if case.settings == Settings::setting2() { 1e-3 } else { 1e-4 };
        if difference > case.allowed() || total.abs() > allowed_total {
            faults.push(format!("{}: {difference:.1e} of the peak, total {total:+.1e}", case.name));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn tables_give_the_same_images() {
    let mut faults = Vec::new();
    for case in Case::all() {
        // Tables for a wavelength of 0.1 um are large; a point has no counts.
        if case.d_um == 0.0 || case.optics.wavelength_um < 0.2 {
            continue;
        }
        // In setting 2 the sensor of Table 1 is smaller than the window of the reference.
        let sensor = 2 * case.width_px as u32 + 1;
        let settings = Settings { pixel_dim_x: sensor, pixel_dim_y: sensor, ..case.settings.clone() };
        let renderer = WavesRenderer::new(&settings, &case.optics, 1e-3).unwrap();
        let middle = f64::from(case.width_px as u32 + 1);
        let [dx, dy] = case.offset_px;
        let particle = Particle::sphere(middle + dx, middle + dy, case.z_um, case.d_um);
        let light = renderer.draw(&[particle]);
        let first = (case.width_px + 1 - case.width_px / 2) - 1;
        let image: Vec<f64> = (0..case.width_px * case.width_px)
            .map(|i| light.values[(first + i / case.width_px) * sensor as usize + first + i % case.width_px])
            .collect();
        let difference = case.largest_difference(&image);
        let TablesState { count, bytes, error } = renderer.state();
        println!("{:20} {difference:.1e} of the peak; {count} tables, {bytes} bytes, {error:.1e}", case.name);
        if difference > case.allowed() {
            faults.push(format!("{}: {difference:.1e} of the peak", case.name));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

fn small_sensor(settings: Settings) -> Settings {
    Settings { pixel_dim_x: 120, pixel_dim_y: 110, ..settings }
}

fn some_particles() -> Vec<Particle> {
    (0..30)
        .map(|i| {
            let x = f64::from(i) * 37.7 % 130.0 - 5.0;
            let y = f64::from(i) * 23.3 % 120.0 - 5.0;
            let mut particle = Particle::sphere(x, y, -40.0 + f64::from(i), 1.7 + 0.017 * f64::from(i % 5));
            particle.c_int = 1.0 + 0.1 * f64::from(i % 3);
            particle
        })
        .collect()
}

#[test]
fn bytes_do_not_depend_on_threads_and_instructions() {
    let particles = some_particles();
    for settings in [small_sensor(Settings::setting1()), small_sensor(Settings::setting1a())] {
        let image = |set: InstructionSet, threads: usize| -> Vec<u64> {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let renderer = WavesRenderer::on(set, &settings, &WaveOptics::new(0.52), 1e-2).unwrap();
            let light = pool.install(|| renderer.draw(&particles));
            light.values.iter().map(|v| v.to_bits()).collect()
        };
        let first = image(InstructionSet::best(), 1);
        assert!(first.iter().any(|&bits| f64::from_bits(bits) > 10.0));
        assert!(image(InstructionSet::best(), 7) == first);
        for set in InstructionSet::available() {
            assert!(image(set, 2) == first, "{set}");
        }
    }
}

#[test]
fn images_have_the_symmetries_of_the_optics() {
    for (settings, round) in [(Settings::setting1(), true), (Settings::setting1a(), false)] {
        let renderer = WavesRenderer::new(&settings, &WaveOptics::new(0.52), 1e-3).unwrap();
        let places = [[3.2, 5.9], [-3.2, 5.9], [3.2, -5.9], [-3.2, -5.9], [5.9, 3.2]];
        let share = renderer.share_at(-20.0, 2.0, &places);
        for mirrored in &share[1..4] {
            assert!((mirrored - share[0]).abs() < 1e-12 * share[0]);
        }
        assert_eq!((share[4] - share[0]).abs() < 1e-6 * share[0], round);
        // Under other rotations only the square shape of the pixels breaks the symmetry: compare light summed
        // over rings.
        let light = renderer.draw(&[Particle::sphere(100.5, 90.0, -20.0, 2.0)]);
        let twice = renderer.draw(&[Particle { c_int: 2.0, ..Particle::sphere(100.5, 90.0, -20.0, 2.0) }]);
        let peak = light.values.iter().copied().fold(0.0, f64::max);
        assert!(light.values.iter().zip(&twice.values).all(|(a, b)| (2.0 * a - b).abs() < 1e-6 * peak));
    }
}

#[test]
fn counts_are_those_of_expected_images() {
    let settings = Settings::setting1();
    let waves = WavesRenderer::new(&settings, &WaveOptics::new(0.52), 1e-3).unwrap();
    let expected = ExpectedRenderer::new(&settings, SpheroidLaw::Original, 1e-3).unwrap();
    for z_um in [-60.0, -12.0, 20.0] {
        let particle = Particle::sphere(300.0, 180.0, z_um, 2.0);
        let ray_sum: f64 = expected.patch(&particle).unwrap().counts.iter().sum();
        let accepted = waves.accepted_light(&particle).unwrap();
        assert!((accepted / ray_sum - 1.0).abs() < 2e-3, "z = {z_um}: {accepted} and {ray_sum}");
        // Tails below a quarter of the tolerance are not drawn.
        let drawn: f64 = waves.patch(&particle).unwrap().counts.iter().sum();
        let outside = 1.0 - drawn / accepted;
        assert!((0.0..0.03).contains(&outside), "z = {z_um}: {outside} outside");
    }
}

/// Far from the focal plane of x but near the one of y, phases change along x within a row of the pupil, and
/// from row to row.
#[test]
fn tables_are_accurate_where_a_cylinder_defocuses_one_axis_only() {
    let renderer = WavesRenderer::new(&Settings::setting1a(), &WaveOptics::new(0.52), 1e-3).unwrap();
    let particle = Particle::sphere(300.0, 180.0, 24.0, 2.0);
    let patch = renderer.patch(&particle).unwrap();
    let error = renderer.state().error;
    assert!(error < 1e-3, "{error}");
    // Otherwise errors of the quadrature would seem to be light far away.
    assert!(patch.window.height < 240, "{:?}", patch.window);
    let drawn: f64 = patch.counts.iter().sum();
    let outside = 1.0 - drawn / renderer.accepted_light(&particle).unwrap();
    assert!((0.0..0.03).contains(&outside), "{outside} outside");
}

#[test]
fn derivatives_are_those_of_the_image() {
    let renderer = WavesRenderer::new(&Settings::setting1a(), &WaveOptics::new(0.52), 1e-3).unwrap();
    let particle = Particle::sphere(100.3, 80.7, -23.4, 2.0);
    let gradient = renderer.gradient(&particle, None).unwrap();
    let values = renderer.patch(&particle).unwrap();
    assert_eq!(gradient.window, values.window);
    let peak = values.counts.iter().copied().fold(0.0, f64::max);
    for (pixel, count) in gradient.pixels.iter().zip(&values.counts) {
        assert!((pixel[0] - count).abs() < 2e-6 * peak);
    }
    let step = 1e-3;
    for axis in 0..3 {
        let at = |by: f64| {
            let mut moved = particle;
            match axis {
                0 => moved.x_px += by,
                1 => moved.y_px += by,
                _ => moved.z_um += by,
            }
            renderer.gradient(&moved, None).unwrap()
        };
        let (low, high) = (at(-step), at(step));
        // The window may shift by a pixel: compare where all three overlap.
        assert_eq!((low.window, high.window), (gradient.window, gradient.window));
        for ((low, high), pixel) in low.pixels.iter().zip(&high.pixels).zip(&gradient.pixels) {
            let difference = (high[0] - low[0]) / (2.0 * step);
            assert!((difference - pixel[axis + 1]).abs() < 1e-4 * peak, "axis {axis}");
        }
    }
}

/// A 20x / 0.45 objective without aberrations, on pixels that resolve the Airy pattern.
#[test]
fn an_aplanatic_lens_gives_the_airy_pattern() {
    let settings = Settings {
        magnification: 20.0,
        numerical_aperture: 0.45,
        pixel_size: 1.0,
        pixel_dim_x: 200,
        pixel_dim_y: 200,
        ..Settings::setting1()
    };
    let optics = WaveOptics { lens: Lens::Aplanatic, ..WaveOptics::new(0.52) };
    let renderer = WavesRenderer::new(&settings, &optics, 1e-3).unwrap();
    let radius = renderer.airy_radius_px();
    assert!((radius - 0.61 * 0.52 * 20.0 / 0.45).abs() < 1e-9);
    let places: Vec<[f64; 2]> =
        (0..101 * 101).map(|i| [f64::from(i % 101) - 50.0, f64::from(i / 101) - 50.0]).collect();
    let shares = renderer.share_at(0.0, 0.0, &places);
    let accepted = 0.5 * 2.0 * (1.0 - libm::sqrt(1.0 - 0.45 * 0.45));
    let within = |r: f64| -> f64 {
        let inside = places.iter().zip(&shares).filter(|([x, y], _)| x * x + y * y < r * r);
        inside.map(|(_, share)| share).sum::<f64>() / accepted
    };
    // 83.8 % for a uniform amplitude; an aplanatic lens's is slightly higher at the rim.
    let encircled = within(radius);
    assert!((encircled - 0.838).abs() < 0.01, "{encircled}");
    // The first dark ring.
    let line: Vec<[f64; 2]> = (0..400).map(|i| [0.6 * radius + 0.002 * radius * f64::from(i), 0.0]).collect();
    let along = renderer.share_at(0.0, 0.0, &line);
    let darkest = (1..399).min_by(|&i, &j| along[i].total_cmp(&along[j])).unwrap();
    let found = line[darkest][0] / radius;
    // The amplitude at the rim exceeds a uniform one by (1 - NA^2)^(-1/4), 6 %, so the pattern is slightly
    // narrower.
    assert!((found - 0.995).abs() < 0.003, "first zero at {found} Airy radii");

    // A 63x / 0.75 objective has an Airy radius of 4 px, MicroSIG's lens one of 10 px.
    let settings = Settings::setting2();
    let renderer = WavesRenderer::new(&settings, &optics, 1e-3).unwrap();
    assert!((renderer.airy_radius_px() - 4.13).abs() < 0.01);
    let line: Vec<[f64; 2]> = (0..400).map(|i| [2.5 + 0.01 * f64::from(i), 0.0]).collect();
    let along = renderer.share_at(0.0, 0.0, &line);
    let darkest = (1..399).min_by(|&i, &j| along[i].total_cmp(&along[j])).unwrap();
    assert!((line[darkest][0] - 4.13).abs() < 0.15, "first dark ring at {} px", line[darkest][0]);
}

#[test]
fn values_out_of_range_are_named() {
    let refused = |settings: &Settings, optics: &WaveOptics| {
        WavesRenderer::new(settings, optics, 1e-3).unwrap_err().to_string()
    };
    let settings = Settings::setting1();
    let message = refused(&settings, &WaveOptics::new(2.5));
    assert!(message.contains("render.wavelength_um = 2.5: expected 0.1 to 2 um"), "{message}");
    let message = refused(&settings, &WaveOptics { bandwidth_um: 0.2, ..WaveOptics::new(0.5) });
    assert!(message.contains("render.bandwidth_um = 0.2: expected 0 to 0.1500 um"), "{message}");
    let message = refused(&settings, &WaveOptics { cyl_angle_deg: 20.0, ..WaveOptics::new(0.5) });
    assert!(message.contains("optics.cyl_angle_deg = 20"), "{message}");
    let mut twice = WaveOptics::new(0.5);
    twice.pupil.zernike = vec![(6, 0.1), (11, 0.1), (6, 0.1)];
    let message = refused(&settings, &twice);
    assert!(message.contains("optics.pupil.zernike.2.0 = 6: expected each Noll index once"), "{message}");
    let message = WavesRenderer::new(&settings, &WaveOptics::new(0.5), 0.5).unwrap_err().to_string();
    assert!(message.contains("tolerance = 0.5: expected 0.0001 to 0.1"), "{message}");
}

/// Small aberrations reduce the peak of a focused point by the Strehl ratio exp(-(2 pi rms)^2) (Marechal,
/// Mahajan).
#[test]
fn aberrations_dim_by_the_strehl_ratio() {
    let settings = Settings { numerical_aperture: 0.2, pixel_size: 0.5, ..Settings::setting1() };
    let middle = |zernike: Vec<(u32, f64)>| {
        let mut optics = WaveOptics { lens: Lens::Aplanatic, ..WaveOptics::new(0.52) };
        optics.pupil.zernike = zernike;
        let renderer = WavesRenderer::new(&settings, &optics, 1e-3).unwrap();
        renderer.share_at(0.0, 0.0, &[[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]])[0]
    };
    let bright = middle(Vec::new());
    for (zernike, rms) in [
        (vec![(11, 0.02)], 0.02),
        (vec![(11, 0.05)], 0.05),
        (vec![(6, 0.04), (8, 0.03)], 0.05),
        (vec![(5, -0.07)], 0.07),
    ] {
        let found = middle(zernike.clone()) / bright;
        let phase = 2.0 * std::f64::consts::PI * rms;
        // The next term of the series is (2 pi rms)^4 / 2 times a factor that depends on the shape of the
        // aberration.
        let allowed = 0.3 * phase * phase * phase * phase + 5e-4;
        assert!((found - libm::exp(-phase * phase)).abs() < allowed, "{zernike:?}: {found}");
    }
}

/// A tilt of c waves rms shifts the image by 2 c lambda b / sigma_a, toward +x for Z2 and toward +y for Z3.
#[test]
fn tilts_move_the_image() {
    let settings = Settings::setting1();
    let plain = WavesRenderer::new(&settings, &WaveOptics::new(0.52), 1e-3).unwrap();
    let mut optics = WaveOptics::new(0.52);
    optics.pupil.zernike = vec![(2, 0.5), (3, -0.25)];
    let tilted = WavesRenderer::new(&settings, &optics, 1e-3).unwrap();
    let (f, m) = (settings.focal_length, settings.magnification);
    let sigma = settings.numerical_aperture * f * (1.0 + 1.0 / m);
    let px = 2.0 * 0.52 * f * (m + 1.0) / sigma / settings.pixel_size;
    let (dx, dy) = (0.5 * px, -0.25 * px);
    let places = [[0.0, 0.0], [1.3, 0.4], [-3.0, 2.0], [0.0, -5.0]];
    let moved = places.map(|[x, y]| [x + dx, y + dy]);
    let (here, there) = (plain.share_at(-12.0, 1.0, &places), tilted.share_at(-12.0, 1.0, &moved));
    for (a, b) in here.iter().zip(&there) {
        assert!((a - b).abs() < 1e-3 * here[0], "{a} and {b}");
    }
}

/// A cylinder rotated by 90 degrees gives the image of an unrotated one with x and y exchanged; rotated by 30
/// degrees, the principal axes of the second moments of its image are rotated too.
#[test]
fn a_turned_cylinder_turns_the_image() {
    let settings = Settings { numerical_aperture: 0.15, ..Settings::setting1a() };
    let at = |angle: f64, places: &[[f64; 2]]| {
        let optics = WaveOptics { cyl_angle_deg: angle, ..WaveOptics::new(0.52) };
        WavesRenderer::new(&settings, &optics, 1e-3).unwrap().share_at(-40.0, 2.0, places)
    };
    let places = [[0.0, 0.0], [4.0, 1.0], [-2.5, 3.0], [0.5, -6.0]];
    let straight = at(0.0, &places);
    let exchanged = at(90.0, &places.map(|[x, y]| [-y, x]));
    for (a, b) in straight.iter().zip(&exchanged) {
        assert!((a - b).abs() < 1e-3 * straight[0], "{a} and {b}");
    }
    let window: Vec<[f64; 2]> =
        (0..41 * 41).map(|i| [f64::from(i % 41) - 20.0, f64::from(i / 41) - 20.0]).collect();
    let moments = |shares: &[f64]| {
        let sum: f64 = shares.iter().sum();
        let moment =
            |f: fn([f64; 2]) -> f64| window.iter().zip(shares).map(|(&p, s)| f(p) * s).sum::<f64>() / sum;
        [moment(|[x, _]| x * x), moment(|[_, y]| y * y), moment(|[x, y]| x * y)]
    };
    let ([xx, yy, _], [_, _, turned_xy]) = (moments(&at(0.0, &window)), moments(&at(30.0, &window)));
    let expected = (xx - yy) * 0.5 * libm::sin(std::f64::consts::FRAC_PI_3);
    assert!((turned_xy / expected - 1.0).abs() < 0.05, "{turned_xy}, not {expected}");
}

/// Coma moves the rims of defocused images, but not images in focus: at the center of the field, where there is
/// none, they are those without coma.
#[test]
fn coma_over_the_field_leaves_images_in_focus_as_they_are() {
    let settings = Settings {
        magnification: 10.0,
        numerical_aperture: 0.3,
        pixel_size: 6.5,
        pixel_dim_x: 1280,
        pixel_dim_y: 1280,
        points_per_pixel: 100.0,
        ..Settings::setting1()
    };
    let coma = FieldComa { per_mm: 0.3, ..FieldComa::default() };
    let draw = |field: FieldOptics, tolerance: f64| {
        let optics = WaveOptics { lens: Lens::Aplanatic, field, ..WaveOptics::new(0.52) };
        let renderer = WavesRenderer::new(&settings, &optics, tolerance).unwrap();
        let patch = renderer.patch(&Particle::sphere(640.5, 640.5, 0.0, 0.1)).unwrap();
        let shortfall = renderer.shortfall();
        (patch.on(Window { x0: 625, y0: 625, width: 32, height: 32 }), shortfall)
    };
    let (plain, _) = draw(FieldOptics::default(), 1e-3);
    let (seen, shortfall) = draw(FieldOptics { coma, ..FieldOptics::default() }, 3e-3);
    assert_eq!(shortfall.unwrap(), None);
    let peak = plain.iter().copied().fold(0.0, f64::max);
    let largest = plain.iter().zip(&seen).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!("{}", largest / peak);
    assert!(largest < 4e-3 * peak, "{}", largest / peak);
}

/// MicroSIG's lens is 437.5 um in front of the focal plane of a 4x, and its spheres have points that shine; a
/// corrected objective has neither.
#[test]
fn a_corrected_objective_sees_beyond_the_lens_of_microsig_and_the_smallest_spheres() {
    let settings = Settings {
        magnification: 4.0,
        numerical_aperture: 0.1,
        pixel_size: 6.5,
        points_per_pixel: 10.0,
        ..Settings::setting1()
    };
    let optics = WaveOptics { lens: Lens::Aplanatic, ..WaveOptics::new(0.52) };
    let corrected = WavesRenderer::new(&settings, &optics, 0.01).unwrap();
    let total = |z_um: f64, d_um: f64| {
        let particle = Particle::sphere(100.0, 100.0, z_um, d_um);
        corrected.check(&particle).unwrap();
        corrected.patch(&particle).unwrap().counts.iter().sum::<f64>()
    };
    // The light does not depend on depth, up to faint tails.
    let light = [-600.0, 600.0].map(|z_um| total(z_um, 2.0));
    assert!((light[0] / light[1] - 1.0).abs() < 0.03, "{light:?}");
    // It is proportional to the surface below one point as above.
    assert_eq!(sphere_points(&settings, 0.1), 0);
    let (small, large) = (total(0.0, 0.1), total(0.0, 1.0));
    let points = f64::from(sphere_points(&settings, 1.0) as u32);
    assert!((large / small / 100.0 - 1.0).abs() < 0.5 / points + 0.02, "{small} {large}");
    // A defocused image reaches the sensor from beside it: its radius is 37 px.
    let beside = |x_px: f64| corrected.reaches_sensor(&Particle::sphere(x_px, 100.0, 600.0, 0.1));
    assert!(beside(-35.0) && !beside(-50.0));
    let rays = WavesRenderer::new(&settings, &WaveOptics::new(0.52), 0.01).unwrap();
    let message = rays.check(&Particle::sphere(100.0, 100.0, -600.0, 2.0)).unwrap_err().to_string();
    assert!(message.contains("reaches the lens, which is at z = -437.5 um"), "{message}");
}
