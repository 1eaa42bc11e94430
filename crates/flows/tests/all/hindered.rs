//! Recordings of spheres that walls slow.

use flows::fields::{Linear, Poiseuille};
use flows::hindered::{resistance_across, slip_in_shear};
use flows::{Boundary, Diameters, Domain, Region, Scene, Seeding, Settling, Shutter, VelocityField};
use glam::DVec3;

use crate::{frames, times, water};
use Boundary::{Open, Periodic, Wall};

const RADIUS_UM: f64 = 0.25;
const DEPTH_UM: f64 = 3.0;

fn domain(boundaries: [Boundary; 3]) -> Domain {
    let region = Region::new(DVec3::new(-20.0, -20.0, 0.0), DVec3::new(20.0, 20.0, DEPTH_UM)).unwrap();
    Domain::new(region, boundaries)
}

/// About 1000 spheres in the domain, per unit of `factor`.
fn seeding(factor: f64) -> Seeding {
    let per_um3 = factor * 1000.0 / (1600.0 * DEPTH_UM);
    Seeding::poisson(per_um3, Diameters::equal(2.0 * RADIUS_UM).unwrap()).unwrap()
}

/// Largest deviation of the distribution of `shares` from a uniform one (Kolmogorov-Smirnov), times the
/// root of their number: above 1.95 with a probability of 0.1 %.
fn deviation(mut shares: Vec<f64>) -> f64 {
    shares.sort_by(f64::total_cmp);
    let n = shares.len() as f64;
    let far = shares.iter().enumerate().map(|(i, s)| ((i as f64 + 0.5) / n - s).abs()).fold(0.0, f64::max);
    far * n.sqrt()
}

fn share(z_um: f64) -> f64 {
    (z_um - RADIUS_UM) / (DEPTH_UM - 2.0 * RADIUS_UM)
}

#[test]
fn a_cloud_in_an_open_channel_stays_uniform_and_off_the_walls() {
    let field = Poiseuille::new(400.0, 0.0, DEPTH_UM, 0.0).unwrap();
    let (domain, seeding) = (domain([Open, Open, Wall]), seeding(2.0));
    let shutter = Shutter::new(0.004, 1, 0.0, 0.1).unwrap();
    let scene = Scene::new(&field, &domain, &seeding).unwrap().with_brownian(water(2)).with_shutter(shutter);
    // A sphere crosses the channel by diffusion in 3 s, and the view by the flow in 0.1 s.
    let frames = frames(&scene.with_slowing_walls(), &times(20, 0.01), 3);
    for frame in &frames {
        let places = frame.tracers.iter().map(|tracer| tracer.position);
        let streak_points =
            frame.streaks.iter().flat_map(|streak| streak.points.iter().map(|point| point.position));
        for z in places.chain(streak_points).map(|x| x.z) {
            assert!((RADIUS_UM..=DEPTH_UM - RADIUS_UM).contains(&z), "{z}");
        }
        // The number is a Poisson number of mean 2000: 4 standard deviations.
        let number = frame.tracers.len() as f64;
        assert!((number - 2000.0).abs() < 4.0 * 45.0, "{number}");
    }
    let last = &frames[19].tracers;
    let heights = deviation(last.iter().map(|t| share(t.position.z)).collect());
    let along = deviation(last.iter().map(|t| (t.position.x + 20.0) / 40.0).collect());
    assert!(heights < 1.95 && along < 1.95, "{heights} {along}");
}

#[test]
fn spheres_lag_behind_the_flow_at_their_height() {
    let field = Poiseuille::new(400.0, 0.0, DEPTH_UM, 0.0).unwrap();
    let (domain, seeding) = (domain([Periodic, Open, Wall]), seeding(1.0));
    let scene = Scene::new(&field, &domain, &seeding).unwrap().keeping_ids();
    let times = times(2, 0.01);
    let (free, slow) = (frames(&scene, &times, 3), frames(&scene.with_slowing_walls(), &times, 3));
    for (free, slow) in free[1].tracers.iter().zip(&slow[1].tracers) {
        let z = free.position.z;
        let gap = |clearance: f64| clearance / RADIUS_UM - 1.0;
        let slip = slip_in_shear(gap(z)) * slip_in_shear(gap(DEPTH_UM - z));
        let fluid = field.velocity(free.position, 0.0).x;
        assert!((free.velocity.unwrap().x - fluid).abs() < 1e-9);
        assert!((slow.velocity.unwrap().x - fluid * slip).abs() < 1e-9, "{z}");
        let step = slow.step.unwrap();
        assert!((step.drift.x - fluid * slip * 0.01).abs() < 1e-7 && step.actual == step.drift);
        assert_eq!(slow.position.z, z);
    }
}

#[test]
fn a_sinking_sphere_approaches_the_floor_without_touching_it() {
    let field = Linear::uniform(DVec3::ZERO).unwrap();
    let (domain, seeding) = (domain([Open, Open, Wall]), seeding(0.1));
    let heavy = Settling { density_difference_kg_m3: 1e4, ..Default::default() };
    let scene = Scene::new(&field, &domain, &seeding).unwrap().with_settling(heavy).with_slowing_walls();
    let frames = frames(&scene, &times(6, 0.2), 3);
    // 9.81 * 1e4 * 0.5^2 / (18 * 0.89e-3) um/s.
    let speed = 9.806_65e4 * 0.25 / (18.0 * 0.89e-3) * 1e-6;
    let gap = |clearance: f64| clearance / RADIUS_UM - 1.0;
    for tracer in &frames[0].tracers {
        let mut z = tracer.position.z;
        for frame in &frames[1..] {
            for _ in 0..2000 {
                let slope = |z: f64| {
                    -speed / (resistance_across(gap(z)) + resistance_across(gap(DEPTH_UM - z)) - 1.0)
                };
                z += slope(z + 0.5e-4 * slope(z)) * 1e-4;
            }
            let there = frame.tracers.iter().find(|other| other.id == tracer.id).unwrap().position.z;
            // The midpoint rule with 1e-4 s errs by 1e-8 um.
            assert!((there - z).abs() < 1e-6 && there >= RADIUS_UM, "{there} {z}");
        }
    }
}
