//! The reference of all keys, `docs/scenario.md` and `docs/scenario/`, with pictures of the effects of single keys.

use std::io::BufWriter;
use std::path::Path;

use anyhow::Context;
use generator::runner::{GenerateOptions, generate};
use image::GrayImage;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use microsig_core::formats::tiff;
use microsig_core::sensor::{Counts, Image};
use scenario::{self, Assignment, Picture, Scene};
use storage::Progress;
use storage::dataset::manifest::MANIFEST;

use suite::picture::{magnified, quantile, side_by_side, stretch};

/// Magnification of pictures: screen pixels per pixel.
const ZOOM: u32 = 2;

/// Particles of the scene `Ladder` far below, in, and above focus: x and y in px, z and diameter in um.
const PLACES: &str = "30 33 -70 2\n80 33 -25 2\n122 33 15 2\n";

/// Writes the document below `docs`, and missing pictures, or all with `redraw`.
pub(super) fn run(docs: &Path, redraw: bool) -> anyhow::Result<()> {
    let folder = docs.join("scenario");
    std::fs::create_dir_all(&folder)?;
    let path = docs.join("scenario.md");
    let pictures = Picture::list(&std::fs::read_to_string(folder.join("pictures.ron"))?)?;
    for page in scenario::document(&pictures)? {
        std::fs::write(docs.join(page.file), page.text)?;
    }
    let wanted = |picture: &&Picture| redraw || !folder.join(picture.file()).exists();
    let mut drawn = 0;
    for wanted in pictures.iter().filter(wanted) {
        let path = folder.join(wanted.file());
        drawn += 1;
        let picture = picture(wanted).with_context(|| wanted.key.clone())?;
        let file = BufWriter::new(std::fs::File::create(&path).with_context(|| path.display().to_string())?);
        // The filter `Up` compresses the repeated rows of magnified pictures.
        picture.write_with_encoder(PngEncoder::new_with_quality(
            file,
            CompressionType::Best,
            FilterType::Up,
        ))?;
    }
    println!("{}: {drawn} pictures drawn", path.display());
    Ok(())
}

/// All images of a picture with a common gray scale.
fn picture(picture: &Picture) -> anyhow::Result<GrayImage> {
    let images: Vec<Image> =
        picture.images.iter().map(|sets| image(picture.scene, sets)).collect::<anyhow::Result<_>>()?;
    let black = images.iter().map(|i| quantile(i, 0.01)).fold(f64::INFINITY, f64::min);
    let white = images.iter().map(|i| quantile(i, 0.998)).fold(black + 1.0, f64::max);
    let tiles: Vec<GrayImage> = images.iter().map(|image| lifted(stretch(image, black, white))).collect();
    Ok(magnified(&side_by_side(&tiles), ZOOM))
}

/// Takes the square root of gray levels, since rings are much fainter than focused images.
fn lifted(mut picture: GrayImage) -> GrayImage {
    for pixel in picture.pixels_mut() {
        pixel.0[0] = (f64::from(pixel.0[0]) * 255.0).sqrt().round() as u8;
    }
    picture
}

/// A background image: brighter to the right, with three dark spots.
fn background((width, height): (u32, u32)) -> Image {
    let smudges = [(20.0, 12.0, 6.0), (75.0, 50.0, 9.0), (130.0, 20.0, 5.0)];
    let at = |x: f64, y: f64| {
        let light: f64 = smudges
            .iter()
            .map(|(x0, y0, r)| -150.0 * (-((x - x0).powi(2) + (y - y0).powi(2)) / (r * r)).exp())
            .sum();
        (200.0 + 2.0 * x + light).round() as u16
    };
    let counts = (0..width * height).map(|i| at(f64::from(i % width), f64::from(i / width))).collect();
    Image { width, height, bits: 16, counts: Counts::Whole(counts) }
}

/// A frame of a scene with some keys changed.
fn image(scene: Scene, sets: &str) -> anyhow::Result<Image> {
    let place = tempfile::tempdir()?;
    std::fs::write(place.path().join("places.txt"), PLACES)?;
    let (size, particles) = match scene {
        Scene::Ladder => ((150, 66), "number: file(\"places.txt\")"),
        Scene::Channel => ((150, 110), "number: count(14)"),
        Scene::Dense | Scene::Later => ((150, 110), "number: ppp(0.008)"),
        Scene::Fast => ((150, 110), "number: count(14)"),
    };
    let file = std::fs::File::create(place.path().join("background.tif"))?;
    let scale = tiff::PixelScale::um_per_px(1.0);
    tiff::write(file, &background(size), &scale, "background.tif")?;
    // A thin range of depths, so that all particles move equally.
    let range = if scene == Scene::Fast { "(-30, -20)" } else { "(-80, 20)" };
    let text = format!(
        "(name: \"effect\", seed: 4, optics: (preset: setting1, pixel_dim_x: {}, pixel_dim_y: {}), \
         motion: flow(field: poiseuille(walls_z_um: (-80, 20), max_speed_um_s: 1000)), particles: ({particles}), \
         boundaries: (z_um: {range}), timing: pairs(count: 1, dt_s: 0.1), calibration: none)",
        size.0, size.1
    );
    let mut spec = scenario::parse(&text, "effect")?;
    for set in sets.split(';') {
        let Assignment { path, value } = set.parse()?;
        spec = scenario::set(&spec, &path, &value)?;
    }
    let scenario = scenario::resolve(spec, place.path(), &microsig_core::render::Context::default())?;
    let out = place.path().join("dataset");
    generate(
        &scenario,
        &GenerateOptions { out: out.clone(), force: false, resume: false, progress: Progress::default() },
    )?;
    anyhow::ensure!(out.join(MANIFEST).is_file(), "a dataset has a manifest");
    let role = if scene == Scene::Later { "b" } else { "a" };
    let frame = out.join(format!("images/pair_00000_{role}.tif"));
    let counts = tiff::read(std::io::BufReader::new(std::fs::File::open(&frame)?), "effect", size)?;
    Ok(Image {
        width: size.0,
        height: size.1,
        bits: 16,
        counts: Counts::Whole(counts.into_iter().map(|count| count as u16).collect()),
    })
}
