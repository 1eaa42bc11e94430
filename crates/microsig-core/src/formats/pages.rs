//! The pages of TIFF files of cameras: gray counts of 8 or 16 bit, one page after the other, so that memory
//! holds one page of a file of any length; and how a file says that its pages are arranged (OME-XML, ImageJ).

use std::io::{Read, Seek};

use ::tiff::ColorType;
use ::tiff::decoder::{Decoder, DecodingResult};
use ::tiff::tags::Tag;

use super::tiff::told;
use crate::error::{Error, Fault};

/// A file of pages, read in their order.
pub struct Pages<R: Read + Seek> {
    decoder: Decoder<R>,
    name: String,
    page: usize,
}

/// The size and pixel type of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PageSize {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Bits of a pixel, 8 or 16.
    pub bits: u8,
}

/// How the pages of a file are arranged: the sizes of channels (`C`), slices (`Z`) and times (`T`), the one
/// that changes from page to page first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageOrder {
    /// Axes and their sizes.
    pub axes: [(char, usize); 3],
    /// The program or standard that says so.
    pub by: &'static str,
}

impl<R: Read + Seek> Pages<R> {
    /// Opens a file at its first page; `name` is its name in errors.
    ///
    /// # Errors
    /// [`Error::Malformed`] if it is no TIFF file.
    pub fn open(reader: R, name: &str) -> Result<Self, Error> {
        let decoder = Decoder::new(reader).map_err(|e| malformed(name, told(&e)))?;
        Ok(Pages { decoder, name: name.to_owned(), page: 0 })
    }

    /// Number of the current page, from 0.
    pub fn page(&self) -> usize {
        self.page
    }

    fn refuse(&self, message: &str) -> Error {
        malformed(&self.name, format!("page {}: {message}", self.page))
    }

    /// Size and pixel type of the current page.
    ///
    /// # Errors
    /// [`Error::Malformed`] if it holds no gray counts of 8 or 16 bit.
    pub fn size(&mut self) -> Result<PageSize, Error> {
        let (width, height) = self.decoder.dimensions().map_err(|e| self.refuse(&told(&e)))?;
        let color = self.decoder.colortype().map_err(|e| self.refuse(&told(&e)))?;
        // 1: unsigned, 2: signed, 3: floating-point numbers.
        let format = self.decoder.find_tag(Tag::SampleFormat).ok().flatten();
        let format = format.and_then(|value| value.into_u16_vec().ok()).and_then(|all| all.first().copied());
        let bits = match (color, format.unwrap_or(1)) {
            (ColorType::Gray(bits @ (8 | 16)), 1) => bits,
            (ColorType::Gray(bits), 3) => {
                return Err(self.refuse(&format!("floating-point numbers of {bits} bit{COUNTS}")));
            }
            (ColorType::Gray(bits), 2) => {
                return Err(self.refuse(&format!("signed numbers of {bits} bit{COUNTS}")));
            }
            (ColorType::Gray(bits), _) => return Err(self.refuse(&format!("{bits} bit{COUNTS}"))),
            (color, _) => return Err(self.refuse(&format!("{color:?}{COUNTS}"))),
        };
        Ok(PageSize { width, height, bits })
    }

    /// The counts of the current page, row by row; `expected` is its size.
    ///
    /// # Errors
    /// [`Error::Malformed`] if it has another size or cannot be read.
    pub fn counts(&mut self, expected: PageSize) -> Result<Vec<u16>, Error> {
        let size = self.size()?;
        // Before memory is allocated for the pixels.
        if (size.width, size.height) != (expected.width, expected.height) {
            let [a, b, c, d] = [size.width, size.height, expected.width, expected.height];
            return Err(self.refuse(&format!("{a} x {b} px: expected {c} x {d} px")));
        }
        let counts = match self.decoder.read_image().map_err(|e| self.refuse(&told(&e)))? {
            DecodingResult::U8(counts) => counts.into_iter().map(u16::from).collect::<Vec<_>>(),
            DecodingResult::U16(counts) => counts,
            _ => return Err(self.refuse(COUNTS)),
        };
        let pixels = size.width as usize * size.height as usize;
        if counts.len() != pixels {
            return Err(self.refuse(&format!("{} values: expected {pixels}, one per pixel", counts.len())));
        }
        Ok(counts)
    }

    /// Goes to the next page; `false` if there is none.
    ///
    /// # Errors
    /// [`Error::Malformed`] if the file is damaged.
    pub fn go_on(&mut self) -> Result<bool, Error> {
        if !self.decoder.more_images() {
            return Ok(false);
        }
        self.page += 1;
        self.decoder.next_image().map_err(|e| self.refuse(&told(&e)))?;
        Ok(true)
    }

    /// The description of the current page.
    pub fn description(&mut self) -> Option<String> {
        self.decoder.find_tag(Tag::ImageDescription).ok()??.into_string().ok()
    }

    /// How the file says that its pages are arranged, from the description of its first page, at which the
    /// file must be.
    pub fn order(&mut self) -> Option<PageOrder> {
        let description = self.description()?;
        ome(&description).or_else(|| image_j(&description))
    }

    /// The step between slices in um as ImageJ or OME-XML states it, from the description of the first page,
    /// at which the file must be; `None` if there is none, or one in another unit.
    pub fn spacing_um(&mut self) -> Option<f64> {
        let text = self.description()?;
        let (spacing, unit) = match Pixels::of(&text) {
            // The unit of OME-XML by default.
            Some(pixels) => (pixels.get("PhysicalSizeZ")?, pixels.get("PhysicalSizeZUnit").unwrap_or("um")),
            None => (entry(&text, "spacing")?, entry(&text, "unit")?),
        };
        let spacing: f64 = spacing.trim().parse().ok()?;
        let known = matches!(
            unit.trim(),
            "um" | "micron"
                | "microns"
                | "\\u00B5m"
                | "\u{b5}m"
                | "\u{3bc}m"
                | "&#181;m"
                | "&#xB5;m"
                | "&#xb5;m"
        );
        (known && spacing.is_finite() && spacing != 0.0).then_some(spacing)
    }
}

const COUNTS: &str = ": expected gray counts of 8 or 16 bit, as the camera recorded them";

fn malformed(name: &str, message: String) -> Error {
    Error::Malformed(vec![Fault::of(name, message)])
}

/// Attributes of the element `Pixels` of OME-XML.
struct Pixels<'a>(&'a str);

impl<'a> Pixels<'a> {
    fn of(text: &'a str) -> Option<Self> {
        let element = text.split_once("<Pixels ").or_else(|| text.split_once("<OME:Pixels "))?.1;
        Some(Pixels(element.split_once('>')?.0))
    }

    fn get(&self, name: &str) -> Option<&'a str> {
        // A name is the end of no other.
        let (_, value) = self.0.split_once(&format!(" {name}=\"")).or_else(|| {
            let value = self.0.strip_prefix(name)?.strip_prefix("=\"")?;
            Some(("", value))
        })?;
        Some(value.split_once('"')?.0)
    }
}

fn ome(text: &str) -> Option<PageOrder> {
    let pixels = Pixels::of(text)?;
    let size =
        |axis: char| pixels.get(&format!("Size{axis}")).and_then(|n| n.trim().parse().ok()).unwrap_or(1usize);
    let axes: Vec<char> = pixels.get("DimensionOrder").unwrap_or("XYCZT").chars().skip(2).collect();
    let [a, b, c] = axes[..].try_into().ok()?;
    Some(PageOrder { axes: [a, b, c].map(|axis| (axis, size(axis).max(1))), by: "OME-XML" })
}

/// An entry of ImageJ's description.
fn entry<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('='))
}

/// Entries of ImageJ's description; pages are in the order of channels, slices and frames.
fn image_j(text: &str) -> Option<PageOrder> {
    if !text.starts_with("ImageJ=") {
        return None;
    }
    let size = |key: &str| entry(text, key).and_then(|n| n.trim().parse().ok()).unwrap_or(1usize).max(1);
    let axes = [('C', size("channels")), ('Z', size("slices")), ('T', size("frames"))];
    Some(PageOrder { axes, by: "ImageJ" })
}

impl PageOrder {
    fn size(&self, axis: char) -> usize {
        self.axes.iter().find(|(own, _)| *own == axis).map_or(1, |(_, size)| *size)
    }

    /// Number of pages.
    pub fn pages(&self) -> usize {
        self.axes.iter().fold(1, |product, (_, size)| product.saturating_mul(*size))
    }

    /// The axis of time: slices if the file has no other times, as programs write sequences.
    fn time(&self) -> char {
        if self.size('T') == 1 && self.size('Z') > 1 { 'Z' } else { 'T' }
    }

    /// Number of pages of one time.
    pub fn per_time(&self) -> usize {
        self.pages() / self.size(self.time()).max(1)
    }

    /// The time to which a page belongs, and its number among the pages of that time.
    pub fn place(&self, page: usize) -> (usize, usize) {
        let (mut rest, mut stride, mut time, mut within) = (page, 1, 0, 0);
        for (axis, size) in self.axes {
            let at = rest % size;
            rest /= size;
            if axis == self.time() {
                time = at;
            } else {
                within += stride * at;
                stride *= size;
            }
        }
        (time, within)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn pages_are_arranged_as_their_file_says() {
        let text = r#"<?xml?><OME><Image><Pixels ID="0" DimensionOrder="XYTCZ" SizeC="2" SizeT="3" SizeX="9" SizeY="9" SizeZ="1" Type="uint16"><Channel/>"#;
        let order = ome(text).unwrap();
        assert_eq!((order.pages(), order.per_time()), (6, 2));
        assert_eq!(
            (0..6).map(|page| order.place(page)).collect::<Vec<_>>(),
            [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
        );
        let order = image_j("ImageJ=1.53t\nimages=6\nchannels=2\nframes=3\n").unwrap();
        assert_eq!((order.place(3), order.per_time()), ((1, 1), 2));
        // A sequence that is stored as slices.
        let order = image_j("ImageJ=1.53t\nimages=6\nslices=6\n").unwrap();
        assert_eq!((order.place(4), order.per_time()), ((4, 0), 1));
        assert_eq!(image_j("a camera"), None);
    }

    #[test]
    fn pages_are_read_one_after_the_other() {
        use ::tiff::encoder::{TiffEncoder, colortype};
        let mut file = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut file).unwrap();
        encoder.write_image::<colortype::Gray16>(2, 1, &[7, 60_000]).unwrap();
        encoder.write_image::<colortype::Gray8>(2, 1, &[3, 255]).unwrap();
        encoder.write_image::<colortype::Gray32Float>(2, 1, &[3.0, 255.0]).unwrap();
        encoder.write_image::<colortype::RGB8>(1, 1, &[3, 2, 1]).unwrap();
        file.set_position(0);
        let mut pages = Pages::open(file, "a.tif").unwrap();
        let size = pages.size().unwrap();
        assert_eq!(size, PageSize { width: 2, height: 1, bits: 16 });
        assert_eq!(pages.counts(size).unwrap(), [7, 60_000]);
        assert!(pages.go_on().unwrap());
        assert_eq!(pages.counts(size).unwrap(), [3, 255]);
        let message = pages.counts(PageSize { width: 3, ..size }).unwrap_err().to_string();
        assert_eq!(message, "a.tif: page 1: 2 x 1 px: expected 3 x 1 px");
        for found in ["page 2: floating-point numbers of 32 bit", "page 3: RGB(8)"] {
            assert!(pages.go_on().unwrap());
            let message = pages.size().unwrap_err().to_string();
            assert!(message.contains(found), "{message}");
        }
        assert!(!pages.go_on().unwrap());
    }
}
