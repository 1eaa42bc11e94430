//! Messages about input: file, line, key; their number and length are bounded. Estimates of `--dry-run`.

use serde_json::Value;
use suite::microsig::{fail, path, run, write};

const SCENARIO: &str = r#"(
    name: "small",
    optics: (pixel_dim_x: 96, pixel_dim_y: 64),
    motion: flow(field: poiseuille()),
    particles: (number: count(5)),
    timing: pairs(count: 2),
    calibration: none,
)"#;

#[test]
fn a_listed_place_that_is_refused_has_file_and_line() {
    let place = tempfile::tempdir().unwrap();
    write(
        place.path(),
        "places.txt",
        "# x y z d\n10 10 -30 2\n\n50 40 -30 2 # in the channel\n50 40 500 2\n",
    );
    let listed = SCENARIO.replace("count(5)", "file(\"places.txt\")");
    let scenario = write(place.path(), "s.ron", &listed);
    for arguments in [&["generate", path(&scenario)][..], &["generate", path(&scenario), "--dry-run"]] {
        let message = fail(2, arguments);
        assert!(
            message.contains("places.txt:5: x = 50 px, y = 40 px, z = 500 um: expected a position inside"),
            "{message}"
        );
        assert!(message.contains("particles.number.file"), "{message}");
    }
}

fn estimate(scenario: &str, set: &[&str]) -> Value {
    let place = tempfile::tempdir().unwrap();
    write(place.path(), "places.txt", "10 10 -30 2\n50 40 -30 2\n");
    let file = write(place.path(), "s.ron", scenario);
    let set = set.iter().flat_map(|set| ["--set", set]);
    let arguments: Vec<&str> =
        ["generate", path(&file), "--dry-run", "--json", "--threads", "1"].into_iter().chain(set).collect();
    serde_json::from_str(&run(&arguments)).unwrap()
}

#[test]
fn estimates_cover_listed_particles_and_the_memory_of_rays() {
    let listed = SCENARIO.replace("count(5)", "file(\"places.txt\")");
    let cost = estimate(&listed, &[]);
    assert_eq!(cost["particles_per_frame"], 2.0);
    assert!(cost["seconds"].as_f64().unwrap() > 0.0);
    // 6 million source points, of which one image takes tens of seconds: an estimate may not draw it.
    let many = estimate(&listed, &["optics.points_per_pixel=100000"]);
    let memory = many["memory_bytes"].as_u64().unwrap();
    assert!((400_000_000..2_000_000_000).contains(&memory), "{memory}");
    assert!(many["seconds"].as_f64().unwrap() > 10.0 * cost["seconds"].as_f64().unwrap(), "{many} {cost}");
}
