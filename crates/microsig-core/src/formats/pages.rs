//! The pages of TIFF files of cameras: gray counts of 8 to 16 bit, one page after the other, so that memory
//! holds one page of a file of any length.

use std::io::{Read, Seek};

use super::arrangement::Arrangement;
use super::gray::{GrayImages, Numbers, told};
use crate::error::Error;
use crate::sensor::Counts;

/// A file of pages, read in their order.
pub struct Pages<R: Read + Seek> {
    images: GrayImages<R>,
    name: String,
    page: usize,
    /// Description of the first page.
    description: Option<String>,
    raw: Option<Raw>,
}

/// Images without directories behind the first one.
#[derive(Debug, Clone, Copy)]
struct Raw {
    offset: u64,
    images: usize,
}

/// The size and pixel type of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PageSize {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Bits of a pixel, 8 or 16 (also for packed numbers of 9 to 15 bit).
    pub bits: u8,
}

impl<R: Read + Seek> Pages<R> {
    /// Opens a file at its first page; `name` is its name in errors. Errors: [`Error::Malformed`] if it is no
    /// TIFF file, or of a kind whose pages cannot be told.
    pub fn open(reader: R, name: &str) -> Result<Self, Error> {
        let damaged = |e| Error::malformed(name, told(&e));
        let mut images = GrayImages::open(reader).map_err(damaged)?;
        let description = images.description().map_err(damaged)?;
        if images.has(METAMORPH) {
            let what = "a MetaMorph stack: expected a TIFF file, such as ImageJ or Bio-Formats write from it";
            return Err(Error::malformed(name, what.to_owned()));
        }
        let stated = description.as_deref().map_or(1, Arrangement::images);
        let mut pages = Pages { images, name: name.to_owned(), page: 0, description, raw: None };
        if stated > 1 && !pages.images.has_next() {
            let size = pages.size()?;
            let bytes = u64::from(size.width) * u64::from(size.height) * u64::from(size.bits / 8);
            let offset = pages.images.raw_data(bytes).map_err(damaged)?;
            let room = pages.images.length().map_err(|e| Error::io(name, e))?;
            let fits = |offset: &u64| {
                bytes > 0
                    && bytes
                        .checked_mul(stated as u64)
                        .is_some_and(|all| *offset <= room && all <= room - offset)
            };
            let offset = offset.filter(fits).ok_or_else(|| {
                Error::malformed(name, format!("it states {stated} images, which its data do not hold"))
            })?;
            pages.raw = Some(Raw { offset, images: stated });
        }
        Ok(pages)
    }

    /// Number of the current page, from 0.
    pub fn page(&self) -> usize {
        self.page
    }

    fn refuse(&self, message: &str) -> Error {
        Error::malformed(&self.name, format!("page {}: {message}", self.page))
    }

    /// Size and pixel type of the current page. Errors: [`Error::Malformed`] if it holds no gray counts of 8
    /// to 16 bit.
    pub fn size(&mut self) -> Result<PageSize, Error> {
        let (width, height) = self.images.size().map_err(|e| self.refuse(&told(&e)))?;
        let found = match self.images.numbers() {
            Ok(Numbers::Unsigned(8)) => return Ok(PageSize { width, height, bits: 8 }),
            Ok(Numbers::Unsigned(9..=16)) => return Ok(PageSize { width, height, bits: 16 }),
            Ok(Numbers::Unsigned(bits)) => format!("{bits} bit"),
            Ok(Numbers::Float(bits)) => format!("floating-point numbers of {bits} bit"),
            Ok(Numbers::Signed(bits)) => format!("signed numbers of {bits} bit"),
            Err(found) => found,
        };
        Err(self
            .refuse(&format!("{found}: expected gray counts of 8 to 16 bit, as the camera recorded them")))
    }

    /// Whether any program reads the current page as these counts: a file of its own that is not packed,
    /// inverted or with a palette.
    pub fn is_plain(&mut self) -> bool {
        self.raw.is_none() && self.images.is_plain()
    }

    /// The counts of the current page, row by row; `expected` is its size. Errors: [`Error::Malformed`] if it
    /// has another size or cannot be read.
    pub fn counts(&mut self, expected: PageSize) -> Result<Vec<u16>, Error> {
        let size = self.size()?;
        // Before memory is allocated for the pixels.
        if (size.width, size.height) != (expected.width, expected.height) {
            let [a, b, c, d] = [size.width, size.height, expected.width, expected.height];
            return Err(self.refuse(&format!("{a} x {b} px: expected {c} x {d} px")));
        }
        if let Some(raw) = self.raw {
            let pixels = size.width as usize * size.height as usize;
            let offset = raw.offset + self.page as u64 * (pixels as u64 * u64::from(size.bits / 8));
            let counts = self.images.raw_counts(offset, pixels, size.bits);
            return counts.map_err(|e| self.refuse(&told(&e)));
        }
        match self.images.counts() {
            Ok(Counts::Whole(counts)) => Ok(counts),
            Ok(Counts::Unrounded(_)) => Err(self.refuse("floating-point numbers")),
            Err(what) => Err(self.refuse(&what)),
        }
    }

    /// Goes to the next page; `false` if there is none.
    pub fn go_on(&mut self) -> Result<bool, Error> {
        if !self.raw.map_or_else(|| self.images.has_next(), |raw| self.page + 1 < raw.images) {
            return Ok(false);
        }
        self.page += 1;
        if self.raw.is_none() {
            self.images.go_on().map_err(|e| self.refuse(&told(&e)))?;
        }
        Ok(true)
    }

    /// The description of the first page.
    pub fn description(&self) -> Option<&str> {
        self.description.as_deref()
    }

    /// How the file says that its pages are arranged, if it does; `n` is their number. Errors:
    /// [`Error::Malformed`] if it says what does not fit its pages.
    pub fn arrangement(&self, n: usize) -> Result<Option<Arrangement>, Error> {
        let Some(text) = &self.description else { return Ok(None) };
        let file = self.name.rsplit(['/', '\\']).next().unwrap_or_default();
        Arrangement::read(text, file, n).map_err(|what| Error::malformed(&self.name, what))
    }
}

/// The tag of MetaMorph's stacks, whose planes but the first have no directories.
const METAMORPH: u16 = 33_629;

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

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
