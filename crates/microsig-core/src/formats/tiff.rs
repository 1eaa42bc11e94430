//! Gray TIFF images, one per file, uncompressed: 8 bit for sensors of 8 bit, otherwise 16 bit, and 32-bit
//! floating point for unrounded counts.
//!
//! The scale is stored where ImageJ and Fiji expect it (ij.io.FileSaver, FileOpener): px per um in the
//! resolution tags, the unit, the time between frames and the step of a stack in a description that starts with
//! "ImageJ=". No other metadata are written: no date, no program, no path.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek, Write};

use ::tiff::decoder::Decoder;
use ::tiff::encoder::{
    Rational, TiffEncoder, TiffKind,
    colortype::{ColorType, Gray8, Gray16, Gray32Float},
};
use ::tiff::tags::{ResolutionUnit, Tag};
use ::tiff::{TiffError, TiffResult};

use super::arrangement::Arrangement;
use super::gray::{GrayImages, told};
use super::stack::equal_step;
use crate::error::Error;
use crate::sensor::{Counts, Image};

/// Spatial and temporal scale of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelScale {
    /// Pixel size in object space, um.
    pub um_per_px: f64,
    /// Time between frames, s; `None` if the image is not part of a series.
    pub frame_interval_s: Option<f64>,
    /// Place in a stack over depth; `None` if the image is not part of one.
    pub plane: Option<StackPlane>,
}

impl PixelScale {
    /// The scale of an image that belongs to no series and no stack.
    pub fn um_per_px(um_per_px: f64) -> Self {
        PixelScale { um_per_px, frame_interval_s: None, plane: None }
    }
}

/// Place of an image in a stack over depth with equal steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StackPlane {
    /// Depth, um, growing away from the lens.
    pub z_um: f64,
    /// Step between depths, um.
    pub step_um: f64,
}

impl StackPlane {
    /// Plane `k` of a stack with these depths, um; `None` if they are not equally far apart.
    pub fn of(depths_um: &[f64], k: usize) -> Option<StackPlane> {
        let step_um = equal_step(depths_um)?;
        Some(StackPlane { z_um: *depths_um.get(k)?, step_um })
    }

    /// The entries of ImageJ's description, by which the depth of slice k is (k - zorigin) spacing. For an
    /// image in a file of its own, k is 0; ImageJ imports a sequence of files with the values of the first.
    pub(super) fn image_j(&self) -> String {
        format!("spacing={}\nzorigin={}\n", self.step_um, 0.0 - self.z_um / self.step_um)
    }
}

/// Writes an image; `name` is the name of the output in errors.
pub fn write(writer: impl Write + Seek, image: &Image, scale: &PixelScale, name: &str) -> Result<(), Error> {
    let written = TiffEncoder::new(writer)
        .and_then(|mut encoder| append(&mut encoder, image, scale, Some(&description(scale))));
    written.map_err(|e| Error::io(name, std::io::Error::other(e)))
}

/// Appends an image as a page, with the size of its pixels and a description.
pub(super) fn append<W: Write + Seek, K: TiffKind>(
    encoder: &mut TiffEncoder<W, K>,
    image: &Image,
    scale: &PixelScale,
    description: Option<&str>,
) -> TiffResult<()> {
    match &image.counts {
        Counts::Unrounded(counts) => encode::<Gray32Float, W, K>(encoder, image, counts, scale, description),
        Counts::Whole(counts) if image.bits > 8 => {
            encode::<Gray16, W, K>(encoder, image, counts, scale, description)
        }
        Counts::Whole(counts) => {
            let counts: Vec<u8> = counts.iter().map(|&c| c.min(255) as u8).collect();
            encode::<Gray8, W, K>(encoder, image, &counts, scale, description)
        }
    }
}

fn encode<C: ColorType, W: Write + Seek, K: TiffKind>(
    encoder: &mut TiffEncoder<W, K>,
    image: &Image,
    counts: &[C::Inner],
    scale: &PixelScale,
    description: Option<&str>,
) -> TiffResult<()>
where
    [C::Inner]: ::tiff::encoder::TiffValue,
{
    let mut page = encoder.new_image::<C>(image.width, image.height)?;
    page.resolution(ResolutionUnit::None, px_per_um(scale.um_per_px));
    if let Some(text) = description {
        page.encoder().write_tag(Tag::ImageDescription, text)?;
    }
    page.write_data(counts)
}

/// The description as ImageJ writes it, with the first version of ImageJ that reads this form.
fn description(scale: &PixelScale) -> String {
    let interval = scale.frame_interval_s.map_or_else(String::new, |s| format!("finterval={s}\n"));
    let plane = scale.plane.map_or_else(String::new, |plane| plane.image_j());
    format!("ImageJ=1.11a\nunit=um\n{interval}{plane}")
}

/// 1 / `um_per_px` as a fraction of 32-bit integers from which ImageJ, by division, recovers `um_per_px`: the
/// numerator is the largest power of ten for which the denominator fits.
fn px_per_um(um_per_px: f64) -> Rational {
    const MOST: f64 = u32::MAX as f64;
    let mut n = 1_000_000_000u32;
    while n > 1 && um_per_px * f64::from(n) > MOST {
        n /= 10;
    }
    let mut d = (um_per_px * f64::from(n)).round().clamp(1.0, MOST) as u32;
    while n.is_multiple_of(10) && d.is_multiple_of(10) {
        (n, d) = (n / 10, d / 10);
    }
    Rational { n, d }
}

/// Width and height of the first image of a file, px.
pub fn size(reader: impl BufRead + Seek, name: &str) -> Result<(u32, u32), Error> {
    let damaged = |e: TiffError| Error::malformed(name, told(&e));
    Decoder::new(reader).map_err(damaged)?.dimensions().map_err(damaged)
}

/// Reads the only gray image of a file, of the given size (width, height in px) and of 8 or 16 bit or of
/// finite floating-point numbers, as counts, row by row; `name` is the name of the input in errors.
pub fn read(reader: impl BufRead + Seek, name: &str, size: (u32, u32)) -> Result<Vec<f64>, Error> {
    Ok(read_counts(reader, name, size)?.values().collect())
}

/// Reads a file like [`read`], as whole counts in [`little_endian`] bytes; others are rounded and clamped.
/// Not generic, so that it is optimized like this crate, whoever calls it.
pub fn read_bytes(file: File, name: &str, size: (u32, u32)) -> Result<Vec<u8>, Error> {
    Ok(little_endian(&read_counts(BufReader::with_capacity(1 << 18, file), name, size)?.whole()))
}

/// Counts as bytes, the lower one first.
pub fn little_endian(counts: &[u16]) -> Vec<u8> {
    counts.iter().flat_map(|count| count.to_le_bytes()).collect()
}

/// Reads an image like [`read`], with the numbers that are in the file.
pub fn read_counts(reader: impl BufRead + Seek, name: &str, size: (u32, u32)) -> Result<Counts, Error> {
    let refuse = |message: String| Error::malformed(name, message);
    let damaged = |e: TiffError| refuse(told(&e));
    let mut images = GrayImages::open(reader).map_err(damaged)?;
    let found = images.size().map_err(damaged)?;
    // Checked before anything is allocated for the pixels.
    if found != size {
        return Err(refuse(format!("{} x {} px: expected {} x {} px", found.0, found.1, size.0, size.1)));
    }
    images.numbers().map_err(|found| refuse(format!("{found}: expected a gray image")))?;
    let counts = images.counts().map_err(refuse)?;
    if let Some(at) = counts.values().position(|count| !count.is_finite()) {
        let (column, row) = (at % size.0 as usize + 1, at / size.0 as usize + 1);
        let count = counts.values().nth(at).unwrap_or_default();
        return Err(refuse(format!("{count} in column {column}, row {row}: expected a finite number")));
    }
    // ImageJ's files above 4 GB have one directory.
    let stated = images.description().map_err(damaged)?.map_or(1, |text| Arrangement::images(&text));
    let mut pages = 1;
    while images.has_next() && pages < MAX_PAGES {
        images.go_on().map_err(damaged)?;
        pages += 1;
    }
    match pages.max(stated.min(MAX_PAGES)) {
        1 => Ok(counts),
        MAX_PAGES => Err(refuse(format!("{MAX_PAGES} pages or more: expected a file with one image"))),
        pages => Err(refuse(format!("{pages} pages: expected a file with one image"))),
    }
}

/// Pages are counted up to this number.
const MAX_PAGES: usize = 10_000;

#[cfg(test)]
mod tests {
    use super::*;
    use ::tiff::decoder::ifd::Value;
    use std::io::Cursor;

    const SCALE: PixelScale = PixelScale { um_per_px: 0.645, frame_interval_s: Some(0.005), plane: None };

    fn written(bits: u8, counts: Vec<u16>) -> Cursor<Vec<u8>> {
        let mut file = Cursor::new(Vec::new());
        let image = Image { width: 3, height: 2, bits, counts: Counts::Whole(counts) };
        write(&mut file, &image, &SCALE, "i.tif").unwrap();
        file.set_position(0);
        file
    }

    fn unrounded(counts: Vec<f32>) -> Cursor<Vec<u8>> {
        let mut file = Cursor::new(Vec::new());
        let counts = Counts::Unrounded(counts);
        write(&mut file, &Image { width: 3, height: 2, bits: 32, counts }, &SCALE, "i.tif").unwrap();
        file.set_position(0);
        file
    }

    #[test]
    fn unrounded_counts_survive_the_round_trip() {
        let counts = vec![-0.25, 0.0, 1e-3, 350.51, 70_000.5, 1e9];
        let read = |file| read_counts(file, "i.tif", (3, 2));
        assert_eq!(read(unrounded(counts.clone())).unwrap(), Counts::Unrounded(counts.clone()));
        assert_eq!(read(unrounded(counts)).unwrap().whole(), vec![0, 0, 0, 351, 65_535, 65_535]);
        let message = read(unrounded(vec![0.0, 1.0, 2.0, 3.0, f32::NAN, 0.0])).unwrap_err().to_string();
        assert_eq!(message, "i.tif: NaN in column 2, row 2: expected a finite number");
    }

    #[test]
    fn an_image_survives_the_round_trip() {
        for (bits, counts) in [(16, vec![0, 1, 350, 4464, 65_534, 65_535]), (8, vec![0, 1, 2, 127, 254, 255])]
        {
            let read = read(written(bits, counts.clone()), "i.tif", (3, 2)).unwrap();
            assert_eq!(read, counts.iter().copied().map(f64::from).collect::<Vec<_>>());
            let path = std::env::temp_dir().join(format!("microsig-tiff-{}-{bits}", std::process::id()));
            std::fs::write(&path, written(bits, counts.clone()).into_inner()).unwrap();
            let bytes = read_bytes(File::open(&path).unwrap(), "i.tif", (3, 2)).unwrap();
            std::fs::remove_file(path).unwrap();
            assert_eq!(bytes, counts.iter().flat_map(|c| [*c as u8, (*c >> 8) as u8]).collect::<Vec<_>>());
        }
    }

    #[test]
    fn the_scale_survives_the_round_trip() {
        for um_per_px in [0.645, 6.45 / 63.0, 1e-8, 1.0, 123_456.75, 4e9] {
            for (frame_interval_s, z_um) in
                [(None, Some(-80.0)), (Some(0.005), None), (Some(1e-7), Some(0.0))]
            {
                let plane = z_um.map(|z_um| StackPlane { z_um, step_um: 2.0 });
                let scale = PixelScale { um_per_px, frame_interval_s, plane };
                let mut file = Cursor::new(Vec::new());
                let image = Image { width: 3, height: 2, bits: 16, counts: Counts::Whole(vec![0; 6]) };
                write(&mut file, &image, &scale, "i.tif").unwrap();
                file.set_position(0);
                let mut decoder = Decoder::new(file).unwrap();
                let Some(Value::Rational(n, d)) = decoder.find_tag(Tag::XResolution).unwrap() else {
                    unreachable!("{um_per_px}");
                };
                // The denominator has at least eight digits, or two for scales that no microscope has.
                let bar = if um_per_px < 1e-7 { 0.05 } else { 1e-8 };
                assert!(
                    (f64::from(d) / f64::from(n) / um_per_px - 1.0).abs() < bar,
                    "{um_per_px}: {d} / {n}"
                );
                let text = decoder.find_tag(Tag::ImageDescription).unwrap().unwrap().into_string().unwrap();
                let interval = frame_interval_s.map_or_else(String::new, |s| format!("finterval={s}\n"));
                assert!(text.starts_with(&format!("ImageJ=1.11a\nunit=um\n{interval}")), "{text}");
                let arranged = Arrangement::read(&text, "i.tif", 1).unwrap().unwrap();
                let position = arranged.position(0).unwrap().map(|at| at.um);
                assert_eq!((position, arranged.step_um()), (z_um, Ok(z_um.map(|_| 2.0))));
            }
        }
        let Rational { n, d } = px_per_um(0.645);
        assert_eq!((n, d), (1000, 645));
    }

    #[test]
    fn other_files_are_refused() {
        let file = written(16, vec![0; 6]).into_inner();
        let refuse = |bytes: &[u8]| read(Cursor::new(bytes), "i.tif", (3, 3)).unwrap_err().to_string();
        assert_eq!(refuse(&file), "i.tif: 3 x 2 px: expected 3 x 3 px");
        assert!(refuse(b"no image").starts_with("i.tif: "));
        assert!(refuse(&file[..file.len() / 2]).starts_with("i.tif: "));
        let mut stack = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut stack).unwrap();
        for _ in 0..3 {
            encoder.write_image::<Gray8>(3, 3, &[7; 9]).unwrap();
        }
        assert_eq!(refuse(stack.get_ref()), "i.tif: 3 pages: expected a file with one image");
    }
    /// An image of 3 x 2 px whose red, green and blue lie one after another in the file.
    fn planar() -> Vec<u8> {
        let (short, long) = (3u16, 4u16);
        let after = 8 + 2 + 10 * 12 + 4;
        let (offsets, sizes, samples) = (after, after + 12, after + 24);
        let planes = after + 30;
        let entries = [
            (256, long, 1, 3),
            (257, long, 1, 2),
            (258, short, 3, samples),
            (259, short, 1, 1),
            (262, short, 1, 2),
            (273, long, 3, offsets),
            (277, short, 1, 3),
            (278, long, 1, 2),
            (279, long, 3, sizes),
            (284, short, 1, 2),
        ];
        let mut bytes = b"II*\0\x08\0\0\0\x0a\0".to_vec();
        for (tag, kind, count, value) in entries {
            bytes.extend(u16::to_le_bytes(tag));
            bytes.extend(kind.to_le_bytes());
            bytes.extend(u32::to_le_bytes(count));
            bytes.extend(u32::to_le_bytes(value));
        }
        bytes.extend([0; 4]);
        bytes.extend([planes, planes + 6, planes + 12, 6, 6, 6].into_iter().flat_map(u32::to_le_bytes));
        bytes.extend([8u16; 3].into_iter().flat_map(u16::to_le_bytes));
        bytes.extend(1..=18u8);
        bytes
    }

    #[test]
    fn colors_are_refused_however_they_are_stored() {
        let file = planar();
        assert_eq!(Decoder::new(Cursor::new(&file)).unwrap().colortype().unwrap(), ::tiff::ColorType::RGB(8));
        let refuse = |bytes: &[u8]| read(Cursor::new(bytes), "i.tif", (3, 2)).unwrap_err().to_string();
        assert_eq!(refuse(&file), "i.tif: RGB(8): expected a gray image");
        let mut chunky = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut chunky).unwrap();
        encoder.write_image::<::tiff::encoder::colortype::RGB8>(3, 2, &[9; 18]).unwrap();
        assert_eq!(refuse(chunky.get_ref()), "i.tif: RGB(8): expected a gray image");
    }
}
