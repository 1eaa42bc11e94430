//! Recall and errors as functions of depth, distance to the nearest neighbor, SNR and overlap.

use numeric::cell_grid::CellGrid;

use super::detection::error;
use super::matching::{Matching, NONE};
use super::statistics::{Errors, ratio};
use super::track_set::{Point, TrackSet};
use super::truth::TrueParticles;

scores! {
    /// Recall and errors in bins of a property of the true particles.
    pub struct Curve {
        /// The property: z_um (depth), neighbor_px (distance to the nearest neighbor), snr or overlap.
        pub against: String,
        /// The bins, in ascending order.
        pub bins: Vec<Bin>,
    }

    /// One bin of a curve; errors are null if no particle in it was found.
    pub struct Bin {
        /// Lower edge of the bin, in the unit of the property.
        pub from: f64,
        /// Upper edge of the bin; null if it is open.
        #[serde(deserialize_with = "super::statistics::or_infinite")]
        #[schemars(with = "Option<f64>")]
        pub to: f64,
        /// Number of true particles in the bin.
        pub n_true: usize,
        /// Number of matched true particles in the bin.
        pub tp: usize,
        /// tp / n_true.
        fraction recall: Option<f64>,
        /// Mean error of x.
        pub bias_x_px: Option<f64>,
        /// Standard deviation of the error of x.
        not_negative random_x_px: Option<f64>,
        /// RMS error of x.
        not_negative rms_x_px: Option<f64>,
        /// Mean error of y.
        pub bias_y_px: Option<f64>,
        /// Standard deviation of the error of y.
        not_negative random_y_px: Option<f64>,
        /// RMS error of y.
        not_negative rms_y_px: Option<f64>,
        /// Mean error of z.
        pub bias_z_um: Option<f64>,
        /// Standard deviation of the error of z.
        not_negative random_z_um: Option<f64>,
        /// RMS error of z.
        not_negative rms_z_um: Option<f64>,
    }
}

/// Name of the curve over the distance to the nearest neighbor.
pub const NEIGHBOR_PX: &str = "neighbor_px";

/// Bins over depth.
const DEPTH_BINS: usize = 20;

/// Largest distance at which neighbors are searched for, px.
const FARTHEST_PX: f64 = 60.0;

/// All curves for which the truth has the values; `depth`: whether z is scored.
pub fn curves(
    truth: &TrueParticles,
    clouds: (&TrackSet, &TrackSet),
    matching: &Matching,
    depth: bool,
) -> Vec<Curve> {
    let t = clouds.0;
    let mut curves = Vec::new();
    let equal = |low: f64, high: f64, n: usize| -> Vec<f64> {
        (0..=n).map(|k| low + (high - low) * k as f64 / n as f64).collect()
    };
    let mut add = |against: &str, values: &[f64], edges: &[f64]| {
        let bins = binned(clouds, matching, values, edges, depth);
        curves.push(Curve { against: against.to_owned(), bins });
    };
    if let Some((low, high)) = truth.facts.depth_um.filter(|(l, h)| depth && h > l) {
        let z: Vec<f64> = t.points.iter().map(|p| p.at.z_um).collect();
        add("z_um", &z, &equal(low, high, DEPTH_BINS));
    }
    let mut edges =
        vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 13.0, 16.0, 20.0, 25.0, 30.0, 40.0, FARTHEST_PX];
    edges.push(f64::INFINITY);
    add(NEIGHBOR_PX, &neighbors(t), &edges);
    for (name, values) in &truth.properties {
        let of: Vec<f64> = t.points.iter().map(|p| values[p.source as usize]).collect();
        let finite = of.iter().copied().filter(|v| v.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low < high {
            add(name, &of, &equal(low, high, 10));
        }
    }
    curves
}

/// Distance from every point to its nearest neighbor in the same frame, px; infinite beyond [`FARTHEST_PX`].
fn neighbors(cloud: &TrackSet) -> Vec<f64> {
    let mut distances = Vec::with_capacity(cloud.len());
    for (_, range) in &cloud.frames {
        let points: Vec<[f64; 2]> = cloud.points[range.clone()].iter().map(Point::in_plane).collect();
        // Small radii first: in dense frames a search with the full radius would visit every point.
        let grids = [4.0, 16.0, FARTHEST_PX].map(|reach| (reach, CellGrid::new(&points, reach)));
        for i in 0..points.len() {
            let found = grids.iter().find_map(|(reach, grid)| grid.nearest_other(i, *reach));
            distances.push(found.unwrap_or(f64::INFINITY));
        }
    }
    distances
}

fn binned(
    (t, r): (&TrackSet, &TrackSet),
    matching: &Matching,
    values: &[f64],
    edges: &[f64],
    depth: bool,
) -> Vec<Bin> {
    let n = edges.len() - 1;
    let mut errors: Vec<Vec<[f64; 3]>> = vec![Vec::new(); n];
    let mut counts = vec![0; n];
    for (i, &value) in values.iter().enumerate() {
        let above = edges.partition_point(|e| *e <= value);
        // The last edge belongs to the last bin.
        let bin = if value == edges[n] { n } else { above };
        if value.is_nan() || bin == 0 || bin > n {
            continue;
        }
        counts[bin - 1] += 1;
        if matching.result_for[i] != NONE {
            errors[bin - 1].push(error(t, r, (i, matching.result_for[i] as usize)));
        }
    }
    (0..n)
        .map(|k| {
            let axis = |a: usize| Errors::of(errors[k].iter().map(move |e| e[a]));
            let (x, y, z) = (axis(0), axis(1), if depth { axis(2) } else { Errors::default() });
            Bin {
                from: edges[k],
                to: edges[k + 1],
                n_true: counts[k],
                tp: errors[k].len(),
                recall: ratio(errors[k].len() as f64, counts[k] as f64),
                bias_x_px: x.bias,
                random_x_px: x.random,
                rms_x_px: x.rms,
                bias_y_px: y.bias,
                random_y_px: y.random,
                rms_y_px: y.rms,
                bias_z_um: z.bias,
                random_z_um: z.random,
                rms_z_um: z.rms,
            }
        })
        .collect()
}
