//! The search with templates of several places of the field of view: each place searches the part of a frame
//! that is nearest to it, with a margin, and keeps what lies in its part.

use super::acceptance::Rejections;
use super::field_images::FieldPlaces;
use super::fit::{ParticleFit, Residual};
use super::gray_image::GrayImage;
use super::maps::MapTemplates;
use super::positions::Position;
use super::search::Search;

/// Two particles closer than this, found by two places at the border between them, are one, px.
const SAME_PLACE_PX: f64 = 3.0;

pub(super) fn search(
    templates: &[MapTemplates],
    places: &FieldPlaces,
    frame: &Residual,
    bin: usize,
    given: Option<&[Position]>,
) -> (Vec<ParticleFit>, Rejections) {
    let (width, height) = (frame.image.width, frame.image.height);
    let nearest = |x: f64, y: f64| places.nearest([x, y].map(|c| c * bin as f64 + (bin / 2) as f64));
    let mut boxes: Vec<Option<[usize; 4]>> = vec![None; templates.len()];
    for i in 0..width * height {
        let (x, y) = (i % width, i / width);
        let own = &mut boxes[nearest(x as f64, y as f64)];
        let [left, top, right, bottom] = own.unwrap_or([x, y, x, y]);
        *own = Some([left.min(x), top.min(y), right.max(x), bottom.max(y)]);
    }
    let mut rejections = Rejections::default();
    let mut found: Vec<ParticleFit> = Vec::new();
    for (place, (place_search, part)) in templates.iter().zip(boxes).enumerate() {
        let Some([left, top, right, bottom]) = part else { continue };
        let margin = place_search
            .sizes
            .iter()
            .flat_map(|size_templates| (0..size_templates.len()).map(|k| size_templates.get(k).radius))
            .max();
        let margin = 2 * margin.unwrap_or(0) + 1;
        let (left, top) = (left.saturating_sub(margin), top.saturating_sub(margin));
        let size = ((right + margin + 1).min(width) - left, (bottom + margin + 1).min(height) - top);
        let at = |x: usize, y: usize| (top + y) * width + left + x;
        let part = Residual {
            image: GrayImage::from_fn(size, |x, y| frame.image.counts[at(x, y)]),
            weight: (0..size.0 * size.1).map(|i| frame.weight[at(i % size.0, i / size.0)]).collect(),
        };
        let corner = [left as f64, top as f64];
        let given_here: Option<Vec<Position>> = given.map(|given| {
            let in_part = given.iter().map(|given| given.mapped(|at| [at[0] - corner[0], at[1] - corner[1]]));
            in_part.filter(|given| part.image.contains(given.at)).collect()
        });
        let (part_fits, rejected) = Search::run(place_search, false, part, given_here.as_deref());
        rejections.add(rejected);
        for fit in part_fits {
            let fit = fit.mapped(|at| [at[0] + corner[0], at[1] + corner[1]]);
            // Beyond the frame, the place of the nearest pixel; of a known position its own.
            let at = fit.given.map_or(fit.at, |given| given.at);
            let [x, y] = [at[0].clamp(0.0, width as f64 - 1.0), at[1].clamp(0.0, height as f64 - 1.0)];
            if nearest(x, y) == place {
                found.push(fit);
            }
        }
    }
    (if given.is_some() { found } else { without_twins(found) }, rejections)
}

/// Keeps the better one of two particles at the same place.
fn without_twins(mut found: Vec<ParticleFit>) -> Vec<ParticleFit> {
    found.sort_by(|a, b| b.chi2_reduction.total_cmp(&a.chi2_reduction));
    let mut kept: Vec<ParticleFit> = Vec::with_capacity(found.len());
    for fit in found {
        let is_same =
            |other: &ParticleFit| (other.at[0] - fit.at[0]).hypot(other.at[1] - fit.at[1]) < SAME_PLACE_PX;
        if !kept.iter().any(is_same) {
            kept.push(fit);
        }
    }
    kept
}
