//! A cylindrical lens before the camera stretches images: truth, images and scores agree about it.

use serde_json::Value;
use suite::microsig::{generate, json, manifest, path, write};

const SCENARIO: &str = r#"(
    name: "stretched",
    seed: 5,
    optics: (
        magnification: 20, numerical_aperture: 0.2, pixel_size: 6.5, pixel_dim_x: 200, pixel_dim_y: 160,
        background_mean: 0, background_noise: 0, lens: aplanatic, cyl_angle_deg: ANGLE,
        cylinder: lens(focal_length_mm: 300, to_sensor_mm: 30),
    ),
    motion: flow(field: poiseuille(max_speed_um_s: 400, direction_rad: 0.4)),
    particles: (number: count(6), diameter_um: constant(1)),
    boundaries: (depth_um: 20),
    timing: sequence(frames: 3, dt_s: 0.005),
    calibration: none,
    render: (mode: waves, wavelength_um: 0.52, tolerance: 0.05),
    image_format: float32,
)"#;

#[test]
fn truth_images_and_scores_are_stretched_alike() {
    for angle in ["0", "30"] {
        let folder = tempfile::tempdir().unwrap();
        let dataset = generate(folder.path(), "dataset", &SCENARIO.replace("ANGLE", angle));
        let facts = manifest(&dataset);
        let rows: Vec<[f64; 2]> = serde_json::from_value(facts["image_stretch"].clone()).unwrap();
        let (sine, cosine) = angle.parse::<f64>().unwrap().to_radians().sin_cos();
        let expected = [
            [1.0 - 0.1 * cosine * cosine, -0.1 * sine * cosine],
            [-0.1 * sine * cosine, 1.0 - 0.1 * sine * sine],
        ];
        for (row, expected) in rows.iter().zip(expected) {
            assert!((row[0] - expected[0]).abs() < 1e-12 && (row[1] - expected[1]).abs() < 1e-12, "{rows:?}");
        }
        assert_eq!(facts["waves"]["cylinder"]["focal_length_mm"], 300.0);
        // d^2 / (M^2 (f - d)) = 8.33 um: the range of 20 um is about half of that.
        let z_um: [f64; 2] = serde_json::from_value(facts["depth_range_um"].clone()).unwrap();
        assert!((z_um[0] + 14.167).abs() < 1e-9 && (z_um[1] - 5.833).abs() < 1e-9, "{z_um:?}");

        let mut table = csv::Reader::from_path(dataset.join("truth/tracks.csv")).unwrap();
        let header = table.headers().unwrap().clone();
        let column = |name: &str| header.iter().position(|h| h == name).unwrap_or_else(|| panic!("{name}"));
        let mut result = "frame,track,x_px,y_px,z_um\n".to_owned();
        for row in table.records() {
            let row = row.unwrap();
            let number = |name: &str| row[column(name)].parse::<f64>().unwrap();
            let [x_px, y_px, x_um, y_um] = ["x_px", "y_px", "x_um", "y_um"].map(number);
            let um_per_px = 6.5 / 20.0;
            for (px, row, middle) in [(x_px, expected[0], 100.5), (y_px, expected[1], 80.5)] {
                let seen = middle + (row[0] * x_um + row[1] * y_um) / um_per_px;
                assert!((px - seen).abs() < 1e-9, "{angle}: {px} and {seen}");
            }
            // The images are drawn from these lines.
            let data = dataset.join(format!("particles/frame_{:05.0}.txt", number("frame")));
            let data = std::fs::read_to_string(data).unwrap();
            let written = data.contains(&format!("{} {} ", &row[column("x_px")], &row[column("y_px")]));
            assert!(written || &row[column("rendered")] == "0", "{data}");
            let [frame, track] = [&row[column("frame")], &row[column("track")]];
            result += &format!("{frame},{track},{x_px},{y_px},{}\n", number("z_um"));
        }
        let result = write(folder.path(), "result.csv", &result);
        let score: Value = json(&["evaluate", path(&dataset), path(&result)]);
        // Without the stretch, displacements in px would be 10 % of the speed off in the direction of the
        // lens's power.
        let relative = score.pointer("/lpt/velocity_rms_relative").and_then(Value::as_f64);
        assert!(relative.unwrap() < 1e-3, "{}", score["lpt"]);
    }
}
