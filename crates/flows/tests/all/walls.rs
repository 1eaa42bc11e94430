//! Fields with walls of their own confine their particles: every such field of the registry, with seeding,
//! advection and diffusion in a box that is larger than its fluid on all sides.
#![expect(clippy::print_stdout, reason = "the measured numbers, for `--nocapture`")]

use flows::fields::{
    Acoustophoresis, AcoustophoresisParams, Linear, Sum, ToroidalDrop, ToroidalDropParams, Tube, TubeParams,
};
use flows::registry::ENTRIES;
use flows::{
    Body, Boundary, Diameters, Domain, FluidRegion, Frame, RecordingStart, Region, Scene, Seeding,
    VelocityField, Wall,
};
use glam::DVec3;
use microsig_core::stream::Streams;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use crate::{brownian, frames, times};

const DT_S: f64 = 0.005;
const RADIUS_UM: f64 = 1.0;

/// A box larger than the default channel and view.
fn wide() -> Domain {
    let region = Region::new(DVec3::new(-250.0, -150.0, -110.0), DVec3::new(250.0, 150.0, 50.0)).unwrap();
    Domain::new(region, [Boundary::Open; 3])
}

fn two_um() -> Diameters {
    Diameters::equal(2.0 * RADIUS_UM).unwrap()
}

/// Every field of the registry that has walls.
fn walled() -> Vec<(String, Box<dyn VelocityField>)> {
    let all = ENTRIES.iter().flat_map(|entry| {
        let variants =
            entry.variants.iter().map(|(variant, make)| (format!("{}: {variant}", entry.name), make));
        std::iter::once((entry.name.to_owned(), &entry.make)).chain(variants)
    });
    all.map(|(name, make)| (name, make().unwrap()))
        // A sum of fields with different walls has flow through those walls.
        .filter(|(name, field)| field.wall(DVec3::ZERO, 0.0).is_some() && name != "sum: three")
        .collect()
}

/// 8 parts of the box along x and 4 along y and z.
fn parts() -> Vec<Region> {
    let region = *wide().region();
    let size = region.size() / DVec3::new(8.0, 4.0, 4.0);
    (0..128)
        .map(|i| {
            let min =
                region.min() + size * DVec3::new(f64::from(i % 8), f64::from(i / 8 % 4), f64::from(i / 32));
            Region::new(min, min + size).unwrap()
        })
        .collect()
}

/// Chi-square of the counts in the parts against the numbers expected from their accessible volume, and its
/// degrees of freedom. Parts with fewer than five expected particles are merged.
fn chi_square(frame: &Frame, scene: &Scene<'_>, number: f64) -> (f64, f64) {
    let fluid = scene.fluid();
    let free: Vec<f64> =
        parts().iter().map(|part| part.volume() * fluid.share(part, frame.t_s, RADIUS_UM)).collect();
    let density = number / free.iter().sum::<f64>();
    let (mut chi, mut freedom, mut rest) = (0.0, 0.0, (0.0, 0.0));
    for (part, free) in parts().iter().zip(free) {
        let found = frame.tracers.iter().filter(|tracer| part.contains(tracer.position)).count() as f64;
        let expected = density * free;
        if expected < 5.0 {
            rest = (rest.0 + found, rest.1 + expected);
        } else {
            chi += (found - expected) * (found - expected) / expected;
            freedom += 1.0;
        }
    }
    if rest.1 > 0.0 {
        chi += (rest.0 - rest.1) * (rest.0 - rest.1) / rest.1;
        freedom += 1.0;
    }
    (chi, freedom)
}

#[test]
#[ignore = "slow: .ci/full"]
fn no_particle_is_in_a_wall_and_the_cloud_stays_uniform() {
    let names: Vec<String> = walled().into_iter().map(|(name, _)| name).collect();
    for expected in [
        "poiseuille",
        "duct",
        "tube",
        "womersley: tube",
        "hele_shaw",
        "double_gyre",
        "stokes_sphere",
        "stokes_cylinder",
        "toroidal_drop",
        "coffee_ring",
        "rayleigh_streaming",
        "acoustophoresis",
        "sum",
        "mirrored: drop",
    ] {
        assert!(names.iter().any(|name| name == expected), "{expected} has no walls");
    }
    for (name, field) in walled() {
        let domain = wide();
        let seeding = Seeding::mean_in_view(3000.0, *domain.region(), two_um()).unwrap();
        // Brownian steps of 0.7 um per frame.
        let hot = brownian(0.89e-5, 1);
        let scene = Scene::new(field.as_ref(), &domain, &seeding).unwrap().with_brownian(hot);
        let fluid = scene.fluid();
        let frames = frames(&scene, &times(21, DT_S), 6);
        for frame in &frames {
            for tracer in &frame.tracers {
                let (x, t) = (tracer.position, frame.t_s);
                assert!(fluid.holds(x, t, RADIUS_UM, 1e-6), "{name}: {x} at {t}");
                // Deposited particles are on the floor where the drop has dried.
                if name != "coffee_ring" {
                    assert!(fluid.contains(x, t), "{name}: {x} at {t} in the solid");
                }
            }
        }
        let (first, last) = (&frames[0], &frames[20]);
        let number = first.tracers.len() as f64;
        // Poisson; 4.5 standard deviations.
        assert!((number - 3000.0).abs() < 4.5 * 55.0, "{name}: {number}");
        // The density increases in a drying drop and where acoustophoresis concentrates particles.
        if name != "coffee_ring" && field.is_divergence_free() {
            for frame in [first, last] {
                let (chi, freedom) = chi_square(frame, &scene, 3000.0);
                let number = frame.tracers.len();
                println!(
                    "{name}, frame {}: {number} particles, chi-square {chi:.0} of {freedom}",
                    frame.index
                );
                // Five standard deviations.
                assert!(chi < freedom + 5.0 * (2.0 * freedom).sqrt(), "{name}: {chi} of {freedom}");
                assert!((number as f64 - 3000.0).abs() < 4.5 * 55.0, "{name}: {number}");
            }
        }
    }
}

#[test]
fn nothing_flows_through_a_wall() {
    let region = *wide().region();
    for (name, field) in walled() {
        let t = 0.0123;
        let (mut touched, mut fastest) = (0, 0.0_f64);
        let mut through = 0.0_f64;
        for i in 0..4000 {
            let i = f64::from(i);
            let unit = DVec3::new(i * 0.819_172 % 1.0, i * 0.671_044 % 1.0, i * 0.549_700 % 1.0);
            let x = region.at(unit);
            let wall = field.wall(x, t).unwrap();
            assert!((wall.normal.length() - 1.0).abs() < 1e-12, "{name}");
            if wall.clearance_um >= 0.0 {
                assert_eq!(field.confine(x, t, 0.0), x, "{name}");
                fastest = fastest.max(field.velocity(x, t).length());
            }
            // The foot point is on the wall, from either side. At the contact line of a drop the normal is
            // not unique.
            let foot = x - wall.normal * wall.clearance_um;
            let at = field.wall(foot, t).unwrap();
            if at.clearance_um.abs() > 1e-6 || x.truncate().length() > 180.0 && name.contains("drop") {
                continue;
            }
            touched += 1;
            let u = field.velocity(foot + at.normal * 1e-7, t);
            // The surface of a drying drop moves and evaporates.
            if name != "coffee_ring" || at.normal == DVec3::Z {
                through = through.max(u.dot(at.normal).abs());
            }
        }
        println!("{name}: {touched} places on walls, {through:.1e} of {fastest:.0} um/s through them");
        // 1e-7 um from the wall, gradients of 1e3 /s give 1e-4 um/s.
        assert!(touched > 50 && through < 1e-3, "{name}: {touched} {through}");
    }
}

#[test]
fn shares_are_those_of_geometry() {
    let domain = wide();
    let volume = |field: &dyn VelocityField, bodies: &[Body], radius: f64| {
        FluidRegion::new(field, &domain, bodies).share(domain.region(), 0.0, radius)
            * domain.region().volume()
    };
    let pi = std::f64::consts::PI;
    let find = |name: &str| (flows::registry::find(name).unwrap().make)().unwrap();
    let still = Linear::uniform(DVec3::ZERO).unwrap();
    let drop = ToroidalDropParams { radius_um: 100.0, ..ToroidalDropParams::default() };
    let drop = ToroidalDrop::new(&drop).unwrap();
    let sphere = [Body::Sphere { center_um: (0.0, 0.0, 0.0), radius_um: 30.0 }];
    for (found, expected, error) in [
        (volume(find("duct").as_ref(), &[], 1.0), 500.0 * 198.0 * 98.0, 5e-4),
        (volume(find("poiseuille").as_ref(), &[], 2.0), 500.0 * 300.0 * 96.0, 1e-9),
        (volume(find("tube").as_ref(), &[], 1.0), 500.0 * pi * 49.0 * 49.0, 5e-4),
        (volume(&drop, &[], 0.0), 0.5 * pi * 100.0 * 100.0 * 60.0, 2e-3),
        (volume(&still, &sphere, 1.0), 500.0 * 300.0 * 160.0 - 4.0 / 3.0 * pi * (31.0 * 31.0 * 31.0), 1e-5),
        (volume(&still, &[], 1.0), 500.0 * 300.0 * 160.0, 0.0),
    ] {
        assert!((found / expected - 1.0).abs() <= error, "{found} {expected}");
    }
    // A narrow capillary, 0.2 % of the box, is resolved too.
    let capillary = Tube::new(&TubeParams {
        radius_um: Some(4.0),
        center_yz_um: Some([20.3, -31.7]),
        ..TubeParams::default()
    })
    .unwrap();
    let expected = 500.0 * pi * 9.0;
    assert!((volume(&capillary, &[], 1.0) / expected - 1.0).abs() < 1e-2, "{}", volume(&capillary, &[], 1.0));
}

#[test]
fn numbers_are_those_of_the_fluid() {
    let domain = wide();
    let field = (flows::registry::find("tube").unwrap().make)().unwrap();
    let count = |seeding: &Seeding| {
        let scene = Scene::new(field.as_ref(), &domain, seeding).unwrap();
        (0..10)
            .map(|recording| {
                let start = RecordingStart { recording, ..RecordingStart::default() };
                let mut sequence = scene.record(&[0.0], Streams::new(8), start).unwrap();
                sequence.next().unwrap().unwrap().tracers.len()
            })
            .sum::<usize>() as f64
            / 10.0
    };
    // Density per volume of fluid, although centers stay one radius from the wall: 500 um of a tube of radius
    // 50 um.
    let expected = 1e-3 * 500.0 * std::f64::consts::PI * 2500.0;
    let found = count(&Seeding::poisson(1e-3, two_um()).unwrap());
    assert!((found - expected).abs() < 4.5 * (expected / 10.0).sqrt(), "{found} {expected}");
    // Number in a view, exact or on average.
    let view = Region::new(DVec3::new(-100.0, -100.0, -110.0), DVec3::new(100.0, 100.0, 50.0)).unwrap();
    let exact = Seeding::count_in_view(400, view, two_um());
    let found = count(&exact);
    // The other 300 um of the tube at the same density.
    assert!((found - 1000.0).abs() < 4.5 * (600.0_f64 / 10.0).sqrt(), "{found}");
    let mean = count(&Seeding::mean_in_view(400.0, view, two_um()).unwrap());
    assert!((mean - 1000.0).abs() < 4.5 * (1000.0_f64 / 10.0).sqrt(), "{mean}");
    // A view outside the tube contains no fluid, and particles that are too large do not fit.
    let beside = Region::new(DVec3::new(-100.0, 60.0, -110.0), DVec3::new(100.0, 100.0, 50.0)).unwrap();
    let fault = |seeding: Seeding| Scene::new(field.as_ref(), &domain, &seeding).unwrap_err().to_string();
    assert!(fault(Seeding::count_in_view(5, beside, two_um())).contains("a view with fluid in it"));
    let huge = Diameters::equal(101.0).unwrap();
    assert!(fault(Seeding::poisson(1e-6, huge).unwrap()).contains("diameter_um = 101"));
    let listed = Seeding::list(vec![DVec3::new(0.0, 80.0, -30.0)], two_um()).unwrap();
    let scene = Scene::new(field.as_ref(), &domain, &listed).unwrap();
    let first = scene.record(&[0.0], Streams::new(1), RecordingStart::default()).unwrap().next().unwrap();
    assert!(first.unwrap_err().to_string().contains("a position in the fluid"));
}

/// Overlap follows from the density around an image, not from the mean over the sensor.
#[test]
fn the_image_share_is_that_of_the_fluid_in_the_image() {
    let domain = wide();
    let view = Region::new(DVec3::new(-100.0, -100.0, -110.0), DVec3::new(100.0, 100.0, 50.0)).unwrap();
    let share = |name: &str, bodies: &[Body]| {
        let field = (flows::registry::find(name).unwrap().make)().unwrap();
        FluidRegion::new(field.as_ref(), &domain, bodies).image_share(&view, 0.0)
    };
    // Chords 2 (R^2 - y^2)^(1/2) of a tube along x of R = 50 um: (pi R^2)^2 / (16 R^3 / 3), over 200 um.
    let pi = std::f64::consts::PI;
    let tube = 3.0 * pi * pi / 16.0 * 50.0 / 200.0;
    assert!((share("tube", &[]) / tube - 1.0).abs() < 5e-3, "{} {tube}", share("tube", &[]));
    let post = Body::Cylinder { center_um: (0.0, 0.0), radius_um: 60.0 };
    let around = 1.0 - pi * 3600.0 / 40000.0;
    assert!((share("lamb_oseen", &[post]) / around - 1.0).abs() < 5e-3, "{}", share("lamb_oseen", &[post]));
    // Floor and ceiling leave particles everywhere in the image.
    assert_eq!((share("lamb_oseen", &[]), share("poiseuille", &[])), (1.0, 1.0));
}

/// Speeds scale with d^2: 4.1 um/s for 1 um and 66 um/s for 4 um, where 2 um particles move at 16.45 um/s.
#[test]
fn sound_drives_each_particle_by_its_own_diameter() {
    let sound: Box<dyn VelocityField> =
        Box::new(Acoustophoresis::new(&AcoustophoresisParams::default()).unwrap());
    let flow: Box<dyn VelocityField> = Box::new(Linear::uniform(DVec3::X * 100.0).unwrap());
    let field = Sum::new(vec![flow, sound]).unwrap();
    let domain = wide();
    // The speed is highest an eighth of a wavelength from the node.
    let places = vec![DVec3::new(0.0, -59.0, 0.0); 3];
    for (d_um, speed) in [(1.0, 4.113), (2.0, 16.453), (4.0, 65.81)] {
        let seeding = Seeding::list(places.clone(), Diameters::equal(d_um).unwrap()).unwrap();
        let scene = Scene::new(&field, &domain, &seeding).unwrap();
        let frames = frames(&scene, &times(2, DT_S), 6);
        let velocity = frames[0].tracers[0].velocity.unwrap();
        assert!((velocity - DVec3::new(100.0, speed, 0.0)).length() < 5e-3, "{d_um}: {velocity}");
        let step = frames[1].tracers[0].step.unwrap().actual;
        assert!((step.y / (speed * DT_S) - 1.0).abs() < 1e-3, "{d_um}: {step}");
    }
}

/// The walls of a field alone, with the number of times that they were asked for.
#[derive(Debug)]
struct Walls<'a> {
    field: &'a dyn VelocityField,
    same_along: [bool; 3],
    calls: AtomicUsize,
}

impl VelocityField for Walls<'_> {
    fn velocity(&self, _x: DVec3, _t: f64) -> DVec3 {
        DVec3::ZERO
    }
    fn is_divergence_free(&self) -> bool {
        true
    }
    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        0.0
    }
    fn wall(&self, x: DVec3, t: f64) -> Option<Wall> {
        self.calls.fetch_add(1, Relaxed);
        self.field.wall(x, t)
    }
    fn walls_same_along(&self) -> [bool; 3] {
        self.same_along
    }
}

#[test]
fn walls_that_are_the_same_along_an_axis_are_measured_once() {
    let mut fewer = 0;
    for (name, field) in walled() {
        let measured = [[false; 3], field.walls_same_along()].map(|same_along| {
            let walls = Walls { field: field.as_ref(), same_along, calls: AtomicUsize::new(0) };
            let parts = [*wide().region(), parts()[9]];
            let shares = parts.map(|part| {
                let domain = Domain::new(part, [Boundary::Open; 3]);
                let fluid = FluidRegion::new(&walls, &domain, &[]);
                [(0.0, 0.0), (0.03, 1.0)].map(|(t, radius)| fluid.share(&part, t, radius))
            });
            (shares.as_flattened().to_vec(), walls.calls.into_inner())
        });
        let apart = measured[0].0.iter().zip(&measured[1].0).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        println!("{name}: along {:?}, {:?} calls", field.walls_same_along(), [measured[0].1, measured[1].1]);
        assert!(apart < 1e-12, "{name}: {measured:?}");
        fewer += usize::from(measured[1].1 * 4 < measured[0].1);
        if name == "poiseuille" {
            assert!(measured[1].1 * 100 < measured[0].1, "{measured:?}");
        }
    }
    assert!(fewer >= 12, "{fewer}");
}
