//! Calibration scans with known truth, for tests of `microsig fit`.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::{RayRenderer, Render};
use microsig_core::sensor::Sensor;
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::Gray16;

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
            beads: vec![
                bead(40.3, 42.2, -14.0, 1.0),
                bead(108.6, 45.1, -11.5, 0.9),
                bead(44.7, 107.4, -17.0, 1.1),
                bead(110.2, 109.8, -13.2, 1.0),
            ],
        }
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
    pub fn planes(&self, seed: u64) -> anyhow::Result<Vec<Vec<u16>>> {
        let renderer = RayRenderer::new(&self.settings, SpheroidLaw::Original)?;
        let (sensor, streams) = (Sensor::new(&self.settings), Streams::new(seed));
        let plane = |i: usize| {
            let light = renderer.light(&self.particles(i), &streams, Purpose::Rays, i as u32);
            let image = sensor.expose(&light, &streams, Purpose::BackgroundNoise, i as u32);
            image.counts.whole().into_owned()
        };
        Ok((0..self.stage_um.len()).map(plane).collect())
    }

    /// Writes `scan.tif` and `z.csv` into a folder.
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
pub fn write_pages(path: &Path, (width, height): (u32, u32), pages: &[Vec<u16>]) -> anyhow::Result<()> {
    let mut encoder = TiffEncoder::new(BufWriter::new(File::create(path)?))?;
    for page in pages {
        encoder.write_image::<Gray16>(width, height, page)?;
    }
    Ok(())
}
