//! Recorded tracks (CSV) that replace a flow.
#![no_main]

use flows::RecordedTracks;
use flows::scale::Scale;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let scale = Scale::new(0.645, 752, 366, 1.0).unwrap();
    if let Ok(tracks) = RecordedTracks::from_csv(bytes, &scale) {
        assert_eq!(tracks.count() == 0, tracks.rows().is_empty());
    }
});
