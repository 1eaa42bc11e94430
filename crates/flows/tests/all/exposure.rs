//! Finite exposure: streaks of particles that move while the shutter is open.

use flows::fields::{LambOseen, Linear};
use flows::{
    Boundary, Brownian, Diameters, Domain, Frame, Orientation, Region, Scene, Seeding, Shutter, Spheroids,
    VelocityField,
};
use glam::{DVec2, DVec3};

use crate::{brownian, frames, times};

const PIECE_UM: f64 = 0.25 * 0.645;

fn domain() -> Domain {
    let region = Region::new(DVec3::new(-100.0, -100.0, -80.0), DVec3::new(100.0, 100.0, 20.0)).unwrap();
    Domain::new(region, [Boundary::Open, Boundary::Open, Boundary::Wall])
}

fn record(field: &dyn VelocityField, shutter: Shutter, count: u32, adorn: fn(Scene) -> Scene) -> Vec<Frame> {
    let (domain, seeding) = (domain(), Seeding::poisson(2e-5, Diameters::equal(2.0).unwrap()).unwrap());
    let scene = adorn(Scene::new(field, &domain, &seeding).unwrap().with_shutter(shutter));
    frames(&scene, &times(count, 0.01), 3)
}

fn centroid(frame: &Frame, i: usize) -> DVec3 {
    let points = &frame.streaks[i].points;
    points.iter().map(|point| point.position).sum::<DVec3>() / points.len() as f64
}

#[test]
fn a_streak_has_its_middle_at_the_particle_and_a_point_every_quarter_pixel() {
    let velocity = DVec3::new(300.0, 400.0, 50.0);
    let field = Linear::uniform(velocity).unwrap();
    let frames = record(&field, Shutter::new(0.004, 1, 0.0, PIECE_UM).unwrap(), 2, |scene| scene);
    for (i, tracer) in
        frames[1].tracers.iter().enumerate().filter(|(_, t)| (-78.0..18.0).contains(&t.position.z))
    {
        let streak = &frames[1].streaks[i];
        // 500 um/s over 4 ms is 2 um, 12.4 times a quarter of 0.645 um; motion along z does not count.
        assert_eq!(streak.points.len(), 13);
        assert!((streak.share - 1.0 / 13.0).abs() < 1e-16);
        assert!((centroid(&frames[1], i) - tracer.position).length() < 1e-12);
        assert!((tracer.velocity.unwrap() - velocity).length() < 1e-9);
        let step = (streak.points[5].position - streak.points[4].position).truncate().length();
        assert!((step - 2.0 / 13.0).abs() < 1e-12 && step <= PIECE_UM);
    }
    let fast = record(&field, Shutter::new(0.01, 1, 0.0, 0.01).unwrap(), 1, |scene| scene);
    assert!(fast[0].streaks.iter().all(|streak| streak.points.len() == 64), "never more than 64");
    let still = Linear::uniform(DVec3::ZERO).unwrap();
    let frames = record(&still, Shutter::new(0.004, 1, 0.0, PIECE_UM).unwrap(), 1, |scene| scene);
    assert!(frames[0].streaks.iter().all(|streak| streak.points.len() == 1));
}

#[test]
fn a_streak_follows_a_curved_path() {
    let field = LambOseen::from_max_speed(DVec2::ZERO, 3000.0, 40.0, 0.0).unwrap();
    let frames = record(&field, Shutter::new(0.008, 1, 0.0, PIECE_UM).unwrap(), 1, |scene| scene);
    for (tracer, streak) in frames[0].tracers.iter().zip(&frames[0].streaks) {
        let radius = tracer.position.truncate().length();
        let n = streak.points.len() as f64;
        for (k, point) in streak.points.iter().enumerate() {
            assert!((point.position.truncate().length() - radius).abs() < 1e-8);
            let t = ((k as f64 + 0.5) / n - 0.5) * 0.008;
            let exact = field.flow_map(tracer.position, 0.0, t).unwrap();
            assert!((point.position - exact).length() < 1e-8);
        }
        // The mean velocity over the exposure is the chord over the time; the chord is shorter than the arc.
        let [first, last] = [-0.004, 0.004].map(|t| field.flow_map(tracer.position, 0.0, t).unwrap());
        assert!((tracer.velocity.unwrap() - (last - first) / 0.008).length() < 1e-6);
    }
}

#[test]
fn flashes_lie_symmetrically_about_the_time_of_the_frame() {
    let field = Linear::uniform(DVec3::X * 1000.0).unwrap();
    let frames = record(&field, Shutter::new(0.0, 3, 0.002, PIECE_UM).unwrap(), 1, |scene| scene);
    let (tracer, streak) = (&frames[0].tracers[0], &frames[0].streaks[0]);
    let places: Vec<f64> = streak.points.iter().map(|p| p.position.x - tracer.position.x).collect();
    // Each flash emits its full light.
    assert_eq!((streak.share, places.len()), (1.0, 3));
    assert!((places[0] + 2.0).abs() < 1e-9 && places[1].abs() < 1e-9 && (places[2] - 2.0).abs() < 1e-9);
    let open = record(&field, Shutter::new(0.001, 2, 0.004, PIECE_UM).unwrap(), 1, |scene| scene);
    let streak = &open[0].streaks[0];
    // 1 um per flash: 7 points each.
    assert_eq!((streak.points.len(), streak.share), (14, 1.0 / 7.0));
    assert!((centroid(&open[0], 0) - open[0].tracers[0].position).length() < 1e-9);
}

#[test]
fn thermal_motion_blurs_a_streak_by_its_law() {
    let field = Linear::uniform(DVec3::ZERO).unwrap();
    // In a liquid with a thousandth of the viscosity of water, so that Brownian motion of 2 um particles is
    // visible.
    fn thermal(scene: Scene) -> Scene {
        scene.with_brownian(brownian(1e-6, 1))
    }
    let frames = record(&field, Shutter::new(0.01, 1, 0.0, PIECE_UM).unwrap(), 8, thermal);
    let (mut squares, mut n) = (0.0, 0.0);
    for frame in &frames {
        for (tracer, streak) in frame.tracers.iter().zip(&frame.streaks) {
            assert_eq!(tracer.velocity, Some(DVec3::ZERO));
            let way = streak.points.last().unwrap().position - tracer.position;
            squares += way.x * way.x + way.y * way.y;
            n += 2.0;
            assert!((-79.0..=19.0).contains(&streak.points[0].position.z));
        }
    }
    let k = frames[0].streaks[0].points.len() as f64;
    let d = brownian(1e-6, 1).diffusion(2.0);
    // The last of K points is the mean over 1/K of the exposure that begins (1/2 - 1/K) of it after its middle.
    let expected = 2.0 * d * 0.01 * (0.5 - 1.0 / k + 1.0 / (3.0 * k));
    let relative = squares / n / expected - 1.0;
    assert!(relative.abs() < 4.0 * (2.0_f64 / n).sqrt(), "{relative}, {n}");
}

/// Displacements of the positions have the variance 2 D dt, of centers of images 2 D (dt - T / 3), and
/// successive ones, which share an exposure, the covariance D T / 3 (Savin and Doyle, Biophys. J. 88 (2005)
/// 623; Berglund, Phys. Rev. E 82 (2010) 011917). Centers have the variance D T / 6 about the positions. For
/// streaks of one, two, three and many points.
#[test]
fn images_of_diffusing_particles_move_as_in_a_camera() {
    const DT_S: f64 = 0.01;
    for (open_s, piece_um, points) in
        [(0.001, 1.0, 1), (0.001, 0.1, 2), (0.001, 0.06, 3), (0.005, 0.4, 1), (0.009, 0.02, 22)]
    {
        let field = Linear::uniform(DVec3::ZERO).unwrap();
        let seeding = Seeding::poisson(4e-3, Diameters::equal(0.2).unwrap()).unwrap();
        let region = Region::new(DVec3::splat(-50.0), DVec3::splat(50.0)).unwrap();
        let domain = Domain::new(region, [Boundary::Periodic; 3]);
        let shutter = Shutter::new(open_s, 1, 0.0, piece_um).unwrap();
        let scene = Scene::new(&field, &domain, &seeding).unwrap().with_shutter(shutter).keeping_ids();
        let brownian = Brownian::default();
        let frames = frames(&scene.with_brownian(brownian), &times(4, DT_S), 3);
        assert_eq!(frames[0].streaks[0].points.len(), points);
        let [mut positions, mut images, mut centers, mut both, mut n] = [0.0; 5];
        let wrapped = |d: DVec3| d - (d / 100.0).round() * 100.0;
        for i in 0..frames[0].tracers.len() {
            let steps: Vec<DVec3> =
                (0..3).map(|k| wrapped(centroid(&frames[k + 1], i) - centroid(&frames[k], i))).collect();
            for k in 0..3 {
                positions += frames[k + 1].tracers[i].step.unwrap().actual.length_squared();
                images += steps[k].length_squared();
                // The first frame, whose first half is a walk backward, too.
                centers += (centroid(&frames[k], i) - frames[k].tracers[i].position).length_squared();
            }
            both += (steps[0].dot(steps[1]) + steps[1].dot(steps[2])) / 2.0;
            n += 9.0;
        }
        let unit = 2.0 * brownian.diffusion(0.2) * DT_S;
        let part = open_s / DT_S;
        let [positions, images, centers] = [positions, images, centers].map(|sum: f64| sum / n / unit);
        let both = both / (n / 3.0) / unit;
        // Variances of 36,000 normal numbers have standard errors of 0.75 %, the covariance one of 1.3 % of
        // that of displacements.
        for (found, known) in [(positions, 1.0), (images, 1.0 - part / 3.0), (centers, part / 12.0)] {
            assert!((found / known - 1.0).abs() < 4.0 * 0.0075, "{points}: {found} {known}");
        }
        assert!((both - part / 6.0).abs() < 4.0 * 0.013, "{points}: {both}");
    }
}

#[test]
fn exposure_changes_no_path_without_diffusion_and_neither_threads_nor_length_change_exposure() {
    fn adorn(scene: Scene) -> Scene {
        let scene = scene.with_brownian(Brownian::default());
        scene.with_spheroids(Spheroids { e_p: 3.0, orientation: Orientation::Random })
    }
    let field = LambOseen::from_max_speed(DVec2::ZERO, 3000.0, 40.0, 4e4).unwrap();
    let shutter = Shutter::new(0.003, 2, 0.004, PIECE_UM).unwrap();
    let long = record(&field, shutter, 6, adorn);
    assert_eq!(long[..3], record(&field, shutter, 3, adorn));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| record(&field, shutter, 3, adorn))
    };
    assert!([1, 7].into_iter().all(|threads| with(threads) == long[..3]));
    fn rods(scene: Scene) -> Scene {
        scene.with_spheroids(Spheroids { e_p: 3.0, orientation: Orientation::Random })
    }
    let sharp = record(&field, Shutter::new(0.0, 1, 0.0, PIECE_UM).unwrap(), 3, rods);
    for (a, b) in record(&field, shutter, 3, rods).iter().zip(&sharp) {
        assert!(b.streaks.is_empty());
        assert!(a.tracers.iter().zip(&b.tracers).all(|(a, b)| a.position == b.position && a.axis == b.axis));
    }
    // The axis of a rod turns along the streak.
    assert!(long[0].streaks.iter().all(|s| s.points.iter().all(|p| (p.axis.length() - 1.0).abs() < 1e-12)));
    assert!(
        long[0].streaks.iter().any(|s| (s.points[0].axis - s.points.last().unwrap().axis).length() > 0.01)
    );
}
