//! What a microscope can measure, before any dataset is generated: images of particles over depth, the Cramer-Rao bound of
//! positions, the depths at which z is determined, and the density of particles that can be told apart.

mod picture;

use generator::preview::{DepthFacts, Preview, lines};
use scenario::{CylinderFacts, Scenario};
use scoring::evaluate::crlb::{DepthBound, DepthBounds, PositionBound};
use serde::Serialize;
use storage::dataset::{USUAL_N_S, digits, usual_ppp};
use storage::error::Result;

pub(crate) use picture::MOST;
pub use picture::{png, svg};

/// Depths of a table.
const ROWS: usize = 11;

/// What the optics of a scenario can measure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Optics {
    /// Images over depth.
    #[serde(flatten)]
    pub preview: Preview,
    /// Bounds of the mean size at the depths of its images.
    pub bounds: DepthBounds,
    /// The number of particles per pixel with N_S = 0.3.
    pub usual_particles_per_px: Option<f64>,
    /// What distinguishes the scenario from others.
    #[serde(skip)]
    pub label: String,
}

impl Optics {
    /// The optics of a scenario.
    pub fn of(scenario: &Scenario) -> Result<Self> {
        let preview = Preview::of(scenario)?;
        let mean = preview.mean();
        let depths_um: Vec<f64> = mean.depths.iter().map(|depth| depth.z_um).collect();
        let bounds = DepthBounds::of(scenario, mean.d_um, &depths_um)?;
        Ok(Optics {
            bounds,
            usual_particles_per_px: usual_ppp(preview.particles_per_px, preview.source_density),
            label: preview.name.clone(),
            preview,
        })
    }
}

/// Name of the `index`-th of several scenarios in tables and figures.
pub(crate) fn letter(index: usize) -> char {
    (b'A' + index as u8) as char
}

/// What is found on several scenarios, side by side.
pub fn side_by_side(all: &[Optics]) -> String {
    let named = all.iter().enumerate().map(|(i, optics)| format!("{}: {}", letter(i), optics.label));
    let named: Vec<String> = named.collect();
    format!("{}\n\n{}", named.join("\n"), summary(all))
}

/// The answers: a row for each, a column for each scenario.
fn summary(all: &[Optics]) -> String {
    type Answer = fn(&Optics) -> String;
    let rows: [(&str, Answer); 14] = [
        ("depth range, um", |o| between(o.preview.depth_range_um.into())),
        ("best focus, um", |o| {
            o.preview.mean().focus_um.map_or("all depths".to_owned(), |z| format!("{z:.1}"))
        }),
        ("depth of field, um", |o| {
            o.preview.depth_of_field_um.map_or("-".to_owned(), |um| format!("{um:.1}"))
        }),
        ("particle diameter, um", |o| format!("{}", o.preview.mean().d_um)),
        ("image in best focus, px", |o| {
            size(o.preview.mean().focus.as_ref().or(o.preview.mean().depths.first()))
        }),
        ("at the lower end, px", |o| size(o.preview.mean().depths.first())),
        ("at the upper end, px", |o| size(o.preview.mean().depths.last())),
        ("peak, counts", |o| {
            o.preview.mean().range(|depth| Some(depth.peak_counts)).map_or("-".to_owned(), between)
        }),
        ("SNR, median over depth", |o| o.preview.mean().median_snr().map_or("no noise".to_owned(), digits)),
        ("bound of x, px: best, mean", |o| best_and_mean(&o.bounds, |bound| bound.crlb_x_px)),
        ("bound of y, px: best, mean", |o| best_and_mean(&o.bounds, |bound| bound.crlb_y_px)),
        ("bound of z, um: best, mean", |o| best_and_mean(&o.bounds, |bound| bound.crlb_z_um)),
        ("z determined, um", |o| determined(&o.bounds)),
        ("N_S at particles per pixel", |o| {
            let Preview { source_density, particles_per_px, .. } = &o.preview;
            format!("{} at {}", digits(*source_density), digits(*particles_per_px))
        }),
    ];
    let mut table: Vec<Vec<String>> = Vec::new();
    if all.len() > 1 {
        table.push(
            std::iter::once(String::new()).chain((0..all.len()).map(|i| letter(i).to_string())).collect(),
        );
    }
    for (name, of) in rows {
        table.push(std::iter::once(name.to_owned()).chain(all.iter().map(of)).collect());
    }
    let usual = |o: &Optics| o.usual_particles_per_px.map_or("-".to_owned(), digits);
    let name = format!("particles per pixel at N_S {USUAL_N_S}");
    table.push(std::iter::once(name).chain(all.iter().map(usual)).collect());
    let width = |k: usize| table.iter().map(|row| row[k].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..=all.len()).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:width$}"));
        cells.collect::<Vec<_>>().join("   ").trim_end().to_owned()
    };
    table.iter().map(line).collect::<Vec<_>>().join("\n")
}

fn between([low, high]: [f64; 2]) -> String {
    format!("{} to {}", tenths(low), tenths(high))
}

/// A number with at most one decimal.
fn tenths(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0")
        .map_or(text.clone(), |whole| if whole == "-0" { "0".to_owned() } else { whole.to_owned() })
}

fn size(depth: Option<&DepthFacts>) -> String {
    depth.map_or("-".to_owned(), |depth| format!("{:.1} x {:.1}", depth.width_px, depth.height_px))
}

fn shown_bound(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), digits)
}

fn best_and_mean(bounds: &DepthBounds, of: fn(&PositionBound) -> Option<f64>) -> String {
    [&bounds.best, &bounds.mean].map(|bound| shown_bound(of(bound))).join(", ")
}

fn determined(bounds: &DepthBounds) -> String {
    if bounds.determined_um.is_empty() {
        return "nowhere".to_owned();
    }
    let ranges: Vec<String> = bounds.determined_um.iter().map(|range| between(*range)).collect();
    format!("{} ({:.0} % of the range)", ranges.join(", "), 100.0 * bounds.determined_share)
}

/// The optics of a scenario as text: the answer first, then the images of each size over depth.
pub fn text(optics: &Optics) -> String {
    let Optics { preview, bounds, .. } = optics;
    let [focus, light] = lines(preview);
    let mut text = format!("{}: {}\n{focus}\n{light}\n", preview.name, preview.optics);
    text += &format!("\n{}\n", summary(std::slice::from_ref(optics)));
    let of_path = preview.path_difference_waves.map_or_else(String::new, |waves| {
        format!(
            ", path differences over the pupil {waves:.2} waves in best focus{}",
            if preview.cylinder.is_some() { " without the cylindrical lens" } else { "" }
        )
    });
    text += &format!(
        "{:.4} um per px; Airy radius {:.2} px{}{of_path}\n",
        preview.um_per_px,
        preview.airy_radius_px,
        if preview.is_diffracted {
            String::new()
        } else {
            format!(" ({} um; not drawn)", preview.wavelength_um)
        }
    );
    if preview.cyl_focal_length_um != 0.0 {
        text += &format!("cylindrical lens: cyl_focal_length = {:.1} um\n", preview.cyl_focal_length_um);
    }
    if let Some(facts) = preview.cylinder {
        text += &(phrase(facts) + "\n");
    }
    text += &format!(
        "depth of correlation {}{:.1} um; {:.1} particles in view; background {:.1} counts with a noise of {:.2}\n",
        if preview.is_correlation_cut { "at least " } else { "" },
        preview.depth_of_correlation_um,
        preview.particles_in_view,
        preview.background_counts,
        preview.background_noise_counts
    );
    for (index, size) in preview.sizes.iter().enumerate() {
        let has_bounds = index == preview.middle;
        let [below, above] = size.ring_slopes_px_um;
        text += &format!(
            "\n{} um: diameters change by {below:.2} px/um at the lower end of the range, by {above:.2} px/um at the upper\n\
             {:>9} {:>9} {:>8} {:>8} {:>10} {:>10} {:>7}{}\n",
            size.d_um,
            "z, um",
            "peak",
            "SNR",
            "with shot",
            "width, px",
            "height, px",
            "share",
            if has_bounds { "   bound of x, px     y, px     z, um" } else { "" }
        );
        let last = size.depths.len() - 1;
        let shown = ROWS.min(last + 1);
        for row in 0..shown {
            let at = row * last / (shown - 1).max(1);
            let depth = &size.depths[at];
            let number = |value: Option<f64>, digits: usize| {
                value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
            };
            text += &format!(
                "{:>9.2} {:>9.1} {:>8} {:>8} {:>10.1} {:>10.1} {:>7}{}\n",
                depth.z_um,
                depth.peak_counts,
                number(depth.snr, 1),
                number(depth.snr_with_shot_noise, 1),
                depth.width_px,
                depth.height_px,
                number(depth.share, 3),
                bounds.depths.get(at).filter(|_| has_bounds).map_or_else(
                    String::new,
                    |DepthBound { bound, .. }| {
                        let [x, y, z] = [bound.crlb_x_px, bound.crlb_y_px, bound.crlb_z_um].map(shown_bound);
                        format!("{x:>17} {y:>9} {z:>9}")
                    }
                )
            );
        }
    }
    text.trim_end().to_owned()
}

/// Focal planes, growth and positions.
fn phrase(CylinderFacts { focus_um, growth, stretch }: CylinderFacts) -> String {
    format!(
        "cylindrical lens: paraxial focus at {focus_um:.2} um along the direction in which it has power, at 0 across it; images grow \
        {growth:.3} times as fast along it as across it, positions are magnified {stretch:.3} times as much"
    )
}
