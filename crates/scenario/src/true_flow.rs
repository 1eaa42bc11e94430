//! The flow of a scenario as images show it: the displacements of `truth/field.csv`, at any position.
//!
//! Definitions of displacement: [`flows::eulerian`]. The depth-weighted displacement is that found by
//! correlating images that contain particles at all depths: D = sum w(z) D(z) / sum w(z), D(z) the central
//! displacement. The contribution of a particle to the correlation decreases with its blur; Olsen & Adrian
//! (Exp. Fluids 29 (2000) S166) derive it for Gaussian images, where it is the squared peak. Here w is
//! measured on noise-free images of the dataset's own optics ([`DepthScan`]): the squared
//! peak, or the curvature of the autocorrelation at its peak, times the square of the illumination at that
//! depth. The number density is assumed to be uniform over depth.

use std::path::Path;
use std::sync::Arc;

use flows::VelocityField;
use microsig_core::render::Context;
use microsig_core::visibility::{DepthScan, ScanImage};
use storage::Result;
use storage::dataset::{FieldRow, ImageFlow, TrueFlow};

use super::load::{SCENARIO, of_dataset};
use super::resolved::Scenario;
use super::truth_grid::Weighting;

impl Weighting {
    /// The weights of a scan's depths at illumination 1, not normalized: trapezoidal rule, with half weights at
    /// the ends.
    pub fn weights(self, scan: &DepthScan) -> Vec<f64> {
        let last = scan.images.len() - 1;
        let weight = |spot: &ScanImage| match self {
            Weighting::PeakSquared => spot.peak * spot.peak,
            Weighting::Curvature => spot.curvature,
            Weighting::None => 0.0,
        };
        let ends = |k: usize| if k == 0 || k == last { 0.5 } else { 1.0 };
        scan.images.iter().enumerate().map(|(k, spot)| ends(k) * weight(spot)).collect()
    }

    /// The depths of a scan (um) with these weights; none without a depth-weighted displacement.
    pub fn depths(self, scan: &DepthScan) -> Vec<(f64, f64)> {
        if self == Weighting::None {
            return Vec::new();
        }
        scan.depths_um.iter().copied().zip(self.weights(scan)).collect()
    }
}

impl Scenario {
    /// The field of the scenario in its images, without averages over windows and backward displacements; `depths`
    /// as [`Weighting::depths`] gives them.
    pub fn image_flow<'a>(&'a self, field: &'a dyn VelocityField, depths: &'a [(f64, f64)]) -> ImageFlow<'a> {
        let (fluid, scale, illumination) = (self.fluid(field), &self.scale, &self.illumination);
        ImageFlow { field, fluid, scale, illumination, depths, window_px: None, backward: false }
    }

    /// The pairs of frames with different displacement fields, by number and times (s): a single one without a
    /// number if the flow is steady and all pairs have the same time between frames.
    pub fn field_intervals(&self, field: &dyn VelocityField) -> Vec<(Option<u32>, (f64, f64))> {
        let recordings = &self.recordings;
        let time_s = |frame| recordings.time_s(frame, self.streams);
        let interval = |frame| Some((Some(recordings.link_to(frame)?), (time_s(frame - 1), time_s(frame))));
        let all: Vec<_> = (0..recordings.frames()).filter_map(interval).collect();
        let duration = |&(_, (t0, t1)): &(Option<u32>, (f64, f64))| t1 - t0;
        let Some(first) = all.first().map(duration) else { return all };
        // Tolerance for rounding of time differences.
        let equal = all.iter().all(|pair| (duration(pair) / first - 1.0).abs() < 1e-9);
        if field.is_steady() && equal { vec![(None, all[0].1)] } else { all }
    }
}

/// The flow of a scenario, which gives the displacements of `truth/field.csv` at any position.
#[derive(Debug)]
pub struct ScenarioFlow {
    scenario: Arc<Scenario>,
    depths: Vec<(f64, f64)>,
    intervals: Vec<(Option<u32>, (f64, f64))>,
}

impl ScenarioFlow {
    /// The flow of a scenario; `None` if it has no true field. `scan` belongs to the mean diameter
    /// ([`Scenario::scan_of_mean`]), which is made if it is needed.
    pub fn of(scenario: Arc<Scenario>, scan: Option<&DepthScan>) -> Result<Option<Arc<dyn TrueFlow>>> {
        let Some((nodes, field)) = scenario.truth_grid().zip(scenario.field()) else { return Ok(None) };
        let depths = match scan {
            _ if nodes.weighting == Weighting::None => Vec::new(),
            Some(scan) => nodes.weighting.depths(scan),
            None => nodes.weighting.depths(&scenario.scan_of_mean()?),
        };
        let intervals = scenario.field_intervals(field);
        Ok(Some(Arc::new(ScenarioFlow { scenario, depths, intervals })))
    }

    /// The flow of the scenario in a dataset's folder, at the times of its frames; `None` also without a scenario, as in
    /// a recording.
    pub fn of_dataset(dataset: &Path, context: &Context) -> Result<Option<Arc<dyn TrueFlow>>> {
        if !dataset.join(SCENARIO).exists() {
            return Ok(None);
        }
        ScenarioFlow::of(Arc::new(of_dataset(dataset, context)?.0), None)
    }
}

impl TrueFlow for ScenarioFlow {
    fn row(&self, pair: Option<u32>, [x_px, y_px, z_um]: [f64; 3], is_weighted: bool) -> FieldRow {
        let at = FieldRow { pair, x_px, y_px, z_um, mask: true, ..FieldRow::default() };
        let interval = match &self.intervals[..] {
            [(None, interval)] => Some(interval),
            all => all.binary_search_by_key(&pair, |(of, _)| *of).ok().map(|k| &all[k].1),
        };
        let (Some(interval), Some(field)) = (interval, self.scenario.field()) else { return at };
        let flow = self.scenario.image_flow(field, &self.depths);
        let weighted = if is_weighted { flow.weighted([x_px, y_px], *interval) } else { [f64::NAN; 3] };
        flow.row(at, weighted, *interval)
    }
}
