//! The score table on standard output: 80 columns wide, with the gate and the signed bias.

use std::fmt::Write;

use scoring::evaluate::Score;
use scoring::evaluate::crlb::{BoundBin, Crlb};
use scoring::evaluate::field::{ComponentErrors, FieldErrors, FieldScore};
use scoring::evaluate::motion::VelocitySource;
use scoring::evaluate::size::Size;
use scoring::evaluate::statistics::quantile;
use scoring::evaluate::uncertainty::Uncertainty;

/// A number with four decimals or in scientific notation; a dash for `None`.
pub(crate) fn number(value: Option<f64>) -> String {
    match value {
        None => "-".to_owned(),
        Some(0.0) => "0".to_owned(),
        Some(v) if v.abs() >= 0.001 && v.abs() < 1e5 => format!("{v:.4}"),
        Some(v) => format!("{v:.3e}"),
    }
}

pub(crate) fn signed(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |v| format!("{v:+.4}"))
}

fn interval(value: Option<[f64; 2]>) -> String {
    value.map_or(String::new(), |[a, b]| format!(" [{a:.4}, {b:.4}]"))
}

/// Width of the table, characters.
const WIDTH: usize = 80;
/// Column in which texts begin.
const INDENT: usize = 13;

/// Adds a labeled line; long texts are wrapped between fields (separated by two blanks) or, without fields,
/// between words.
fn line(out: &mut String, name: &str, text: &str) {
    let separator = if text.contains("  ") { "  " } else { " " };
    let mut row = format!("  {name:<10} ");
    let mut empty = true;
    for field in text.split(separator).filter(|f| !f.is_empty()) {
        if !empty && row.chars().count() + separator.len() + field.chars().count() > WIDTH {
            // Writing to a string cannot fail.
            let _ = writeln!(out, "{}", row.trim_end());
            (row, empty) = (" ".repeat(INDENT), true);
        }
        row += if empty { "" } else { separator };
        row += field;
        empty = false;
    }
    let _ = writeln!(out, "{}", row.trim_end());
}

/// The scores as a text table: those that a result of this kind is judged by.
pub fn summary(score: &Score) -> String {
    let (mut text, has_more) = (head(score), score.detection.is_some() || score.field.is_some());
    let out = &mut text;
    found(out, score);
    planes(out, score);
    score.field.iter().for_each(|field| vectors_in_short(out, field));
    if has_more {
        line(out, "", "(--all prints all scores)");
    }
    text
}

/// All scores as a text table.
pub fn table(score: &Score) -> String {
    let mut text = head(score);
    let out = &mut text;
    particles(out, score);
    planes(out, score);
    if let Some(field) = &score.field {
        counts(out, field);
        field.truths.iter().for_each(|(name, against)| vectors(out, name, against));
    }
    if let Some(offset) = &score.offset {
        let fits = format!(
            "({:+.3}, {:+.3}) px fits best; without it F1 would be {:.3}; not applied",
            offset.x_px, offset.y_px, offset.f1_without
        );
        line(out, "offset", &fits);
    }
    text
}

/// What precedes the scores.
fn head(score: &Score) -> String {
    let mut text = format!("{} against {}\n", score.result, score.dataset);
    let out = &mut text;
    score.hints.iter().for_each(|hint| line(out, "HINT", &hint.what));
    score.warnings.iter().for_each(|warning| line(out, "WARNING", warning));
    score.assumptions.iter().for_each(|a| line(out, "read as", a));
    score.unknown.iter().for_each(|what| line(out, "not known", what));
    text
}

/// How many vectors there are, and where.
fn counts(out: &mut String, field: &FieldScore) {
    let counts = format!(
        "{} of {} vectors valid, {} interpolated, {} outside the true field",
        field.n_reported, field.n_total, field.n_interpolated, field.n_outside
    );
    line(out, "field", &counts);
    if let Some(z_um) = field.plane_um {
        line(out, "plane", &format!("truth at z = {z_um} um"));
    }
}

/// Errors along an axis.
fn component(c: &ComponentErrors) -> String {
    let n = number;
    format!("bias {}  random {}  RMS {} px", signed(c.bias_px), n(c.random_px), n(c.rms_px))
}

/// Vectors, their errors against the main truth, outliers, what they resolve.
fn vectors_in_short(out: &mut String, field: &FieldScore) {
    let (n, main) = (number, &field.main);
    counts(out, field);
    line(out, &field.against, &format!("u  {}", component(&main.u)));
    line(out, "", &format!("v  {}", component(&main.v)));
    // Where the main truth is another one, the usual one as well.
    if let Some(central) = field.truths.get("central").filter(|_| field.against != "central") {
        line(out, "central", &format!("u  {}", component(&central.u)));
        line(out, "", &format!("v  {}", component(&central.v)));
    }
    let medians = [main.u.median_abs_px, main.v.median_abs_px].map(n);
    line(out, "", &format!("median error: u {}  v {} px", medians[0], medians[1]));
    let nodes = &field.nodes;
    let text = format!(
        "{} beyond {} px  AEE {} px{}  valid nodes {}{}",
        n(main.outlier_fraction),
        main.outlier_threshold_px,
        n(main.aee_px),
        interval(main.interval_aee_px),
        n(nodes.valid),
        interval(nodes.interval_valid)
    );
    line(out, "outliers", &text);
    let text = format!(
        "peak locking {}  bias amplitude {} px  modulation u {}  v {}",
        n(main.peak_locking.degree_corrected),
        n(main.peak_locking.amplitude_px),
        n(main.modulation_u),
        n(main.modulation_v)
    );
    line(out, "resolves", &text);
}

/// Particles found, errors of their positions, links, and what explains them: overlap, and the bound or claims.
fn found(out: &mut String, score: &Score) {
    let Some(d) = &score.detection else { return };
    let n = number;
    let text = format!(
        "{} of {}  recall {}{}  {} ghosts  precision {}  F1 {}{}",
        d.tp,
        d.tp + d.missed,
        n(d.recall),
        interval(d.interval_recall),
        d.fp,
        n(d.precision),
        n(d.f1),
        interval(d.interval_f1)
    );
    line(out, "found", &text);
    let of_axis = |name: &str, bias: Option<f64>, rms: Option<f64>, unit: &str| {
        rms.map(|rms| format!("{name} RMS {} {unit}, bias {}", n(Some(rms)), signed(bias)))
    };
    let errors = [
        of_axis("x", d.bias_x_px, d.rmse_x_px, "px"),
        of_axis("y", d.bias_y_px, d.rmse_y_px, "px"),
        of_axis("z", d.bias_z_um, d.rmse_z_um, "um"),
        score.gdpt.as_ref().and_then(|g| Some(format!("sigma z {} h", n(Some(g.sigma_z_over_h?))))),
    ];
    line(out, "errors", &errors.into_iter().flatten().collect::<Vec<_>>().join("  "));
    let links = [
        score.links.as_ref().map(|l| format!("F1 {}{}", n(l.f1), interval(l.interval_f1))),
        score.hota.as_ref().map(|h| format!("HOTA {}{}", n(h.hota), interval(h.interval_hota))),
        score.lpt.as_ref().map(|l| format!("displacement RMS {} px", n(l.motion.displacement_rms_px))),
    ];
    let links: Vec<String> = links.into_iter().flatten().collect();
    if !links.is_empty() {
        line(out, "links", &links.join("  "));
    }
    if let Some(size) = &score.size {
        sizes(out, size);
    }
    if let Some(text) = overlap(score) {
        line(out, "overlap", &text);
    }
    match (&score.crlb, &score.uncertainty) {
        (Some(of), _) => bounds(out, of),
        (None, Some(claims)) => {
            let axes = [("x", &claims.x), ("y", &claims.y), ("z", &claims.z)];
            let all = axes
                .iter()
                .filter_map(|(axis, of)| Some(format!("{axis} RMS error / RMS U {}", n(of.as_ref()?.ratio))));
            line(out, "claims", &all.collect::<Vec<_>>().join("  "));
        }
        (None, None) => {}
    }
}

/// Errors of diameters, and the fraction of particles with the right class.
fn sizes(out: &mut String, size: &Size) {
    let mut text = format!(
        "diameter RMS {} um, bias {} ({} of {} particles)",
        number(size.rms_um),
        number(size.bias_um),
        size.n,
        size.n_true
    );
    if size.right.is_some() {
        let _ = write!(text, "  right class {}", number(size.right) + &interval(size.interval_right));
    }
    line(out, "size", &text);
}

/// Largest overlap of an image that counts as isolated, and the least difference of recalls and share of the misses that
/// overlap explains.
const ISOLATED: f64 = 0.2;
const EXPLAINED: f64 = 0.1;
const SHARE_OF_MISSES: f64 = 0.25;

/// The recall of isolated particles and of the others, if they differ and many are missed or nearly all overlap.
fn overlap(score: &Score) -> Option<String> {
    let bins = &score.curves.iter().find(|curve| curve.against == "overlap")?.bins;
    let sum = |is_isolated: bool| {
        let own = bins.iter().filter(|bin| (bin.to <= ISOLATED + 1e-9) == is_isolated);
        own.fold((0, 0), |(tp, n), bin| (tp + bin.tp, n + bin.n_true))
    };
    let recall = |(tp, n): (usize, usize)| (n > 0).then(|| tp as f64 / n as f64);
    let (isolated, others) = (sum(true), sum(false));
    let share = others.1 as f64 / (isolated.1 + others.1).max(1) as f64;
    let (low, high) = (recall(others)?, recall(isolated));
    let missed = |(tp, n): (usize, usize)| (n - tp) as f64;
    let are_many = missed(others) > SHARE_OF_MISSES * (missed(others) + missed(isolated));
    let explains = are_many && high.is_some_and(|high| high > low + EXPLAINED) || (share > 0.9 && low < 0.5);
    explains.then(|| {
        let high = high.map_or_else(String::new, |high| format!(", {high:.2} of the others"));
        format!(
            "explains misses: {:.0} % of the particles share more than {ISOLATED} of their light with others; recall {low:.2} of these{high}",
            100.0 * share
        )
    })
}

/// Errors of depth against planes of known height.
fn planes(out: &mut String, score: &Score) {
    let Some(p) = &score.planes else { return };
    let n = number;
    let scored = format!("{} points in {} frames whose plane is known", p.n, p.frames);
    line(out, "planes", &scored);
    let within =
        format!("{} of them within {} um of their plane ({})", p.n_within, p.gate_z_um, n(p.share_within));
    line(out, "", &within);
    let errors =
        format!("bias {}  random {}  RMS {} um", signed(p.bias_z_um), n(p.random_z_um), n(p.rmse_z_um));
    line(out, "z of those", &errors);
    let all = format!(
        "50 % within {}  68 % within {}  95 % within {} um",
        n(p.p50_z_um),
        n(p.p68_z_um),
        n(p.p95_z_um)
    );
    line(out, "z of all", &all);
    if let Some(f) = &p.fitted {
        let (gate, wrong) = (
            p.gate_z_um,
            p.wrong_side.map_or(String::new(), |share| format!("; {share:.3} on the wrong side")),
        );
        let fitted = format!(
            "of planes fitted to each height (tilt and height; gate {gate} um): RMS {}  50 % within {}  68 % within {} um  within the gate {}{wrong}",
            n(f.rms_z_um),
            n(f.p50_z_um),
            n(f.p68_z_um),
            n(f.share_within)
        );
        line(out, "", &fitted);
    }
    let ends = |bins: &[scoring::evaluate::planes::PlaneBin]| {
        let most = |a: f64, b: &scoring::evaluate::planes::PlaneBin| {
            b.bias_z_um.filter(|v| v.abs() > a.abs()).unwrap_or(a)
        };
        bins.iter().filter(|bin| bin.n > 0).fold(0.0, most)
    };
    line(
        out,
        "",
        &format!(
            "largest bias {:+.3} um over height, {:+.3} um over radius",
            ends(&p.over_height),
            ends(&p.over_radius)
        ),
    );
}

fn particles(out: &mut String, score: &Score) {
    let Some(d) = &score.detection else { return };
    let n = number;
    let c = &score.counts;
    let scored = format!(
        "{} true particles and {} found in {} frames; not scored: {} true, {} found",
        c.n_truth, c.n_result, c.frames, c.ignored_truth, c.ignored_result
    );
    line(out, "scored", &scored);
    if let Some(gate) = &score.definitions.gate {
        line(out, "gate", &format!("{gate}, {}", score.definitions.assignment));
    }
    line(out, "detection", &format!("tp {}  fn {}  fp {}  Jaccard {}", d.tp, d.missed, d.fp, n(d.jaccard)));
    for (name, value, between) in [
        ("precision", d.precision, d.interval_precision),
        ("recall   ", d.recall, d.interval_recall),
        ("F1       ", d.f1, d.interval_f1),
        ("RMSE xy  ", d.rmse_xy_px, d.interval_rmse_xy_px),
    ] {
        let unit = if name.starts_with("RMSE") { " px" } else { "" };
        let _ = writeln!(out, "             {name} {}{unit}{}", n(value), interval(between));
    }
    let _ = writeln!(out, "  error              bias     random        RMS");
    for (axis, bias, random, rms) in [
        ("x px", d.bias_x_px, d.random_x_px, d.rmse_x_px),
        ("y px", d.bias_y_px, d.random_y_px, d.rmse_y_px),
        ("z um", d.bias_z_um, d.random_z_um, d.rmse_z_um),
    ] {
        if rms.is_some() {
            let _ = writeln!(out, "       {axis}   {:>11} {:>10} {:>10}", signed(bias), n(random), n(rms));
        }
    }
    if !score.gates.is_empty() {
        let _ = writeln!(out, "  at gate                  precision     recall    xy px     z um");
    }
    for g in &score.gates {
        let _ = writeln!(
            out,
            "    {:<22} {:>9} {:>10} {:>8} {:>8}",
            g.gate,
            n(g.precision),
            n(g.recall),
            n(g.rmse_xy_px),
            n(g.rmse_z_um)
        );
    }
    if let Some(g) = &score.gdpt {
        let text = format!(
            "phi {}  sigma x {} px  y {} px  z {} um = {} h{}  outliers {}  (box {} px, {} um; greedy)",
            n(g.phi),
            n(g.sigma_x_px),
            n(g.sigma_y_px),
            n(g.sigma_z_um),
            n(g.sigma_z_over_h),
            interval(g.interval_sigma_z_over_h),
            n(g.rate_outlier),
            g.gate_xy_px,
            g.gate_z_um
        );
        line(out, "GDPT", &text);
    }
    if let Some(b) = &score.boxes {
        let text = format!(
            "AP {}  AP50 {}  AP75 {}  AR {}  recall at 1 % ghosts {}  at 10 % {}  ({} true, {} found)",
            n(b.ap),
            n(b.ap50),
            n(b.ap75),
            n(b.ar),
            n(b.recall_at_1_percent_ghosts),
            n(b.recall_at_10_percent_ghosts),
            b.n_truth,
            b.n_result
        );
        line(out, "boxes", &text);
    }
    if let Some(size) = &score.size {
        sizes(out, size);
        for (class, row) in size.classes_um.iter().zip(&size.confusion) {
            let counts: Vec<String> = row.iter().map(usize::to_string).collect();
            let text = format!(
                "{class} um: {}  (found as each class, without a diameter, missed)",
                counts.join("  ")
            );
            line(out, "", &text);
        }
    }
    score.crlb.iter().for_each(|bound| bounds(out, bound));
    tracks(out, score);
    if let Some(claims) = &score.uncertainty {
        let axes = [("x", &claims.x), ("y", &claims.y), ("z", &claims.z)];
        axes.iter().for_each(|(axis, of)| claimed(out, &format!("claims {axis}"), of.as_ref()));
        if let Some(c) = &score.crps {
            line(out, "CRPS", &format!("xy {} px  z {} um, mean over all particles", n(c.xy_px), n(c.z_um)));
        }
    }
}

fn tracks(out: &mut String, score: &Score) {
    let n = number;
    if let Some(l) = &score.links {
        let text = format!(
            "tp {}  fn {}  fp {}  precision {}  recall {}  F1 {}{}",
            l.tp,
            l.missed,
            l.fp,
            n(l.precision),
            n(l.recall),
            n(l.f1),
            interval(l.interval_f1)
        );
        line(out, "links", &text);
    }
    for i in score.isbi.iter().chain(&score.isbi_2d) {
        let text = format!(
            "alpha {}{}  beta {}  JSC {}  JSC_theta {}  RMSE {} px",
            n(i.alpha),
            interval(i.interval_alpha),
            n(i.beta),
            n(i.jsc),
            n(i.jsc_theta),
            n(i.rmse)
        );
        line(out, &format!("ISBI {}-D", i.dims), &format!("{text}  (gate {} px)", i.gate_px));
    }
    if let Some(h) = &score.hota {
        let text = format!(
            "HOTA {}{}  DetA {}  AssA {}  LocA {}",
            n(h.hota),
            interval(h.interval_hota),
            n(h.deta),
            n(h.assa),
            n(h.loca)
        );
        line(out, "tracks", &text);
    }
    if let (Some(c), Some(i), Some(ctc)) = (&score.clear, &score.identity, &score.ctc) {
        let text = format!(
            "MOTA {}  MOTP {} px  switches {}  IDF1 {}  TRA {}",
            n(c.mota),
            n(c.motp),
            c.id_switches,
            n(i.idf1),
            n(ctc.tra)
        );
        line(out, "", &text);
    }
    if let Some(l) = &score.lpt {
        let m = &l.motion;
        let acceleration = match m.acceleration_rms_px {
            None if m.acceleration_rms_um_s2.is_some() => format!("{} um/s^2", n(m.acceleration_rms_um_s2)),
            px => format!("{} px/frame^2", n(px)),
        };
        let text = format!(
            "missed {}  ghosts {}  displacement {} px  velocity {} um/s{}  acceleration {}  mean length {}  \
             longest run {}  fragments {}  tracked: mostly {}  partially {}  lost {}",
            n(l.missed),
            n(l.ghost),
            n(m.displacement_rms_px),
            n(m.velocity_rms_um_s),
            match m.velocity_from {
                Some(VelocitySource::Positions) => " (of positions)",
                Some(VelocitySource::Both) => " (partly of positions)",
                Some(VelocitySource::Result) | None => "",
            },
            acceleration,
            n(l.mean_length),
            n(l.coverage_longest),
            n(l.fragments_per_truth),
            n(l.mostly_tracked),
            n(l.partially_tracked),
            n(l.mostly_lost)
        );
        line(out, "LPT", &text);
    }
}

/// The Cramér-Rao bound and the efficiency: medians over depth.
fn bounds(out: &mut String, of: &Crlb) {
    let median = |value: fn(&BoundBin) -> Option<f64>| {
        let mut values: Vec<f64> = of.bins.iter().filter_map(value).collect();
        values.sort_unstable_by(f64::total_cmp);
        number(quantile(&values, 0.5))
    };
    let text = format!(
        "Cramer-Rao bound x {} px  y {} px  z {} um  efficiency x {}  y {}  z {}  (medians over depth)",
        median(|b| b.crlb_x_px),
        median(|b| b.crlb_y_px),
        median(|b| b.crlb_z_um),
        median(|b| b.efficiency_x),
        median(|b| b.efficiency_y),
        median(|b| b.efficiency_z)
    );
    line(out, "bound", &text);
    if of.bins.iter().any(|bin| bin.crlb_d_um.is_some()) {
        line(out, "", &format!("diameter {} um", median(|b| b.crlb_d_um)));
    }
    if of.crlb_axis_deg.is_some() {
        let text =
            format!("axes {} deg  efficiency {}", number(of.crlb_axis_deg), number(of.efficiency_axis));
        line(out, "", &text);
    }
}

/// A line on claimed uncertainties, if there are any.
fn claimed(out: &mut String, name: &str, of: Option<&Uncertainty>) {
    let Some(u) = of else { return };
    let n = number;
    let text = format!(
        "{} within U  {} within 2 U (normal: 0.6827, 0.9545)  RMS error / RMS U {}",
        n(u.coverage_1s),
        n(u.coverage_2s),
        n(u.ratio)
    );
    line(out, name, &text);
}

fn vectors(out: &mut String, name: &str, a: &FieldErrors) {
    let n = number;
    line(out, name, &format!("u  {}", component(&a.u)));
    line(out, "", &format!("v  {}", component(&a.v)));
    line(out, &format!("  < {} px", a.outlier_threshold_px), &format!("u  {}", component(&a.u_inliers)));
    line(out, "", &format!("v  {}", component(&a.v_inliers)));
    let text = format!(
        "AEE {} px{}  NEPE {}  angle {} deg  outliers {}  valid {}{}  peak locking {} (corrected for the number of vectors)  bias amplitude {} px  \
         modulation u {}  v {}",
        n(a.aee_px),
        interval(a.interval_aee_px),
        n(a.nepe),
        n(a.angular_error_deg),
        n(a.outlier_fraction),
        n(a.valid_vector_probability),
        interval(a.interval_valid_vector_probability),
        n(a.peak_locking.degree_corrected),
        n(a.peak_locking.amplitude_px),
        n(a.modulation_u),
        n(a.modulation_v)
    );
    line(out, "", &text);
    if let Some(g) = &a.gradients {
        let text = format!(
            "vorticity {} of {}  divergence {} of {}  strain {} of {} px/px RMS",
            n(g.vorticity_rms),
            n(g.true_vorticity_rms),
            n(g.divergence_rms),
            n(g.true_divergence_rms),
            n(g.strain_rms),
            n(g.true_strain_rms)
        );
        line(out, "  gradients", &text);
    }
    for s in a.spectra.iter().filter(|s| s.wavelength_50_px.is_some() || s.wavelength_80_px.is_some()) {
        let text = format!(
            "{} along {}: response 0.8 at {} px, 0.5 at {} px wavelength",
            s.component,
            s.along,
            n(s.wavelength_80_px),
            n(s.wavelength_50_px)
        );
        line(out, "  resolves", &text);
    }
    claimed(out, "  claims u", a.uncertainty.u.as_ref());
    claimed(out, "  claims v", a.uncertainty.v.as_ref());
}

#[cfg(test)]
mod tests {
    use scoring::evaluate::curves::{Bin, Curve};
    use scoring::evaluate::detection::Detection;

    use super::*;

    #[test]
    fn five_lines_say_how_good_a_result_is_and_that_overlap_explains_it() {
        let bin =
            |to: f64, n_true: usize, tp: usize| Bin { from: to - 0.1, to, n_true, tp, ..Bin::default() };
        let crowded =
            |hard: usize| vec![bin(0.1, 10, 10), bin(0.2, 10, 9), bin(0.3, 40, hard), bin(0.4, 40, hard)];
        let of = |bins: Vec<Bin>| {
            let detection = Detection { tp: 3, missed: 1, recall: Some(0.75), ..Detection::default() };
            let curves = vec![Curve { against: "overlap".to_owned(), bins }];
            summary(&Score { detection: Some(detection), curves, ..Score::default() })
        };
        let said = of(crowded(4));
        assert!(said.contains("found      3 of 4  recall 0.7500"), "{said}");
        assert!(said.contains("80 % of the particles share more than 0.2"), "{said}");
        assert!(said.contains("recall 0.10 of") && said.contains("0.95 of the others"), "{said}");
        assert!(
            !of(crowded(38)).contains("overlap")
                && said.lines().count() <= 6
                && said.lines().all(|l| l.len() <= WIDTH),
            "{said}"
        );
        // One of the 62 misses.
        assert!(!of(vec![bin(0.1, 479, 418), bin(0.3, 1, 0)]).contains("overlap"));
    }
}
