//! Calibration stacks: averages of particles of a scan, one stack or one at each of several places of the
//! field of view. The depth of an image is the position of the stage, the same at all places: a focal surface
//! that is tilted or curved is part of the calibration.

use std::path::Path;

use fit::{Level, Scan, noise_of_repeats};
use microsig_core::Particle;
use microsig_core::formats::tiff::{self, PixelScale, StackPlane};
use microsig_core::formats::{data_file, settings_file};
use microsig_core::sensor::{Counts, Image};
use rayon::prelude::*;
use storage::OutputFolder;
use storage::advice;
use storage::advice::{Advice, option};
use storage::dataset::manifest::{NoiseFacts, PlaceFacts};
use storage::dataset::{CalibrationRow, Row, ScanParticleRow, write_table};
use storage::error::{Error, Result};
use tracking::GrayImage;

use super::alignment::{Aligned, peak, sharpest};
use super::located::Located;
use super::optics::Model;
use super::particles::{MARGIN, usable};
use super::{ImportOptions, Unused, extent};

/// Number of others to which a particle is compared: the nearest ones.
const COMPARED: usize = 6;

/// Rounds of alignment. After each, particles are left out if the others do not explain this share of their
/// squared light in focus: first those that are no part of a good reference, then all that are not single.
const UNLIKE: [f64; 3] = [0.16, 0.08, 0.04];

/// A larger share is accepted if it is at most this many times the median of all; if the median is larger
/// than the second number, none is single.
const UNLIKE_MEDIAN: f64 = 2.0;
const NONE_ALIKE: f64 = 0.06;

/// Depths whose images have this share of the highest peak are in focus: there, two particles side by side
/// differ most from one.
const IN_FOCUS: f32 = 0.5;

/// Pixels by which calibration images are wider than the light of a particle, on each side.
const BEYOND_PX: usize = 3;

/// Smallest half width of calibration images, px, and least number of depths.
const LEAST_HALF: usize = 5;
const LEAST_DEPTHS: usize = 5;

#[derive(Debug)]
pub(crate) struct PlaceStack {
    pub(crate) place: PlaceFacts,
    /// Images above the background by depth, on squares with the particle on the middle pixel.
    pub(crate) images: Vec<GrayImage>,
}

#[derive(Debug)]
pub(crate) struct Stacks {
    pub(crate) depths_um: Vec<f64>,
    pub(crate) places: Vec<PlaceStack>,
    /// Whether they are at several places.
    pub(crate) is_field: bool,
    /// Mean and standard deviation of the background, counts.
    pub(crate) background: [f64; 2],
    pub(crate) unused: Unused,
    pub(crate) warnings: Vec<String>,
    /// Width and height of the frames, px.
    pub(crate) frame_px: (usize, usize),
    /// All particles of the scan.
    located: Vec<ScanParticleRow>,
}

impl Stacks {
    /// Cuts the stacks from a scan; `file` is its name in messages.
    /// Errors: a scan without single particles, or with too few depths.
    pub(crate) fn cut(scan: &Scan, file: &Path, options: &ImportOptions) -> Result<Self> {
        let name = file.display();
        let levels = scan.levels();
        if levels.len() < LEAST_DEPTHS {
            return Err(Error::input(format!(
                "{name}: {} depths: expected at least {LEAST_DEPTHS}",
                levels.len()
            )));
        }
        let located = Located::of(scan, &levels).map_err(|e| Error::input(format!("{name}: {e}")))?;
        let radii = extent::radii(scan, &levels, &located);
        let mut half = half_px(scan, &radii, options);
        let places = Places { side: options.field, size: (scan.width, scan.height) };
        let most = 3 * options.particles;
        let chosen: Vec<[f64; 2]> = (0..places.len())
            .flat_map(|place| places.nearest(place, &located.places).into_iter().take(most))
            .map(|k| located.places[k])
            .collect();
        let cut = |half: usize, radii: &[usize]| {
            usable(scan, &levels, &located, (half, radii), |at| chosen.contains(&at))
        };
        let (mut particles, mut unused) = cut(half, &radii);
        let mut warnings = Vec::new();
        // Where particles are dense, their images far from focus overlap, and the extent of one is not seen.
        let most = extent::half_spacing(&located);
        let is_wide =
            options.window_px.is_none() && most >= LEAST_HALF && radii.iter().any(|radius| *radius > most);
        if is_wide && particles.len() < options.particles.min(located.places.len()) {
            let narrow: Vec<usize> = radii.iter().map(|radius| *radius.min(&most)).collect();
            let narrow_half = half_px(scan, &narrow, options);
            let again = cut(narrow_half, &narrow);
            if again.0.len() > particles.len() {
                ((particles, unused), half) = (again, narrow_half);
                warnings.push(format!(
                    "{name}: calibration images are {} px wide, as the spacing of the particles allows: far from focus, images of \
                     particles overlap",
                    2 * half + 1
                ));
            }
        }
        if particles.is_empty() {
            return Err(Error::option(none(&name.to_string(), &located, half, unused)));
        }
        options.progress.check()?;
        let found = particles.len();
        let mut aligned: Vec<Aligned> = particles.into_par_iter().map(|p| Aligned::new(p, half)).collect();
        let repeats = levels.iter().map(|level| level.planes.len()).min().unwrap_or(1) as f64;
        align(&mut aligned, located.background_noise.powi(2) / repeats, options)?;
        unused.unlike = found - aligned.len();
        if aligned.is_empty() {
            return Err(Error::input(format!(
                "{name}: no single particle: the {found} that lie apart differ from each other by more than {} % of their light in \
                 focus, as pairs of particles side by side do; expected particles of one size, farther apart",
                100.0 * NONE_ALIKE
            )));
        }
        let mut made = Stacks {
            depths_um: levels.iter().map(|level| level.z_um).collect(),
            places: Vec::new(),
            is_field: options.field > 1,
            background: [located.background, located.background_noise],
            unused,
            warnings,
            frame_px: (scan.width, scan.height),
            located: lights(scan, &levels, &located, &radii),
        };
        made.average(&aligned, places, options, &name.to_string());
        Ok(made)
    }

    fn average(&mut self, aligned: &[Aligned], places: Places, options: &ImportOptions, name: &str) {
        let positions: Vec<[f64; 2]> = aligned.iter().map(Aligned::at).collect();
        let mut empty = Vec::new();
        for place in 0..places.len() {
            let near: Vec<usize> =
                places.nearest(place, &positions).into_iter().take(options.particles).collect();
            if near.is_empty() {
                empty.push(format!("row {}, column {}", place / places.side + 1, place % places.side + 1));
                continue;
            }
            let mean =
                |axis: usize| near.iter().map(|k| positions[*k][axis]).sum::<f64>() / near.len() as f64 + 1.0;
            let particles: Vec<&Aligned> = near.iter().map(|k| &aligned[*k]).collect();
            let images = averaged(&particles, |particle| particle.brightness * particle.brightness);
            let facts = PlaceFacts {
                place: place as u32,
                x_px: mean(0),
                y_px: mean(1),
                particles: Some(near.len() as u32),
            };
            self.places.push(PlaceStack { place: facts, images });
        }
        let mut lights: Vec<f32> = aligned.iter().map(light).collect();
        lights.sort_by(f32::total_cmp);
        equal_light(&mut self.places, lights[lights.len() / 2]);
        if aligned.len() == 1 {
            self.warnings.push(format!(
                "{name}: one particle: its stack has its noise and whatever is special about it; several particles would average both"
            ));
        }
        if !empty.is_empty() {
            self.warnings.push(format!(
                "no single particle at {} of {} places ({}): trackers use the stacks beside them",
                empty.len(),
                places.len(),
                empty.join("; ")
            ));
        }
    }

    /// Writes images, table and, with a model of the optics, settings and data files.
    pub(crate) fn write(&self, folder: &OutputFolder, um_per_px: f64, model: Option<&Model>) -> Result<()> {
        let scale = PixelScale::um_per_px(um_per_px);
        let mut rows = Vec::new();
        for stack in &self.places {
            let within =
                if self.is_field { format!("/place_{:02}", stack.place.place) } else { String::new() };
            for part in ["images", "particles"].into_iter().take(if model.is_some() { 2 } else { 1 }) {
                folder.subfolder(&format!("calibration/{part}{within}"))?;
            }
            for (step, (image, z_um)) in stack.images.iter().zip(&self.depths_um).enumerate() {
                let middle = (image.width / 2 + 1) as f64;
                let path = format!("calibration/images{within}/step_{step:04}.tif");
                let plane = StackPlane::of(&self.depths_um, step);
                self.save(folder, &path, image, &PixelScale { plane, ..scale })?;
                let mut row = CalibrationRow {
                    step: step as u32,
                    z_um: *z_um,
                    x_px: middle,
                    y_px: middle,
                    image: path,
                    place: stack.place.place,
                    place_x_px: stack.place.x_px,
                    place_y_px: stack.place.y_px,
                    ..CalibrationRow::default()
                };
                if let Some(model) = model {
                    row.particles = format!("calibration/particles{within}/step_{step:04}.txt");
                    let particle = [Particle::sphere(middle, middle, model.depth_um(*z_um), model.d_um)];
                    let path = folder.join(&row.particles);
                    let layout = data_file::Layout::of(&particle);
                    folder.save(&row.particles, |w| {
                        data_file::write(w, &particle, layout).map_err(Error::write(&path))
                    })?;
                }
                rows.push(row);
            }
        }
        if let Some(model) = model {
            let file = "calibration/settings.txt";
            let path = folder.join(file);
            folder.save(file, |w| settings_file::write(w, &model.settings).map_err(Error::write(&path)))?;
        }
        write_table(folder, &self.table(), &rows)?;
        write_table(folder, &ScanParticleRow::table(&[]), &self.located)
    }

    /// Writes an image with its background, as floating-point numbers: an average has more digits than counts.
    fn save(&self, folder: &OutputFolder, path: &str, image: &GrayImage, scale: &PixelScale) -> Result<()> {
        let counts = image.counts.iter().map(|count| count + self.background[0] as f32).collect();
        let (width, height) = (image.width as u32, image.height as u32);
        let image = Image { width, height, bits: Image::FLOAT_BITS, counts: Counts::Unrounded(counts) };
        let name = folder.join(path).display().to_string();
        folder.save(path, |writer| Ok(tiff::write(writer, &image, scale, &name)?))
    }

    /// The stack nearest to the middle of the field of view.
    pub(crate) fn central(&self) -> &PlaceStack {
        let (x, y) = (0.5 * self.frame_px.0 as f64 + 0.5, 0.5 * self.frame_px.1 as f64 + 0.5);
        let away = |stack: &&PlaceStack| (stack.place.x_px - x).hypot(stack.place.y_px - y);
        // There is at least one.
        self.places.iter().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(&self.places[0])
    }

    /// Edge of the calibration images, px.
    pub(crate) fn side_px(&self) -> u32 {
        self.central().images.first().map_or(0, |image| image.width as u32)
    }

    /// Depth of the sharpest image of a stack, um.
    pub(crate) fn focus_um(&self, stack: &PlaceStack) -> f64 {
        self.depths_um[sharpest(&stack.images)]
    }

    /// Mean over depth of the number of pixels above a tenth of the peak of the central stack, px.
    pub(crate) fn area_px(&self) -> f64 {
        let images = &self.central().images;
        let area = |image: &GrayImage| {
            let least = 0.1 * image.counts.iter().copied().fold(0.0, f32::max);
            image.counts.iter().filter(|count| **count > least).count()
        };
        images.iter().map(area).sum::<usize>() as f64 / images.len() as f64
    }
}

/// The particles with the light of their sharpest images above the background, in squares of the size of these.
fn lights(scan: &Scan, levels: &[Level], located: &Located, radii: &[usize]) -> Vec<ScanParticleRow> {
    let light = |(at, depth): (&[f64; 2], &usize)| {
        let [columns, rows] = [(at[0], scan.width), (at[1], scan.height)].map(|(at, size)| {
            let (at, reach) = (at.round() as usize, radii[*depth] + 1);
            at.saturating_sub(reach)..(at + reach + 1).min(size)
        });
        let planes = &levels[*depth].planes;
        let counts = |plane: &usize| {
            let row = |y: usize| &scan.planes[*plane][y * scan.width..(y + 1) * scan.width][columns.clone()];
            rows.clone().flat_map(row).map(|count| f64::from(*count) - located.background).sum::<f64>()
        };
        planes.iter().map(counts).sum::<f64>() / planes.len() as f64
    };
    let lights: Vec<f64> = located.places.iter().zip(&located.sharpest).map(light).collect();
    let mut sorted = lights.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    let row = |([x, y], light): (&[f64; 2], f64)| ScanParticleRow {
        x_px: x + 1.0,
        y_px: y + 1.0,
        light: light / median,
    };
    located.places.iter().zip(lights).map(row).collect()
}

/// Half width of the calibration images, px.
fn half_px(scan: &Scan, radii: &[usize], options: &ImportOptions) -> usize {
    let most = (scan.width.min(scan.height) / 2).saturating_sub(MARGIN + 1);
    let largest = radii.iter().copied().max().unwrap_or(0);
    let half = options.window_px.map_or(largest + BEYOND_PX, |width| width / 2);
    half.max(LEAST_HALF).min(most.max(1))
}

/// Aligns the particles to each other and leaves out those unlike the others.
fn align(aligned: &mut Vec<Aligned>, noise: f64, options: &ImportOptions) -> Result<()> {
    for particle in aligned.iter_mut() {
        // At brightness 1, the light over all depths is 1.
        particle.brightness = light(particle);
    }
    for unlike in UNLIKE {
        if aligned.len() < 2 {
            return Ok(());
        }
        options.progress.check()?;
        let references: Vec<Vec<GrayImage>> = (0..aligned.len())
            .into_par_iter()
            .map(|k| {
                let at = aligned[k].at();
                let away = |other: &Aligned| (other.at()[0] - at[0]).hypot(other.at()[1] - at[1]);
                let mut others: Vec<&Aligned> =
                    aligned.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, other)| other).collect();
                others.sort_by(|a, b| away(a).total_cmp(&away(b)));
                others.truncate(COMPARED);
                averaged(&others, |_| 1.0)
            })
            .collect();
        aligned.par_iter_mut().zip(&references).for_each(|(particle, reference)| {
            let peaks: Vec<f32> = reference.iter().map(peak).collect();
            let most = peaks.iter().copied().fold(0.0, f32::max);
            let in_focus: Vec<usize> = (0..peaks.len()).filter(|k| peaks[*k] >= IN_FOCUS * most).collect();
            particle.fit(reference, &in_focus, noise);
        });
        leave_out(aligned, unlike);
    }
    Ok(())
}

fn leave_out(aligned: &mut Vec<Aligned>, unlike: f64) {
    let mut shares: Vec<f64> = aligned.iter().map(|particle| particle.unexplained).collect();
    shares.sort_by(f64::total_cmp);
    let median = shares[shares.len() / 2];
    let limit = if median > NONE_ALIKE { 0.0 } else { unlike.max(UNLIKE_MEDIAN * median) };
    aligned.retain(|particle| particle.unexplained <= limit);
}

/// Sum of the light of a particle over all depths.
fn light(particle: &Aligned) -> f32 {
    let of_depth = |depth: usize| particle.image(depth).into_iter().flatten().sum::<f32>();
    (particle.brightness * (0..particle.depths()).map(of_depth).sum::<f32>()).max(1.0)
}

/// Mean stack of several particles at brightness 1; pixels that belong to neighbors of all of them are dark.
/// Weights by the square of the brightness give the least noise, equal ones keep pairs of particles, which are
/// bright, from having their way.
fn averaged(particles: &[&Aligned], weight: impl Fn(&Aligned) -> f32 + Sync) -> Vec<GrayImage> {
    let depths = particles.first().map_or(0, |particle| particle.depths());
    let average = |depth: usize| {
        let (mut sums, mut weights) = (Vec::new(), Vec::new());
        for particle in particles {
            let image = particle.image(depth);
            sums.resize(image.len(), 0.0f32);
            weights.resize(image.len(), 0.0f32);
            let weight = weight(particle);
            for (i, value) in image.into_iter().enumerate() {
                let Some(value) = value else { continue };
                sums[i] += weight * value;
                weights[i] += weight;
            }
        }
        let side = sums.len().isqrt();
        GrayImage::from_fn((side, side), |x, y| {
            let i = y * side + x;
            if weights[i] > 0.0 { sums[i] / weights[i] } else { 0.0 }
        })
    };
    (0..depths).map(average).collect()
}

/// Scales all stacks to the same light over all depths: the brightness of particles varies more than that of
/// the field of view.
fn equal_light(places: &mut [PlaceStack], light: f32) {
    for stack in places {
        let own = stack.images.iter().flat_map(|image| &image.counts).sum::<f32>();
        let factor = light / own.max(f32::MIN_POSITIVE);
        stack.images.iter_mut().flat_map(|image| &mut image.counts).for_each(|count| *count *= factor);
    }
}

/// Why no particle can be used.
fn none(name: &str, located: &Located, half: usize, unused: Unused) -> Advice {
    let (n, width) = (located.places.len(), 2 * half + 1);
    let what = format!(
        "{name}: none of {n} particles can be used with calibration images of {width} x {width} px: {} cut by the edge of the image, \
         {} too close to others, {} saturated; expected at least one; set a smaller ",
        unused.cut, unused.crowded, unused.saturated
    );
    advice!(what, option("window_px"), ", leave out the planes farthest from focus, or reduce the exposure")
}

/// The noise of a frame of the scan, whose background has this mean and standard deviation.
pub(crate) fn noise_of_scan(scan: &Scan, background: [f64; 2]) -> NoiseFacts {
    let repeats = scan.levels().iter().map(|level| level.planes.len()).max().unwrap_or(1) as u32;
    let (variance, definition) = match noise_of_repeats(scan, background[0]) {
        Some(variance) => (
            variance,
            "variance of each pixel over repeated frames of a plane against its mean signal above the background, fitted \
             over classes of signal",
        ),
        None => (
            vec![background[1] * background[1]],
            "variance of the background over pixels; the scan has no repeated frames, which would show how noise grows with \
             the signal",
        ),
    };
    NoiseFacts { background_counts: background[0], variance, repeats, definition: definition.to_owned() }
}

/// A grid of places over the images.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Places {
    /// Places along each side.
    pub(crate) side: usize,
    /// Width and height of the images, px.
    pub(crate) size: (usize, usize),
}

impl Places {
    /// Number of places.
    pub(crate) fn len(&self) -> usize {
        self.side * self.side
    }

    /// Center of a place, px from 0.
    pub(crate) fn center(&self, place: usize) -> [f64; 2] {
        let along = |i: usize, size: usize| size as f64 * (i as f64 + 0.5) / self.side as f64 - 0.5;
        [along(place % self.side, self.size.0), along(place / self.side, self.size.1)]
    }

    /// The place whose rectangle contains a position.
    pub(crate) fn of(&self, at: [f64; 2]) -> usize {
        let along = |v: f64, size: usize| {
            (((v + 0.5) / size as f64 * self.side as f64).max(0.0) as usize).min(self.side - 1)
        };
        along(at[1], self.size.1) * self.side + along(at[0], self.size.0)
    }

    /// Indices of positions in the rectangle of a place, nearest to its center first.
    pub(crate) fn nearest(&self, place: usize, positions: &[[f64; 2]]) -> Vec<usize> {
        let center = self.center(place);
        let away = |i: &usize| (positions[*i][0] - center[0]).hypot(positions[*i][1] - center[1]);
        let mut inside: Vec<usize> =
            (0..positions.len()).filter(|i| self.of(positions[*i]) == place).collect();
        inside.sort_by(|a, b| away(a).total_cmp(&away(b)));
        inside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_belong_to_the_place_around_them() {
        let places = Places { side: 3, size: (300, 150) };
        assert_eq!(places.center(4), [149.5, 74.5]);
        for place in 0..places.len() {
            assert_eq!(places.of(places.center(place)), place);
        }
        assert_eq!((places.of([-0.5, -0.5]), places.of([299.4, 149.4])), (0, 8));
        assert_eq!(places.nearest(0, &[[10.0, 10.0], [40.0, 30.0], [200.0, 10.0]]), [1, 0]);
    }
}
