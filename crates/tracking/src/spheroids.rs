//! Trackers of spheroids: what `ncc` and `mle` have in common, and `mle --shape spheroid`.
//!
//! Templates of several axes find the particles, which are then matched with images at all axes and depths
//! (`shape_correlation`). `mle` also fits each of them with the others subtracted (`shape_fit`), overlapping ones in turn
//! until they no longer move. An aspect ratio that is not given
//! is taken to be common to all particles. It is the median over those whose images are the clearest: the image of two
//! overlapping particles resembles one long rod's.

use std::collections::BTreeMap;
use std::sync::Arc;

use microsig_core::cancel::checkpoint;
use microsig_core::visibility::vertex;
use rayon::prelude::*;

use super::denoise::PixelNoise;
use super::fit::Residual;
use super::gray_image::GrayImage;
use super::job::Job;
use super::locate::{self, Coarse};
use super::mle::{self, COARSE, FINE, OfSpheroids, ShapeImages};
use super::opposite::Opposite;
use super::output::Output;
use super::shape_correlation::{self, Match};
use super::shape_fit::{Fit, Fitted, Pose, Region, Uncertainty, is_particle};
use super::shape_table::ShapeTable;
use super::shape_templates::{ShapeTemplates, angle, mirrored};
use super::{AspectRatio, Localization, ParticleShape, ShapeEstimate, ShapeUncertainty};
use storage::NumberRange;
use storage::error::Result;

/// Number of depths of the templates; and if there are several aspect ratios.
const DEPTHS: usize = 40;
const DEPTHS_OF_STARTS: usize = 20;

/// Templates of the search: number of axes and of depths.
const AXES_OF_SEARCH: usize = 12;
const DEPTHS_OF_SEARCH: usize = 13;

/// Aspect ratios of templates if it is not known.
const ASPECTS: [f64; 4] = [0.25, 0.5, 2.0, 4.0];

/// Rounds over overlapping particles.
const ROUNDS: usize = 3;

/// Frames and particles by which a common aspect ratio is measured.
const SAMPLED_FRAMES: usize = 4;
const SAMPLED: usize = 24;

/// Step of the logarithm of the aspect ratio between tables, and how many of them are the first step to the best.
const ASPECT_STEP: f64 = std::f64::consts::LN_2 / 8.0;
const FIRST_STEP: i32 = 4;

/// Up to this number of particles, one at a wrong orientation would decide about the tables that are compared, so that the aspect
/// ratio of each is fitted.
const FEW: usize = 8;

/// Measurements with tables of the last result, and the change of the logarithm at which they end.
const ASPECT_ROUNDS: usize = 4;
const NEAR_ASPECT: f64 = 0.01;

/// Relative error of an aspect ratio that its standard deviation may lack: of overlapping particles. It limits their weight.
const ASPECT_ERROR: f64 = 0.02;

/// Standard deviation of the median of normal deviates over that of their mean, and of a normal distribution over its median
/// absolute deviation.
const OF_MEDIAN: f64 = 1.253;
const OF_ABSOLUTE: f64 = 1.483;

/// What trackers know of the aspect ratio.
#[derive(Debug, Clone, Copy)]
enum Known {
    Given(f64),
    /// Common to all particles, with its standard deviation.
    Measured(f64, f64),
    /// Each particle has its own.
    No,
}

/// The particles of a frame by correlation: correlation coefficients and poses, of each the best matches, best first; the
/// frame without its background; and what fits in it have in common.
struct Matched<'a> {
    particles: Vec<(f64, Vec<Pose>)>,
    counts: Vec<f32>,
    fit: Fit<'a>,
}

/// A particle with which few others overlap, and its matches.
struct Clear<'a> {
    fit: Fit<'a>,
    region: Region,
    starts: Vec<Pose>,
    /// By a fit, unless aspect ratios are measured by tables.
    aspect: Option<Aspect>,
}

/// Logarithm of the aspect ratio of one particle, its standard deviation, and chi^2 per pixel.
struct Aspect {
    logarithm: f64,
    deviation: f64,
    misfit: f64,
}

/// The aspect ratio of all particles with its standard deviation.
#[derive(Clone, Copy)]
struct CommonAspect {
    value: f64,
    deviation: f64,
    /// Number of particles that measure it.
    particles: usize,
    /// Whether it is the best of tables, not fitted yet by exact images.
    by_tables: bool,
}

/// Fits of particles with one aspect ratio: poses and chi^2.
struct Compared {
    fits: Vec<Option<(Pose, f64)>>,
}

impl Compared {
    /// Logarithms of chi^2, so that overlapping particles, which none fits, decide no more than others.
    fn cost(&self) -> f64 {
        self.fits.iter().flatten().map(|(_, chi2)| chi2.ln()).sum()
    }

    fn poses(&self) -> Vec<Vec<Pose>> {
        self.fits.iter().map(|fit| fit.iter().map(|(pose, _)| *pose).collect()).collect()
    }
}

/// The aspect ratio whose logarithm is this many steps.
fn aspect_at(step: i32) -> f64 {
    (f64::from(step) * ASPECT_STEP).exp()
}

impl Clear<'_> {
    /// The matches, and the same tilted the other way.
    fn both_tilts(&self) -> Vec<Pose> {
        let both = |pose: &Pose| [*pose, Pose { axis: mirrored(pose.axis), ..*pose }];
        self.starts.iter().flat_map(both).collect()
    }
}

/// The particles of a recording.
pub(super) struct Spheroids {
    images: ShapeImages,
    templates: ShapeTemplates,
    /// Images of each aspect ratio of the templates.
    tables: Vec<Option<Arc<ShapeTable>>>,
    coarse: Coarse,
    opposite: Opposite,
    known: Known,
}

impl Known {
    /// Standard deviation of the logarithm of what is known.
    fn deviation(self) -> f64 {
        if let Known::Measured(aspect, deviation) = self { deviation / aspect } else { 0.0 }
    }
}

impl Spheroids {
    pub(super) fn new(job: &Job, aspect: AspectRatio) -> Result<Self> {
        let busy = job.options.progress.spinner("images of spheroids");
        let made = Spheroids::prepared(job, aspect);
        busy.finish();
        made
    }

    fn prepared(job: &Job, aspect: AspectRatio) -> Result<Self> {
        let aspects = match aspect {
            AspectRatio::Given(aspect) => vec![aspect],
            AspectRatio::Common | AspectRatio::Each => ASPECTS.to_vec(),
        };
        let OfSpheroids { images, noise } = mle::shape_images(job, longest(&aspects))?;
        let known = if let AspectRatio::Given(aspect) = aspect { Known::Given(aspect) } else { Known::No };
        let all = Spheroids::with(images, aspects, noise, known);
        if aspect != AspectRatio::Common {
            return Ok(all);
        }
        let Some(mut measured) = all.common_aspect(job)? else {
            job.warn("no particle shows the aspect ratio; each is taken to have its own");
            return Ok(all);
        };
        let tabled = |images: ShapeImages, CommonAspect { value, deviation, .. }: CommonAspect| {
            Spheroids::with(
                images.up_to(longest(&[value])),
                vec![value],
                noise,
                Known::Measured(value, deviation),
            )
        };
        let (rounds, mut all) =
            (if measured.by_tables { ASPECT_ROUNDS } else { 0 }, tabled(all.images, measured));
        // Now by exact images, again with a table of the result if that is not near the last.
        for _ in 0..rounds {
            let Some(next) = all.common_aspect(job)? else { break };
            let change = (next.value / measured.value).ln().abs();
            measured = next;
            if change < NEAR_ASPECT {
                all.templates.aspects[0] = measured.value;
                break;
            }
            all = tabled(all.images, measured);
        }
        let CommonAspect { value, deviation, particles, .. } = measured;
        all.known = Known::Measured(value, deviation);
        job.note(format!("an aspect ratio of {value:.3} +- {deviation:.3} by {particles} of the particles"));
        Ok(all)
    }

    fn with(images: ShapeImages, aspects: Vec<f64>, noise: PixelNoise, known: Known) -> Self {
        let (nodes, depths) = match known {
            Known::No => (COARSE, DEPTHS_OF_STARTS),
            Known::Given(_) | Known::Measured(..) => (FINE, DEPTHS),
        };
        let tables: Vec<_> = aspects.iter().map(|e_p| images.tabled(*e_p, nodes)).collect();
        let templates = ShapeTemplates::new(&images, aspects, &tables, depths);
        let images = match known {
            Known::Given(_) | Known::Measured(..) => images.with_table(tables[0].clone()),
            Known::No => images,
        };
        let opposite = Opposite::new(templates.depths_um.clone(), &templates.means);
        let coarse = Coarse::for_shapes(templates.over_axes(AXES_OF_SEARCH, DEPTHS_OF_SEARCH, noise), noise);
        Spheroids { images, templates, tables, coarse, opposite, known }
    }

    /// The particles of a frame by correlation.
    fn matched(&self, frame: &GrayImage) -> Matched<'_> {
        let found = self.coarse.find(frame, None);
        let counts: Vec<f32> = frame.counts.iter().map(|counts| counts - found.level).collect();
        let image = GrayImage { counts: counts.clone(), ..*frame };
        let weight = locate::weights(&image, found.noise, shape_correlation::IMAGE_ERROR);
        let places = found.particles.iter().map(|fit| fit.at).filter(|at| frame.contains(*at));
        let all = shape_correlation::in_frame(Residual { image, weight }, &self.templates, places);
        let particles = all.iter().map(|of| (of[0].correlation, self.poses(of))).collect();
        let aspect = match self.known {
            Known::Given(aspect) | Known::Measured(aspect, _) => Some(aspect),
            Known::No => None,
        };
        let (images, opposite, noise) = (&self.images, &self.opposite, found.noise);
        let size = [frame.width as isize, frame.height as isize];
        Matched { particles, counts, fit: Fit { images, opposite, aspect, noise, size } }
    }

    fn poses(&self, matches: &[Match]) -> Vec<Pose> {
        matches.iter().map(|found| found.pose(&self.templates)).collect()
    }

    /// The aspect ratio to report for a particle, and its standard deviation.
    fn reported(&self, own: f64, deviation: f64) -> Option<(f64, f64)> {
        match self.known {
            Known::Given(_) => None,
            Known::Measured(aspect, deviation) => Some((aspect, deviation)),
            Known::No => Some((own, deviation)),
        }
    }

    /// Median of the aspect ratios of particles that are fitted well, its standard deviation, and their number.
    fn common_aspect(&self, job: &Job) -> Result<Option<CommonAspect>> {
        let all = job.recording.frames();
        let frames = all.min(SAMPLED_FRAMES);
        let clearest = |by_tables: bool| -> Result<Vec<Clear>> {
            let in_frame = |k: usize| -> Result<Vec<Clear>> {
                let frame = job.recording.frame(k * all / frames)?;
                Ok(self.clearest(&frame, SAMPLED.div_ceil(frames), by_tables))
            };
            let found = (0..frames).into_par_iter().map(in_frame).collect::<Result<Vec<_>>>()?;
            Ok(found.into_iter().flatten().collect())
        };
        let mut by_tables = self.images.can_have_tables() && !self.images.has_table();
        let mut clear = clearest(by_tables)?;
        if by_tables && clear.len() <= FEW {
            by_tables = false;
            clear = clearest(false)?;
        }
        let mut measured = match by_tables {
            true => self.aspects_by_tables(&clear),
            false => clear.into_iter().filter_map(|of| of.aspect).collect(),
        };
        // Worse than these are overlapping particles that were taken for one.
        measured.sort_by(|a, b| a.misfit.total_cmp(&b.misfit));
        measured.truncate(measured.len().div_ceil(2));
        let measured = measured.iter().map(|one| (one.logarithm, one.deviation));
        let measured: Vec<(f64, f64)> = measured.collect();
        let weight = |deviation: f64| 1.0 / (deviation.powi(2) + ASPECT_ERROR.powi(2));
        let weighted = |of: &dyn Fn(f64) -> f64| {
            weighted_median(
                measured.iter().map(|(value, deviation)| (of(*value), weight(*deviation))).collect(),
            )
        };
        let Some(middle) = weighted(&|value| value) else { return Ok(None) };
        let n = measured.len();
        let median_factor = if n == 1 { 1.0 } else { OF_MEDIAN };
        // By the scatter, but not less than by the fits themselves.
        let away = weighted(&|value| (value - middle).abs()).unwrap_or(0.0);
        let scatter = median_factor * OF_ABSOLUTE * away / (n as f64).sqrt();
        let weights: f64 = measured.iter().map(|(_, deviation)| weight(*deviation)).sum();
        let variances: f64 =
            measured.iter().map(|(_, deviation)| (weight(*deviation) * deviation).powi(2)).sum();
        let deviation = scatter.max(median_factor * variances.sqrt() / weights);
        let value = middle.exp();
        Ok(Some(CommonAspect { value, deviation: value * deviation, particles: n, by_tables }))
    }

    /// The aspect ratio of a particle by a fit of it, or by a last step from a fit with that of a table.
    fn aspect(&self, fit: &Fit, residual: &[f32], fitted: Fitted) -> Option<Aspect> {
        let fitted = if self.images.has_table() { fit.with_aspect(residual, fitted)? } else { fitted };
        let (e_p, NumberRange { least, most, .. }) = (fitted.pose().e_p, ParticleShape::ASPECTS);
        let deviation = fitted.uncertainty(0.0)?.deviations[3];
        let aspect = Aspect { logarithm: e_p.ln(), deviation, misfit: fitted.misfit };
        (e_p > least && e_p < most).then_some(aspect)
    }

    /// The `most` particles of a frame that correlate best, with their aspect ratios unless these are measured by tables.
    fn clearest(&self, frame: &GrayImage, most: usize, by_tables: bool) -> Vec<Clear<'_>> {
        let Matched { fit, counts: mut residual, mut particles } = self.matched(frame);
        particles.sort_by(|a, b| b.0.total_cmp(&a.0));
        particles.iter().for_each(|(_, of)| fit.add(&mut residual, &of[0], -1.0));
        let clear = particles.into_iter().take(most).map(|(_, starts)| {
            fit.add(&mut residual, &starts[0], 1.0);
            let region = fit.region(&residual, &starts[0]);
            let aspect = match by_tables {
                true => None,
                false => fit.best(&residual, &starts).and_then(|fitted| self.aspect(&fit, &residual, fitted)),
            };
            fit.add(&mut residual, &starts[0], -1.0);
            Clear { fit, region, starts, aspect }
        });
        clear.collect()
    }

    /// Fits of all particles with the same aspect ratio, of this logarithm in steps, each the best from its starts.
    fn compared(&self, clearest: &[Clear], step: i32, starts: &[Vec<Pose>]) -> Compared {
        let e_p = aspect_at(step);
        let is_same = |other: &f64| (other / e_p - 1.0).abs() < 1e-9;
        let table = match self.templates.aspects.iter().position(is_same) {
            Some(i) => self.tables[i].clone(),
            None => self.images.tabled(e_p, FINE),
        };
        let images = self.images.clone().with_table(table);
        let best = |(of, starts): (&Clear, &Vec<Pose>)| {
            let fit = Fit { images: &images, aspect: Some(e_p), ..of.fit };
            let fits = starts.iter().filter_map(|pose| fit.drafted(&of.region, &Pose { e_p, ..*pose }));
            fits.min_by(|a, b| a.1.total_cmp(&b.1))
        };
        Compared { fits: clearest.par_iter().zip(starts).map(best).collect() }
    }

    /// The aspect ratios of particles by fits with tables of several, the same for all particles: from the most frequent match in
    /// smaller and smaller steps to the best, then for each particle by a parabola through its chi^2.
    fn aspects_by_tables(&self, clearest: &[Clear]) -> Vec<Aspect> {
        let matches = clearest.iter().map(|of| (of.starts[0].e_p.ln() / ASPECT_STEP, 1.0));
        let Some(first) = weighted_median(matches.collect()) else { return Vec::new() };
        let starts: Vec<Vec<Pose>> = clearest.iter().map(Clear::both_tilts).collect();
        let mut best = first.round() as i32;
        let mut tried = BTreeMap::from([(best, self.compared(clearest, best, &starts))]);
        let better = |at: i32, than: i32, tried: &mut BTreeMap<i32, Compared>| {
            if !tried.contains_key(&at) {
                let compared = self.compared(clearest, at, &tried[&than].poses());
                tried.insert(at, compared);
            }
            if tried[&at].cost() < tried[&than].cost() { at } else { than }
        };
        let range = ParticleShape::ASPECTS.least..=ParticleShape::ASPECTS.most;
        for step in [FIRST_STEP, 1] {
            loop {
                let here = best;
                for at in [here - step, here + step].into_iter().filter(|at| range.contains(&aspect_at(*at)))
                {
                    best = better(at, best, &mut tried);
                }
                if best == here {
                    break;
                }
            }
            let costs = [best - step, best, best + step].map(|at| tried.get(&at).map(|of| -of.cost()));
            if let [Some(low), Some(middle), Some(high)] = costs {
                let off = (vertex([low, middle, high]).0 * f64::from(step)).round() as i32;
                best = better(best + off, best, &mut tried);
            }
        }
        let chi2 = |at: i32, i: usize| Some(tried.get(&at)?.fits[i]?.1);
        let vertex = |(i, of): (usize, &Clear)| {
            let [low, middle, high] = [chi2(best - 1, i)?, chi2(best, i)?, chi2(best + 1, i)?];
            let curvature = low - 2.0 * middle + high;
            let off = (0.5 * (low - high) / curvature).clamp(-4.0, 4.0);
            (curvature > 0.0).then(|| Aspect {
                logarithm: (f64::from(best) + off) * ASPECT_STEP,
                deviation: ASPECT_STEP * (2.0 / curvature).sqrt(),
                misfit: middle / of.region.pixels() as f64,
            })
        };
        clearest.iter().enumerate().filter_map(vertex).collect()
    }

    /// The particles of a frame by correlation.
    pub(super) fn correlated(&self, frame: &GrayImage) -> Vec<Localization> {
        let best_fit = |starts: Vec<Pose>| {
            let Pose { at, z_um, axis, e_p, .. } = starts[0];
            let aspect = self.reported(e_p, f64::NAN).map(|(aspect, _)| aspect);
            let shape = Some(ShapeEstimate { axis, aspect, uncertainty: None });
            let [x_px, y_px] = at.map(|at| at + 1.0);
            Localization { x_px, y_px, z_um: Some(z_um), shape, ..Localization::default() }
        };
        self.matched(frame).particles.into_iter().map(|(_, starts)| best_fit(starts)).collect()
    }

    /// The particles of a frame by maximum likelihood.
    fn fitted(&self, frame: &GrayImage) -> Vec<Localization> {
        let Matched { fit, counts: mut residual, particles } = self.matched(frame);
        let drafts = drafts(&fit, &mut residual, &particles);
        let mut found = Vec::new();
        for draft in drafts {
            fit.add(&mut residual, &draft, 1.0);
            if let Some(fitted) = fit.best(&residual, &[draft]) {
                fit.add_fitted(&mut residual, &fitted, -1.0);
                found.push(fitted);
            }
        }
        settle(&fit, &mut residual, &mut found);
        let inside = |found: &&Fitted| {
            let pose = found.pose();
            frame.contains(pose.at) && is_particle(found.chi2_reduction, pose.brightness)
        };
        found.iter().filter(inside).filter_map(|found| self.localization(found)).collect()
    }

    fn localization(&self, fitted: &Fitted) -> Option<Localization> {
        let Uncertainty { deviations: [x, y, z, by_aspect], turns: [u, v], covariance } =
            fitted.uncertainty(self.known.deviation())?;
        let [uu, vv, uv] = covariance;
        let (mean, half) = (0.5 * (uu + vv), (0.25 * (uu - vv).powi(2) + uv * uv).sqrt());
        let turn = 0.5 * (2.0 * uv).atan2(uu - vv);
        let Pose { at, z_um, axis, e_p, .. } = *fitted.pose();
        let (aspect, aspect_sd) = self.reported(e_p, e_p * by_aspect).unzip();
        let shape = ShapeEstimate {
            axis,
            aspect,
            uncertainty: Some(ShapeUncertainty {
                axis_deviations: [(mean + half).sqrt(), (mean - half).max(0.0).sqrt()],
                uncertain: turn.cos() * u + turn.sin() * v,
                other: fitted.other,
                aspect: aspect_sd.unwrap_or(f64::NAN),
            }),
        };
        let ([x_px, y_px], deviations) = (at.map(|at| at + 1.0), Some([x, y, z]));
        let (z_um, shape) = (Some(z_um), Some(shape));
        Some(Localization { x_px, y_px, z_um, deviations, shape, ..Localization::default() })
    }
}

/// Tracks spheroids by maximum likelihood.
pub(super) fn particles(job: &Job, aspect: AspectRatio) -> Result<Output> {
    let spheroids = Spheroids::new(job, aspect)?;
    job.particles(|_, image| spheroids.fitted(image))
}

/// Fits by drafts of the images, subtracted from the residual, without the ghosts: light that the matches left beside a
/// particle fades as that is fitted.
fn drafts(fit: &Fit, residual: &mut [f32], particles: &[(f64, Vec<Pose>)]) -> Vec<Pose> {
    particles.iter().for_each(|(_, of)| fit.add(residual, &of[0], -1.0));
    let mut drafts = Vec::new();
    for (_, starts) in particles {
        fit.add(residual, &starts[0], 1.0);
        let draft = fit.draft(residual, starts);
        if let Some(draft) = draft.filter(|draft| fit.is_particle(residual, draft)) {
            fit.add(residual, &draft, -1.0);
            drafts.push(draft);
        }
    }
    drafts
}

/// Fits overlapping particles in turn, each with the others subtracted, until they no longer move.
fn settle(fit: &Fit, residual: &mut [f32], found: &mut [Fitted]) {
    for _ in 1..ROUNDS {
        let mut moved = false;
        for k in 0..found.len() {
            checkpoint();
            let now = *found[k].pose();
            let overlaps = |(j, other): (usize, &Fitted)| j != k && fit.overlap(&now, other.pose());
            if !found.iter().enumerate().any(overlaps) {
                continue;
            }
            fit.add_fitted(residual, &found[k], 1.0);
            if let Some(again) = fit.again(residual, &found[k]) {
                moved |=
                    angle(again.pose().axis, now.axis) > 0.01 || (again.pose().z_um - now.z_um).abs() > 0.05;
                found[k] = again;
            }
            fit.add_fitted(residual, &found[k], -1.0);
        }
        if !moved {
            break;
        }
    }
}

/// Polar diameter, relative to the calibration particle's, for which images have room.
fn longest(aspects: &[f64]) -> f64 {
    aspects.iter().copied().fold(1.0, f64::max)
}

/// Median of values with weights; `None` without any.
pub fn weighted_median(mut values: Vec<(f64, f64)>) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut sum = 0.0;
    let reaches_half = |(_, weight): &&(f64, f64)| {
        sum += weight;
        sum >= half
    };
    values.iter().find(reaches_half).map(|(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn median_by_weight() {
        assert_eq!(weighted_median(vec![(3.0, 1.0), (1.0, 1.0), (2.0, 1.0)]), Some(2.0));
        assert_eq!(weighted_median(vec![(3.0, 5.0), (1.0, 1.0), (2.0, 1.0)]), Some(3.0));
        assert_eq!(weighted_median(Vec::new()), None);
    }
}
