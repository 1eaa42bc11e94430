//! The table on standard output: at most 110 columns but for sentences, the gate beside the numbers, the signed bias always.

use std::fmt::Write;

use crate::evaluate::field::{Against, Component};
use crate::evaluate::{Score, words};

/// A number with a few digits, or a dash.
pub(crate) fn number(value: Option<f64>) -> String {
    match value {
        None => "-".to_owned(),
        Some(0.0) => "0".to_owned(),
        Some(v) if v.abs() >= 0.001 && v.abs() < 1e5 => format!("{v:.4}"),
        Some(v) => format!("{v:.3e}"),
    }
}

fn signed(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |v| format!("{v:+.4}"))
}

fn interval(value: Option<[f64; 2]>) -> String {
    value.map_or(String::new(), |[a, b]| format!(" [{a:.4}, {b:.4}]"))
}

/// The scores as text.
pub fn table(score: &Score) -> String {
    let mut text = String::new();
    let out = &mut text;
    line(out, "", &format!("{} against {}", score.result, score.dataset));
    score.assumptions.iter().for_each(|a| line(out, "read as", a));
    particles(out, score);
    if let Some(field) = &score.field {
        line(
            out,
            "field",
            &format!(
                "{} of {} vectors valid, {} interpolated, {} outside of the truth",
                field.n_reported, field.n_total, field.n_interpolated, field.n_outside
            ),
        );
        field.truths.iter().for_each(|(name, against)| vectors(out, name, against));
    }
    if let Some(offset) = &score.offset {
        let fits = format!(
            "({:+.3}, {:+.3}) px fits best; without it F1 would be {:.3}; not applied",
            offset.x_px, offset.y_px, offset.f1_without
        );
        line(out, "offset", &fits);
    }
    score.warnings.iter().for_each(|w| line(out, "WARNING", w));
    text
}

fn line(out: &mut String, name: &str, text: &str) {
    // Writing to a string cannot fail.
    let _ = if name.is_empty() { writeln!(out, "{text}") } else { writeln!(out, "  {name:<10} {text}") };
}

fn particles(out: &mut String, score: &Score) {
    let Some(d) = &score.detection else { return };
    let n = number;
    let c = &score.counts;
    line(
        out,
        "scored",
        &format!(
            "{} true particles and {} found in {} frames; not scored: {} true, {} found",
            c.n_truth, c.n_result, c.frames, c.ignored_truth, c.ignored_result
        ),
    );
    if let Some(gate) = &score.definitions.gate {
        line(out, "gate", &format!("{}, {}", words(gate), score.definitions.assignment));
    }
    line(out, "detection", &format!("tp {}  fn {}  fp {}  Jaccard {}", d.tp, d.missed, d.fp, n(d.jaccard)));
    line(out, "", &format!("    precision  {}{}", n(d.precision), interval(d.interval.precision)));
    line(out, "", &format!("    recall     {}{}", n(d.recall), interval(d.interval.recall)));
    line(out, "", &format!("    F1         {}{}", n(d.f1), interval(d.interval.f1)));
    line(out, "", &format!("    RMSE xy    {} px{}", n(d.rmse_xy_px), interval(d.interval.rmse_xy_px)));
    line(out, "error", "         bias     random        RMS");
    for (axis, bias, random, rms) in [
        ("x px", d.bias_x_px, d.random_x_px, d.rmse_x_px),
        ("y px", d.bias_y_px, d.random_y_px, d.rmse_y_px),
        ("z um", d.bias_z_um, d.random_z_um, d.rmse_z_um),
    ] {
        if rms.is_some() {
            line(out, "", &format!("    {axis}   {:>12} {:>10} {:>10}", signed(bias), n(random), n(rms)));
        }
    }
    for g in &score.gates {
        let text = format!(
            "{}: precision {}  recall {}  RMSE xy {} px{}",
            g.gate,
            n(g.precision),
            n(g.recall),
            n(g.rmse_xy_px),
            g.rmse_z_um.map_or(String::new(), |z| format!(", z {} um", n(Some(z))))
        );
        line(out, "at gate", &text);
    }
    if let Some(g) = &score.gdpt {
        let text = format!(
            "phi {}  sigma x {} y {} px  z {} um = {} h (box {} px, {} um; greedy)",
            n(g.phi),
            n(g.sigma_x_px),
            n(g.sigma_y_px),
            n(g.sigma_z_um),
            n(g.sigma_z_over_h),
            g.gate_xy_px,
            g.gate_z_um
        );
        line(out, "GDPT", &text);
    }
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
            "alpha {}  beta {}  JSC {}  JSC_theta {}  RMSE {} px (gate {} px, {}-D)",
            n(i.alpha),
            n(i.beta),
            n(i.jsc),
            n(i.jsc_theta),
            n(i.rmse),
            i.gate_px,
            i.dims
        );
        line(out, "ISBI", &text);
    }
    if let (Some(h), Some(c), Some(i)) = (&score.hota, &score.clear, &score.identity) {
        let text = format!("HOTA {}  DetA {}  AssA {}  LocA {}", n(h.hota), n(h.deta), n(h.assa), n(h.loca));
        line(out, "tracks", &text);
        let text = format!(
            "MOTA {}  MOTP {} px  switches {}  IDF1 {}",
            n(c.mota),
            n(c.motp),
            c.id_switches,
            n(i.idf1)
        );
        line(out, "", &format!("             {text}"));
    }
    if let Some(l) = &score.lpt {
        let text = format!(
            "missed {}  ghosts {}  displacement {} px  velocity {} um/s  acceleration {} px",
            n(l.missed),
            n(l.ghost),
            n(l.displacement_rms_px),
            n(l.velocity_rms_um_s),
            n(l.acceleration_rms_px)
        );
        line(out, "LPT", &text);
        let text = format!(
            "mean length {}  longest run {}  fragments {}  MT {} PT {} ML {}",
            n(l.mean_length),
            n(l.coverage_longest),
            n(l.fragments_per_truth),
            n(l.mostly_tracked),
            n(l.partially_tracked),
            n(l.mostly_lost)
        );
        line(out, "", &format!("             {text}"));
    }
}

fn vectors(out: &mut String, name: &str, a: &Against) {
    let n = number;
    let component = |c: &Component| {
        format!("bias {}  random {}  RMS {} px", signed(c.bias_px), n(c.random_px), n(c.rms_px))
    };
    line(out, name, &format!("u: {}", component(&a.u)));
    line(out, "", &format!("             v: {}", component(&a.v)));
    line(out, "", &format!("    inliers  u: {} (< {} px)", component(&a.u_inliers), a.outlier_threshold_px));
    line(out, "", &format!("             v: {}", component(&a.v_inliers)));
    let text = format!(
        "AEE {} px{}  NEPE {}  angle {} deg  outliers {}  valid {}",
        n(a.aee_px),
        interval(a.interval_aee_px),
        n(a.nepe),
        n(a.angular_error_deg),
        n(a.outlier_fraction),
        n(a.valid_vector_probability)
    );
    line(out, "", &format!("             {text}"));
    let text = format!(
        "peak locking {}  bias amplitude {} px  modulation u {} v {}",
        n(a.peak_locking.degree),
        n(a.peak_locking.amplitude_px),
        n(a.modulation_u),
        n(a.modulation_v)
    );
    line(out, "", &format!("             {text}"));
}
