//! TRA, DET and LNK of the Cell Tracking Challenge (Matula et al., PLoS ONE 10, e0144959, 2015), for points.
//!
//! AOGM = 10 FN + 1 FP + 1 ED + 1.5 EA: what it costs to edit the result into the truth, where ED are links between matched
//! points that are no true link, EA true links without one of the result. Points are matched one to one, so nothing is to be
//! split, and particles do not divide. TRA = 1 - min(AOGM, AOGM0) / AOGM0 with AOGM0 the cost of the truth itself; DET has
//! the points alone, LNK the links. Missed points weigh so much that TRA hardly sees identities: never rank by it.

use serde::Serialize;

use super::cloud::Cloud;
use super::links::{right, successors};
use super::matching::{Matching, NONE};
use super::statistics::ratio;

/// The scores.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Ctc {
    pub tra: Option<f64>,
    pub det: Option<f64>,
    pub lnk: Option<f64>,
    pub aogm: f64,
    pub fn_nodes: usize,
    pub fp_nodes: usize,
    pub fn_edges: usize,
    pub fp_edges: usize,
}

impl Ctc {
    /// Of a matching.
    pub fn of(truth: &Cloud, result: &Cloud, matching: &Matching) -> Self {
        let tp = matching.pairs().count();
        let right = right(result, matching, &successors(truth)).count();
        let matched = |i: u32| matching.of_result[i as usize] != NONE;
        let between_matched = result.links().filter(|&(a, b)| matched(a) && matched(b)).count();
        let (n, links) = (truth.len(), truth.links().count());
        let (fn_nodes, fp_nodes) = (n - tp, result.len() - tp);
        let (fn_edges, fp_edges) = (links - right, between_matched - right);
        let nodes = 10.0 * fn_nodes as f64 + fp_nodes as f64;
        let edges = fp_edges as f64 + 1.5 * fn_edges as f64;
        let (all_nodes, all_edges) = (10.0 * n as f64, 1.5 * links as f64);
        let score = |cost: f64, all: f64| ratio(cost.min(all), all).map(|share| 1.0 - share);
        Ctc {
            tra: score(nodes + edges, all_nodes + all_edges),
            det: score(nodes, all_nodes),
            lnk: score(edges, all_edges),
            aogm: nodes + edges,
            fn_nodes,
            fp_nodes,
            fn_edges,
            fp_edges,
        }
    }
}
