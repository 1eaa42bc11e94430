use super::*;
use crate::body::Body;
use crate::domain::Boundary::{Open, Wall};
use crate::fields::Linear;
use microsig_core::stream::{Purpose, Streams};

fn domain() -> Domain {
    let region = Region::new(DVec3::new(-200.0, -100.0, -80.0), DVec3::new(200.0, 100.0, 20.0)).unwrap();
    Domain::new(region, [Open, Wall, Wall])
}

/// Water at rest in the domain.
fn still() -> Linear {
    Linear::uniform(DVec3::ZERO).unwrap()
}

fn density_of(seeding: &Seeding) -> Result<f64> {
    seeding.density(&FluidRegion::new(&still(), &domain(), &[]), 0.0)
}

fn sow(seeding: &Seeding, bodies: &[Body], stream: &mut Stream) -> Result<Vec<Seed>> {
    let (still, domain) = (still(), domain());
    let fluid = FluidRegion::new(&still, &domain, bodies);
    seeding.populate(&fluid, 0.0, seeding.density(&fluid, 0.0)?, stream)
}

fn stream(row: u32) -> Stream {
    Streams::new(5).stream(Purpose::Seeding, 0, row)
}

#[test]
fn the_view_holds_the_count_and_the_rest_has_the_same_density() {
    // The view is away from the side walls; large particles are squeezed by 10 % along y and 20 % along z.
    let view = Region::new(DVec3::new(-100.0, -50.0, -80.0), DVec3::new(100.0, 50.0, 20.0)).unwrap();
    let seeding = Seeding::count_in_view(1000, view, Diameters::equal(20.0).unwrap());
    let mut outside = 0.0;
    for row in 0..20 {
        let seeds = sow(&seeding, &[], &mut stream(row)).unwrap();
        assert_eq!(seeds.iter().filter(|seed| view.contains(seed.position)).count(), 1000);
        assert!(seeds[..1000].iter().all(|seed| view.contains(seed.position)));
        assert!(seeds.iter().all(|seed| domain().room(9.999).unwrap().contains(seed.position)));
        outside += seeds.len() as f64 - 1000.0;
    }
    // In the accessible area of 400 x 180 um, 2.6 times the view of 200 x 100 um lies outside it; Poisson
    // error of 52000.
    assert!((outside - 52_000.0).abs() < 4.0 * 228.0, "{outside}");
}

#[test]
fn a_density_is_a_number_per_volume_between_the_walls() {
    let seeding = Seeding::poisson(1e-3, Diameters::equal(20.0).unwrap()).unwrap();
    let number: usize = (0..20).map(|row| sow(&seeding, &[], &mut stream(row)).unwrap().len()).sum();
    // 20 x 8000 expected, Poisson error 400.
    assert!((number as f64 - 160_000.0).abs() < 1600.0, "{number}");
    let empty = Seeding::poisson(0.0, Diameters::equal(2.0).unwrap()).unwrap();
    assert!(sow(&empty, &[], &mut stream(0)).unwrap().is_empty());
}

#[test]
fn what_cannot_be_seeded_is_refused() {
    let two = Diameters::equal(2.0).unwrap();
    let density = |seeding: Seeding| density_of(&seeding).unwrap_err().to_string();
    let outside = Region::new(DVec3::splat(-50.0), DVec3::new(300.0, 50.0, 10.0)).unwrap();
    assert!(density(Seeding::count_in_view(5, outside, two.clone())).contains("view_um"));
    let in_wall = Region::new(DVec3::new(0.0, 0.0, -80.0), DVec3::new(9.0, 9.0, -79.0)).unwrap();
    assert!(
        density(Seeding::count_in_view(5, in_wall, two.clone())).contains("particles fit between the walls")
    );
    assert!(density(Seeding::poisson(10.0, two.clone()).unwrap()).contains("80000000"));
    let huge = Seeding::poisson(1e-3, Diameters::equal(100.0).unwrap()).unwrap();
    assert!(density(huge).contains("diameter_um = 100"));
    assert!(Seeding::poisson(-1.0, two.clone()).is_err());
    // A view of 1e-6 of the depth takes a million draws per particle.
    let sliver = Region::new(DVec3::new(-200.0, -100.0, -5e-5), DVec3::new(200.0, 100.0, 5e-5)).unwrap();
    let seeds = sow(&Seeding::count_in_view(5, sliver, two), &[], &mut stream(0));
    assert!(seeds.unwrap_err().to_string().contains("thousandth"));
}

#[test]
fn least_distances_are_kept_in_space_or_in_the_image() {
    let sizes = Diameters::uniform(2.0, 8.0).unwrap();
    let worst = |seeding: &Seeding, flat: bool| {
        let seeds = sow(seeding, &[], &mut stream(1)).unwrap();
        let place = |seed: &Seed| if flat { seed.position.with_z(0.0) } else { seed.position };
        let mut worst = f64::INFINITY;
        for (i, a) in seeds.iter().enumerate() {
            for b in &seeds[..i] {
                worst = worst.min((place(a) - place(b)).length() - 0.5 * (a.d_um + b.d_um));
            }
        }
        (seeds.len(), worst)
    };
    let view = Region::new(DVec3::new(-100.0, -50.0, -80.0), DVec3::new(100.0, 50.0, 20.0)).unwrap();
    let dense = Seeding::poisson(2e-4, sizes.clone()).unwrap();
    assert!(worst(&dense, false).1 < 0.0);
    let apart = worst(&dense.clone().apart(1.5).unwrap(), false);
    assert!(apart.0 > 1400 && apart.1 >= 1.5, "{apart:?}");
    let counted = Seeding::count_in_view(60, view, sizes.clone()).apart_in_image(2.0).unwrap();
    let flat = worst(&counted, true);
    assert!(flat.0 > 100 && flat.1 >= 2.0, "{flat:?}");
    // 1600 disks of 23 um do not fit into 400 x 200 um, nor do 600 spheres into a view of 200 x 100 x 100 um:
    // this is reported before the first particle is placed.
    let full = |seeding: &Seeding| density_of(seeding).unwrap_err().to_string();
    let said = full(&dense.apart_in_image(18.0).unwrap());
    assert!(said.contains("apart_in_image = 18: expected room for 1600 particles with centers 23"), "{said}");
    let count = Seeding::count_in_view(600, view, sizes.clone());
    assert!(
        full(&count.clone().apart(18.0).unwrap()).contains("apart = 18: expected room for 600 particles")
    );
    // With 6 um they fill 0.42 of the jammed state, and can be placed.
    let seeds = sow(&count.apart(6.0).unwrap(), &[], &mut stream(1)).unwrap();
    assert_eq!(seeds.iter().filter(|seed| view.contains(seed.position)).count(), 600);
}

#[test]
fn random_placement_jams_below_the_limit() {
    // Particles of diameter 1 are placed in boxes until one finds no room in 10,000 attempts: in boxes of any
    // size, their number stays below the number that is refused, and reaches a good part of it.
    let d = Diameters::equal(1.0).unwrap();
    for (dims, edges) in [(3, [1.0, 3.0, 10.0]), (2, [1.0, 8.0, 40.0])] {
        for edge in edges {
            let region = Region::new(DVec3::ZERO, DVec3::splat(edge)).unwrap();
            let mut spacing = Spacing::new(Arrangement::MinimumDistance { gap: 0.0, dims }, &d);
            let (mut stream, mut placed) = (stream(3), 0.0);
            'placing: loop {
                for _ in 0..MAX_TRIES {
                    let at = DVec3::new(stream.uniform(), stream.uniform(), stream.uniform());
                    let seed = Seed { position: region.at(at), d_um: 1.0, axis: None };
                    if spacing.admits(&seed) {
                        spacing.add(&seed);
                        placed += 1.0;
                        continue 'placing;
                    }
                }
                break;
            }
            assert!(check_room((0.0, dims), &d, placed, &region).is_ok(), "{dims} {edge}: {placed}");
            // In small boxes the surface counts; 10,000 attempts reach three quarters of the jammed state.
            let refused = check_room((0.0, dims), &d, 1.35 * placed, &region).is_err();
            assert!(edge < 8.0 || refused, "{dims} {edge}: {placed}");
        }
    }
}

#[test]
fn a_grid_has_one_particle_in_every_cell() {
    let two = Diameters::equal(2.0).unwrap();
    let seeding = Seeding::poisson(1e-3, two.clone()).unwrap().on_jittered_grid(0.8).unwrap();
    let seeds = sow(&seeding, &[], &mut stream(1)).unwrap();
    assert_eq!(seeds.len(), 8000);
    let mut cells: Vec<[i64; 3]> =
        seeds.iter().map(|seed| (seed.position / 10.0).floor().to_array().map(|x| x as i64)).collect();
    cells.sort_unstable();
    cells.dedup();
    assert_eq!(cells.len(), 8000);
    assert!(seeding.on_jittered_grid(1.5).is_err());
    let view = *domain().region();
    assert!(Seeding::count_in_view(5, view, two).on_jittered_grid(0.5).is_err());
}

#[test]
fn lists_are_kept_and_checked() {
    let two = Diameters::equal(2.0).unwrap();
    let places = vec![DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 5.0, -6.0)];
    let seeding = Seeding::list(places.clone(), two.clone()).unwrap();
    let seeds = sow(&seeding, &[], &mut stream(0)).unwrap();
    assert_eq!(seeds.iter().map(|seed| seed.position).collect::<Vec<_>>(), places);
    assert_eq!(density_of(&seeding).unwrap(), 0.0);
    let in_the_way = [Body::Sphere { center_um: (0.0, 0.0, 0.0), radius_um: 5.0 }];
    let fault = |x: DVec3, bodies: &[Body]| {
        let seeding = Seeding::list(vec![x], two.clone()).unwrap();
        sow(&seeding, bodies, &mut stream(0)).unwrap_err().to_string()
    };
    assert!(
        fault(DVec3::Z * 19.5, &[]).contains("one radius from its walls")
            && fault(DVec3::X * 201.0, &[]).contains("201")
    );
    assert!(fault(DVec3::ZERO, &in_the_way).contains("outside all bodies"));
    assert!(Seeding::list(vec![DVec3::NAN], two.clone()).is_err());
}
