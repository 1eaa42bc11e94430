//! Tracers with additional physics: diffusion, settling, rotation, bodies and periodic faces.
#![expect(clippy::print_stdout, reason = "the measured numbers, for `--nocapture`")]

use flows::fields::{
    HeleShaw, HeleShawParams, LambOseen, LambOseenParams, Linear, Poiseuille, PoiseuilleParams, Source,
    SourceParams, SourceShape,
};
use flows::{
    Axis, Body, Boundary, Diameters, Domain, FluidRegion, Frame, Intensities, Orientation, Region, Scene,
    Seeding, Settling, SpheroidFriction, Spheroids, VelocityField,
};
use glam::DVec3;
use std::f64::consts::PI;

use crate::{LIMIT, brownian, chi_square, frames, times, water};

use Boundary::{Open, Periodic, Wall};

const DT_S: f64 = 0.01;

fn domain(boundaries: [Boundary; 3]) -> Domain {
    let region = Region::new(DVec3::new(-150.0, -100.0, -80.0), DVec3::new(150.0, 100.0, 20.0)).unwrap();
    Domain::new(region, boundaries)
}

/// 6000 particles of 1 um.
fn seeding() -> Seeding {
    Seeding::poisson(1e-3, Diameters::equal(1.0).unwrap()).unwrap()
}

fn rest() -> Linear {
    Linear::uniform(DVec3::ZERO).unwrap()
}

fn assert_uniform(what: &str, frame: &Frame, domain: &Domain, expected: f64) {
    let room = domain.room(0.5).unwrap();
    for axis in 0..3 {
        let chi = chi_square(frame.tracers.iter().map(|t| t.position), &room, axis, expected);
        println!("{what}, axis {axis}: {} tracers, chi-square {chi:.1}", frame.tracers.len());
        assert!(chi < LIMIT, "{what}, axis {axis}: {chi}");
    }
}

#[test]
fn tracers_at_rest_diffuse_by_2dt_on_every_axis() {
    let (domain, seeding, field) = (domain([Periodic; 3]), seeding(), rest());
    let scene = Scene::new(&field, &domain, &seeding).unwrap().with_brownian(water(1)).keeping_ids();
    let frames = frames(&scene, &times(6, DT_S), 1);
    let count = frames[0].tracers.len();
    assert!(frames.iter().all(|frame| frame.tracers.len() == count));
    let expected = 2.0 * water(1).diffusion(1.0) * DT_S;
    for frame in &frames[1..] {
        for axis in 0..3 {
            let squares = frame.tracers.iter().map(|tracer| {
                let step = tracer.step.unwrap();
                assert_eq!(step.drift, DVec3::ZERO);
                step.actual[axis] * step.actual[axis]
            });
            let ratio = squares.sum::<f64>() / count as f64 / expected;
            // The variance of the square of a standard normal number is 2.
            assert!((ratio - 1.0).abs() < 4.0 * (2.0 / count as f64).sqrt(), "axis {axis}: {ratio}");
        }
    }
    // Steps are independent of one another.
    let along = frames[1].links(&frames[2]).map(|(a, b)| a.step.unwrap().actual.dot(b.step.unwrap().actual));
    let correlation = along.sum::<f64>() / count as f64 / (3.0 * expected);
    assert!(correlation.abs() < 4.0 / (3.0 * count as f64).sqrt(), "{correlation}");
}

/// 2 um silica in water at 10 Hz: between two frames a sphere settles by 2.5 times its gravitational length of
/// 0.1 um, and diffuses by twice that length.
#[test]
fn settled_spheres_have_boltzmanns_profile_whatever_the_frame_rate() {
    let region = Region::new(DVec3::new(-20.0, -20.0, 0.0), DVec3::new(20.0, 20.0, 2.5)).unwrap();
    let domain = Domain::new(region, [Periodic, Periodic, Wall]);
    let seeding = Seeding::poisson(0.5, Diameters::equal(2.0).unwrap()).unwrap();
    let field = rest();
    let settling = Settling { density_difference_kg_m3: 1000.0, ..Default::default() };
    let speed = settling.velocity(2.0, &SpheroidFriction::SPHERE, DVec3::Z).length();
    let length = water(2).diffusion(2.0) / speed;
    assert!((length - 0.1).abs() < 0.001, "{length}");
    let scene = Scene::new(&field, &domain, &seeding)
        .unwrap()
        .with_brownian(water(2))
        .with_settling(settling)
        .keeping_ids();
    for (what, scene) in [("free", scene), ("hindered", scene.with_slowing_walls())] {
        // Far from walls they settle by five lengths in 0.2 s; next to the wall, a tenth as fast.
        let times = times(if what == "free" { 8 } else { 26 }, 0.1);
        let last = frames(&scene, &times, 6).pop().unwrap();
        let n = last.tracers.len() as f64;
        let mut counts = [0.0; 20];
        for tracer in &last.tracers {
            // Share of the profile below the sphere.
            let below = |gap: f64| 1.0 - libm::exp(-gap / length);
            let share = below(tracer.position.z - 1.0) / below(0.5);
            counts[((share * 20.0) as usize).min(19)] += 1.0;
        }
        let chi: f64 = counts.iter().map(|c| (c - n / 20.0) * (c - n / 20.0) / (n / 20.0)).sum();
        println!("{what}: {n} spheres, chi-square {chi:.1}, {counts:?}");
        assert!(n > 1000.0 && chi < LIMIT, "{what}: {chi}");
    }
}

#[test]
fn shear_and_diffusion_act_together() {
    // g t = 10 in 20 steps: var x = 2 D t (1 + (g t)^2 (1/3 - 1/(12 n^2))); 40000 tracers in a box so large
    // that none reaches a face.
    let (rate, time) = (1.0, 10.0);
    let field = Linear::shear(rate, Axis::X, Axis::Z, DVec3::ZERO).unwrap();
    let region = Region::new(DVec3::splat(-1e4), DVec3::splat(1e4)).unwrap();
    let domain = Domain::new(region, [Open; 3]);
    let seeding = Seeding::list(vec![DVec3::ZERO; 40_000], Diameters::equal(1.0).unwrap()).unwrap();
    let scene = Scene::new(&field, &domain, &seeding).unwrap().with_brownian(water(20));
    let last = &frames(&scene, &[0.0, time], 2)[1];
    let mean = |f: &dyn Fn(DVec3) -> f64| last.tracers.iter().map(|t| f(t.position)).sum::<f64>() / 40_000.0;
    let unit = 2.0 * water(1).diffusion(1.0) * time;
    let (gt, third) = (rate * time, 1.0 / 3.0 - 1.0 / (12.0 * 400.0));
    for (what, found, expected) in [
        ("xx", mean(&|x| x.x * x.x), 1.0 + gt * gt * third),
        ("xz", mean(&|x| x.x * x.z), 0.5 * gt),
        ("yy", mean(&|x| x.y * x.y), 1.0),
        ("zz", mean(&|x| x.z * x.z), 1.0),
    ] {
        println!("<{what}> / 2Dt = {} of {expected}", found / unit);
        // Standard error of a variance: sqrt(2 / 40000) = 0.7 %; the seed is fixed.
        assert!((found / unit / expected - 1.0).abs() < 0.02, "{what}: {}", found / unit);
    }
}

#[test]
fn diffusing_clouds_stay_uniform_between_walls_and_at_open_faces() {
    let seeding = seeding();
    // Strong diffusion of 7 um per frame, so that many tracers reach faces and walls.
    let hot = brownian(1e-5 * 0.89e-3, 2);
    let still = rest();
    let channel =
        Poiseuille::from_params(&PoiseuilleParams { max_speed_um_s: Some(1500.0), ..Default::default() })
            .unwrap();
    let cases: [(&str, &dyn VelocityField, [Boundary; 3]); 4] = [
        ("at rest, open", &still, [Open; 3]),
        ("at rest, walls", &still, [Wall; 3]),
        ("channel", &channel, [Open, Open, Wall]),
        ("periodic channel", &channel, [Periodic, Open, Wall]),
    ];
    for (what, field, boundaries) in cases {
        let domain = domain(boundaries);
        let scene = Scene::new(field, &domain, &seeding).unwrap().with_brownian(hot);
        let frames = frames(&scene, &times(16, DT_S), 3);
        let expected = if boundaries == [Wall; 3] { frames[0].tracers.len() as f64 } else { 6000.0 };
        assert_uniform(what, &frames[15], &domain, expected);
        let survivors = frames[0].links(&frames[15]).count();
        assert!(
            survivors < frames[0].tracers.len() * 9 / 10 || boundaries == [Wall; 3],
            "{what}: {survivors}"
        );
    }
}

#[test]
fn settling_adds_its_velocity_and_keeps_the_cloud_uniform() {
    let (domain, field) = (domain([Open; 3]), rest());
    let seeding = Seeding::poisson(1e-3, Diameters::uniform(1.0, 3.0).unwrap()).unwrap();
    // Iron: particles of 2 um settle at 16 um/s.
    let settling = Settling { density_difference_kg_m3: 6800.0, ..Default::default() };
    let scene = Scene::new(&field, &domain, &seeding).unwrap().with_settling(settling);
    let frames = frames(&scene, &times(11, 0.2), 4);
    for (now, next) in frames[0].links(&frames[1]) {
        let expected = settling.velocity(now.d_um, &SpheroidFriction::SPHERE, DVec3::X) * 0.2;
        assert!((next.position - now.position - expected).length() < 1e-11);
        assert!((next.step.unwrap().drift - expected).length() < 1e-11);
    }
    assert_uniform("settling", &frames[10], &domain, 6000.0);
}

/// Rods diffuse faster along their initial direction than across it until they have turned (Han et al.,
/// Science 314 (2006) 626, in three dimensions): <dx^2> = 2 D t + (4/3) dD (1 - e^(-6 Dr t)) / (6 Dr), <dy^2>
/// with -2/3, and the mean axis e^(-2 Dr t).
#[test]
fn rods_diffuse_as_perrin_says() {
    let domain = domain([Wall; 3]);
    let seeding = Seeding::poisson(5e-3, Diameters::equal(1.0).unwrap()).unwrap();
    let (field, hot, time) = (rest(), brownian(1e-2 * 0.89e-3, 2), 0.005);
    let spheroids = Spheroids { e_p: 3.0, orientation: Orientation::Aligned((1.0, 0.0, 0.0)) };
    let scene = Scene::new(&field, &domain, &seeding).unwrap().with_spheroids(spheroids).with_brownian(hot);
    let frames = frames(&scene, &times(2, time), 12);
    let (mut axis, mut squares, mut number) = (0.0, DVec3::ZERO, 0.0);
    // Away from walls, where reflection shortens displacements.
    for (first, last) in frames[0].links(&frames[1]).filter(|(first, _)| first.position.z.abs() < 15.0) {
        axis += last.axis.x;
        squares += (last.position - first.position) * (last.position - first.position);
        number += 1.0;
    }
    // Friction relative to the sphere: 1.4045 along, 1.7276 across, 7.0222 for tumbling (Perrin 1936).
    let (along, across) = (hot.diffusion(1.0) / 1.4045, hot.diffusion(1.0) / 1.7276);
    let (turning, mean) = (hot.rotational_diffusion(1.0) / 7.0222, (along + 2.0 * across) / 3.0);
    let memory = (along - across) * (1.0 - libm::exp(-6.0 * turning * time)) / (6.0 * turning);
    let expected = [4.0 / 3.0, -2.0 / 3.0, -2.0 / 3.0].map(|share| 2.0 * mean * time + share * memory);
    println!("{number} rods: {} of {expected:?}, axis {}", squares / number, axis / number);
    for i in 0..3 {
        // 4.5 standard errors of a variance of n normal numbers, sqrt(2 / n) each.
        assert!((squares[i] / number / expected[i] - 1.0).abs() < 4.5 * (2.0_f64 / number).sqrt(), "{i}");
    }
    // The error of two steps is (D_r h)^2.
    assert!((axis / number - libm::exp(-2.0 * turning * time)).abs() < 0.01, "{}", axis / number);
}

#[test]
fn bodies_stay_free_and_the_rest_uniform() {
    let domain = domain([Open, Open, Wall]);
    let field = HeleShaw::new(&HeleShawParams { mean_speed_um_s: 1000.0, ..Default::default() }).unwrap();
    let bodies = [Body::Cylinder { center_um: (0.0, 0.0), radius_um: 60.0 }];
    let fluid = FluidRegion::new(&field, &domain, &bodies);
    for brownian in [None, Some(water(1))] {
        let seeding = seeding();
        let mut scene = Scene::in_fluid(fluid, &seeding).unwrap();
        if let Some(brownian) = brownian {
            scene = scene.with_brownian(brownian);
        }
        let frames = frames(&scene, &times(31, DT_S), 6);
        for frame in [&frames[0], &frames[30]] {
            let nearest =
                frame.tracers.iter().map(|t| t.position.truncate().length()).fold(f64::INFINITY, f64::min);
            assert!(nearest >= 60.5 - 1e-9, "{nearest}");
            // The density outside the body, in each quadrant.
            let free = 6e6 - PI * 60.5 * 60.5 * 100.0;
            for (sx, sy) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                let inside = |x: DVec3| x.x * sx > 0.0 && x.y * sy > 0.0;
                let count = frame.tracers.iter().filter(|tracer| inside(tracer.position)).count() as f64;
                let expected = free / 4.0 * 1e-3;
                assert!((count - expected).abs() < 4.0 * expected.sqrt(), "{count} of {expected}");
            }
        }
    }
    // A count in view is the number of particles in the view, outside the bodies.
    let view = Region::new(DVec3::new(-70.0, -70.0, -80.0), DVec3::new(70.0, 70.0, 20.0)).unwrap();
    let seeding = Seeding::count_in_view(300, view, Diameters::equal(1.0).unwrap());
    let scene = Scene::in_fluid(fluid, &seeding).unwrap();
    let first = &frames(&scene, &[0.0], 7)[0];
    assert_eq!(first.tracers.iter().filter(|tracer| view.contains(tracer.position)).count(), 300);
}

#[test]
fn a_drain_takes_what_falls_into_it() {
    let (domain, seeding) = (domain([Open, Open, Wall]), seeding());
    let params = SourceParams { shape: SourceShape::Point, core_speed_um_s: -900.0, ..Default::default() };
    let field = Source::new(&params).unwrap();
    let bodies = [Body::Drain { center_um: (0.0, 0.0, -30.0), radius_um: 20.0 }];
    let scene = Scene::in_fluid(FluidRegion::new(&field, &domain, &bodies), &seeding).unwrap();
    let frames = frames(&scene, &times(11, DT_S), 8);
    for frame in &frames {
        assert!(frame.tracers.iter().all(|t| t.position.distance(DVec3::Z * -30.0) >= 20.0));
    }
    // 4 pi (20 um)^2 * 900 um/s * 0.1 s at 1e-3 per um^3 are drained, from radii up to 48.8 um.
    let gone = frames[0].tracers.len() - frames[0].links(&frames[10]).count();
    assert!((gone as f64 - 452.4).abs() < 4.0 * 21.3, "{gone}");
}

#[test]
fn periodic_faces_give_new_names_or_keep_them() {
    let (domain, seeding) = (domain([Periodic, Periodic, Wall]), seeding());
    let field =
        Poiseuille::from_params(&PoiseuilleParams { direction_rad: 0.4, ..Default::default() }).unwrap();
    let scene = Scene::new(&field, &domain, &seeding).unwrap();
    let renamed = frames(&scene, &times(11, DT_S), 9);
    let kept = frames(&scene.keeping_ids(), &times(11, DT_S), 9);
    for (a, b) in renamed.iter().zip(&kept) {
        // The same cloud with different ids.
        let sorted = |frame: &Frame| {
            let mut places: Vec<[u64; 3]> =
                frame.tracers.iter().map(|t| t.position.to_array().map(f64::to_bits)).collect();
            places.sort_unstable();
            places
        };
        assert_eq!(sorted(a), sorted(b));
        assert!(b.tracers.iter().map(|t| t.id).eq(kept[0].tracers.iter().map(|t| t.id)));
        assert!(a.tracers.is_sorted_by(|x, y| x.id < y.id));
    }
    let mut jumps = 0;
    for (now, next) in kept[9].links(&kept[10]) {
        let step = next.step.unwrap();
        assert!((step.actual - field.velocity(now.position, 0.0) * DT_S).length() < 1e-11);
        jumps += usize::from((next.position - now.position - step.actual).length() > 1.0);
    }
    assert!(jumps > 100);
    for (now, next) in renamed[9].links(&renamed[10]) {
        assert!((next.position - now.position).length() < 13.0);
    }
    assert!(renamed[10].tracers.iter().filter(|tracer| tracer.step.is_none()).count() == jumps);
}

#[test]
fn with_everything_on_threads_and_run_length_change_nothing() {
    let domain = domain([Open, Periodic, Wall]);
    let sizes = Diameters::lognormal(1.5, 0.5, 0.5, 4.0).unwrap();
    let seeding = Seeding::poisson(2e-4, sizes).unwrap().apart(0.5).unwrap();
    let field =
        LambOseen::from_params(&LambOseenParams { viscosity_um2_s: 1e3, ..Default::default() }).unwrap();
    let bodies = [Body::Sphere { center_um: (60.0, 0.0, -30.0), radius_um: 20.0 }];
    let orientation = Orientation::VonMisesFisher { mean: (1.0, 0.0, 0.0), kappa: 5.0 };
    let scene = Scene::in_fluid(FluidRegion::new(&field, &domain, &bodies), &seeding)
        .unwrap()
        .with_brownian(water(2))
        .with_settling(Settling { density_difference_kg_m3: 50.0, ..Default::default() })
        .with_spheroids(Spheroids { e_p: 3.0, orientation })
        .with_intensities(Intensities::Normal { mean: 1.0, sd: 0.2 });
    let with = |threads: usize, count: u32| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| frames(&scene, &times(count, DT_S), 10))
    };
    let one = with(1, 4);
    assert_eq!(with(7, 4), one);
    assert_eq!(with(2, 3), one[..3]);
    // A tracer keeps its properties.
    for (a, b) in one[0].links(&one[3]) {
        assert_eq!((a.d_um, a.c_int, a.aspect), (b.d_um, b.c_int, b.aspect));
        assert_ne!(a.axis, b.axis);
    }
    let spread = one[0].tracers.iter().map(|tracer| tracer.c_int).fold(0.0, f64::max);
    assert!(spread > 1.2);
}
