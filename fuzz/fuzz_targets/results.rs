//! Result files of all trackers: the first byte selects the format or its detection.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use storage::argument::variants;
use scoring::results::{Conventions, Format, TrackerResult, read};

static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().unwrap());

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let [choice, file @ ..] = bytes else { return };
    let formats = variants::<Format>();
    // One more: detection.
    let format = formats.get(usize::from(*choice) % (formats.len() + 1)).copied();
    let extension = ["csv", "txt", "xml", "flo", "json"][usize::from(*choice / 16) % 5];
    let path: PathBuf = FOLDER.path().join(format!("result.{extension}"));
    std::fs::write(&path, file).unwrap();
    let given = Conventions {
        format,
        um_per_px: Some(0.645),
        depth_um: Some((-80.0, 20.0)),
        width_px: Some(752.0),
        height_px: Some(366.0),
        ..Conventions::default()
    };
    if let Ok(TrackerResult::Points(points)) = read(&path, &given) {
        for row in &points.rows {
            assert!(row.at.x_px.is_finite() && row.at.y_px.is_finite() && row.at.z_um.is_finite());
        }
    }
});
