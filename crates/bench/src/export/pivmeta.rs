//! The manifest in the terms of PIVMeta 3.1 (<https://matthiasprobst.github.io/pivmeta>), an ontology of
//! image velocimetry, as JSON-LD: data set, distributions, setup and its parameters (Metadata4Ing, QUDT
//! units).

use serde_json::{Value, json};
use storage::dataset::DatasetPlace;
use storage::dataset::manifest::{Facts, MANIFEST, Manifest, RECORDING, Resource};
use storage::error::{Error, Result};

/// The file, and the number of distributions.
pub(super) fn write(dataset: &DatasetPlace) -> Result<(Vec<u8>, usize)> {
    let DatasetPlace::Folder(dataset) = dataset else {
        return Err(Error::input(
            "pivmeta describes files: expected a dataset in a folder, not one in memory",
        ));
    };
    let manifest = Manifest::read(dataset)?;
    let facts = &manifest.microsig;
    let is_recorded = facts.kind.as_deref() == Some(RECORDING);
    let tables = manifest.resources.iter().filter(|resource| resource.schema.is_some());
    let images = |folder: &str| {
        manifest
            .resources
            .iter()
            .filter(|resource| resource.path.starts_with(folder) && resource.mediatype == "image/tiff")
            .count()
    };
    let kind = if is_recorded { "piv:ExperimentalImage" } else { "piv:SyntheticImage" };
    let mut distributions: Vec<Value> = [("images/", "frames"), ("calibration/images/", "calibration stack")]
        .into_iter()
        .map(|(folder, title)| (folder, title, images(folder)))
        .filter(|(.., n)| *n > 0)
        .map(|(folder, title, n)| {
            json!({
                "@type": "piv:ImageVelocimetryDistribution",
                "dcterms:title": title,
                "dcat:mediaType": { "@id": MEDIA.to_owned() + "image/tiff" },
                "piv:hasPIVDataType": { "@id": kind },
                "piv:filenamePattern": format!("^{folder}.*\\.tif$"),
                "piv:hasMetric": [number("number of images", n as f64, None)],
            })
        })
        .collect();
    distributions.extend(tables.map(table));
    let n = distributions.len();
    let license = manifest.licenses.first().map(|license| json!({ "@id": license.path }));
    let text = json!({
        "@context": {
            "piv": "https://matthiasprobst.github.io/pivmeta#",
            "dcat": "http://www.w3.org/ns/dcat#",
            "dcterms": "http://purl.org/dc/terms/",
            "m4i": "http://w3id.org/nfdi4ing/metadata4ing#",
            "obo": "http://purl.obolibrary.org/obo/",
            "rdfs": "http://www.w3.org/2000/01/rdf-schema#",
            "schema": "https://schema.org/",
            "unit": "http://qudt.org/vocab/unit/",
            "has part": "obo:BFO_0000051",
        },
        "@type": ["piv:ImageVelocimetryDataset", "dcat:Dataset"],
        "dcterms:title": manifest.title,
        "dcterms:identifier": manifest.name,
        "dcterms:description": manifest.description,
        "dcterms:license": license,
        "dcat:version": manifest.version,
        "piv:hasSetup": setup(facts, is_recorded),
        "dcat:distribution": distributions,
        "schema:isBasedOn": MANIFEST,
    });
    Ok((format!("{text:#}\n").into_bytes(), n))
}

/// Prefix of media types.
const MEDIA: &str = "https://www.iana.org/assignments/media-types/";

fn table(resource: &Resource) -> Value {
    json!({
        "@type": "piv:ImageVelocimetryDistribution",
        "dcterms:title": resource.path,
        "dcterms:description": resource.description,
        "dcat:mediaType": { "@id": MEDIA.to_owned() + "text/csv" },
        "dcat:byteSize": resource.bytes,
        "piv:hasPIVDataType": { "@id": "piv:ResultData" },
    })
}

/// A named number; `unit` is a name of QUDT's units.
fn number(label: &str, value: f64, unit: Option<&str>) -> Value {
    let mut made =
        json!({ "@type": "m4i:NumericalVariable", "rdfs:label": label, "m4i:hasNumericalValue": value });
    if let Some(unit) = unit {
        made["m4i:hasUnit"] = json!({ "@id": format!("unit:{unit}") });
    }
    made
}

fn setup(facts: &Facts, is_recorded: bool) -> Value {
    let numbers = |all: &[(&str, Option<f64>, Option<&str>)]| {
        let known = all.iter().filter_map(|(label, value, unit)| Some((label, (*value)?, unit)));
        known.map(|(label, value, unit)| number(label, value, *unit)).collect::<Vec<_>>()
    };
    let sensor = facts.sensor.as_ref();
    let camera = numbers(&[
        ("image width", sensor.map(|s| f64::from(s.width_px)), Some("PIXEL")),
        ("image height", sensor.map(|s| f64::from(s.height_px)), Some("PIXEL")),
        ("bit depth", sensor.map(|s| f64::from(s.bit_depth)), Some("BIT")),
        ("pixel size in object space", facts.um_per_px, Some("MicroM")),
    ]);
    let range = facts.depth_range_um;
    let setup = numbers(&[
        ("time between images", facts.timing.dt_s(), Some("SEC")),
        ("lower end of the depth range", range.map(|r| r[0]), Some("MicroM")),
        ("upper end of the depth range", range.map(|r| r[1]), Some("MicroM")),
        ("particles per image", facts.n_p, None),
        ("particles per pixel", facts.n_ppp, None),
        ("source density", facts.n_s, None),
        ("signal-to-noise ratio", facts.snr.as_ref().and_then(|snr| snr.value), None),
    ]);
    let diameter = facts.particle_image.as_ref().map(|particle| particle.d_um);
    let particle = numbers(&[("particle diameter", diameter, Some("MicroM"))]);
    let [setup_type, camera_type, particle_type] = match is_recorded {
        true => ["piv:ExperimentalSetup", "piv:DigitalCamera", "piv:PIVParticle"],
        false => ["piv:VirtualSetup", "piv:VirtualCamera", "piv:SyntheticPIVParticle"],
    };
    json!({
        "@type": setup_type,
        "m4i:hasParameter": setup,
        "has part": [
            { "@type": camera_type, "m4i:hasParameter": camera },
            { "@type": particle_type, "m4i:hasParameter": particle },
        ],
        "piv:usesSoftware": {
            "@type": "piv:PIVSoftware",
            "rdfs:label": "microsig",
            "schema:softwareVersion": facts.generator_version,
        },
    })
}
