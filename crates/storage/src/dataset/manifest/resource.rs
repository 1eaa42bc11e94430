use serde::{Deserialize, Serialize};

use crate::checksums::Fingerprint;
use crate::dataset::{Column, Table};

/// A file of a dataset.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Resource {
    /// Name, lower case without slashes.
    #[serde(default)]
    pub name: String,
    /// Path in the dataset.
    pub path: String,
    /// Extension.
    #[serde(default)]
    pub format: String,
    /// Media type.
    #[serde(default)]
    pub mediatype: String,
    /// Size, bytes.
    pub bytes: u64,
    /// `sha256:` and 64 hexadecimal digits.
    pub hash: String,
    /// `tabular-data-resource` of a table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// Encoding of a table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub encoding: Option<String>,
    /// Description of a table and its rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
    /// Columns of a table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub schema: Option<TableSchema>,
    /// Frame number of an image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<u32>,
    /// Width of an image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width_px: Option<u32>,
    /// Height of an image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_px: Option<u32>,
    /// Bit depth of an image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bit_depth: Option<u8>,
    /// Number of visible particles in an image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub n_visible: Option<u64>,
}

impl Resource {
    /// SHA-256 in hexadecimal.
    pub fn sha256(&self) -> &str {
        self.hash.trim_start_matches("sha256:")
    }
}

/// The columns of a table.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TableSchema {
    /// The columns, in order.
    pub fields: Vec<SchemaField>,
    /// Contents of cells with missing values.
    #[serde(rename = "missingValues", default)]
    pub missing_values: Vec<String>,
}

/// A column.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SchemaField {
    /// Name.
    pub name: String,
    /// `integer`, `number` or `string`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Unit; empty if there is none.
    #[serde(default)]
    pub unit: String,
    /// Description of the column.
    #[serde(default)]
    pub description: String,
}

/// The manifest's entry of a file; `tables` gives the columns if it is a table.
pub fn resource(path: &str, fingerprint: &Fingerprint, tables: &[Table]) -> Resource {
    let extension = path.rsplit_once('.').map_or("", |(_, e)| e);
    let mediatype = match extension {
        "csv" => "text/csv",
        "tif" | "tiff" => "image/tiff",
        "png" => "image/png",
        "md" => "text/markdown",
        "npy" => "application/octet-stream",
        "zip" => "application/zip",
        _ => "text/plain",
    };
    let table = tables.iter().find(|t| t.path == path);
    Resource {
        name: resource_name(path),
        path: path.to_owned(),
        format: if extension.is_empty() { "txt" } else { extension }.to_owned(),
        mediatype: mediatype.to_owned(),
        bytes: fingerprint.bytes,
        hash: format!("sha256:{}", fingerprint.sha256),
        profile: table.map(|_| "tabular-data-resource".to_owned()),
        encoding: table.map(|_| "utf-8".to_owned()),
        description: table.map(|t| t.description.to_owned()),
        schema: table.map(schema),
        ..Resource::default()
    }
}

fn schema(table: &Table) -> TableSchema {
    let field = |c: &Column| SchemaField {
        name: c.name.to_owned(),
        kind: c.kind.to_owned(),
        unit: c.unit.to_owned(),
        description: c.description.to_owned(),
    };
    TableSchema { fields: table.columns.iter().map(field).collect(), missing_values: vec![String::new()] }
}

/// Names of resources are lower case, without slashes.
fn resource_name(path: &str) -> String {
    path.chars()
        .map(|c| match c.to_ascii_lowercase() {
            c if c.is_ascii_alphanumeric() || "._-".contains(c) => c,
            '/' => '-',
            _ => '_',
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_the_media_types_of_their_extensions() {
        for (path, expected) in [
            ("inputs/velocities.npy", "application/octet-stream"),
            ("small-test.zip", "application/zip"),
            ("inputs/gain.tiff", "image/tiff"),
            ("settings.txt", "text/plain"),
            ("LICENSE", "text/plain"),
        ] {
            assert_eq!(resource(path, &Fingerprint::of(b""), &[]).mediatype, expected, "{path}");
        }
    }
}
