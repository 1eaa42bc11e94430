//! Grey TIFF images, one image a file, uncompressed: 8 bit where counts fit, else 16 bit.

use std::io::{Seek, Write};

use ::tiff::encoder::{
    TiffEncoder,
    colortype::{Gray8, Gray16},
};

use crate::error::Error;
use crate::sensor::Image;

/// Writes an image; `name` is what an error calls the output.
///
/// # Errors
/// [`Error::Io`] if writing fails.
pub fn write(writer: impl Write + Seek, image: &Image, name: &str) -> Result<(), Error> {
    TiffEncoder::new(writer)
        .and_then(|mut encoder| {
            if image.bits > 8 {
                return encoder.write_image::<Gray16>(image.width, image.height, &image.counts);
            }
            let counts: Vec<u8> = image.counts.iter().map(|&c| c.min(255) as u8).collect();
            encoder.write_image::<Gray8>(image.width, image.height, &counts)
        })
        .map_err(|e| Error::io(name, std::io::Error::other(e)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::tiff::decoder::{Decoder, DecodingResult};
    use std::io::Cursor;

    #[test]
    fn an_image_survives_the_round_trip() {
        let image = Image { width: 3, height: 2, bits: 16, counts: vec![0, 1, 350, 4464, 65_534, 65_535] };
        let mut file = Cursor::new(Vec::new());
        write(&mut file, &image, "i.tif").unwrap();
        file.set_position(0);
        let mut decoder = Decoder::new(file).unwrap();
        assert_eq!(decoder.dimensions().unwrap(), (3, 2));
        match decoder.read_image().unwrap() {
            DecodingResult::U16(counts) => assert_eq!(counts, image.counts),
            other => panic!("not 16 bit: {other:?}"),
        }
    }
}
