//! Texts that describe a release: README files, license, citation, and metadata for archives and data
//! loaders.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::croissant;
use super::deadline::{Deadline, UNTIL};
use super::splits::Train;
use super::{COMMITMENT, ReleaseOptions, SALT};
use scenario::license::License;
use scoring::ranking::ScoreDef;
use storage::checksums::Fingerprint;
use storage::dataset::manifest::{
    self, GENERATOR_VERSION, ResultKind, ScoringGates, ScoringRules, ZERO_OF_DATASETS, coordinates,
};
use storage::dataset::{CalibrationRow, Row, TrackRow};

/// The facts used in the texts.
#[derive(Debug)]
pub(super) struct ReleaseTexts<'a> {
    pub(super) name: &'a str,
    pub(super) title: String,
    pub(super) commitment: &'a str,
    creators: Vec<String>,
    version: &'a str,
    license: License,
    pub(super) deadline: Option<Deadline>,
    /// Whether all particles are in focus, as in ordinary PIV.
    in_focus: bool,
    /// Whether the dataset has a calibration stack.
    calibrated: bool,
    /// What is scored: particles, fields.
    pub(super) scored: Vec<ResultKind>,
    /// How it is scored, where the dataset states it.
    rules: Option<ScoringRules>,
    gates: Option<ScoringGates>,
    /// Whether the train split reveals the velocity field of the test split.
    is_flow_known: bool,
}

/// The columns of a displacement field.
const OF_FIELDS: &str = "Fields have a row per vector, `pair, x_px, y_px, dx_px, dy_px, flag`: image pair from 0, position and \
displacement, flag 0 valid, 1 invalid, 2 interpolated. Report a vector wherever you can: places without one count as wrong.";

/// The columns of particles.
fn particle_columns(in_focus: bool) -> String {
    let depth = if in_focus { "`z_um` may be left out. " } else { "" };
    format!(
        "Particles have one row per particle and frame, `frame, track, x_px, y_px, z_um`, and optionally `d_um`, `quality`, `sx_px`, `sy_px`, \
         `sz_um` (claimed standard uncertainties). `track` identifies a particle across frames; -1 or empty if it is not \
         linked. {depth}"
    )
}

impl ReleaseOptions {
    /// The facts used in the texts, completed by what the dataset states.
    pub(super) fn texts<'a>(
        &'a self,
        train: &'a Train,
        commitment: &'a str,
        scored: &[ResultKind],
        is_flow_known: bool,
    ) -> ReleaseTexts<'a> {
        let (name, manifest) = (train.scenario.spec.name.as_str(), &train.manifest);
        let title = if manifest.title.is_empty() { name.to_owned() } else { manifest.title.clone() };
        let creators = match self.challenge.creators.as_slice() {
            [] => vec![format!("The organizers of {name}")],
            creators => creators.to_vec(),
        };
        let title = self.title.clone().unwrap_or(title);
        let license = train.scenario.license;
        let calibrated = !train.scenario.calibrated_um().is_empty();
        let in_focus = !train.scenario.renderer.depends_on_depth();
        ReleaseTexts {
            name,
            title,
            commitment,
            creators,
            version: &self.version,
            deadline: self.challenge.deadline,
            license,
            in_focus,
            calibrated,
            scored: scored.to_vec(),
            rules: train.scenario.spec.scoring.clone(),
            gates: manifest.microsig.scoring_gates,
            is_flow_known,
        }
    }
}

impl ReleaseTexts<'_> {
    /// The deadline, for README files.
    fn timetable(&self) -> String {
        self.deadline.map(|day| format!("**Deadline: {day}**, {UNTIL}.\n\n")).unwrap_or_default()
    }

    /// Whether only displacement fields are scored.
    pub(super) fn is_for_fields(&self) -> bool {
        self.scored == [ResultKind::Fields]
    }

    /// What is scored and what train reveals about it, for both README files.
    fn what_is_scored(&self) -> &'static str {
        match (self.is_for_fields(), self.is_flow_known) {
            (true, true) => {
                "Displacement fields are scored. **The flow does not depend on random numbers, so `truth/field.csv` of train is also \
                the field of test**: it could be submitted without looking at the images, so scores rely on the honesty of participants. "
            }
            (true, false) => "Displacement fields are scored. ",
            (false, true) => {
                "Particles are scored. Fields are refused: the flow does not depend on random numbers, so train reveals the field of test. \
                For the same reason, velocities of particles could be taken from train; their score assumes that they are measured. "
            }
            (false, false) => "Particles or displacement fields are scored. ",
        }
    }

    /// The gates, and the scores that rank.
    fn how_it_is_scored(&self) -> String {
        let rules = self.rules.clone().unwrap_or_default();
        let mut text = String::new();
        if let Some(gates) = self.gates.filter(|_| !self.is_for_fields()) {
            let along_z = format!(" and {} um along z", gates.z_um);
            let [along_z, dims] = match rules.dims {
                Some(2) => ["", ", in the image plane"],
                Some(_) => [&*along_z, ", with depth"],
                None => [&*along_z, ", with depth if truth and result have one"],
            };
            text = format!(
                "A point can belong to a particle within {} px in the image plane{along_z}{dims}. ",
                gates.xy_px
            );
        }
        let titles: Vec<String> = rules.rank_by.iter().map(|metric| ScoreDef::of(*metric).title()).collect();
        if !titles.is_empty() {
            text += &format!("Results are ranked by {}, in this order. ", titles.join(", "));
        }
        text
    }

    /// Whether depths are scored.
    pub(super) fn scores_depth(&self) -> bool {
        self.rules.as_ref().and_then(|rules| rules.dims).map_or(!self.in_focus, |dims| dims == 3)
    }

    fn focus(&self) -> &'static str {
        if self.in_focus { "all in focus" } else { "out of focus" }
    }

    fn keywords(&self) -> Vec<&'static str> {
        let depth = ["defocusing", "astigmatism", "microfluidics"];
        let of_depth = depth.into_iter().filter(|_| !self.in_focus);
        ["particle image velocimetry", "particle tracking", "benchmark"].into_iter().chain(of_depth).collect()
    }

    /// `README.md` of the public part.
    pub(super) fn readme(&self) -> String {
        let (name, commitment) = (self.name, self.commitment);
        format!(
            "# {title}\n\n\
             A challenge for {trackers}: synthetic images with known ground truth, which is withheld for the test \
             split. {scored} {rules}\n\n\
             {timetable}\
             | file | contents |\n|---|---|\n\
             | `{name}-train.zip` | images with truth, for development and training |\n\
             | `{name}-val.zip` | the same scenario with different random numbers, with truth, for tuning parameters |\n\
             | `{name}-test.zip` | generated with a secret key: images only, for scoring, and a submission template |\n\
             | `{COMMITMENT}` | SHA-256 of a salt and the truth of the test split, which are published after the deadline |\n\
             | `datapackage.json`, `croissant.json`, `SHA256SUMS` | metadata and checksums; `sha256sum -c SHA256SUMS` checks all files |\n\n\
             ## Taking part\n\n\
             1. Unpack the archives. Each contains a `README.md` that describes axes, units and files. All three splits share optics{and_calibration}.\n\
             2. Run your tracker on `{name}-test/images/`. `frames.csv` lists their times.\n\
             3. Copy `{name}-test/submission/`, write your {results} to `results.csv` and fill in `submission.json`.\n\
             4. Check it: `microsig check-submission {name}-test SUBMISSION`. Send it as a folder or zip archive.\n\n\
             You can score results on train and val yourself: `microsig evaluate {name}-val results.csv`. The test split is scored \
             in the same way.\n\n\
             ## The truth of the test split\n\n\
             It was fixed before the first submission: `{COMMITMENT}` is the SHA-256 of `{SALT}` followed by \
             `{name}-test-truth.zip`. Both files are published after the deadline. To verify them:\n\n\
             ```sh\n\
             cat {SALT} {name}-test-truth.zip | sha256sum -c {COMMITMENT}      # the truth matches the commitment\n\
             unzip {name}-test-truth.zip -d revealed\n\
             cp -r {name}-test/images revealed/{name}-test/\n\
             microsig verify revealed/{name}-test --regenerate          # scenario and key reproduce images and truth\n\
             ```\n\n\
             Commitment: `{commitment}`.\n\n\
             ## Source and license\n\n\
             Generated by microsig {GENERATOR_VERSION}; the optical model is that of M. Rossi, Meas. Sci. Technol. 31, 017003 (2020). \
             License of the data: {license}, see `LICENSE`. To cite: `CITATION.cff`.\n",
            title = self.title,
            timetable = self.timetable(),
            scored = self.what_is_scored().trim_end(),
            rules = self.how_it_is_scored().trim_end(),
            results = if self.is_for_fields() { "vectors" } else { "points" },
            trackers = if self.is_for_fields() {
                "PIV"
            } else if self.in_focus {
                "PIV and particle tracking"
            } else {
                "tracking of defocused particles"
            },
            and_calibration = if self.calibrated {
                ", camera and the calibration stack in `calibration/`"
            } else {
                " and camera"
            },
            license = self.license.id,
        )
    }

    /// `README.md` of the test split.
    pub(super) fn test_card(&self) -> String {
        let calibration = format!(
            "- `calibration/`: images of one particle scanned through the depth range, from the train split. `{}` lists the \
             depths.\n",
            CalibrationRow::PATH
        );
        let calibration = if self.calibrated { calibration.as_str() } else { "" };
        format!(
            "# {title}: test split\n\n\
             Images of tracer particles, {focus}. The truth is withheld until the deadline of the challenge.\n\n\
             - `images/`: the frames, 16-bit TIFF (8-bit for 8-bit cameras); `frames.csv`: number, time and, for pair \
             recordings, pair and role of each frame.\n\
             - `settings.txt`: optics and sensor in MicroSIG's format; `datapackage.json`: camera, scale, depth range, times.\n\
             {calibration}\
             - `submission/`: the template. `microsig check-submission . SUBMISSION` checks a submission without the truth.\n\n\
             ## Axes and units\n\n{axes}\n\n\
             ## Submitting\n\n\
             {timetable}{scored}{rules}{particle_columns}{of_fields}\n\n\
             `submission.json` describes team and method; leave `coordinate_declaration` unchanged, and enter the hash of the images you used \
             in `images_sha256`: `grep '  images/' SHA256SUMS | sha256sum`.\n\n\
             ## License\n\n{license}; see `LICENSE`.\n",
            title = self.title,
            axes = coordinates(ZERO_OF_DATASETS),
            focus = self.focus(),
            timetable = self.timetable(),
            scored = self.what_is_scored(),
            rules = self.how_it_is_scored(),
            particle_columns =
                if self.is_for_fields() { String::new() } else { particle_columns(self.in_focus) },
            of_fields = if self.scored == [ResultKind::Particles] { "" } else { OF_FIELDS },
            license = self.license.id,
        )
    }

    /// `README.md` of the withheld part.
    pub(super) fn withheld(&self) -> String {
        let name = self.name;
        format!(
            "# {title}: withheld until the deadline\n\n\
             `test/` is the complete test split; anyone who has `test/secret_key.txt` can generate its truth.\n\n\
             Score a submission (folder or zip archive):\n\n\
             ```sh\n\
             microsig evaluate test SUBMISSION --out scores/TEAM --report\n\
             microsig compare scores/* --out scores/leaderboard\n\
             ```\n\n\
             {timetable}\
             After the deadline, `microsig reveal .. --out ../../{name}-truth` writes a folder to be published, with `{SALT}` and \
             `{name}-test-truth.zip`. They match the commitment in \
             `../public/{COMMITMENT}`:\n\n\
             ```sh\n\
             cat {SALT} {name}-test-truth.zip | sha256sum -c ../public/{COMMITMENT}\n\
             ```\n\n\
             The archive contains `test/` without its images, which are public.\n",
            title = self.title,
            timetable = self.timetable(),
        )
    }

    pub(super) fn license_text(&self) -> String {
        let ReleaseTexts { title, version, license, .. } = self;
        license.text(&format!("{title}, version {version}, by {},", self.creators.join("; ")))
    }

    pub(super) fn citation(&self) -> String {
        // A JSON string is a valid YAML string.
        let quoted = |text: &str| Value::from(text).to_string();
        let authors: String = self
            .creators
            .iter()
            .map(|creator| match creator.split_once(", ") {
                Some((family, given)) => {
                    format!("  - family-names: {}\n    given-names: {}\n", quoted(family), quoted(given))
                }
                None => format!("  - name: {}\n", quoted(creator)),
            })
            .collect();
        format!(
            "cff-version: 1.2.0\nmessage: {message}\ntype: dataset\ntitle: {title}\nversion: {version}\nlicense: {license}\n\
             authors:\n{authors}references:\n  - type: article\n    title: {rossi}\n    authors:\n      - family-names: Rossi\n        \
             given-names: Massimiliano\n    journal: \"Measurement Science and Technology\"\n    volume: 31\n    start: \"017003\"\n    \
             year: 2020\n",
            message = quoted(
                "If you use these images, please cite them, and the optical model that they were made with."
            ),
            title = quoted(&self.title),
            version = quoted(self.version),
            license = self.license.id,
            rossi = quoted("Synthetic image generator for defocusing and astigmatic PIV/PTV"),
        )
    }

    pub(super) fn zenodo(&self) -> String {
        let creators: Vec<Value> = self.creators.iter().map(|name| json!({ "name": name })).collect();
        let zenodo = json!({
            "title": self.title,
            "upload_type": "dataset",
            "description": format!("<p>{}</p>", self.description()),
            "version": self.version,
            "creators": creators,
            "keywords": self.keywords(),
            "license": self.license.id.to_ascii_lowercase(),
            "access_right": "open",
        });
        format!("{zenodo:#}\n")
    }

    fn description(&self) -> String {
        format!(
            "Synthetic images of tracer particles, {}, with known truth: a challenge in three splits, train and val with \
             truth, test with images only. Made by microsig {GENERATOR_VERSION}.",
            self.focus()
        )
    }

    /// `datapackage.json` of the public part.
    pub(super) fn manifest(&self, files: &BTreeMap<String, Fingerprint>) -> String {
        let resources: Vec<manifest::Resource> =
            files.iter().map(|(path, f)| manifest::resource(path, f, &[])).collect();
        let manifest = json!({
            "profile": "data-package",
            "name": format!("{}-challenge", self.name),
            "title": self.title,
            "description": self.description(),
            "version": self.version,
            "licenses": [generator::dataset::manifest::license(self.license)],
            "contributors": self.creators.iter().map(|c| json!({ "title": c, "role": "author" })).collect::<Vec<_>>(),
            "keywords": self.keywords(),
            "microsig": {
                "generator": "microsig",
                "generator_version": GENERATOR_VERSION,
                "splits": ["train", "val", "test"],
                "commitment_sha256": self.commitment,
                "deadline": self.deadline.map(|deadline| deadline.to_string()),
                "scoring": self.rules,
            },
            "resources": resources,
        });
        format!("{manifest:#}\n")
    }

    /// `croissant.json`: metadata in the Croissant 1.0 vocabulary of MLCommons, for machine-learning data
    /// loaders.
    pub(super) fn croissant(&self, archives: &BTreeMap<String, Fingerprint>) -> String {
        let archive = |(path, f): (&String, &Fingerprint)| {
            json!({
                "@type": "cr:FileObject",
                "@id": path,
                "name": path,
                "contentUrl": path,
                "contentSize": format!("{} B", f.bytes),
                "encodingFormat": "application/zip",
                "sha256": f.sha256.to_string(),
            })
        };
        let mut distribution: Vec<Value> = archives.iter().map(archive).collect();
        for split in ["train", "val", "test"] {
            distribution.push(self.images_of(split));
            if split != "test" {
                distribution.push(self.tracks_of(split));
            }
        }
        let mut croissant = json!({
            "@context": croissant::context(),
            "@type": "sc:Dataset",
            "conformsTo": ["http://mlcommons.org/croissant/1.0", "http://mlcommons.org/croissant/RAI/1.0"],
            "name": self.name,
            "description": self.description(),
            "license": self.license.url,
            "version": self.version,
            "creator": self.creators.iter().map(|c| json!({ "@type": "sc:Person", "name": c })).collect::<Vec<_>>(),
            "keywords": self.keywords(),
            "citeAs": format!("{}: {}, version {}", self.creators.join("; "), self.title, self.version),
            "distribution": distribution,
            "recordSet": [self.records("train"), self.records("val")],
        });
        for (key, text) in croissant::RESPONSIBLE {
            croissant[format!("rai:{key}")] = json!(text);
        }
        format!("{croissant:#}\n")
    }

    fn images_of(&self, split: &str) -> Value {
        json!({
            "@type": "cr:FileSet",
            "@id": format!("{split}-images"),
            "name": format!("{split}-images"),
            "containedIn": { "@id": format!("{}-{split}.zip", self.name) },
            "encodingFormat": "image/tiff",
            "includes": "*/images/*.tif",
        })
    }

    fn tracks_of(&self, split: &str) -> Value {
        let name = self.name;
        json!({
            "@type": "cr:FileObject",
            "@id": format!("{split}-tracks"),
            "name": format!("{split}-tracks"),
            "containedIn": { "@id": format!("{name}-{split}.zip") },
            "contentUrl": format!("{name}-{split}/{}", TrackRow::PATH),
            "encodingFormat": "text/csv",
        })
    }

    /// The record set of a split's table of tracks.
    fn records(&self, split: &str) -> Value {
        let fields: Vec<Value> = TrackRow::table(&[])
            .columns
            .iter()
            .map(|c| {
                json!({
                    "@type": "cr:Field",
                    "@id": format!("{split}/{}", c.name),
                    "name": c.name,
                    "description": c.description,
                    "dataType": if c.kind == "integer" { "sc:Integer" } else { "sc:Float" },
                    "source": {
                        "fileObject": { "@id": format!("{split}-tracks") },
                        "extract": { "column": c.name },
                    },
                })
            })
            .collect();
        json!({
            "@type": "cr:RecordSet",
            "@id": split,
            "name": split,
            "description": TrackRow::DESCRIPTION,
            "field": fields,
        })
    }
}
