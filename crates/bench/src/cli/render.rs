//! `microsig render`: renders images from MicroSIG's own files.

use std::path::PathBuf;

use clap::Args;
use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::DEFAULT_TOLERANCE;
use microsig_core::render::waves::{Emission, Lens, WaveOptics};
use microsig_core::render::{RenderMethod, RendererSpec};
use microsig_core::sensor::{ImageFormat, NoiseRounding};

use super::Common;
use super::options::{Drawing, ImageTables, Replace};
use super::output::{progress, summarize, warn};
use generator::runner::{RenderOptions, render};
use scenario::spec::RenderMode;
use storage::InputFile;
use storage::argument::{choice, folder, input};
use storage::error::{Error, Result};

/// Render images from MicroSIG's own settings file and data files
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig render settings.txt particles/ images/ --seed 1")]
pub(super) struct Render {
    /// Settings file of MicroSIG
    #[arg(value_parser = input())]
    settings: InputFile,
    /// A data file, or a folder of them (*.txt); the image of `-` is image.tif
    #[arg(value_parser = input())]
    data: InputFile,
    /// Output folder for the images (STEM.tif)
    #[arg(value_parser = folder())]
    out: PathBuf,
    /// Renderer
    #[arg(long, value_parser = choice::<RenderMode>(), default_value = "rays")]
    mode: RenderMode,
    /// With --mode waves: wavelength in vacuum, um
    #[arg(long, value_name = "UM", required_if_eq("mode", "waves"))]
    wavelength: Option<f64>,
    /// With --mode waves: full width of the band at half maximum, um [default: 0]
    #[arg(long, value_name = "UM")]
    bandwidth: Option<f64>,
    /// With --mode waves: the part of a particle that emits light [default: surface]
    #[arg(long, value_parser = choice::<Emission>())]
    emission: Option<Emission>,
    /// With --mode waves: the model of the objective [default: microsig]
    #[arg(long, value_parser = choice::<Lens>())]
    lens: Option<Lens>,
    /// With --mode expected and --mode waves: error of an image as a fraction of its peak [default: 0.003]
    #[arg(long, value_name = "SHARE")]
    tolerance: Option<f64>,
    /// Number of the first frame; it selects the random numbers
    #[arg(long, default_value_t = 0, value_name = "N")]
    first_frame: u32,
    /// Which points of a spheroid emit light: as in MicroSIG's program, or uniform in area
    #[arg(long, value_parser = choice::<SpheroidLaw>(), default_value = "original")]
    spheroids: SpheroidLaw,
    /// Pixel format of the images; float32 has counts before rounding and clamping
    #[arg(long, value_parser = choice::<ImageFormat>(), default_value = "integer")]
    image_format: ImageFormat,
    /// Round counts only once, after noise is added, as in datasets; MicroSIG rounds before adding noise,
    /// which loses faint light
    #[arg(long)]
    round_once: bool,
    #[command(flatten)]
    drawing: Drawing,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    tables: ImageTables,
}

impl Render {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let rendered = render(&RenderOptions {
            settings: self.settings.clone(),
            data: self.data.clone(),
            out: self.out.clone(),
            seed: self.drawing.seed,
            first_frame: self.first_frame,
            renderer: self.renderer()?,
            rounding: if self.round_once { NoiseRounding::AfterSum } else { NoiseRounding::BeforeSum },
            format: self.image_format,
            force: self.replace.force,
            progress: progress(common),
            context: common.context.clone(),
        })?;
        warn(&rendered.warnings, common);
        let text = format!(
            "{} images of {} x {} px with {} particles in {:.2} s ({:.1} images/s), in {}",
            rendered.images,
            rendered.width_px,
            rendered.height_px,
            rendered.particles,
            rendered.seconds,
            rendered.images as f64 / rendered.seconds.max(1e-9),
            rendered.out.display()
        );
        summarize(&text, &rendered, common)
    }

    fn renderer(&self) -> Result<RendererSpec> {
        let only = |option: &str, value: String, modes: &str| {
            Err(Error::input(format!("{option} {value}: only {modes} this option")))
        };
        let name = |value: &dyn std::fmt::Debug| format!("{value:?}").to_lowercase();
        if self.mode != RenderMode::Waves {
            let given = [
                ("--wavelength", self.wavelength.map(|value| value.to_string())),
                ("--bandwidth", self.bandwidth.map(|value| value.to_string())),
                ("--emission", self.emission.map(|value| name(&value))),
                ("--lens", self.lens.map(|value| name(&value))),
            ];
            if let Some((option, value)) =
                given.into_iter().find_map(|(option, value)| Some((option, value?)))
            {
                return only(option, value, "--mode waves takes");
            }
        }
        if let Some(tolerance) = self.tolerance.filter(|_| self.mode == RenderMode::Rays) {
            return only("--tolerance", tolerance.to_string(), "--mode expected and --mode waves take");
        }
        let (spheroids, tolerance) = (self.spheroids, self.tolerance.unwrap_or(DEFAULT_TOLERANCE));
        let method = match self.mode {
            RenderMode::Rays => RenderMethod::Rays { spheroids },
            RenderMode::Expected => RenderMethod::Expected { spheroids, tolerance },
            RenderMode::Waves => {
                let mut optics = WaveOptics::new(self.wavelength.unwrap_or_default());
                optics.bandwidth_um = self.bandwidth.unwrap_or_default();
                optics.emission = self.emission.unwrap_or_default();
                optics.lens = self.lens.unwrap_or_default();
                RenderMethod::Waves { optics, tolerance }
            }
        };
        Ok(method.into())
    }
}
