//! Calibration scans with known truth, for tests of `microsig fit`.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use anyhow::{Context, ensure};
use microsig_core::emission::{SpheroidLaw, sphere_points};
use microsig_core::random::{normal, poisson};
use microsig_core::render::expected::ExpectedRenderer;
use microsig_core::render::{RayRenderer, Render};
use microsig_core::sensor::Sensor;
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};
use serde_json::Value;
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::Gray16;

/// Parts of a pixel along each axis of [`SimulatedScan::mean_rays`].
const PARTS: usize = 4;

/// One particle of a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bead {
    /// Position at the mean stage position, px.
    pub x_px: f64,
    /// Position at the mean stage position, px.
    pub y_px: f64,
    /// Depth at stage position 0, um of the model.
    pub z_um: f64,
    /// Brightness.
    pub c_int: f64,
}

/// The truth of a scan.
#[derive(Debug, Clone)]
pub struct SimulatedScan {
    /// The microscope, with the size of the images.
    pub settings: Settings,
    /// Particle diameter, um.
    pub diameter_um: f64,
    /// Stage positions, um.
    pub stage_um: Vec<f64>,
    /// +1: stage positions increase away from the lens; -1: toward it.
    pub direction: f64,
    /// Physical depth over depth in the model.
    pub depth_factor: f64,
    /// Lateral drift, px per um of stage position.
    pub drift_px_per_um: [f64; 2],
    /// Direction in which the cylindrical lens has power, degrees from x toward y.
    pub rotation_deg: f64,
    /// The particles.
    pub beads: Vec<Bead>,
}

impl SimulatedScan {
    /// A spherical lens of NA 0.3 at tenfold magnification: `n` planes at steps of `step_um`, and four
    /// particles of 2 um, at different depths, on 150 x 150 px.
    pub fn tenfold(n: usize, step_um: f64) -> SimulatedScan {
        let settings = Settings {
            magnification: 10.0,
            numerical_aperture: 0.3,
            focal_length: 350.0,
            pixel_size: 6.45,
            pixel_dim_x: 150,
            pixel_dim_y: 150,
            background_mean: 350.0,
            background_noise: 10.0,
            points_per_pixel: 18.0,
            n_rays: 500,
            gain: 3.2,
            ..Settings::setting1()
        };
        let bead = |x_px, y_px, z_um, c_int| Bead { x_px, y_px, z_um, c_int };
        let middle = 0.5 * (n as f64 - 1.0);
        SimulatedScan {
            settings,
            diameter_um: 2.0,
            stage_um: (0..n).map(|i| (i as f64 - middle) * step_um).collect(),
            direction: 1.0,
            depth_factor: 1.0,
            drift_px_per_um: [0.01, -0.015],
            rotation_deg: 0.0,
            beads: vec![
                bead(40.3, 42.2, -14.0, 1.0),
                bead(108.6, 45.1, -11.5, 0.9),
                bead(44.7, 107.4, -17.0, 1.1),
                bead(110.2, 109.8, -13.2, 1.0),
            ],
        }
    }

    /// The truth of a scan in the folder: `truth.json`, `z.csv`, and the size of `scan.tif`.
    ///
    /// # Errors
    /// A file that cannot be read, or a value that is missing.
    pub fn read(folder: &Path) -> anyhow::Result<SimulatedScan> {
        let json: Value = serde_json::from_reader(File::open(folder.join("truth.json"))?)?;
        let (given, truth) = (&json["given"], &json["truth"]);
        let of = |from: &Value, key: &str| from[key].as_f64().with_context(|| format!("{key} is missing"));
        let (width, height) = crate::image_size(&folder.join("scan.tif"))?;
        let settings = Settings {
            magnification: of(given, "magnification")?,
            numerical_aperture: of(truth, "numerical_aperture")?,
            focal_length: of(truth, "focal_length")?,
            ri_medium: of(given, "ri_medium")?,
            ri_lens: of(given, "ri_lens")?,
            pixel_size: of(given, "pixel_size")?,
            pixel_dim_x: width,
            pixel_dim_y: height,
            background_mean: of(truth, "background_mean")?,
            background_noise: of(truth, "background_noise")?,
            points_per_pixel: of(truth, "points_per_pixel")?,
            n_rays: of(truth, "n_rays")? as u32,
            gain: of(truth, "gain")?,
            cyl_focal_length: of(truth, "cyl_focal_length")?,
        };
        let beads = truth["beads"].as_array().context("beads are missing")?;
        let bead = |bead: &Value| {
            Ok(Bead {
                x_px: of(bead, "x_px")?,
                y_px: of(bead, "y_px")?,
                z_um: of(bead, "z_offset_um")?,
                c_int: of(bead, "c_int")?,
            })
        };
        let mut rows = csv::Reader::from_path(folder.join("z.csv"))?;
        let stage_um = rows.deserialize::<(usize, f64)>().map(|row| Ok(row?.1));
        Ok(SimulatedScan {
            settings,
            diameter_um: of(given, "particle_diameter_um")?,
            stage_um: stage_um.collect::<anyhow::Result<_>>()?,
            direction: of(truth, "z_direction")?,
            depth_factor: of(given, "depth_factor")?,
            drift_px_per_um: [0, 1].map(|i| truth["drift_px_per_um"][i].as_f64().unwrap_or(0.0)),
            rotation_deg: of(truth, "rotation_deg")?,
            beads: beads.iter().map(bead).collect::<anyhow::Result<_>>()?,
        })
    }

    /// The particles of a plane.
    pub fn particles(&self, plane: usize) -> Vec<Particle> {
        let mean = self.stage_um.iter().sum::<f64>() / self.stage_um.len() as f64;
        let (s, [dx, dy]) = (self.stage_um[plane], self.drift_px_per_um);
        let particle = |bead: &Bead| {
            let (x, y) = (bead.x_px + dx * (s - mean), bead.y_px + dy * (s - mean));
            let z = self.direction * s / self.depth_factor + bead.z_um;
            Particle { c_int: bead.c_int, ..Particle::sphere(x, y, z, self.diameter_um) }
        };
        self.beads.iter().map(particle).collect()
    }

    /// The counts of all planes, traced with random rays and noise.
    ///
    /// # Errors
    /// Settings that cannot be rendered, such as a rotated cylindrical lens.
    pub fn planes(&self, seed: u64) -> anyhow::Result<Vec<Vec<u16>>> {
        ensure!(self.rotation_deg == 0.0, "rays cannot draw a rotated cylindrical lens");
        let renderer = RayRenderer::new(&self.settings, SpheroidLaw::Original)?;
        let (sensor, streams) = (Sensor::new(&self.settings), Streams::new(seed));
        let plane = |i: usize| {
            let light = renderer.light(&self.particles(i), &streams, Purpose::Rays, i as u32);
            let image = sensor.expose(&light, &streams, Purpose::BackgroundNoise, i as u32);
            image.counts.whole().into_owned()
        };
        Ok((0..self.stage_um.len()).map(plane).collect())
    }

    /// The mean number of rays on each pixel of all planes, whatever the direction of the cylindrical lens: a
    /// pixel is the sum of `PARTS` x `PARTS` parts, so small that their own orientation does not matter.
    ///
    /// # Errors
    /// Settings that cannot be rendered.
    pub fn mean_rays(&self) -> anyhow::Result<Vec<Vec<f64>>> {
        let Settings { pixel_dim_x: width, pixel_dim_y: height, pixel_size, n_rays, .. } = self.settings;
        let parts = PARTS as f64;
        let fine = Settings { pixel_size: pixel_size / parts, ..self.settings.clone() };
        let renderer = ExpectedRenderer::new(&fine, SpheroidLaw::Original, 3e-4)?;
        let points = sphere_points(&self.settings, self.diameter_um) as f64;
        let rays = points * (f64::from(n_rays) + 1.0);
        let (sine, cosine) = self.rotation_deg.to_radians().sin_cos();
        let place = |px: f64, part: usize| parts * px + part as f64 - 0.5 * (parts - 1.0);
        let plane = |i: usize| {
            let mut light = vec![0.0; (width * height) as usize];
            for particle in self.particles(i) {
                let of_pixel = |at: usize| {
                    let (column, row) = (at % width as usize + 1, at / width as usize + 1);
                    let (x, y) = (column as f64 - particle.x_px, row as f64 - particle.y_px);
                    (0..PARTS * PARTS).map(move |part| {
                        let (x, y) = (place(x, part % PARTS), place(y, part / PARTS));
                        [cosine * x + sine * y, cosine * y - sine * x]
                    })
                };
                let places: Vec<[f64; 2]> = (0..light.len()).flat_map(of_pixel).collect();
                let shares = renderer.shares(particle.z_um, particle.d_um, &places);
                for (light, of_pixel) in light.iter_mut().zip(shares.chunks(PARTS * PARTS)) {
                    *light += rays * particle.c_int * of_pixel.iter().sum::<f64>();
                }
            }
            light
        };
        Ok((0..self.stage_um.len()).map(plane).collect())
    }

    /// The counts of all planes for these mean numbers of rays, as of photons: Poisson numbers times the
    /// gain, with background and normal noise, rounded and clipped at 0.
    pub fn photon_planes(&self, mean_rays: &[Vec<f64>], seed: u64) -> Vec<Vec<u16>> {
        let Settings { gain, background_mean, background_noise, .. } = self.settings;
        let streams = Streams::new(seed);
        let plane = |(i, mean): (usize, &Vec<f64>)| {
            let mut stream = streams.stream(Purpose::BackgroundNoise, i as u32, 0);
            let mut count = |mean: &f64| {
                let light = gain * poisson(&mut stream, mean.max(0.0)) as f64;
                (light + background_mean + background_noise * normal(&mut stream)).round().max(0.0) as u16
            };
            mean.iter().map(&mut count).collect()
        };
        mean_rays.iter().enumerate().map(plane).collect()
    }

    /// Writes `scan.tif` and `z.csv` into a folder.
    ///
    /// # Errors
    /// Settings that cannot be rendered, or an I/O error.
    pub fn write(&self, folder: &Path, seed: u64) -> anyhow::Result<()> {
        let size = (self.settings.pixel_dim_x, self.settings.pixel_dim_y);
        write_pages(&folder.join("scan.tif"), size, &self.planes(seed)?)?;
        let mut rows = csv::Writer::from_path(folder.join("z.csv"))?;
        rows.write_record(["page", "z_um"])?;
        for (page, z_um) in self.stage_um.iter().enumerate() {
            rows.write_record([page.to_string(), z_um.to_string()])?;
        }
        Ok(rows.flush()?)
    }
}

/// Writes a TIFF of several pages of 16 bit.
///
/// # Errors
/// An I/O error.
pub fn write_pages(path: &Path, (width, height): (u32, u32), pages: &[Vec<u16>]) -> anyhow::Result<()> {
    let mut encoder = TiffEncoder::new(BufWriter::new(File::create(path)?))?;
    for page in pages {
        encoder.write_image::<Gray16>(width, height, page)?;
    }
    Ok(())
}
