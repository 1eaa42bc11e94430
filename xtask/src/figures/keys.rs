//! The reference of all keys, `docs/scenario.md`, with pictures of what single keys do to the image.

use std::io::BufWriter;
use std::path::Path;

use anyhow::Context;
use bench::dataset::manifest::MANIFEST;
use bench::runner::{GenerateOptions, Progress, generate};
use bench::scenario::{self, assignment, effects};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{GrayImage, imageops};
use microsig_core::formats::tiff;
use microsig_core::sensor::Image;

use crate::picture::{quantile, side_by_side, stretch};

/// Screen pixels for one pixel of a picture.
const ZOOM: u32 = 2;

/// Depths of the particles of the ladder: far below focus, in focus, above; x and y in px, z and diameter in um.
const PLACES: &str = "30 33 -70 2\n80 33 -25 2\n122 33 15 2\n";

/// Writes the document below `docs`, and the pictures that are not there yet, or all of them.
pub(super) fn run(docs: &Path, redraw: bool) -> anyhow::Result<()> {
    let folder = docs.join("scenario");
    std::fs::create_dir_all(&folder)?;
    let path = docs.join("scenario.md");
    std::fs::write(&path, scenario::reference::document()?)?;
    let wanted = |effect: &&effects::Effect| redraw || !folder.join(effect.file()).exists();
    let mut drawn = 0;
    for effect in effects::EFFECTS.iter().filter(wanted) {
        let path = folder.join(effect.file());
        drawn += 1;
        let picture = picture(effect).with_context(|| effect.path)?;
        let file = BufWriter::new(std::fs::File::create(&path).with_context(|| path.display().to_string())?);
        // Zoomed rows repeat, which the filter makes nothing of.
        picture.write_with_encoder(PngEncoder::new_with_quality(
            file,
            CompressionType::Best,
            FilterType::Up,
        ))?;
    }
    println!("{}: {drawn} pictures drawn", path.display());
    Ok(())
}

/// All pictures of an effect on one grey scale.
fn picture(effect: &effects::Effect) -> anyhow::Result<GrayImage> {
    let images: Vec<Image> =
        effect.pictures.iter().map(|sets| image(effect.scene, sets)).collect::<anyhow::Result<_>>()?;
    let black = images.iter().map(|i| quantile(i, 0.01)).fold(f64::INFINITY, f64::min);
    let white = images.iter().map(|i| quantile(i, 0.998)).fold(black + 1.0, f64::max);
    let tiles: Vec<GrayImage> = images.iter().map(|image| lifted(stretch(image, black, white))).collect();
    let strip = side_by_side(&tiles);
    let (width, height) = strip.dimensions();
    Ok(imageops::resize(&strip, width * ZOOM, height * ZOOM, imageops::FilterType::Nearest))
}

/// Square roots of the grey levels: rings are far fainter than spots.
fn lifted(mut picture: GrayImage) -> GrayImage {
    for pixel in picture.pixels_mut() {
        pixel.0[0] = (f64::from(pixel.0[0]) * 255.0).sqrt().round() as u8;
    }
    picture
}

/// A background for the ladder: brighter to the right, with three smudges.
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
    Image { width, height, bits: 16, counts }
}

/// A frame of a scene with some values replaced.
fn image(scene: effects::Scene, sets: &str) -> anyhow::Result<Image> {
    let place = tempfile::tempdir()?;
    std::fs::write(place.path().join("places.txt"), PLACES)?;
    let (size, particles) = match scene {
        effects::Scene::Ladder => ((150, 66), "number: file(\"places.txt\")"),
        effects::Scene::Cloud => ((150, 110), "number: count(14)"),
        effects::Scene::Dense | effects::Scene::Later => ((150, 110), "number: ppp(0.008)"),
        effects::Scene::Fast => ((150, 110), "number: count(14)"),
    };
    let file = std::fs::File::create(place.path().join("background.tif"))?;
    let scale = tiff::PixelScale { um_per_px: 1.0, frame_interval_s: None };
    tiff::write(file, &background(size), &scale, "background.tif")?;
    // Particles of one plane move alike.
    let range = if scene == effects::Scene::Fast { "(-30, -20)" } else { "(-80, 20)" };
    let text = format!(
        "(name: \"effect\", seed: 4, optics: (preset: setting1, pixel_dim_x: {}, pixel_dim_y: {}), \
         motion: flow(field: poiseuille(walls_z_um: (-80, 20), max_speed_um_s: 1000)), particles: ({particles}), \
         boundaries: (z_um: {range}), timing: pairs(count: 1, dt_s: 0.1), calibration: none)",
        size.0, size.1
    );
    let mut spec = scenario::parse(&text, "effect")?;
    for set in sets.split(';') {
        let (path, value) = assignment(set)?;
        spec = scenario::set(&spec, path, value)?;
    }
    let scenario = scenario::resolve(spec, place.path())?;
    let out = place.path().join("dataset");
    generate(
        &scenario,
        &GenerateOptions { out: out.clone(), force: false, resume: false, progress: Progress::Hidden },
    )?;
    anyhow::ensure!(out.join(MANIFEST).is_file(), "a dataset has a manifest");
    let role = if scene == effects::Scene::Later { "b" } else { "a" };
    let frame = out.join(format!("images/pair_00000_{role}.tif"));
    let counts = tiff::read(std::io::BufReader::new(std::fs::File::open(&frame)?), "effect", size)?;
    Ok(Image {
        width: size.0,
        height: size.1,
        bits: 16,
        counts: counts.into_iter().map(|count| count as u16).collect(),
    })
}
