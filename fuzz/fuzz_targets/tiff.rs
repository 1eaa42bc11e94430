//! Grayscale TIFF images: the first two bytes are the expected size.
#![no_main]

use std::io::Cursor;

use microsig_core::formats::tiff;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let [width, height, file @ ..] = bytes else { return };
    let size = (u32::from(*width), u32::from(*height));
    if let Ok(counts) = tiff::read(Cursor::new(file), "fuzz", size) {
        assert_eq!(counts.len(), usize::from(*width) * usize::from(*height));
    }
    let _ = tiff::read_scale(Cursor::new(file), "fuzz");
});
