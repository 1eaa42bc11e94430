//! TRA, DET and LNK of the Cell Tracking Challenge (Matula et al., PLoS ONE 10, e0144959, 2015), for points.
//!
//! AOGM = 10 FN + 1 FP + 1 ED + 1.5 EA is the cost of editing the result into the truth: ED counts links
//! between matched points that are not true links, EA true links missing from the result. Points are matched
//! one to one, so there is nothing to split, and particles do not divide. TRA = 1 - min(AOGM, AOGM0) / AOGM0,
//! where AOGM0 is the cost of creating the truth from nothing; DET uses only the points, LNK only the links.
//! Missed points dominate TRA, which is therefore insensitive to identity errors and unsuitable for ranking.

use super::links::{correct_links, successors};
use super::matching::{Matching, NONE};
use super::statistics::ratio;
use super::track_set::TrackSet;

scores! {
    /// Cell Tracking Challenge (Matula et al., PLoS ONE 10, e0144959, 2015), for points without divisions.
    pub struct Ctc {
        /// Tracking score: 1 - min(AOGM, AOGM0) / AOGM0, where AOGM0 is the cost of creating the truth from
        /// nothing.
        fraction tra: Option<f64>,
        /// Detection score: the same with the costs of nodes (points) only.
        fraction det: Option<f64>,
        /// Linking score: the same with the costs of edges (links) only.
        fraction lnk: Option<f64>,
        /// Cost of editing the result into the truth: 10 fn_nodes + fp_nodes + fp_edges + 1.5 fn_edges.
        not_negative aogm: f64,
        /// Number of true points without a match.
        pub fn_nodes: usize,
        /// Number of result points without a match.
        pub fp_nodes: usize,
        /// Number of true links that no result link reproduces.
        pub fn_edges: usize,
        /// Number of result links between matched points that are not true links.
        pub fp_edges: usize,
    }
}

impl Ctc {
    /// Scores a matching.
    pub fn of(truth: &TrackSet, result: &TrackSet, matching: &Matching) -> Self {
        let tp = matching.pairs().count();
        let correct = correct_links(result, matching, &successors(truth)).count();
        let matched = |i: u32| matching.truth_for[i as usize] != NONE;
        let between_matched = result.links().filter(|&(a, b)| matched(a) && matched(b)).count();
        let (n, links) = (truth.len(), truth.links().count());
        let (fn_nodes, fp_nodes) = (n - tp, result.len() - tp);
        let (fn_edges, fp_edges) = (links - correct, between_matched - correct);
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
