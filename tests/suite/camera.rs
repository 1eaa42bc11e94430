//! Cameras whose pixels have offset, gain and read noise of their own, from files.

use std::path::Path;

use microsig_core::formats::tiff::{self, PixelScale};
use microsig_core::sensor::{Counts, Image};
use suite::microsig::{path, run};

const WIDTH: u32 = 80;
const HEIGHT: u32 = 60;

const SCENARIO: &str = r#"(
    name: "maps",
    optics: (pixel_dim_x: 80, pixel_dim_y: 60, points_per_pixel: 4, background_mean: 0),
    sensor: (maps: (offset: "offset.npy", gain: "gain.tif", variance: "variance.tif")),
    motion: flow(field: poiseuille()),
    particles: (number: count(3)),
    timing: sequence(frames: 2),
)"#;

fn tif(folder: &Path, name: &str, (width, height): (u32, u32), value: impl Fn(u32) -> f32) {
    let counts = Counts::Unrounded((0..width * height).map(value).collect());
    let image = Image { width, height, bits: Image::FLOAT_BITS, counts };
    let scale = PixelScale::um_per_px(1.0);
    let file = std::fs::File::create(folder.join(name)).unwrap();
    tiff::write(file, &image, &scale, name).unwrap();
}

fn npy(folder: &Path, name: &str, (width, height): (u32, u32), value: impl Fn(u32) -> f64) {
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({height}, {width}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend((0..width * height).flat_map(|i| value(i).to_le_bytes()));
    std::fs::write(folder.join(name), bytes).unwrap();
}

/// Columns with an offset, and a camera that is darker at the bottom.
fn offset(i: u32) -> f64 {
    100.0 + f64::from(i % WIDTH % 7) * 20.0
}

fn maps(folder: &Path) {
    npy(folder, "offset.npy", (WIDTH, HEIGHT), offset);
    tif(folder, "gain.tif", (WIDTH, HEIGHT), |i| 0.5 + i as f32 / 10_000.0);
    tif(folder, "variance.tif", (WIDTH, HEIGHT), |i| if i % 11 == 0 { 30.0 } else { 1.0 });
    std::fs::write(folder.join("s.ron"), SCENARIO).unwrap();
}

#[test]
fn a_dataset_has_the_maps_of_its_camera() {
    let place = tempfile::tempdir().unwrap();
    maps(place.path());
    let (scenario, out) = (place.path().join("s.ron"), place.path().join("out"));
    run(&["generate", path(&scenario), "--out", path(&out), "--quiet"]);
    for name in ["offset.npy", "gain.tif", "variance.tif"] {
        std::fs::remove_file(place.path().join(name)).unwrap();
        assert!(out.join("inputs").join(name).exists());
        for list in ["SHA256SUMS", "datapackage.json"] {
            let text = std::fs::read_to_string(out.join(list)).unwrap();
            assert!(text.contains(&format!("inputs/{name}")), "{list} does not list {name}");
        }
    }
    // With the maps in its folder, also for the crops of calibration images.
    run(&["verify", path(&out), "--regenerate"]);

    // Most pixels of a frame are dark.
    let file = std::io::BufReader::new(std::fs::File::open(out.join("images/frame_00000.tif")).unwrap());
    let counts = tiff::read(file, "frame", (WIDTH, HEIGHT)).unwrap();
    let near = counts.iter().zip(0..).filter(|(c, i)| (*c - offset(*i)).abs() < 30.0).count();
    assert!(near > counts.len() / 2, "{near} of {} pixels", counts.len());
}
