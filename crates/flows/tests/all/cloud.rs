//! Clouds in open domains stay uniform, and do not depend on the number of threads.
#![expect(clippy::print_stdout, reason = "the measured numbers, for `--nocapture`")]

use flows::fields::{Kraichnan, KraichnanParams, LambOseen, Linear, Poiseuille};
use flows::{
    Boundary, Diameters, Domain, FluidRegion, Frame, RecordingStart, Region, Scene, Seeding, VelocityField,
};
use glam::{DVec2, DVec3};
use microsig_core::stream::Streams;
use std::collections::HashSet;

use crate::{LIMIT, chi_square, times};

/// Displacements range from 0 to 14.835 um (23 px of 0.645 um) per frame.
const FASTEST_UM: f64 = 23.0 * 0.645;
const DT_S: f64 = 0.01;

/// The field of view of the sensor with a margin, in the default channel.
fn domain(boundaries: [Boundary; 3]) -> Domain {
    let region = Region::new(DVec3::new(-280.0, -150.0, -80.0), DVec3::new(280.0, 150.0, 20.0)).unwrap();
    Domain::new(region, boundaries)
}

fn channel() -> Domain {
    domain([Boundary::Open, Boundary::Open, Boundary::Wall])
}

/// 16800 particles on average.
fn seeding() -> Seeding {
    Seeding::poisson(1e-3, Diameters::equal(2.0).unwrap()).unwrap()
}

/// Particles per um^3.
fn density(seeding: &Seeding, domain: &Domain) -> f64 {
    let rest = Linear::uniform(DVec3::ZERO).unwrap();
    seeding.density(&FluidRegion::new(&rest, domain, &[]), 0.0).unwrap()
}

fn poiseuille() -> Poiseuille {
    Poiseuille::new(FASTEST_UM / DT_S, -80.0, 20.0, 0.0).unwrap()
}

fn positions(frame: &Frame) -> Vec<DVec3> {
    frame.tracers.iter().map(|tracer| tracer.position).collect()
}

/// Worst chi-square over the axes.
fn worst_profile(positions: &[DVec3], domain: &Domain, seeding: &Seeding) -> f64 {
    let room = domain.room(1.0).unwrap();
    let expected = density(seeding, domain) * domain.region().volume();
    let chi = |axis| chi_square(positions.iter().copied(), &room, axis, expected);
    (0..3).map(chi).fold(0.0, f64::max)
}

/// Selected frames of a long recording, without storing the others.
fn snapshots(
    field: &dyn VelocityField,
    domain: &Domain,
    seeding: &Seeding,
    indices: &[u32],
    seed: u64,
) -> Vec<Frame> {
    let scene = Scene::new(field, domain, seeding).unwrap();
    let last = indices.iter().copied().max().unwrap();
    let sequence =
        scene.record(&times(last + 1, DT_S), Streams::new(seed), RecordingStart::default()).unwrap();
    sequence.map(Result::unwrap).filter(|frame| indices.contains(&frame.index)).collect()
}

#[test]
fn a_channel_flow_stays_uniform_over_400_frames() {
    let (domain, seeding) = (channel(), seeding());
    let frames = snapshots(&poiseuille(), &domain, &seeding, &[0, 1, 10, 100, 400], 1);
    for frame in &frames {
        let chi = worst_profile(&positions(frame), &domain, &seeding);
        println!("frame {}: {} tracers, chi-square {chi:.1}", frame.index, frame.tracers.len());
        assert!(chi < LIMIT, "frame {}: {chi}", frame.index);
        let expected = density(&seeding, &domain) * domain.region().volume();
        let number = frame.tracers.len() as f64;
        // A Poisson number; 4.5 standard deviations.
        assert!(
            (number - expected).abs() < 4.5 * expected.sqrt(),
            "frame {}: {number}, {expected}",
            frame.index
        );
    }
    // All but the slowest layers have been replaced more than once: the cloud consists of inflow.
    let survivors = frames[0].links(&frames[4]).count();
    assert!(survivors < frames[0].tracers.len() / 10, "{survivors}");
}

#[test]
fn no_inflow_would_fail_the_same_test() {
    let (domain, seeding) = (channel(), seeding());
    let frames = snapshots(&poiseuille(), &domain, &seeding, &[0, 10], 1);
    let old: Vec<DVec3> = frames[0].links(&frames[1]).map(|(_, tracer)| tracer.position).collect();
    assert!(worst_profile(&old, &domain, &seeding) > 10.0 * LIMIT);
}

#[test]
fn vortices_and_strains_stay_uniform_too() {
    let open = domain([Boundary::Open; 3]);
    let center = DVec3::new(10.0, 20.0, -30.0);
    // Inflow through all faces at once, corners included; the vortex decays to a tenth meanwhile.
    let cases: [(&str, Box<dyn VelocityField>, &Domain); 4] = [
        ("rotation", Box::new(Linear::rotation(DVec3::new(0.5, 1.0, 3.0), center).unwrap()), &open),
        ("uniaxial strain", Box::new(Linear::uniaxial_strain(2.0, flows::Axis::X, center).unwrap()), &open),
        (
            "vortex",
            Box::new(LambOseen::from_max_speed(DVec2::new(-270.0, 20.0), 1500.0, 60.0, 4e4).unwrap()),
            &channel(),
        ),
        ("diagonal", Box::new(Linear::uniform(DVec3::new(900.0, -700.0, 300.0)).unwrap()), &open),
    ];
    for (name, field, domain) in cases {
        let seeding = seeding();
        let frames = snapshots(field.as_ref(), domain, &seeding, &[0, 100], 4);
        let born = frames[1].tracers.len() - frames[0].links(&frames[1]).count();
        let chi = worst_profile(&positions(&frames[1]), domain, &seeding);
        println!("{name}: {} tracers, {born} born, chi-square {chi:.1}", frames[1].tracers.len());
        assert!(chi < LIMIT && born > 1000, "{name}: {chi}, {born}");
    }
}

/// An unsteady field without walls or symmetry, in a box open on all sides.
#[test]
fn a_turbulent_field_keeps_its_cloud_uniform_over_100_frames() {
    let open = domain([Boundary::Open; 3]);
    let seeding = Seeding::poisson(1.2e-4, Diameters::equal(2.0).unwrap()).unwrap();
    // One block of modes; 4 um per frame along each axis, so that most particles are replaced.
    let params =
        KraichnanParams { rms_speed_um_s: 400.0, modes: 16, unsteadiness: 0.2, ..KraichnanParams::default() };
    let field = Kraichnan::new(&params).unwrap();
    assert!(field.is_divergence_free());
    let frames = snapshots(&field, &open, &seeding, &[0, 50, 100], 11);
    let survivors = frames[0].links(&frames[2]).count();
    println!("turbulence: {} tracers, {survivors} of them since frame 0", frames[2].tracers.len());
    assert!(survivors < frames[0].tracers.len() * 3 / 4, "{survivors}");
    for frame in &frames {
        let chi = worst_profile(&positions(frame), &open, &seeding);
        println!("turbulence, frame {}: chi-square {chi:.1}", frame.index);
        assert!(chi < LIMIT, "frame {}: {chi}", frame.index);
    }
}

#[test]
fn ids_are_never_used_again() {
    let (domain, seeding, field) = (channel(), seeding(), poiseuille());
    let scene = Scene::new(&field, &domain, &seeding).unwrap();
    let start = RecordingStart { recording: 3, first_frame: 6, first_id: 1000 };
    let mut sequence = scene.record(&times(20, DT_S), Streams::new(5), start).unwrap();
    let (mut gone, mut alive) = (HashSet::new(), HashSet::new());
    let mut index = 6;
    while let Some(frame) = sequence.next() {
        let frame = frame.unwrap();
        assert_eq!(frame.index, index);
        index += 1;
        assert!(frame.tracers.is_sorted_by(|a, b| a.id < b.id));
        let now: HashSet<u64> = frame.tracers.iter().map(|tracer| tracer.id).collect();
        gone.extend(alive.difference(&now).copied());
        assert!(now.is_disjoint(&gone), "an id came back");
        assert!(now.iter().all(|id| (1000..sequence.next_id()).contains(id)));
        alive = now;
    }
    assert!(!gone.is_empty() && index == 26);
    // The next recording continues the ids of this one with an independent cloud.
    let next = RecordingStart { recording: 4, first_frame: 26, first_id: sequence.next_id() };
    let fresh = scene.record(&times(2, DT_S), Streams::new(5), next).unwrap().next().unwrap().unwrap();
    assert_eq!(fresh.tracers[0].id, next.first_id);
    let old = scene.record(&times(1, DT_S), Streams::new(5), start).unwrap().next().unwrap().unwrap();
    assert_ne!(fresh.tracers[0].position, old.tracers[0].position);
}
