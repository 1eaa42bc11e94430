//! The card of a recording, `README.md` of its folder.

use storage::OutputFolder;
use storage::dataset::manifest::{GENERATOR_VERSION, NoiseFacts, ScoringGates, coordinates};
use storage::error::Result;

use super::manifest::About;
use super::stacks::Stacks;

pub(crate) fn write(folder: &OutputFolder, about: &About<'_>) -> Result<()> {
    folder.save_bytes("README.md", text(about))
}

fn text(about: &About<'_>) -> String {
    let size = about.frames.size();
    let pairs = if about.frames.are_pairs() { " within a pair" } else { "" };
    let dt = about.options.dt_s.map_or_else(|| "unknown".to_owned(), |dt_s| format!("{dt_s} s{pairs}"));
    let calibrated = about.made.zip(about.depths_um());
    let [what, rows, gates, files] = match calibrated {
        Some((made, depths_um)) => calibration(about, made, depths_um),
        None => [
            "without a calibration: particles in focus, for `piv` and `spots`".to_owned(),
            String::new(),
            format!("{} px in the image", ScoringGates::XY_PX),
            String::new(),
        ],
    };
    let depth = if calibrated.is_some() { DEPTH } else { "" };
    format!(
        "# {name}\n\n\
         Recorded images {what}: {frames} frames.\n\n\
         ![some of the frames](preview.png)\n\n\
         | | |\n|---|---|\n\
         | images | {width} x {height} px, {um_per_px:.4} um per px; {images} |\n\
         | time between frames | {dt} |\n{rows}\
         | known | {known} |\n\
         | gates for scoring | {gates} |\n\n\
         ## Axes and units\n\n{axes}\n\n\
         ## Files\n\n\
         - `images/`: the frames. `truth/frames.csv`: their times.\n{files}\
         - `truth/planes.csv`, `truth/tracks.csv` (if there): what is known.\n\
         - `datapackage.json`: all columns with their units; `kind` is `recording`.\n\n{depth}\
         Imported by microsig {GENERATOR_VERSION}; `sha256sum -c SHA256SUMS` or `microsig verify` checks the files.\n",
        name = about.name,
        frames = about.frames.len(),
        width = size.width,
        height = size.height,
        um_per_px = about.um_per_px,
        images = images(about),
        known = known(about),
        axes = coordinates(crate::manifest::ZERO),
    )
}

const DEPTH: &str = "The depth of a calibration image is the position of the stage, and its particle is on the middle pixel at all depths: a \
     tilted or curved focal surface, and images that move with depth, are part of the calibration of each place.\n\n";

/// What the card says of a calibration: in the first sentence, in rows of the table, of the gates and the files.
fn calibration(about: &About<'_>, made: &Stacks, [low, high]: [f64; 2]) -> [String; 4] {
    let optics = about.model.map_or_else(
        || "unknown: `mle` needs them (`microsig fit`, then `import --optics`)".to_owned(),
        |model| {
            format!("{}; z = 0 of this model is at {:.2} um of the stage", model.description, model.zero_um)
        },
    );
    let turned = if about.options.toward_lens { " (signs of the scan's positions turned)" } else { "" };
    let rows = format!(
        "| optics | {optics} |\n\
         | depths | {low} to {high} um, positions of the stage, which increase away from the lens{turned} |\n\
         | calibration | {steps} depths, {stacks} |\n\
         | best focus | {focus} |\n\
         | noise of a frame | {noise} |\n",
        steps = made.depths_um.len(),
        stacks = stacks(about, made),
        focus = focus(made),
        noise = about.noise.map_or_else(String::new, noise),
    );
    let gates = ScoringGates::over(high - low);
    let place_columns = if made.is_field { ", and the place of each stack in the frames" } else { "" };
    [
        "with a calibration from a scan".to_owned(),
        rows,
        format!("{} px in the image, {} um in depth", gates.xy_px, gates.z_um),
        format!(
            "- `calibration/`: images of a particle at each depth, the average of several particles of the scan; \
             `calibration.csv` has the depth of each{place_columns}.\n"
        ),
    ]
}

fn images(about: &About<'_>) -> String {
    let written = about.written;
    let parts = [
        (written.linked, "linked to the given files (hard links: a change of those changes these)"),
        (written.copied, "copied"),
        (written.written, "written from pages of files, counts unchanged"),
    ];
    let parts = parts.into_iter().filter(|(n, _)| *n > 0);
    let what: Vec<String> = parts.map(|(n, how)| format!("{n} {how}")).collect();
    if about.correction.is_empty() {
        what.join(", ")
    } else {
        format!("{} images{}", written.written, about.correction)
    }
}

fn stacks(about: &About<'_>, made: &Stacks) -> String {
    let n = |place: &storage::dataset::manifest::PlaceFacts| place.particles.unwrap_or(0);
    if !made.is_field {
        return format!(
            "one stack, the average of {} particles nearest to the middle",
            n(&made.central().place)
        );
    }
    let counts: Vec<u32> = made.places.iter().map(|stack| n(&stack.place)).collect();
    let (least, most) = (counts.iter().min().unwrap_or(&0), counts.iter().max().unwrap_or(&0));
    let side = about.options.field;
    format!(
        "stacks at {} of {side} x {side} places of the field of view, each the average of {least} to {most} particles",
        counts.len()
    )
}

/// Depths of best focus, and how much they differ over the field.
fn focus(made: &Stacks) -> String {
    let middle = made.focus_um(made.central());
    if !made.is_field {
        return format!("{middle} um");
    }
    let all: Vec<f64> = made.places.iter().map(|stack| made.focus_um(stack)).collect();
    let low = all.iter().copied().fold(f64::INFINITY, f64::min);
    let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    format!("{middle} um in the middle, {low} to {high} um over the field (steps of the scan)")
}

fn noise(noise: &NoiseFacts) -> String {
    match noise.variance[..] {
        [a] => format!(
            "variance {a:.2} counts^2 of the background ({}); how it grows with the signal is unknown: the scan has no repeated frames",
            noise.background_counts.round()
        ),
        [a, b] => format!(
            "variance {a:.2} + {b:.4} s counts^2 at a signal of s counts above the background of {:.1}",
            noise.background_counts
        ),
        [a, b, c] => format!(
            "variance {a:.2} + {b:.4} s + {c:.2e} s^2 counts^2 at a signal of s counts above the background of {:.1}",
            noise.background_counts
        ),
        _ => "unknown".to_owned(),
    }
}

fn known(about: &About<'_>) -> String {
    let facts = about.known.facts();
    let mut parts = Vec::new();
    if facts.planes > 0 {
        parts.push(format!(
            "the height of the plane of all particles in {} of {} frames",
            facts.planes,
            about.frames.len()
        ));
    }
    if facts.particles > 0 {
        let all = if facts.all_particles { "all particles of their frames" } else { "some of the particles" };
        parts.push(format!("{} positions ({all})", facts.particles));
    }
    if parts.is_empty() { "nothing: results cannot be scored".to_owned() } else { parts.join("; ") }
}
