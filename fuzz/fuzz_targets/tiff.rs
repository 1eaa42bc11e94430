//! Grayscale TIFF images and stacks: the first two bytes are the expected size of an image.
#![no_main]

use std::io::Cursor;

use microsig_core::formats::pages::Pages;
use microsig_core::formats::tiff;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let [width, height, file @ ..] = bytes else { return };
    let size = (u32::from(*width), u32::from(*height));
    if let Ok(counts) = tiff::read(Cursor::new(file), "fuzz", size) {
        assert_eq!(counts.len(), usize::from(*width) * usize::from(*height));
    }
    let Ok(mut pages) = Pages::open(Cursor::new(file), "fuzz") else { return };
    while pages.size().and_then(|size| pages.counts(size)).is_ok() && pages.go_on().is_ok_and(|found| found) {}
    let _ = pages.arrangement(pages.page() + 1);
});
