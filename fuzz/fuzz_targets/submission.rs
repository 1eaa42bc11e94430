//! Submissions to a challenge: the first byte selects an archive, or a folder with this `submission.json`.
#![no_main]

use std::sync::LazyLock;

use arena::release::SubmissionFiles;
use scoring::results::Limits;

static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().unwrap());

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let [choice, file @ ..] = bytes else { return };
    let path = if choice % 2 == 0 {
        let path = FOLDER.path().join("team.zip");
        std::fs::write(&path, file).unwrap();
        path
    } else {
        let path = FOLDER.path().join("team");
        std::fs::create_dir_all(&path).unwrap();
        std::fs::write(path.join("submission.json"), file).unwrap();
        std::fs::write(path.join("results.csv"), "frame,track,x_px,y_px\n0,1,2,3\n").unwrap();
        path
    };
    let limits = Limits { bytes: 1 << 20, rows: 1000 };
    if let Ok(files) = SubmissionFiles::open(&path, limits) {
        assert!(files.results().exists());
    }
});
