//! Facts about a recording other than its particles, from the dataset's manifest.

use std::path::Path;

use crate::dataset::TrackRow;
use crate::dataset::manifest::{Manifest, RECORDING, ResultKind, ScoringRules, SensorFacts};
use crate::dataset::table::Row;
use crate::error::{Error, Result};
use crate::folder::is_partial;

/// Largest plausible length in object space, um.
pub const LARGEST_UM: f64 = 1e9;

/// Facts about a recording other than its particles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RecordingFacts {
    /// Name of the dataset, or the file name of a bare table.
    pub name: String,
    /// SHA-256 of truth/tracks.csv as recorded in the manifest, or of the bare table.
    pub sha256: Option<String>,
    /// Object-space length of a pixel, um.
    pub um_per_px: Option<f64>,
    /// The rows of the matrix by which a cylindrical lens before the camera stretches images.
    pub stretch: Option<[[f64; 2]; 2]>,
    /// Least and greatest depth, um.
    pub depth_um: Option<(f64, f64)>,
    /// Width and height of the images, px.
    pub sensor_px: Option<(f64, f64)>,
    /// Time between frames (in double-frame recordings: between the frames of a pair), s.
    pub dt_s: Option<f64>,
    /// File names of the images.
    pub images: Vec<String>,
    /// Whether frames are recorded in pairs, so that links exist from A to B only.
    pub pairs: bool,
    /// Number of frames.
    pub frames: Option<u32>,
    /// Version of microsig that generated the dataset.
    pub generator: Option<String>,
    /// Whether frames come in bursts of four: there is no image pair from one burst to the next.
    pub bursts: bool,
    /// Depth at which particle images are sharpest, um.
    pub focus_um: Option<f64>,
    /// Largest displacement of a visible particle in the image plane, px.
    pub max_displacement_px: Option<f64>,
    /// How far the fastest visible particle moves within an exposure, px.
    pub max_streak_px: Option<f64>,
    /// Mean area of a particle image over depth, px.
    pub image_area_px: Option<f64>,
    /// The share of the sensor in which particles are, if walls or bodies exclude them from the rest.
    pub image_share: Option<f64>,
    /// Why hardly any particle can be found, if overlap or noise prevent it.
    pub hopeless: Vec<String>,
    /// Whether particle images are equally sharp at all depths.
    pub is_all_in_focus: bool,
    /// Whether this is a test split, whose truth only the organizers have.
    pub is_withheld: bool,
    /// Whether the images were recorded instead of generated: only a part of the truth is known.
    pub is_recording: bool,
    /// Whether the known particles of a recording are all particles of their frames.
    pub has_all_particles: bool,
    /// Whether it was generated with a secret key.
    pub is_from_key: bool,
    /// Whether only particles are scored, because train has the same velocity field.
    pub is_for_particles_only: bool,
    /// Whether only displacement fields are scored.
    pub is_for_fields_only: bool,
    /// How results are scored and ranked, where the dataset states it.
    pub rules: ScoringRules,
}

impl RecordingFacts {
    /// Reads the facts in a dataset's manifest.
    pub fn read(dataset: &Path) -> Result<Self> {
        if is_partial(dataset) {
            return Err(Error::input(format!(
                "{}: unfinished; microsig generate --resume (or sweep --resume) continues it",
                dataset.display()
            )));
        }
        Ok(RecordingFacts::of(&Manifest::read(dataset)?))
    }

    /// The facts in a manifest.
    pub fn of(manifest: &Manifest) -> Self {
        let (own, timing) = (&manifest.microsig, &manifest.microsig.timing);
        let positive = |v: Option<f64>| v.filter(|v| *v > 0.0 && v.is_finite());
        let sensor =
            |side: fn(&SensorFacts) -> u32| positive(own.sensor.as_ref().map(|s| f64::from(side(s))));
        let pairs = timing.are_pairs();
        let images = manifest.resources.iter().filter_map(|resource| resource.path.strip_prefix("images/"));
        RecordingFacts {
            images: images.map(str::to_owned).collect(),
            name: if manifest.name.is_empty() { "dataset".to_owned() } else { manifest.name.clone() },
            // Recorded hash of the true particles, which saves reading them again.
            sha256: manifest.resource(TrackRow::PATH).map(|r| r.sha256().to_owned()),
            um_per_px: positive(own.um_per_px),
            stretch: own.image_stretch.filter(|[[a, b], [c, d]]| a * d - b * c > 0.0),
            depth_um: own
                .depth_range_um
                .map(|[low, high]| (low, high))
                .filter(|(l, h)| l <= h && l.abs().max(h.abs()) <= LARGEST_UM),
            sensor_px: sensor(|s| s.width_px).zip(sensor(|s| s.height_px)),
            dt_s: positive(timing.dt_s()),
            pairs,
            frames: if pairs { timing.pairs().and_then(|p| p.checked_mul(2)) } else { timing.frames() },
            generator: own.generator_version.clone(),
            bursts: timing.are_bursts(),
            focus_um: own.particle_image.as_ref().and_then(|p| p.focus_um),
            max_displacement_px: positive(own.max_displacement_px),
            max_streak_px: positive(own.max_displacement_px)
                .zip(positive(timing.dt_s()))
                .and_then(|(moved_px, dt_s)| positive(Some(moved_px * timing.open_s() / dt_s))),
            image_area_px: positive(own.a_pi_px),
            image_share: own.image_share.filter(|share| *share > 0.0 && *share < 1.0),
            hopeless: own.n_ppp.zip(own.n_s).map_or_else(Vec::new, |(n_ppp, n_s)| {
                crate::dataset::hopeless(n_ppp, n_s, own.snr.as_ref().and_then(|snr| snr.value))
            }),
            // The public part of a test split names its renderer, not its particle images.
            is_all_in_focus: own
                .particle_image
                .as_ref()
                .map_or(own.renderer.as_deref() == Some("gaussian"), |p| p.focus_um.is_none()),
            is_withheld: own.truth.as_deref() == Some("withheld"),
            is_recording: own.kind.as_deref() == Some(RECORDING),
            has_all_particles: own.known.as_ref().is_some_and(|known| known.all_particles),
            is_from_key: own.seed == Some(None),
            is_for_fields_only: own.scored.as_ref().is_some_and(|s| !s.contains(&ResultKind::Particles)),
            rules: own.scoring.clone().unwrap_or_default(),
            is_for_particles_only: own.scored.as_ref().is_some_and(|s| !s.contains(&ResultKind::Fields)),
        }
    }

    /// A vector as it would be in an image without the stretch by a cylindrical lens before the camera.
    pub fn unstretched(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        self.stretch.map_or([x, y, z], |[[a, b], [c, d]]| {
            let of = a * d - b * c;
            [(d * x - b * y) / of, (a * y - c * x) / of, z]
        })
    }

    /// Whether the recording has an image pair of this number.
    pub fn has_pair(&self, pair: u32) -> bool {
        let Some(frames) = self.frames else { return true };
        if self.pairs {
            return pair < frames / 2;
        }
        pair.saturating_add(1) < frames && !(self.bursts && pair % 4 == 3)
    }

    /// Refuses an operation that needs the truth of a test split.
    pub fn needs_truth(&self, dataset: &Path) -> Result<()> {
        if self.is_recording && !dataset.join(TrackRow::PATH).exists() {
            return Err(Error::input(format!(
                "{}: a recording, of which no positions of particles are known; `microsig import --truth` adds known ones",
                dataset.display()
            )));
        }
        if self.is_withheld {
            return Err(Error::input(format!(
                "{}: a test split, whose truth is withheld: only its organizers have it; \
                 evaluate --validate-only checks a result without it",
                dataset.display()
            )));
        }
        Ok(())
    }

    /// Whether results of a challenge need a depth: by its rules, or because images tell depth.
    pub fn is_scored_in_depth(&self) -> bool {
        let by_images = self.depth_h_um().is_some() && !self.is_all_in_focus;
        self.rules.dims.map_or(by_images, |dims| dims == 3)
    }

    /// The depth range, um; `None` if it is unknown or empty.
    pub fn depth_h_um(&self) -> Option<f64> {
        self.depth_um.map(|(low, high)| high - low).filter(|h| *h > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_manifest_tells_is_read_and_the_rest_is_unknown() {
        let read = |text: &str| {
            Manifest::parse(text, "datapackage.json").map(|manifest| RecordingFacts::of(&manifest))
        };
        let facts = read(
            r#"{ "name": "a", "microsig": { "timing": { "mode": "pairs", "pairs": 3, "dt_s": 0.01 },
                "depth_range_um": [-5, 5], "um_per_px": -1, "scored": ["particles"],
                "particle_image": { "d_um": 2, "focus_um": null } },
                "resources": [ { "path": "truth/tracks.csv", "bytes": 1, "hash": "sha256:12" } ] }"#,
        )
        .unwrap();
        assert_eq!((facts.frames, facts.pairs, facts.dt_s), (Some(6), true, Some(0.01)));
        assert_eq!((facts.sensor_px, facts.um_per_px, facts.depth_um), (None, None, Some((-5.0, 5.0))));
        assert!(
            facts.is_all_in_focus && facts.is_for_particles_only && facts.sha256.as_deref() == Some("12")
        );
        for (renderer, in_focus) in [("gaussian", true), ("rays", false)] {
            let public = read(&format!(r#"{{ "microsig": {{ "renderer": "{renderer}" }} }}"#)).unwrap();
            assert_eq!(public.is_all_in_focus, in_focus, "{renderer}");
        }
        assert_eq!(
            read("{}").unwrap(),
            RecordingFacts { name: "dataset".to_owned(), ..RecordingFacts::default() }
        );
        assert!(read("{").is_err());
    }
}
