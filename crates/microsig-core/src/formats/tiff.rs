//! Grey TIFF images, one image a file, uncompressed: 8 bit where counts fit, else 16 bit.

use std::io::{BufRead, Seek, Write};

use ::tiff::decoder::{Decoder, DecodingResult};
use ::tiff::encoder::{
    TiffEncoder,
    colortype::{Gray8, Gray16},
};

use crate::error::{Error, Fault};
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

/// Reads a grey image of 8 or 16 bit and of the given size as counts, row by row; `name` is what an error calls it.
///
/// # Errors
/// [`Error::Malformed`] if it is no such image.
pub fn read(reader: impl BufRead + Seek, name: &str, size: (u32, u32)) -> Result<Vec<f64>, Error> {
    let refuse = |message: String| {
        let fault = Fault { source_name: name.to_owned(), line: None, column: None, message };
        Error::Malformed(vec![fault])
    };
    let damaged = |e: ::tiff::TiffError| refuse(e.to_string());
    let mut decoder = Decoder::new(reader).map_err(damaged)?;
    let found = decoder.dimensions().map_err(damaged)?;
    // Checked before anything is allocated for the pixels.
    if found != size {
        return Err(refuse(format!("{} x {} px: expected {} x {} px", found.0, found.1, size.0, size.1)));
    }
    let counts: Vec<f64> = match decoder.read_image().map_err(damaged)? {
        DecodingResult::U8(counts) => counts.into_iter().map(f64::from).collect(),
        DecodingResult::U16(counts) => counts.into_iter().map(f64::from).collect(),
        _ => return Err(refuse("expected grey counts of 8 or 16 bit".to_owned())),
    };
    let pixels = size.0 as usize * size.1 as usize;
    if counts.len() != pixels {
        return Err(refuse(format!("{} values: expected {pixels}, one per pixel", counts.len())));
    }
    Ok(counts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn written(bits: u8, counts: Vec<u16>) -> Cursor<Vec<u8>> {
        let mut file = Cursor::new(Vec::new());
        write(&mut file, &Image { width: 3, height: 2, bits, counts }, "i.tif").unwrap();
        file.set_position(0);
        file
    }

    #[test]
    fn an_image_survives_the_round_trip() {
        for (bits, counts) in [(16, vec![0, 1, 350, 4464, 65_534, 65_535]), (8, vec![0, 1, 2, 127, 254, 255])]
        {
            let read = read(written(bits, counts.clone()), "i.tif", (3, 2)).unwrap();
            assert_eq!(read, counts.into_iter().map(f64::from).collect::<Vec<_>>());
        }
    }

    #[test]
    fn other_files_are_refused() {
        let file = written(16, vec![0; 6]).into_inner();
        let refuse = |bytes: &[u8]| read(Cursor::new(bytes), "i.tif", (3, 3)).unwrap_err().to_string();
        assert_eq!(refuse(&file), "i.tif: 3 x 2 px: expected 3 x 3 px");
        assert!(refuse(b"no image").starts_with("i.tif: "));
        assert!(refuse(&file[..file.len() / 2]).starts_with("i.tif: "));
    }
}
