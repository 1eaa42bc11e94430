#![expect(clippy::print_stdout, reason = "samples per CPU second are shown")]

use super::*;

/// Crops of 64 x 64 px of setting 1 with a particle in view.
const SCENARIO: &str = r#"(name: "ml", optics: (preset: setting1, background_noise: 10, pixel_dim_x: 64, pixel_dim_y: 64),
    motion: flow(field: uniform()), particles: (number: count(1)), boundaries: (z_um: (-60, 0)), timing: pairs(count: 1))"#;

fn stream(values: &[(&str, &str)], vary: (&str, f64, f64), labels: LabelOptions) -> SampleStream {
    made(values, vary, labels).unwrap()
}

fn made(values: &[(&str, &str)], vary: (&str, f64, f64), labels: LabelOptions) -> Result<SampleStream> {
    let assignment = |(path, value): &(&str, &str)| format!("{path}={value}").parse().unwrap();
    let (path, low, high) = vary;
    SampleStream::new(StreamOptions {
        text: SCENARIO.to_owned(),
        name: "ml".to_owned(),
        folder: PathBuf::from("."),
        assignments: values.iter().map(assignment).collect(),
        vary: vec![(path.to_owned(), Distribution::Uniform { low, high })],
        seed: 1,
        split: Split::Train,
        frames: 1,
        labels,
        rows: 0,
        window: None,
    })
}

#[test]
fn errors_name_the_key_and_the_draw() {
    let error = |vary| made(&[], vary, LabelOptions::default()).unwrap_err().to_string();
    let unknown = error(("optics.na", 0.2, 0.3));
    assert!(
        unknown.starts_with("vary optics.na, 0.2") && unknown.contains("in sample 0: unknown key"),
        "{unknown}"
    );
    assert!(unknown.contains("`numerical_aperture`") && !unknown.contains("optics.na="), "{unknown}");
    let range = error(("optics.numerical_aperture", 1.5, 3.0));
    assert!(range.starts_with("vary optics.numerical_aperture, ") && range.contains("< 1"), "{range}");
}

const APERTURE: (&str, f64, f64) = ("optics.numerical_aperture", 0.28, 0.32);
const EXPECTED: (&str, &str) = ("render.mode", "expected");
const WAVES: [(&str, &str); 2] = [("render.mode", "waves"), ("render.wavelength_um", "0.52")];
const SINGLE: (&str, &str) = ("render.images", "single");
const CYLINDER: (&str, &str) = ("optics.cyl_focal_length", "3500");

#[test]
fn keys_that_need_new_tables_are_named() {
    let none = LabelOptions::default();
    let warning =
        |values: &[(&str, &str)], vary, labels| stream(values, vary, labels).warning().map(ToOwned::to_owned);
    let message = warning(&[EXPECTED], APERTURE, none).unwrap();
    assert!(message.starts_with("vary optics.numerical_aperture: each sample needs new tables"), "{message}");
    assert!(message.contains("`render.images: single`"), "{message}");
    assert_eq!(warning(&[EXPECTED, SINGLE], APERTURE, none), None);
    assert_eq!(warning(&[EXPECTED], ("optics.background_noise", 0.0, 20.0), none), None);
    assert_eq!(warning(&[], APERTURE, none), None);
    assert!(warning(&[], APERTURE, LabelOptions { clean: true, ..none }).is_some());
    assert_eq!(warning(&[SINGLE], APERTURE, LabelOptions { clean: true, ..none }), None);
}

/// Images by waves share kernels, which must not depend on the samples before.
#[test]
fn single_images_do_not_depend_on_samples_before() {
    for (values, vary) in [
        ([WAVES[0], WAVES[1], SINGLE].to_vec(), APERTURE),
        (
            vec![WAVES[0], WAVES[1], SINGLE, ("optics.lens", "aplanatic")],
            ("optics.cyl_focal_length", 3000.0, 4000.0),
        ),
    ] {
        let labels = LabelOptions { clean: true, ..LabelOptions::default() };
        let (one, other) = (stream(&values, vary, labels), stream(&values, vary, labels));
        let clean = |stream: &SampleStream, i: u64| stream.sample(i).unwrap().clean;
        let by_one: Vec<_> = [0, 1, 2].map(|i| clean(&one, i)).into();
        let by_other: Vec<_> = [2, 1, 0].map(|i| clean(&other, i)).into();
        assert!(by_one.iter().eq(by_other.iter().rev()));
    }
}

/// CPU time of this process, s.
fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) / 100.0
}

/// Samples per CPU second with new optics for each, from tables and one by one.
#[test]
#[ignore = "speed"]
fn samples_of_varied_optics() {
    let none = LabelOptions::default();
    let aplanatic = ("optics.lens", "aplanatic");
    for (name, values, tables, single) in [
        ("rays", vec![], 0, 1000),
        ("expected", vec![EXPECTED], 20, 1000),
        ("expected, cylindrical lens", vec![EXPECTED, CYLINDER], 6, 300),
        ("waves", WAVES.to_vec(), 6, 300),
        ("waves, corrected lens", vec![WAVES[0], WAVES[1], aplanatic], 6, 300),
    ] {
        let mut shown = format!("{name}:");
        for (more, n) in [(None, tables), (Some(SINGLE), single)].into_iter().filter(|(_, n)| *n > 0) {
            let values: Vec<_> = values.iter().copied().chain(more).collect();
            let stream = stream(&values, APERTURE, none);
            let start = cpu_s();
            (0..n).for_each(|i| drop(stream.sample(i).unwrap()));
            let kind = if more.is_some() { "single" } else { "tables" };
            shown += &format!(" {kind} {:.1}", n as f64 / (cpu_s() - start).max(0.01));
        }
        println!("{shown}");
    }
}
