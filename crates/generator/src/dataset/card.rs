//! The dataset card, `README.md` of a dataset.

use storage::dataset::manifest::{
    GENERATOR_VERSION, ScoringGates, SizeFacts, WaveFacts, ZERO_OF_DATASETS, coordinates,
};

use super::manifest::{bit_depth, wave_facts};
use super::truth::Totals;
use super::truth::depth::ParticleImage;
use microsig_core::render::Description;
use microsig_core::sensor::ImageFormat;
use scenario::spec::{PairSeeding, Timing};
use scenario::{MotionSource, Scenario, compact};
use storage::{OutputFolder, Result};

/// Name of the card.
const CARD: &str = "README.md";

/// Writes the card into a dataset's folder.
pub fn write(
    folder: &OutputFolder,
    scenario: &Scenario,
    totals: &Totals,
    image: &ParticleImage,
    sizes: &[SizeFacts],
) -> Result<()> {
    folder.save_bytes(CARD, text(scenario, totals, image, sizes)?)
}

fn text(scenario: &Scenario, totals: &Totals, image: &ParticleImage, sizes: &[SizeFacts]) -> Result<String> {
    let (spec, settings) = (&scenario.spec, &scenario.settings);
    let (low, high) = scenario.depth_range_um;
    let gates = ScoringGates::by(spec.scoring.as_ref(), high - low);
    let what = frames(scenario);
    let Description { optics, method } = scenario.renderer.description();
    let focus = if scenario.renderer.depends_on_depth() { "out of focus" } else { "all in focus" };
    let motion = compact(&spec.motion)?;
    let n_p = totals.visible as f64 / f64::from(totals.frames.max(1));
    let pixels = f64::from(settings.pixel_dim_x) * f64::from(settings.pixel_dim_y);
    let image_share = scenario.image_share();
    let snr = match image.snr {
        Some(snr) => format!("{snr:.1} (noise-free peak over background noise, median over depth)"),
        None => "no background noise".to_owned(),
    };
    let mut best = image
        .focus_um
        .map_or_else(String::new, |z_um| format!("; best focus at z = {} um", thousandths(z_um)));
    if !sizes.is_empty() {
        best += &format!(" (of the mean diameter, {} um)", thousandths(image.d_um));
    }
    let field = match scenario.truth_grid() {
        Some(_) => "`truth/field.csv`: the displacement field on a grid. ",
        None => "",
    };
    let description =
        if spec.description.is_empty() { String::new() } else { format!("{}\n\n", spec.description) };
    Ok(format!(
        "# {name}\n\n\
         {description}\
         Synthetic images of tracer particles, {focus} and with known truth: {what}.\n\n\
         ![some of the frames](preview.png)\n\n\
         | | |\n|---|---|\n\
         | image | {width} x {height} px, {bits} bit{unrounded}, {um_per_px} um per px |\n\
         | optics | {optics} |\n\
         {light}\
         | depth range | {low} to {high} um |\n\
         | depth factor (physical depth over depth in `particles/`) | {depth_factor} |\n\
         | particles on the sensor | N_p = {n_p:.1} per frame on average, N_ppp = {n_ppp:.3e} per pixel{within} |\n\
         | area of a particle image | A_pi = {area:.0} px (above 10 % of its peak, mean over depth) |\n\
         | source density | N_S = {n_s:.3} |\n\
         | signal-to-noise ratio | {snr}{best} |\n\
         {each}\
         | displacement | up to {max:.2} px in the image plane |\n\
         | background | {mean} counts, noise {noise} counts |\n\
         | gates for scoring | {gate_xy} px in the image, {gate_z} um in depth; ISBI {gate_isbi} px |\n\
         | seed | {seed} |\n\n\
         Motion: `{motion}`.{moved}\n\n\
         {shone}\
         ## Axes and units\n\n{axes}\n\n\
         ## Files\n\n\
         - `images/`: the frames. `particles/`: the MicroSIG data file of each, `settings.txt`: the settings of all.\n\
         - `truth/tracks.csv`: every particle in every frame. `truth/displacements.csv`: how each moved within a pair. \
         `truth/frames.csv`: the frames. {field}`truth/depth.csv`: what a particle's image is at each depth.\n\
         - `calibration/` (if there): {calibration}.\n\
         - `scenario.ron`: all that the dataset was made from. `datapackage.json`: all columns with their units.\n\n\
         ## How it was made\n\n\
         By microsig {GENERATOR_VERSION}, which {method}. {again} makes the same bytes again; \
         `sha256sum -c SHA256SUMS` or `microsig verify` checks them.\n\n\
         ## Licence\n\n\
         {license}; see `LICENSE`.\n",
        name = spec.name,
        each = sizes.iter().map(size_text).collect::<String>(),
        calibration = match scenario.calibrated_um().as_slice() {
            [] | [_] => "one particle scanned through the depth range".to_owned(),
            sizes => format!("particles of {} um, each scanned through the depth range", joined(sizes)),
        } + &at_places(scenario),
        license = spec.license,
        light = wave_facts(scenario, image.drawn_share).as_ref().map_or_else(String::new, light),
        moved = motion_note(scenario),
        shone = illumination_note(scenario)?,
        bits = bit_depth(scenario),
        unrounded = match spec.image_format() {
            ImageFormat::Integer => "",
            ImageFormat::Float32 => " (floating point: counts before rounding and clamping)",
        },
        n_ppp = n_p / pixels,
        area = image.area_px,
        within = within_walls(n_p / pixels, image_share),
        n_s = n_p * image.area_px / (pixels * image_share),
        gate_xy = gates.xy_px,
        gate_z = gates.z_um,
        gate_isbi = gates.isbi_px,
        axes = coordinates(ZERO_OF_DATASETS),
        width = settings.pixel_dim_x,
        height = settings.pixel_dim_y,
        um_per_px = scenario.scale.um_per_px(),
        depth_factor = scenario.depth_factor(),
        again = match scenario.streams.seed() {
            Some(_) => "`microsig generate scenario.ron`",
            None => "`microsig verify --regenerate`, with the key in `secret_key.txt`,",
        },
        max = totals.max_displacement_px,
        mean = thousandths(image.background_counts),
        noise = thousandths(image.background_noise_counts),
        seed = scenario.streams.seed().map_or_else(|| "none: secret key".to_owned(), |seed| seed.to_string()),
    ))
}

/// The number of places of the calibration stacks, if there are several.
fn at_places(scenario: &Scenario) -> String {
    match scenario.calibrated_px().len() {
        0 => String::new(),
        n => format!(", at {n} places of the field of view"),
    }
}

/// The density per pixel of that share of the image where particles can be, if it is not all of it.
fn within_walls(per_pixel: f64, share: f64) -> String {
    if share == 1.0 {
        return String::new();
    }
    let (density, percent) = (per_pixel / share, 100.0 * share);
    format!(", {density:.3e} in the {percent:.0} % of the image that walls and bodies leave for particles")
}

/// The rows on light and objective for wave optics.
fn light(waves: &WaveFacts) -> String {
    let WaveFacts { wavelength_um, bandwidth_um, emission, lens, airy_radius_px, pupil, layers, .. } = waves;
    let drawn = waves.drawn_share.map_or_else(String::new, |shares| {
        let [least, greatest] = shares.map(|share| 100.0 * share);
        format!("; images show {least:.1} to {greatest:.1} % of the light that it accepts")
    });
    let layers = if layers.is_none() { "" } else { ", layers in front of it" };
    let pupil = if pupil.is_none() { "" } else { ", mask or aberrations in its pupil" };
    format!(
        "| light | {wavelength_um} um, band of {bandwidth_um} um, from each particle's {} |\n\
         | objective | {}{layers}{pupil}; Airy radius {airy_radius_px:.2} px{drawn} |\n",
        emission.name(),
        lens.name()
    )
}

/// The row on the images of a size.
fn size_text(size: &SizeFacts) -> String {
    let SizeFacts { d_um, focus_um, peak_counts: [low, high], snr } = size;
    let snr =
        snr.map_or_else(String::new, |[low, high]| format!(", signal-to-noise ratio {low:.1} to {high:.1}"));
    let focus =
        focus_um.map_or_else(String::new, |z_um| format!("; best focus at z = {} um", thousandths(z_um)));
    format!("| images of {d_um} um over depth | peaks of {low:.1} to {high:.1} counts{snr}{focus} |\n")
}

fn joined(numbers: &[f64]) -> String {
    let texts: Vec<String> = numbers.iter().map(f64::to_string).collect();
    texts.split_last().map_or_else(String::new, |(last, others)| format!("{} and {last}", others.join(", ")))
}

/// A number rounded to thousandths.
fn thousandths(number: f64) -> f64 {
    (number * 1000.0).round() / 1000.0
}

fn frames(scenario: &Scenario) -> String {
    match scenario.recordings.timing() {
        Timing::Pairs(p) => {
            let whose = match p.seeding {
                PairSeeding::Fresh => "every pair has particles of its own",
                PairSeeding::Continuing => "the same cloud goes on from pair to pair",
            };
            format!("{} image pairs with {} s between A and B; {whose}", p.count, p.dt_s)
        }
        Timing::Sequence(s) => format!("a sequence of {} frames, {} s apart", s.frames, s.dt_s),
        Timing::FourPulse(f) => format!(
            "{} bursts of four frames, {} s, {} s and {} s apart; every burst has particles of its own",
            f.count, f.dt_s, f.gap_s, f.dt_s
        ),
    }
}

/// Definition of velocity and position in the truth, for recorded tracks and for exposures.
fn motion_note(scenario: &Scenario) -> String {
    let mut text = String::new();
    if let MotionSource::Tracks(tracks) = &scenario.motion {
        text += &format!(
            " {} tracks, read in {}. Velocities that the file does not give are the slope of the parabola through a track's \
             places in the frame before, this one and the next; at its ends and beside gaps the difference to the one \
             neighbour.",
            tracks.count(),
            tracks.units()
        );
    }
    if let Some(shutter) = &scenario.shutter {
        text += &format!(
            " Frames collect light over {} s about `t_s`: the truth is the place in the middle and the mean velocity over \
             that time, and a moving particle has several rows in the data file, at most a quarter of a pixel apart.",
            shutter.span_s()
        );
    }
    text
}

/// Describes the illumination, if it is not uniform and constant.
fn illumination_note(scenario: &Scenario) -> Result<String> {
    let Some(light) = &scenario.spec.illumination else { return Ok(String::new()) };
    Ok(format!(
        "Illumination: `{}`. It multiplies `c_int` in the data files; in `truth/tracks.csv` it is the column `light`.\n\n",
        compact(light)?
    ))
}
