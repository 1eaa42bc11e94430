//! The search for particles in a frame: candidates from correlation maps, in order of decreasing likelihood.
//!
//! Weighted cross-correlation maps of some templates with the frame give candidates. Starting with the most
//! likely one, position, depth and brightness are fitted; if the particle is significant and similar to its
//! template, it is subtracted from the frame, so that it is not detected twice and overlapped particles
//! become visible. With stacks for several particle sizes, all are searched, and each particle gets the size
//! that fits best. At known positions, particles are fitted in the same way without the maps.

use std::ops::Range;

use microsig_core::cancel::checkpoint;

use super::acceptance::{
    LEAST_BRIGHTNESS, LEAST_KNOWN_BRIGHTNESS, LEAST_SIGNIFICANCE, Rejections, Verdict, verdict,
};
use super::fit::{ParticleFit, Residual};
use super::images::ParticleImages;
use super::maps::{CorrelationMaps, MapTemplates};
use super::positions::Position;
use super::templates::Templates;

/// Number of templates of a size for which correlation maps are computed.
pub(super) const COARSE: usize = 13;

/// A candidate is fitted if its amplitude exceeds this fraction of the minimum brightness.
const WORTH_A_FIT: f64 = 0.5;

/// Offsets in depth steps from which the fit is repeated.
const OTHER_DEPTHS: [f64; 6] = [-12.0, -8.0, -4.0, 4.0, 8.0, 12.0];

/// Two particles closer than this may be a single particle, px.
const SAME_PLACE_PX: f64 = 3.0;

/// One particle replaces two if it achieves this fraction of their combined reduction of chi^2.
const AS_GOOD: f64 = 0.97;

/// A fit at another depth is compared again in the final fit if it achieves this fraction of the reduction of
/// chi^2; and the least difference of these depths, in depth steps, less at a known position, where all others
/// tell which is right.
const NEARLY_AS_GOOD: f64 = 0.9;
const OTHER_SIDE: f64 = 3.0;
const OTHER_SIDE_OF_KNOWN: f64 = 1.0;

/// Maximum number of depths from which fits start.
const STARTS: usize = 3;

/// Where templates are compared with the image around a known position, px along x and y.
const AROUND: [isize; 3] = [-2, 0, 2];

/// Number of rounds over all known positions.
const ROUNDS: usize = 3;

/// A possible particle: template and pixel.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    size: usize,
    template: usize,
    x: isize,
    y: isize,
    /// Expected reduction of chi^2.
    chi2_reduction: f32,
}

/// A template at a pixel: its reduction of chi^2, and its brightness.
#[derive(Debug, Clone, Copy, Default)]
struct Match {
    at: [isize; 2],
    chi2_reduction: f64,
    amplitude: f64,
}

impl Match {
    fn is_worth_a_fit(&self, given: Option<Position>) -> bool {
        let least = if given.is_some() { LEAST_KNOWN_BRIGHTNESS } else { LEAST_BRIGHTNESS };
        self.amplitude > WORTH_A_FIT * least
    }
}

/// Whether two fits of a particle are at depths that may be on both sides of the focus.
pub(super) fn are_apart(fit: &ParticleFit, other: &ParticleFit, step_um: f64) -> bool {
    let steps = if fit.given.is_some() { OTHER_SIDE_OF_KNOWN } else { OTHER_SIDE };
    (other.z_um - fit.z_um).abs() > steps * step_um
}

/// The state of the search in a frame.
pub(super) struct Search<'a> {
    maps: &'a MapTemplates,
    /// Templates of each particle size.
    templates: &'a [Templates],
    /// Whether a candidate is fitted with templates of its own size alone, of many similar ones.
    own_size: bool,
    residual: Residual,
    found: Vec<ParticleFit>,
    rejections: Rejections,
}

impl<'a> Search<'a> {
    /// Finds the particles in a background-subtracted frame with pixel weights, or at known positions only, and
    /// counts the rejected candidates.
    pub(super) fn run(
        maps: &'a MapTemplates,
        own_size: bool,
        residual: Residual,
        given: Option<&[Position]>,
    ) -> (Vec<ParticleFit>, Rejections) {
        let (found, rejections) = (Vec::new(), Rejections::default());
        let mut search = Search { maps, templates: &maps.sizes, own_size, residual, found, rejections };
        match given {
            Some(given) => search.measure(given),
            None => {
                for candidate in search.candidates() {
                    search.take(candidate);
                }
                search.again();
            }
        }
        (search.found, search.rejections)
    }

    /// Local maxima of the correlation maps of a subset of the templates, the most likely first.
    fn candidates(&self) -> Vec<Candidate> {
        let maps = CorrelationMaps::new(self.maps, &self.residual);
        let ((w, h), margin) = (maps.size, self.maps.margin);
        let least = (LEAST_SIGNIFICANCE * LEAST_SIGNIFICANCE) as f32;
        let mut candidates = Vec::new();
        for (k, &(size, template)) in self.maps.coarse.iter().enumerate() {
            checkpoint();
            let map = maps.chi2_reduction(k);
            for y in 0..h {
                for x in 0..w {
                    let chi2_reduction = map[y * w + x];
                    if chi2_reduction <= least {
                        continue;
                    }
                    let mut around = (y.saturating_sub(1)..(y + 2).min(h))
                        .flat_map(|v| &map[v * w + x.saturating_sub(1)..v * w + (x + 2).min(w)]);
                    if around.all(|other| *other <= chi2_reduction) {
                        let [x, y] = [x, y].map(|c| c as isize - margin as isize);
                        candidates.push(Candidate { size, template, x, y, chi2_reduction });
                    }
                }
            }
        }
        let place = |c: &Candidate| (c.y, c.x, c.size, c.template);
        candidates
            .sort_by(|a, b| b.chi2_reduction.total_cmp(&a.chi2_reduction).then(place(a).cmp(&place(b))));
        candidates
    }

    /// Fits a candidate and, if it is accepted as a particle, subtracts it from the frame.
    fn take(&mut self, candidate: Candidate) {
        checkpoint();
        let Candidate { size, template, x, y, .. } = candidate;
        // Particles accepted in the meantime may account for this candidate.
        let now = self.match_at(size, template, x, y);
        if now.chi2_reduction
            < 0.5 * f64::from(candidate.chi2_reduction).min(4.0 * LEAST_SIGNIFICANCE.powi(2))
            || !now.is_worth_a_fit(None)
        {
            return;
        }
        let sizes = if self.own_size { size..size + 1 } else { 0..self.templates.len() };
        let at = [x as f64, y as f64];
        let Some(fit) = self.best(sizes, ParticleFit { at, ..ParticleFit::default() }) else { return };
        let verdict = verdict(&fit);
        self.rejections.count(verdict);
        if verdict == Verdict::Particle {
            let fit = self.at_other_depths(fit);
            self.residual.add(self.templates, &fit, -1.0);
            self.found.push(fit);
            self.unite();
        }
    }

    /// Fits a particle at each given position, first where most light is, then again with all others subtracted.
    fn measure(&mut self, given: &[Position]) {
        let sizes = 0..self.templates.len();
        let light = |start: &ParticleFit| -> f64 {
            let matches = sizes.clone().flat_map(|size| self.over_depth(&ParticleFit { size, ..*start }));
            matches.map(|found| found.chi2_reduction).fold(0.0, f64::max)
        };
        let start = |at: &Position| ParticleFit { at: at.at, given: Some(*at), ..ParticleFit::default() };
        let mut starts: Vec<ParticleFit> = given.iter().map(start).collect();
        starts.sort_by_cached_key(|start| std::cmp::Reverse(light(start).to_bits()));
        let mut fits: Vec<Option<ParticleFit>> = vec![None; starts.len()];
        for round in 1..=ROUNDS {
            for (start, own) in starts.iter().zip(&mut fits) {
                if let Some(fit) = own {
                    self.residual.add(self.templates, fit, 1.0);
                }
                let best = self.best(sizes.clone(), *start).map(|best| self.at_other_depths(best));
                *own = best.filter(|best| verdict(best) == Verdict::Particle);
                if let Some(fit) = own {
                    if round == ROUNDS {
                        fit.other_z_um = self.other_side(fit);
                    }
                    self.residual.add(self.templates, fit, -1.0);
                }
            }
        }
        self.found = fits.into_iter().flatten().collect();
    }

    /// The best fit of a particle of one of these sizes.
    fn best(&self, sizes: Range<usize>, start: ParticleFit) -> Option<ParticleFit> {
        let is_particle = |fit: &ParticleFit| verdict(fit) == Verdict::Particle;
        // A particle of another size may fit the data better but be much too bright.
        let fits = sizes.flat_map(|size| self.fits(&ParticleFit { size, ..start }));
        fits.max_by(|a, b| {
            is_particle(a).cmp(&is_particle(b)).then(a.chi2_reduction.total_cmp(&b.chi2_reduction))
        })
    }

    /// The matches of all templates of a particle's size at its pixel, or around its known position.
    fn over_depth(&self, of: &ParticleFit) -> Vec<Match> {
        let [x, y] = of.given.map_or(of.at, |given| given.at).map(|at| at.round() as isize);
        let around = if of.given.is_some() { &AROUND[..] } else { &[0] };
        let best = |template: usize| {
            let all = around.iter().flat_map(|dy| around.iter().map(move |dx| (x + dx, y + dy)));
            let all = all.map(|(x, y)| self.match_at(of.size, template, x, y));
            all.max_by(|a, b| a.chi2_reduction.total_cmp(&b.chi2_reduction)).unwrap_or_default()
        };
        (0..self.templates[of.size].len()).map(best).collect()
    }

    /// Fits of a particle, starting from the depths whose templates resemble the residual most.
    fn fits(&self, of: &ParticleFit) -> Vec<ParticleFit> {
        let over_depth = self.over_depth(of);
        let at =
            |k: usize, d: isize| over_depth.get(k.wrapping_add_signed(d)).map_or(0.0, |m| m.chi2_reduction);
        let mut starts: Vec<usize> = (0..over_depth.len())
            .filter(|&k| {
                over_depth[k].is_worth_a_fit(of.given) && at(k, 0) >= at(k, -1) && at(k, 0) > at(k, 1)
            })
            .collect();
        starts.sort_by(|a, b| over_depth[*b].chi2_reduction.total_cmp(&over_depth[*a].chi2_reduction));
        starts.truncate(STARTS);
        let start = |k: usize| {
            let (at, z_um) = (over_depth[k].at.map(|c| c as f64), self.templates[of.size].depth_um(k));
            ParticleFit { at, z_um, ..*of }
        };
        starts.into_iter().filter_map(|k| self.fit(start(k))).collect()
    }

    fn fit(&self, start: ParticleFit) -> Option<ParticleFit> {
        checkpoint();
        let templates = &self.templates[start.size];
        ParticleFit::near(&self.residual, templates, start, templates.step_um())
    }

    /// The best of a fit and of fits that start at nearby depths: near the focus, images at several depths
    /// are similar.
    fn at_other_depths(&self, fit: ParticleFit) -> ParticleFit {
        let templates = &self.templates[fit.size];
        let [low, high] = templates.depths_um();
        let depths = OTHER_DEPTHS.map(|d| fit.z_um + d * templates.step_um());
        let inside = depths.into_iter().filter(|d| (low..=high).contains(d));
        let fits = inside.filter_map(|z_um| self.fit(ParticleFit { z_um, ..fit }));
        fits.fold(fit, |best, other| if other.chi2_reduction > best.chi2_reduction { other } else { best })
    }

    /// Replaces the last particle and another one at the same position by a single particle if it fits nearly
    /// as well.
    fn unite(&mut self) {
        let Some(last) = self.found.pop() else { return };
        let apart = |f: &ParticleFit| (f.at[0] - last.at[0]).hypot(f.at[1] - last.at[1]);
        let Some(k) = self.found.iter().position(|f| apart(f) < SAME_PLACE_PX) else {
            self.found.push(last);
            return;
        };
        let first = self.found[k];
        self.residual.add(self.templates, &last, 1.0);
        self.residual.add(self.templates, &first, 1.0);
        let mut one = self.at_other_depths(first);
        if last.size != first.size {
            let other = self.at_other_depths(last);
            one = if other.chi2_reduction > one.chi2_reduction { other } else { one };
        }
        if one.chi2_reduction > AS_GOOD * (first.chi2_reduction + last.chi2_reduction) {
            self.residual.add(self.templates, &one, -1.0);
            self.found[k] = one;
        } else {
            self.residual.add(self.templates, &first, -1.0);
            self.residual.add(self.templates, &last, -1.0);
            self.found.push(last);
        }
    }

    /// Refits every particle with all others subtracted; particles that are no longer accepted are dropped.
    fn again(&mut self) {
        for fit in std::mem::take(&mut self.found) {
            self.residual.add(self.templates, &fit, 1.0);
            if let Some(better) = self.fit(fit).filter(|fit| verdict(fit) == Verdict::Particle) {
                let other_z_um = self.other_side(&better);
                self.residual.add(self.templates, &better, -1.0);
                self.found.push(ParticleFit { other_z_um, ..better });
            }
        }
    }

    /// The depth of another fit that is nearly as good, rather of one that is far from it.
    fn other_side(&self, fit: &ParticleFit) -> Option<f64> {
        let step_um = self.templates[fit.size].step_um();
        let is_other = |other: &ParticleFit| {
            are_apart(fit, other, step_um)
                && other.chi2_reduction > NEARLY_AS_GOOD * fit.chi2_reduction
                && verdict(other) == Verdict::Particle
        };
        let is_far = |other: &ParticleFit| (other.z_um - fit.z_um).abs() > OTHER_SIDE * step_um;
        let others = self.fits(fit).into_iter().filter(is_other);
        let best = others
            .max_by(|a, b| is_far(a).cmp(&is_far(b)).then(a.chi2_reduction.total_cmp(&b.chi2_reduction)));
        best.map(|other| other.z_um)
    }

    /// Match of a template at a pixel with the residual.
    fn match_at(&self, size: usize, template: usize, x: isize, y: isize) -> Match {
        let template = self.templates[size].get(template);
        let r = template.radius as isize;
        let (w, h) = (self.residual.image.width as isize, self.residual.image.height as isize);
        let (mut own, mut both) = (0.0f32, 0.0f32);
        let columns = (x - r).max(0)..(x + r + 1).min(w);
        // A template beyond the frame.
        if columns.is_empty() {
            return Match::default();
        }
        for v in (y - r).max(0)..(y + r + 1).min(h) {
            let pixels = (v * w + columns.start) as usize..(v * w + columns.end) as usize;
            let data = self.residual.weight[pixels.clone()].iter().zip(&self.residual.image.counts[pixels]);
            let row = template.row(v - y, columns.start - x..columns.end - x);
            for (light, (weight, count)) in row.iter().zip(data) {
                let weighted = weight * light;
                own += weighted * light;
                both += weighted * count;
            }
        }
        if own > 0.0 && both > 0.0 {
            let (chi2_reduction, amplitude) = (f64::from(both * both / own), f64::from(both / own));
            Match { at: [x, y], chi2_reduction, amplitude }
        } else {
            Match { at: [x, y], ..Match::default() }
        }
    }
}
