//! How far the light of a particle extends at each depth of a scan: the radius at which the mean over rings,
//! of which the median over particles is taken, falls below a share of its maximum. The median leaves out
//! neighbors.

use fit::{Level, Scan};

use rayon::prelude::*;

use super::located::Located;

/// The share of the maximum.
const SHARE: f64 = 0.05;

/// Largest radius, px, and number of particles that are measured, brightest first.
const LARGEST: usize = 100;
const MEASURED: usize = 60;

/// The radius at each depth, px.
pub(crate) fn radii(scan: &Scan, levels: &[Level], located: &Located) -> Vec<usize> {
    levels.par_iter().map(|level| radius(scan, level, located)).collect()
}

/// Half the distance to the nearest other particle, px, which a quarter of the particles exceed: beyond it,
/// light comes mostly from other particles.
pub(crate) fn half_spacing(located: &Located) -> usize {
    let nearest = |k: usize| {
        let away =
            |other: &[f64; 2]| (other[0] - located.places[k][0]).hypot(other[1] - located.places[k][1]);
        let others = located.places.iter().enumerate().filter(|(j, _)| *j != k);
        others.map(|(_, other)| away(other)).fold(f64::INFINITY, f64::min)
    };
    let mut spacing: Vec<f64> = (0..located.places.len()).into_par_iter().map(nearest).collect();
    spacing.sort_by(f64::total_cmp);
    spacing.get(3 * spacing.len() / 4).map_or(usize::MAX, |px| (0.5 * px) as usize)
}

fn radius(scan: &Scan, level: &Level, located: &Located) -> usize {
    let most = LARGEST.min(scan.width.min(scan.height) / 4).max(1);
    let inside = |at: &&[f64; 2]| {
        let room = [at[0], at[1], scan.width as f64 - 1.0 - at[0], scan.height as f64 - 1.0 - at[1]];
        room.into_iter().all(|room| room >= most as f64)
    };
    let mut particles: Vec<&[f64; 2]> = located.places.iter().filter(inside).take(MEASURED).collect();
    if particles.is_empty() {
        particles = located.places.iter().take(MEASURED).collect();
    }
    let profiles: Vec<Vec<f64>> =
        particles.iter().map(|at| profile(scan, level.planes[0], **at, most, located.background)).collect();
    let mut median: Vec<f64> = (0..=most)
        .map(|ring| {
            let mut values: Vec<f64> = profiles.iter().map(|profile| profile[ring]).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        })
        .collect();
    let peak = median.iter().copied().fold(0.0, f64::max);
    // Where neighbors are everywhere, rings do not become dark: their darkest one is the background.
    let dark = median.iter().copied().fold(f64::INFINITY, f64::min).max(0.0);
    median.iter_mut().for_each(|value| *value -= dark);
    median.iter().position(|value| *value >= 0.999 * (peak - dark)).map_or(1, |top| {
        let falls = median[top..].iter().position(|value| *value < SHARE * (peak - dark));
        top + falls.unwrap_or(median.len() - 1 - top)
    })
}

/// Mean light of the rings around a position.
fn profile(scan: &Scan, plane: usize, at: [f64; 2], most: usize, background: f64) -> Vec<f64> {
    let mut rings = vec![(0.0, 0.0); most + 1];
    let [x0, y0] = at.map(|c| c.round() as isize);
    let reach = most as isize;
    for y in (y0 - reach).max(0)..(y0 + reach + 1).min(scan.height as isize) {
        for x in (x0 - reach).max(0)..(x0 + reach + 1).min(scan.width as isize) {
            let r = libm::hypot((x - x0) as f64, (y - y0) as f64).round() as usize;
            if let Some(ring) = rings.get_mut(r) {
                ring.0 += f64::from(scan.planes[plane][y as usize * scan.width + x as usize]) - background;
                ring.1 += 1.0;
            }
        }
    }
    rings.into_iter().map(|(sum, n)| if n > 0.0 { sum / n } else { 0.0 }).collect()
}
