//! The preview of a scenario: as much of its dataset as can be computed within about a second.
//!
//! It reads the text, renders the first two frames as `generate` does, renders a particle over depth, and
//! computes the numbers of the dataset. Each part is sent as soon as it is ready. The preview is cancelled,
//! even while a frame or a table is being computed, when another one starts or the page is closed.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use axum::body::Bytes;
use flows::Frame;
use microsig_core::Particle;
use microsig_core::cancel::Cancellation;
use microsig_core::formats::tiff;
use microsig_core::sensor::Image;
use serde_json::{Value, json};
use tokio::sync::mpsc::Sender;

use super::columns::list;
use super::routes::message;
use super::state::{App, locked};
use super::{editor, optics};
use generator::dataset::Camera;
use generator::dataset::truth::{depth, rendered};
use generator::preview::infeasible;
use generator::runner::{Cost, Frames};
use scenario::Scenario;
use storage::error::{Error, Result};

/// Maximum time for rendering a frame, s; if it would take longer, only the first particles are rendered.
const FRAME_S: f64 = 4.0;

/// Number of particles rendered to measure the time per particle.
const PROBE: usize = 8;

/// Maximum number of pixels of a preview.
const MAX_PIXELS: u64 = 1 << 24;

/// Maximum number of particles in a frame of a preview.
const MAX_PARTICLES: f64 = 2e6;

/// A preview that is being computed.
struct PreviewRun {
    cancellation: Cancellation,
    sender: Sender<Bytes>,
    start: Instant,
}

/// Computes a preview and sends its parts.
pub(super) fn run(app: &App, text: &str, cancellation: Cancellation, sender: Sender<Bytes>) {
    let preview = PreviewRun { cancellation, sender, start: Instant::now() };
    let under_way = Arc::clone(&app.previewing);
    let _one_at_a_time = locked(&under_way);
    let ended = match preview.cancellation.run(0, || preview.parts(app, text)) {
        Some(Ok(())) => json!({ "part": "end" }),
        Some(Err(Error::Interrupted)) | None => return,
        Some(Err(error)) => json!({ "part": "failed", "message": error.to_string() }),
    };
    let _ = preview.send(ended, &[]);
}

impl PreviewRun {
    fn send(&self, mut part: Value, block: &[u8]) -> Result<()> {
        part["ms"] = json!(self.start.elapsed().as_millis() as u64);
        let sent = self.sender.blocking_send(message(&part, block));
        if sent.is_err() { Err(Error::Interrupted) } else { self.check() }
    }

    /// Checks that no other preview has started and the page is open.
    fn check(&self) -> Result<()> {
        let is_left = self.cancellation.is_cancelled() || self.sender.is_closed();
        if is_left { Err(Error::Interrupted) } else { Ok(()) }
    }

    fn parts(&self, app: &App, text: &str) -> Result<()> {
        self.check()?;
        let scenario = match editor::read(&app.subject, text) {
            Ok(scenario) => scenario,
            Err(problems) => return self.send(json!({ "part": "problems", "problems": problems }), &[]),
        };
        let cost = Cost::of(&scenario, Path::new("."))?;
        self.send(
            json!({ "part": "checked", "about": about(&scenario), "warnings": scenario.warnings,
            "cost": cost, "too_large": cost.check_resources(&scenario).err().map(|e| e.to_string()) }),
            &[],
        )?;
        if cost.pixels > MAX_PIXELS || cost.particles_per_frame > MAX_PARTICLES {
            return Err(Error::input(format!(
                "too large for a preview: {} pixels, {:.0} particles in a frame",
                cost.pixels, cost.particles_per_frame
            )));
        }
        self.check()?;
        let camera = Camera::new(scenario.renderer.clone(), scenario.sensor()?, scenario.streams);
        let (mut frames, mut drawn_s) = (Vec::new(), 0.0);
        for frame in Frames::new(&scenario)?.take(2) {
            self.check()?;
            let frame = frame?;
            let (image, seconds, share) = self.draw(&scenario, &camera, &frame)?;
            drawn_s = f64::max(drawn_s, seconds);
            let pixels = tiff::little_endian(&image.counts.whole());
            let part = json!({ "part": "frame", "index": frame.index, "width": image.width, "height": image.height,
                "t_s": frame.t_s, "share": share, "seconds": seconds, "particles": particles(&scenario, &frame) });
            self.send(part, &pixels)?;
            frames.push(frame);
        }
        self.check()?;
        let once = Instant::now();
        let scan = scenario.scan_of_mean()?;
        let once_s = once.elapsed().as_secs_f64();
        self.check()?;
        let (rows, image) = depth::measure(&scenario, &scan)?;
        let curves = optics::curves(&scan, &rows, &image);
        let (strip, block) = optics::strip(&scan, &rows);
        self.send(json!({ "part": "depth", "curves": curves, "strip": strip }), &block)?;
        let (numbers, [n_ppp, n_s]) = numbers(&scenario, &frames, image.area_px);
        let dark = [image.background_counts, image.background_noise_counts];
        let warnings = infeasible(&scenario, [n_ppp, n_s], image.snr, dark);
        self.send(
            json!({ "part": "numbers", "numbers": numbers, "warnings": warnings, "a_pi_px": image.area_px, "snr": image.snr,
            "focus_um": image.focus_um, "background_counts": image.background_counts,
            "background_noise_counts": image.background_noise_counts,
            // A rough estimate: it omits visibility, which takes about as long as rendering.
            "seconds": once_s + drawn_s * f64::from(cost.frames), "bytes": cost.disk_bytes }),
            &[],
        )
    }

    /// Renders a frame, or as many of its particles as time permits; returns the image, the (extrapolated)
    /// time for all particles in s, and the fraction of the particles that is rendered.
    fn draw(&self, scenario: &Scenario, camera: &Camera, frame: &Frame) -> Result<(Image, f64, f64)> {
        let rows = rendered(scenario, camera.renderer(), frame);
        let timed = |rows: &[Particle]| {
            let start = Instant::now();
            (camera.image(rows, frame.index), start.elapsed().as_secs_f64())
        };
        let (image, probe_s) = timed(&rows[..rows.len().min(PROBE)]);
        if rows.len() <= PROBE {
            return Ok((image, probe_s, 1.0));
        }
        self.check()?;
        let whole_s = probe_s / PROBE as f64 * rows.len() as f64;
        if whole_s <= FRAME_S {
            let (image, seconds) = timed(&rows);
            return Ok((image, seconds, 1.0));
        }
        let share = FRAME_S / whole_s;
        let n = ((rows.len() as f64 * share) as usize).max(PROBE);
        let (image, seconds) = timed(&rows[..n]);
        let share = n as f64 / rows.len() as f64;
        Ok((image, seconds / share, share))
    }
}

/// Properties that are known without rendering.
fn about(scenario: &Scenario) -> Value {
    let (settings, (low, high)) = (&scenario.settings, scenario.depth_range_um);
    let sensor = scenario.sensor().ok();
    let recordings = &scenario.recordings;
    json!({
        "name": scenario.spec.name, "width": settings.pixel_dim_x, "height": settings.pixel_dim_y,
        "bits": scenario.detector.as_ref().map_or(16, |detector| detector.bits),
        "um_per_px": scenario.scale.um_per_px(), "depth_um": [low, high], "frames": recordings.frames(),
        "are_pairs": recordings.are_pairs(), "mode": recordings.timing().mode(), "dt_s": recordings.dt_s(),
        "saturation_counts": sensor.map(|sensor| sensor.saturation_counts()), "renderer": scenario.renderer.name(),
        "full_well_e": scenario.detector.as_ref().map(|detector| detector.full_well_e),
    })
}

/// The particles whose centers are on the sensor, by columns.
fn particles(scenario: &Scenario, frame: &Frame) -> Value {
    let placed = frame.tracers.iter().map(|tracer| (tracer, scenario.scale.to_image(tracer.position)));
    let seen: Vec<_> = placed.filter(|(_, at)| scenario.settings.is_on_sensor(at.x_px, at.y_px)).collect();
    let velocity = |k: usize| {
        let of = |tracer: &flows::Tracer| tracer.velocity.map_or(f64::NAN, |v| v.to_array()[k]);
        list(seen.iter().map(|(tracer, _)| of(tracer)))
    };
    json!({
        "x_px": list(seen.iter().map(|(_, at)| at.x_px)), "y_px": list(seen.iter().map(|(_, at)| at.y_px)),
        "z_um": list(seen.iter().map(|(tracer, _)| tracer.position.z)),
        "d_um": list(seen.iter().map(|(tracer, _)| tracer.d_um)),
        "track": list(seen.iter().map(|(tracer, _)| tracer.id as f64)),
        "u_um_s": velocity(0), "v_um_s": velocity(1), "w_um_s": velocity(2),
    })
}

/// Number of visible particles, densities and displacements in the rendered frames; particles per pixel and N_S.
fn numbers(scenario: &Scenario, frames: &[Frame], area_px: f64) -> (Value, [f64; 2]) {
    let visible = |tracer: &flows::Tracer| {
        let at = scenario.scale.to_image(tracer.position);
        scenario.settings.is_on_sensor(at.x_px, at.y_px)
    };
    let counts = frames.iter().map(|frame| frame.tracers.iter().filter(|tracer| visible(tracer)).count());
    let n_p = counts.sum::<usize>() as f64 / frames.len().max(1) as f64;
    let pixels = f64::from(scenario.settings.pixel_dim_x) * f64::from(scenario.settings.pixel_dim_y);
    let mut moved: Vec<[f64; 2]> = match frames {
        [a, b] => a
            .links(b)
            .filter(|(from, _)| visible(from))
            .map(|(from, to)| {
                let moved = to.step.map_or(to.position - from.position, |step| step.actual);
                let d = scenario.scale.displacement_to_image(moved);
                [d.dx_px.hypot(d.dy_px), moved.z]
            })
            .collect(),
        _ => Vec::new(),
    };
    moved.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let at = |share: f64| moved.get(((moved.len().max(1) - 1) as f64 * share) as usize).map(|d| d[0]);
    let depth = moved.iter().map(|d| d[1]).fold(None, |all: Option<(f64, f64)>, dz| {
        Some(all.map_or((dz, dz), |(low, high)| (low.min(dz), high.max(dz))))
    });
    let density = [n_p / pixels, n_p * area_px / pixels];
    let value = json!({ "n_p": n_p, "n_ppp": density[0], "n_s": density[1],
        "displacement_px": [at(0.0), at(0.5), at(1.0)], "displacement_um": depth.map(|(low, high)| [low, high]) });
    (value, density)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tokio::sync::mpsc::channel;

    use super::*;
    use crate::view::Subject;

    /// Rendering its frames takes as long as [`FRAME_S`] allows.
    const SLOW: &str = r#"(
        name: "slow",
        optics: (preset: setting1, pixel_dim_x: 2048, pixel_dim_y: 2048, n_rays: 2000),
        motion: flow(field: poiseuille(max_speed_um_s: 300)),
        particles: (number: count(50000), diameter_um: constant(2)),
        timing: pairs(count: 1, dt_s: 0.005),
    )"#;

    #[test]
    fn a_preview_is_not_finished_when_another_begins_or_its_reader_leaves() {
        let app = Arc::new(App::new(Subject::default(), 1).unwrap());
        for leaves in [false, true] {
            let (sender, mut receiver) = channel(2);
            let cancellation = app.next_preview();
            let (own, made) = (cancellation.clone(), Arc::clone(&app));
            let running = std::thread::spawn(move || run(&made, SLOW, own, sender));
            // The scenario is checked; its first frame is being drawn.
            assert!(receiver.blocking_recv().is_some());
            std::thread::sleep(Duration::from_millis(500));
            assert!(!running.is_finished());
            if leaves {
                // As the route does once the client has disconnected.
                cancellation.cancel();
            } else {
                app.next_preview();
            }
            // The sender exists until the preview ends.
            while let Some(part) = receiver.blocking_recv() {
                assert!(!part.windows(5).any(|word| word == b"\"end\""), "the preview ran to its end");
            }
            running.join().unwrap();
        }
    }
}
