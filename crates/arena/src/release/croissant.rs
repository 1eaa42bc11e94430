//! Parts of `croissant.json` that are the same for all releases.

use serde_json::{Value, json};

/// What venues ask of data for machine learning, in the terms of Croissant RAI 1.0.
pub(super) const RESPONSIBLE: [(&str, &str); 10] = [
    (
        "dataCollection",
        "Images are generated: a velocity field moves particles, rays or waves are traced from them through a model of the optics, and a \
         model of the camera adds noise. scenario.ron of every split lists all parameters.",
    ),
    ("dataCollectionType", "Others: numerical simulation"),
    (
        "dataAnnotationProtocol",
        "Annotations are the positions, sizes and displacements from which the images are generated; they are exact, and nobody annotates.",
    ),
    ("dataImputationProtocol", "None: no value is imputed."),
    (
        "dataCollectionMissingData",
        "The truth of the test split is withheld until the deadline; the commitment proves that it does not change.",
    ),
    (
        "dataBiases",
        "Optics, flow, particles and noise come from a single scenario. Trackers that are tuned or trained on it may be worse on other \
         microscopes, particle sizes, densities and noise.",
    ),
    (
        "dataLimitations",
        "Images contain what the optical model contains: no multiple scattering, no dirt, no vibration, no defects of the camera unless the \
         scenario states them.",
    ),
    (
        "dataUseCases",
        "Training, validation and comparison of particle detectors, depth estimators, trackers and PIV algorithms. Conclusions about a real \
         experiment need its own calibration.",
    ),
    ("personalSensitiveInformation", "None: the data contain no persons."),
    (
        "dataSocialImpact",
        "Comparable measurements of trackers in microfluidics; no foreseeable harm to persons.",
    ),
];

/// The JSON-LD context required by the Croissant 1.0 specification.
pub(super) fn context() -> Value {
    json!({
        "@language": "en",
        "@vocab": "https://schema.org/",
        "citeAs": "cr:citeAs",
        "column": "cr:column",
        "conformsTo": "dct:conformsTo",
        "cr": "http://mlcommons.org/croissant/",
        "rai": "http://mlcommons.org/croissant/RAI/",
        "data": { "@id": "cr:data", "@type": "@json" },
        "dataType": { "@id": "cr:dataType", "@type": "@vocab" },
        "dct": "http://purl.org/dc/terms/",
        "equivalentProperty": "cr:equivalentProperty",
        "examples": { "@id": "cr:examples", "@type": "@json" },
        "extract": "cr:extract",
        "field": "cr:field",
        "fileProperty": "cr:fileProperty",
        "fileObject": "cr:fileObject",
        "fileSet": "cr:fileSet",
        "format": "cr:format",
        "includes": "cr:includes",
        "isLiveDataset": "cr:isLiveDataset",
        "jsonPath": "cr:jsonPath",
        "key": "cr:key",
        "md5": "cr:md5",
        "parentField": "cr:parentField",
        "path": "cr:path",
        "recordSet": "cr:recordSet",
        "references": "cr:references",
        "regex": "cr:regex",
        "repeated": "cr:repeated",
        "replace": "cr:replace",
        "samplingRate": "cr:samplingRate",
        "sc": "https://schema.org/",
        "separator": "cr:separator",
        "source": "cr:source",
        "subField": "cr:subField",
        "transform": "cr:transform",
    })
}
