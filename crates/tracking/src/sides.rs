//! Whether images above and below the focus can be distinguished in the noise of a frame, and on which side the points
//! of a track are.
//!
//! With a spherical lens, images at two depths on either side of the focus resemble each other. For images `a` and `b`
//! of known brightness and Gaussian noise, the more likely one is the wrong one with probability `Phi(-d / 2)`, where
//! `d^2` is the sum of squared differences in standard deviations of the noise (the ideal observer of two known
//! signals, e.g. Barrett & Myers 2004, Foundations of Image Science, ch. 13).

use std::collections::BTreeMap;

use super::Localization;
use super::denoise::PixelNoise;
use super::joint_fit::MOST_BY_A_POINT;
use super::output::Row;
use super::shape_fit::LEAST_LIKELIHOOD;
use super::templates::Templates;

/// Below this distance, more than one depth in ten is on the wrong side.
const DISTINGUISHABLE: f64 = 2.56;

/// Images of the other side are separated from a depth by images that differ by more than this, and by this factor
/// more.
const BARRIER: f64 = 4.0;
const HIGHER: f64 = 2.0;

/// The share of depths about which a warning is due.
const MANY: f64 = 0.1;

/// A warning if many depths have images that, in frames with this noise and for templates with this relative error,
/// look the same at a depth on the other side of the focus.
pub(super) fn warning(templates: &Templates, noise: PixelNoise, error: f32) -> Option<String> {
    let depths = templates.len();
    let guessed: Vec<f64> = (0..depths)
        .filter(|&k| other_side(&distances(templates, k, noise, error), k))
        .map(|k| templates.depth_um(k))
        .collect();
    let share = guessed.len() as f64 / depths as f64;
    let ends = guessed.first().zip(guessed.last())?;
    (share > MANY).then(|| {
        format!(
            "at {:.0} % of the depths (between {:.1} and {:.1} um), images above and below the focus differ by less than the \
             noise: the side of the focus, and so the sign of the depth, is a guess there. A cylindrical lens, more light or \
             a depth range on one side of the focus would help",
            100.0 * share,
            ends.0,
            ends.1
        )
    })
}

/// Distances of all images from that at depth `k`, in standard deviations of the noise; brightness is free, as it is
/// in a fit.
fn distances(templates: &Templates, k: usize, noise: PixelNoise, error: f32) -> Vec<f64> {
    let image = templates.image(k);
    let weight = |count: &f32| 1.0 / f64::from(noise.variance(count.max(0.0)) + (error * count).powi(2));
    let weights: Vec<f64> = image.counts.iter().map(weight).collect();
    let product = |a: &[f32], b: &[f32]| -> f64 {
        a.iter().zip(b).zip(&weights).map(|((a, b), w)| f64::from(a * b) * w).sum()
    };
    let own = product(&image.counts, &image.counts);
    let distance = |j: usize| {
        let other = &templates.image(j).counts;
        let both = product(&image.counts, other);
        (own - both * both.max(0.0) / product(other, other).max(f64::MIN_POSITIVE)).max(0.0).sqrt()
    };
    (0..templates.len()).map(distance).collect()
}

/// Whether a depth beyond a barrier has an image that cannot be distinguished from that at depth `k`.
fn other_side(distances: &[f64], k: usize) -> bool {
    let beyond = |side: &[f64], order: fn(usize, usize) -> usize| {
        let mut highest = 0.0f64;
        (0..side.len()).map(|i| side[order(i, side.len())]).any(|d| {
            highest = highest.max(d);
            d < DISTINGUISHABLE && highest > BARRIER && highest > HIGHER * d
        })
    };
    beyond(&distances[k..], |i, _| i) || beyond(&distances[..k], |i, n| n - 1 - i)
}

/// Added to -2 ln of the likelihood of a track for each jump in depth.
const JUMP: f64 = 1e9;

/// Decides on which side of the focus each point is with the rest of its track: of all ways through the points of a track
/// on either side, those with the fewest jumps by more than `reach_um` in depth, and of those the most likely. The other
/// side then has the likelihood of the best way through it, and is left out if that is small. Particles that are `at_rest`
/// in the image move alike in depth, with the stage: steps unlike the others' between the same frames are less likely.
pub(super) fn choose(rows: &mut [Row], reach_um: f64, at_rest: bool) {
    let mut tracks: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
    rows.iter().enumerate().for_each(|(k, row)| tracks.entry(row.track).or_default().push(k));
    let steps = if at_rest { common_steps(rows, tracks.values()) } else { Steps::new() };
    for track in tracks.into_values() {
        let sides = |k: &usize| -> Point {
            let Localization { z_um, other, .. } = rows[*k].found;
            let z_um = z_um.unwrap_or_default();
            let other = other.map_or((z_um, f64::INFINITY), |other| (other.z_um, other.cost));
            Point { frame: rows[*k].frame, sides: [(z_um, 0.0), other] }
        };
        let points: Vec<_> = track.iter().map(sides).collect();
        let forward = costs(points.iter(), reach_um, &steps);
        let backward = costs(points.iter().rev(), reach_um, &steps).into_iter().rev();
        for (((k, own), before), after) in track.into_iter().zip(&points).zip(forward).zip(backward) {
            let found = &mut rows[k].found;
            let Some(mut other) = found.other else { continue };
            let through = [0, 1].map(|side| before[side] + after[side] - own.sides[side].1);
            other.cost = through[1] - through[0];
            found.other = Some(other);
            if other.cost < 0.0
                && let Some(there) = found.on_other_side()
            {
                *found = there;
            }
            found.other = found.other.filter(|other| other.likelihood() > LEAST_LIKELIHOOD);
        }
    }
}

/// Depth of a point, and -2 ln of its likelihood, on this side of the focus and on the other.
struct Point {
    frame: u32,
    sides: [(f64, f64); 2],
}

/// From a frame to the next or the one before, the median change in depth of particles and its robust standard
/// deviation, um.
type Steps = BTreeMap<[u32; 2], [f64; 2]>;

/// Fewest particles that tell how all move, and the least standard deviation, um.
const FEWEST: usize = 8;
const LEAST_UM: f64 = 1e-3;

/// How all particles move in depth from frame to frame, in both directions of time.
fn common_steps<'a>(rows: &[Row], tracks: impl Iterator<Item = &'a Vec<usize>>) -> Steps {
    let mut all: BTreeMap<[u32; 2], Vec<f64>> = BTreeMap::new();
    for pair in tracks.flat_map(|track| track.windows(2)) {
        let [from, to] = [&rows[pair[0]], &rows[pair[1]]];
        if let Some((from_um, to_um)) = from.found.z_um.zip(to.found.z_um) {
            all.entry([from.frame, to.frame]).or_default().push(to_um - from_um);
        }
    }
    let median = |of: &mut Vec<f64>| {
        of.sort_by(f64::total_cmp);
        of[of.len() / 2]
    };
    all.retain(|_, steps| steps.len() >= FEWEST);
    let robust = |([from, to], mut steps): ([u32; 2], Vec<f64>)| {
        let middle = median(&mut steps);
        steps.iter_mut().for_each(|step| *step = (*step - middle).abs());
        let sd = 1.48 * median(&mut steps);
        [([from, to], [middle, sd]), ([to, from], [-middle, sd])]
    };
    all.into_iter().flat_map(robust).collect()
}

/// The least cost of a way through all points up to each of them, which is on this side of the focus or on the other.
fn costs<'a>(points: impl Iterator<Item = &'a Point>, reach_um: f64, steps: &Steps) -> Vec<[f64; 2]> {
    let mut before: Option<(&Point, [f64; 2])> = None;
    let up_to = |point: &'a Point| {
        let cost = point.sides.map(|(z_um, own)| {
            let Some((from, costs)) = before else { return own };
            let jump = |side: usize| {
                let from_um = from.sides[side].0;
                if (from_um - z_um).abs() > reach_um {
                    return JUMP;
                }
                let unlike = |[common_um, sd_um]: &[f64; 2]| {
                    ((z_um - from_um - common_um) / sd_um.max(LEAST_UM)).powi(2).min(MOST_BY_A_POINT)
                };
                steps.get(&[from.frame, point.frame]).map_or(0.0, unlike)
            };
            own + f64::min(costs[0] + jump(0), costs[1] + jump(1))
        });
        before = Some((point, cost));
        cost
    };
    points.map(up_to).collect()
}

#[cfg(test)]
mod tests {
    use super::super::OtherSide;
    use super::super::gray_image::GrayImage;
    use super::*;

    /// Spots that grow on both sides of a focus, and on one side are rings with this share of their light.
    fn templates(ring: f32) -> Templates {
        let image = |k: i32| {
            let width = 1.5 + 0.3 * k.abs() as f32;
            let share = if k > 0 { ring } else { 0.0 };
            GrayImage::from_fn((41, 41), |x, y| {
                let r2 = [x, y].map(|c| (c as f32 - 20.0).powi(2)).iter().sum::<f32>() / (width * width);
                2000.0 / (width * width) * (-0.5 * r2).exp() * (1.0 - share + 0.5 * share * r2)
            })
        };
        let depths = (-10..=10).map(f64::from).collect();
        Templates::new(depths, (-10..=10).map(image).collect(), PixelNoise::new(4.0, 0.0))
    }

    /// A point that may be at this depth or, less likely by this cost, at the opposite one; more likely if it is negative.
    fn point(track: i64, frame: u32, z_um: f64, cost: f64) -> Row {
        let [z_um, other_z_um, cost] = if cost < 0.0 { [-z_um, z_um, -cost] } else { [z_um, -z_um, cost] };
        let other = Some(OtherSide { at: [1.0; 2], z_um: other_z_um, deviations: None, cost });
        Row { frame, track, found: Localization { z_um: Some(z_um), other, ..Localization::default() } }
    }

    /// Particles on a stage in steps of 5 um through the focus; three are more likely on the other side next to it.
    #[test]
    fn particles_at_rest_move_alike() {
        let height = |frame: u32| 5.0 * f64::from(frame) - 8.0;
        let points = (0..12).flat_map(|track| (0..4).map(move |frame| (track, frame)));
        let all: Vec<Row> = points
            .map(|(track, frame)| {
                let own = 0.1 * (track % 4 * i64::from(frame)) as f64;
                point(track, frame, height(frame) + own, if track < 3 && frame == 1 { -9.0 } else { 2.0 })
            })
            .collect();
        for (at_rest, wrong) in [(false, 3), (true, 0)] {
            let mut rows = all.clone();
            choose(&mut rows, 30.0, at_rest);
            let is_wrong = |row: &&Row| (row.found.z_um.unwrap_or_default() - height(row.frame)).abs() > 2.0;
            assert_eq!(rows.iter().filter(is_wrong).count(), wrong);
        }
    }

    /// A particle that sinks from 30 um to 10 um; one of its five points is more likely on the other side by itself.
    #[test]
    fn the_side_of_a_point_is_the_side_of_its_track() {
        let point = |(frame, cost): (u32, f64)| point(0, frame, 30.0 - 5.0 * f64::from(frame), cost);
        let mut rows: Vec<Row> = (0..5).zip([2.0, 3.0, -1.0, 2.0, 3.0]).map(point).collect();
        choose(&mut rows, 10.0, false);
        let depths: Vec<f64> = rows.iter().filter_map(|row| row.found.z_um).collect();
        assert_eq!(depths, [30.0, 25.0, 20.0, 15.0, 10.0]);
        // All on the other side.
        assert_eq!(rows[2].found.other.unwrap().cost, 2.0 + 3.0 - 1.0 + 2.0 + 3.0);
    }

    #[test]
    fn images_that_are_the_same_on_both_sides_are_warned_of() {
        let noise = PixelNoise::new(4.0, 0.0);
        let text = warning(&templates(0.0), noise, 0.01).unwrap();
        assert!(text.contains("side of the focus"), "{text}");
        assert_eq!(warning(&templates(0.9), noise, 0.01), None);
        // The same images in more noise.
        assert!(warning(&templates(0.1), PixelNoise::new(100.0, 0.0), 0.01).is_some());
    }
}
