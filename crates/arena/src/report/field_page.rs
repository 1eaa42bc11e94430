//! The report of a fit of a field: coefficients, maps of the values of single particles, images from center to corner.

use fit::{FieldFiles, FieldFit, FieldParticle};
use maud::{Markup, html};

use super::fit_page::decimals;
use super::page::document;
use super::tiles::{self, SHOWN_SD, diverging};
use storage::error::Result;

/// Edge of a map, and radius of a particle in it, in units of the drawing.
const MAP: f64 = 200.0;
const DOT: f64 = 5.0;

/// Quantities that do not depend on the field.
const UNMAPPED: [&str; 2] = ["x_px", "y_px"];

/// The report of a fit.
pub fn field_page(made: &FieldFiles, scan: &str, size_px: [usize; 2]) -> Result<String> {
    let fitted = &made.fitted;
    let singles = fitted.particles.iter().filter(|particle| particle.is_single).count();
    let title = format!("Optics over the field of {scan}");
    let montage = montage(made)?;
    let body = html! {
        h1 { (title) }
        p.soft { (singles) " single particles of " (fitted.particles.len()) "; their images with the fitted optics: R2 "
            (format!("{:.4}", fitted.r2_of_field)) ", chi2 per pixel " (format!("{:.2}", fitted.chi2_of_field)) " (noise of one frame)" }
        p { b { "Conclusion: " (fitted.sentence()) "." } }
        @for warning in &fitted.warnings { p.warning { (warning) } }
        h2 { "Field dependence" }
        p.soft { "X and Y are distances from the center of the field in the particles' space, mm. Intervals: from the scatter of the \
            particles about the fitted functions of X and Y." }
        div.scroll { table {
            tr { th { "coefficient" } th { "value" } th { "95 % interval" } }
            @for c in &fitted.coefficients {
                @let places = decimals(c.sd);
                tr {
                    td { (c.key) @if !c.unit.is_empty() { ", " (c.unit) } }
                    td { (format!("{:.places$}", c.value)) }
                    td { (format!("{:.places$} to {:.places$}", c.value - 1.96 * c.sd, c.value + 1.96 * c.sd)) }
                }
            }
        } }
        h2 { "Images from the center to the corner" }
        (montage)
        h2 { "Maps" }
        p.soft { "Each particle at its place. Blue and red: the lowest and the highest value about the mean; in the residual, on the \
            same scale. Rings: particles that are not described as single ones." }
        @for (i, name) in fitted.quantities.iter().enumerate().filter(|(_, name)| !UNMAPPED.contains(name)) {
            (maps(fitted, i, name, size_px))
        }
    };
    Ok(document(&title, &body))
}

fn montage(made: &FieldFiles) -> Result<Markup> {
    Ok(html! {
        @for images in &made.images {
            @let particle = &made.fitted.particles[images.particle];
            @let r_mm = particle.place_mm[0].hypot(particle.place_mm[1]);
            div.scroll { table.windows {
                tr { th { (format!("{r_mm:.3} mm")) }
                    @for plane in &images.planes { th { (format!("{:.1}", plane.stage_um)) " um" } } }
                @for (name, of) in [("data", 0), ("model", 1), ("residual", 2)] {
                    tr { td { (name) } @for plane in &images.planes {
                        td { img alt=(name) src=(tiles::of(images.edge, [&plane.data, &plane.model, &plane.residual], of)?); }
                    } }
                }
            } }
        }
        p.soft { "Distance from the center, and stage positions. Data and model have the same gray scale in a column. Residuals: blue \
            and red are " (-SHOWN_SD) " and +" (SHOWN_SD) " standard deviations of the mean of a plane's frames; hatched pixels \
            are lit by neighbors." }
    })
}

/// Measured values, fitted field dependence and residuals of a quantity.
fn maps(fitted: &FieldFit, quantity: usize, name: &str, size_px: [usize; 2]) -> Markup {
    let singles = || fitted.particles.iter().filter(|particle| particle.is_single);
    let count = singles().count().max(1) as f64;
    let mean = singles().map(|particle| particle.measured[quantity]).sum::<f64>() / count;
    let most = singles().map(|particle| (particle.measured[quantity] - mean).abs()).fold(1e-12, f64::max);
    let residual = |particle: &FieldParticle| particle.measured[quantity] - particle.of_field[quantity];
    let rms = (singles().map(|particle| residual(particle).powi(2)).sum::<f64>() / count).sqrt();
    let places = decimals(most);
    html! {
        h3 { (name) ": " (format!("{mean:.places$} +- {most:.places$}, {rms:.places$} RMS residual")) }
        div.scroll { table.windows { tr {
            td { (map("measured", fitted, size_px, &|particle| (particle.measured[quantity] - mean) / most)) }
            td { (map("field dependence", fitted, size_px, &|particle| (particle.of_field[quantity] - mean) / most)) }
            td { (map("residual", fitted, size_px, &|particle| residual(particle) / most)) }
        } } }
    }
}

fn map(
    title: &str,
    fitted: &FieldFit,
    [width, height]: [usize; 2],
    value: &dyn Fn(&FieldParticle) -> f64,
) -> Markup {
    let scale = MAP / width.max(height) as f64;
    let color = |particle: &FieldParticle| {
        let [r, g, b] = diverging(value(particle) as f32);
        if particle.is_single { format!("rgb({r},{g},{b})") } else { "none".to_owned() }
    };
    html! {
        figure {
            svg viewBox=(format!("-1 -1 {} {}", scale * width as f64 + 2.0, scale * height as f64 + 2.0)) width=(MAP) role="img"
                aria-label=(title) {
                rect width=(scale * width as f64) height=(scale * height as f64) fill="#f4f4f4" stroke="#999" {}
                @for p in &fitted.particles {
                    circle cx=(format!("{:.1}", scale * p.x_px)) cy=(format!("{:.1}", scale * p.y_px)) r=(DOT) fill=(color(p))
                        stroke="#555" {}
                }
            }
            figcaption { (title) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fit::{Coefficient, FieldImages, PlaneImages};

    #[test]
    fn the_page_shows_laws_images_and_maps() {
        let particle = |is_single: bool, x_px: f64| FieldParticle {
            x_px,
            y_px: 30.0,
            place_mm: [0.03, 0.04],
            is_single,
            chi2: 1.1,
            r2: 0.99,
            chi2_of_field: 1.2,
            r2_of_field: 0.98,
            refitted_focus_um: -1.6,
            light: 1e5,
            measured: vec![x_px, 0.44],
            sd: vec![0.1, 0.01],
            of_field: vec![x_px, 0.43],
        };
        let fitted = FieldFit {
            coefficients: vec![Coefficient { key: "numerical_aperture", value: 0.44, sd: 0.001, unit: "" }],
            field: microsig_core::optics::FieldOptics::default(),
            numerical_aperture: 0.44,
            blur_um: 0.8,
            particle_diameter_um: 1.0,
            focus_um: 0.0,
            depths_um: [-10.0, 10.0],
            noise: [4.0, 0.1, 0.0],
            is_noise_measured: true,
            background: 100.0,
            quantities: vec!["x_px", "numerical_aperture"],
            particles: vec![particle(true, 20.0), particle(false, 80.0)],
            r2_of_field: 0.98,
            chi2_of_field: 1.2,
            excess_sd: 50.0,
            r2_of_signal: 0.98,
            verdict: fit::Verdict::Good,
            warnings: vec!["a < b".to_owned()],
        };
        let counts = vec![1.0, f32::NAN, 3.0, 4.0];
        let (data, model, residual) = (counts.clone(), counts.clone(), counts);
        let planes = vec![PlaneImages { stage_um: -4.0, data, model, residual }];
        let images = vec![FieldImages { particle: 0, edge: 2, planes }];
        let page =
            field_page(&FieldFiles { fitted, images, files: Vec::new() }, "scan.tif", [100, 60]).unwrap();
        for text in ["numerical_aperture", "0.4380 to 0.4420", "0.050 mm", "-4.0 um", "a &lt; b", "1 single"]
        {
            assert!(page.contains(text), "{text}");
        }
        // Three images, and three maps of the only quantity that is mapped.
        assert_eq!(page.matches("data:image/png").count(), 3);
        assert_eq!((page.matches("<circle").count(), page.matches("fill=\"none\"").count()), (6, 3));
    }
}
