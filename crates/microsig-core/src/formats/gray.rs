//! Decoder of gray TIFF images that gives the numbers in the file: images whose zero is white are not
//! inverted, images with a gray palette give its indices (as ImageJ and tifffile have them), and
//! packed numbers of 9 to 15 bit are unpacked.

use std::io::{Read, Seek, SeekFrom};

use ::tiff::decoder::{Decoder, DecodingResult, Limits};
use ::tiff::tags::{ByteOrder, CompressionMethod, Tag, Type, ValueBuffer};
use ::tiff::{ColorType, TiffError, TiffResult};

use crate::sensor::Counts;

/// Most bytes of a description: OME-XML of a long series has millions.
const MOST_BYTES: usize = 1 << 27;

/// Values of the tag of the photometric interpretation.
const WHITE_IS_ZERO: u64 = 0;
const BLACK_IS_ZERO: u64 = 1;
const PALETTE: u64 = 3;

pub(super) struct GrayImages<R: Read + Seek> {
    decoder: Decoder<Patched<R>>,
    index: usize,
    /// The photometric interpretation that the file states for the current image.
    photometric: Option<u64>,
    /// Bits and width of the current image if its numbers are packed.
    packed: Option<(u8, u32)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Numbers {
    /// Unsigned, of this number of bits.
    Unsigned(u8),
    /// Floating point, of this number of bits.
    Float(u8),
    /// Signed, of this number of bits.
    Signed(u8),
}

impl<R: Read + Seek> GrayImages<R> {
    /// Opens a file at its first image.
    pub(super) fn open(reader: R) -> TiffResult<Self> {
        let mut limits = Limits::default();
        limits.ifd_value_size = MOST_BYTES;
        let decoder = Decoder::new(Patched { inner: reader, at: 0, bytes: Vec::new() })?.with_limits(limits);
        let mut images = GrayImages { decoder, index: 0, photometric: None, packed: None };
        images.prepare()?;
        Ok(images)
    }

    /// Whether there is another image.
    pub(super) fn has_next(&self) -> bool {
        self.decoder.more_images()
    }

    /// Goes to the next image.
    pub(super) fn go_on(&mut self) -> TiffResult<()> {
        self.decoder.inner().bytes.clear();
        self.decoder.next_image()?;
        self.index += 1;
        self.prepare()
    }

    /// The decoder inverts images whose zero is white, and has no palettes and no packed numbers: it is told that
    /// zero is black, and that rows of packed numbers are rows of bytes.
    fn prepare(&mut self) -> TiffResult<()> {
        let mut numbers =
            |tag: Tag| self.decoder.find_tag_unsigned_vec::<u64>(tag).map(Option::unwrap_or_default);
        let (photometric, bits) = (numbers(Tag::PhotometricInterpretation)?, numbers(Tag::BitsPerSample)?);
        let (samples, tiles) = (numbers(Tag::SamplesPerPixel)?, numbers(Tag::TileWidth)?);
        (self.photometric, self.packed) = (photometric.first().copied(), None);
        let mut told = Vec::new();
        if matches!(self.photometric, Some(WHITE_IS_ZERO | PALETTE)) {
            told.push((Tag::PhotometricInterpretation, BLACK_IS_ZERO));
        }
        if let ([bits @ 9..=15], [] | [1], []) = (&bits[..], &samples[..], &tiles[..]) {
            let (width, _) = self.decoder.dimensions()?;
            self.packed = Some((*bits as u8, width));
            told.push((Tag::BitsPerSample, 8));
            told.push((Tag::ImageWidth, (u64::from(width) * bits).div_ceil(8)));
        }
        if !told.is_empty() {
            self.tell(&told)?;
            self.decoder.seek_to_image(self.index)?;
        }
        Ok(())
    }

    /// Lets the decoder read other values than those in the directory of the image.
    fn tell(&mut self, told: &[(Tag, u64)]) -> TiffResult<()> {
        let Some(directory) = self.decoder.ifd_pointer() else { return Ok(()) };
        let is_little = self.decoder.byte_order() == ByteOrder::LittleEndian;
        let reader = self.decoder.inner();
        let number = |bytes: &[u8]| {
            let byte = |value: u64, byte: &u8| value << 8 | u64::from(*byte);
            if is_little { bytes.iter().rev().fold(0, byte) } else { bytes.iter().fold(0, byte) }
        };
        let mut head = [0; 8];
        reader.seek(SeekFrom::Start(0))?;
        reader.read_exact(&mut head[..4])?;
        // Sizes of the count of entries, of an entry, and of what precedes the value in it.
        let (count, entry, before) = if number(&head[2..4]) == 43 { (8, 20, 12) } else { (2, 12, 8) };
        reader.seek(SeekFrom::Start(directory.0))?;
        reader.read_exact(&mut head[..count])?;
        for k in 0..number(&head[..count]) {
            let start = directory.0 + count as u64 + k * entry;
            reader.seek(SeekFrom::Start(start))?;
            reader.read_exact(&mut head[..4])?;
            let tag = number(&head[..2]);
            let Some((_, value)) = told.iter().find(|(told, _)| u64::from(told.to_u16()) == tag) else {
                continue;
            };
            // Numbers of one, two, four or eight bytes.
            let size = match number(&head[2..4]) {
                1 => 1,
                4 => 4,
                16 => 8,
                _ => 2,
            };
            for byte in 0..size {
                let place = if is_little { byte } else { size - 1 - byte };
                reader.bytes.push((start + before + place, (value >> (8 * byte)) as u8));
            }
        }
        Ok(())
    }

    /// Width and height, px.
    pub(super) fn size(&mut self) -> TiffResult<(u32, u32)> {
        let (width, height) = self.decoder.dimensions()?;
        Ok((self.packed.map_or(width, |(_, width)| width), height))
    }

    /// Whether any program reads the image as its counts: gray of 8 or 16 bit, not packed, inverted or with a
    /// palette.
    pub(super) fn is_plain(&mut self) -> bool {
        let numbers = self.numbers();
        self.photometric == Some(BLACK_IS_ZERO) && matches!(numbers, Ok(Numbers::Unsigned(8 | 16)))
    }

    /// The type of the numbers. Errors: what the image holds instead of gray numbers.
    pub(super) fn numbers(&mut self) -> Result<Numbers, String> {
        let failed = |e: TiffError| told(&e);
        let bits = match self.decoder.colortype().map_err(failed)? {
            ColorType::Gray(bits) => self.packed.map_or(bits, |(packed, _)| packed),
            color => return Err(format!("{color:?}")),
        };
        if self.photometric == Some(PALETTE) {
            let map = self.decoder.find_tag_unsigned_vec::<u16>(Tag::ColorMap).map_err(failed)?;
            let map = map.unwrap_or_default();
            let (red, rest) = map.split_at(map.len() / 3);
            if !rest.chunks(red.len().max(1)).all(|color| color == red) {
                return Err("a palette of colors".to_owned());
            }
            if !red.is_sorted() || red.is_empty() {
                return Err("a palette whose grays do not rise".to_owned());
            }
        }
        // 1: unsigned, 2: signed, 3: floating-point numbers.
        let format = self.decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).map_err(failed)?;
        match format.and_then(|all| all.first().copied()).unwrap_or(1) {
            2 => Ok(Numbers::Signed(bits)),
            3 => Ok(Numbers::Float(bits)),
            _ => Ok(Numbers::Unsigned(bits)),
        }
    }

    /// The numbers of the image, row by row.
    pub(super) fn counts(&mut self) -> Result<Counts, String> {
        let counts = match (self.numbers()?, self.packed) {
            (Numbers::Unsigned(_), Some(packed)) => Counts::Whole(self.unpacked(packed)?),
            _ => match self.decoder.read_image().map_err(|e| told(&e))? {
                DecodingResult::U8(counts) => Counts::Whole(counts.into_iter().map(u16::from).collect()),
                DecodingResult::U16(counts) => Counts::Whole(counts),
                DecodingResult::F32(counts) => Counts::Unrounded(counts),
                DecodingResult::F64(counts) => {
                    Counts::Unrounded(counts.into_iter().map(|c| c as f32).collect())
                }
                _ => {
                    return Err("expected gray counts of 8 or 16 bit, or floating-point numbers".to_owned());
                }
            },
        };
        let (width, height) = self.size().map_err(|e| told(&e))?;
        let pixels = width as usize * height as usize;
        if counts.len() != pixels {
            return Err(format!("{} values: expected {pixels}, one per pixel", counts.len()));
        }
        Ok(counts)
    }

    /// Numbers that are packed without gaps, the highest bit first; rows begin with a byte.
    fn unpacked(&mut self, (bits, width): (u8, u32)) -> Result<Vec<u16>, String> {
        let failed = |e: TiffError| told(&e);
        for (tag, what) in
            [(Tag::Predictor, "with a predictor"), (Tag::FillOrder, "with the lowest bit first")]
        {
            if self.decoder.find_tag_unsigned::<u16>(tag).map_err(failed)?.unwrap_or(1) != 1 {
                return Err(format!("{bits} bit {what}: expected none of this kind"));
            }
        }
        let DecodingResult::U8(bytes) = self.decoder.read_image().map_err(failed)? else {
            return Err(format!("{bits} bit: expected packed numbers"));
        };
        let unpack = |row: &[u8]| -> Vec<u16> {
            let (mut rest, mut have, mut counts) = (0u32, 0, Vec::with_capacity(width as usize));
            for byte in row {
                (rest, have) = (rest << 8 | u32::from(*byte), have + 8);
                if have >= bits && counts.len() < width as usize {
                    have -= bits;
                    counts.push((rest >> have) as u16);
                    rest &= (1 << have) - 1;
                }
            }
            counts
        };
        let row = (width as usize * usize::from(bits)).div_ceil(8).max(1);
        Ok(bytes.chunks(row).flat_map(unpack).collect())
    }

    /// The description of the image: UTF-8, or Latin-1, as older programs write it.
    pub(super) fn description(&mut self) -> TiffResult<Option<String>> {
        let mut value = ValueBuffer::empty(Type::ASCII);
        if self.decoder.image_ifd().find_tag_buf(Tag::ImageDescription, &mut value)?.is_none() {
            return Ok(None);
        }
        let bytes = value.as_bytes().split(|byte| *byte == 0).next().unwrap_or_default();
        let text = std::str::from_utf8(bytes).map(str::to_owned);
        Ok(Some(text.unwrap_or_else(|_| bytes.iter().map(|byte| char::from(*byte)).collect())))
    }

    /// A private tag, such as a vendor writes.
    pub(super) fn has(&mut self, tag: u16) -> bool {
        self.decoder.image_ifd().find_entry(Tag::Unknown(tag)).is_some()
    }

    /// Where the data of the image begin, if they are uncompressed and in one piece of this length.
    pub(super) fn raw_data(&mut self, bytes: u64) -> TiffResult<Option<u64>> {
        let mut numbers = |tag: Tag| self.decoder.find_tag_unsigned_vec::<u64>(tag);
        let compression = numbers(Tag::Compression)?.and_then(|all| all.first().copied());
        let offsets = numbers(Tag::StripOffsets)?.unwrap_or_default();
        let lengths = numbers(Tag::StripByteCounts)?.unwrap_or_default();
        let joins = |k: usize| offsets[k].checked_add(lengths[k]) == Some(offsets[k + 1]);
        let is_one = compression.is_none_or(|c| c == u64::from(CompressionMethod::None.to_u16()))
            && offsets.len() == lengths.len()
            && (0..offsets.len().saturating_sub(1)).all(joins)
            && lengths.iter().fold(0, |sum: u64, n| sum.saturating_add(*n)) == bytes;
        Ok(offsets.first().copied().filter(|_| is_one))
    }

    /// Length of the file, bytes.
    pub(super) fn length(&mut self) -> std::io::Result<u64> {
        self.decoder.inner().seek(SeekFrom::End(0))
    }

    /// Counts of `bits` bit that lie somewhere in the file in its byte order.
    pub(super) fn raw_counts(&mut self, offset: u64, pixels: usize, bits: u8) -> TiffResult<Vec<u16>> {
        let is_little = self.decoder.byte_order() == ByteOrder::LittleEndian;
        let mut bytes = vec![0; pixels * usize::from(bits / 8)];
        self.decoder.inner().seek(SeekFrom::Start(offset))?;
        self.decoder.inner().read_exact(&mut bytes)?;
        let word = |pair: &[u8]| match (pair, is_little) {
            ([a, b], true) => u16::from_le_bytes([*a, *b]),
            ([a, b], false) => u16::from_be_bytes([*a, *b]),
            _ => 0,
        };
        Ok(if bits == 8 {
            bytes.into_iter().map(u16::from).collect()
        } else {
            bytes.chunks_exact(2).map(word).collect()
        })
    }
}

/// What is wrong with a file.
pub(super) fn told(e: &TiffError) -> String {
    match e {
        TiffError::IoError(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            "it ends before its data do; is it truncated?".to_owned()
        }
        _ => e.to_string(),
    }
}

/// A file of which some bytes, by their places, are read as others.
struct Patched<R> {
    inner: R,
    at: u64,
    bytes: Vec<(u64, u8)>,
}

impl<R: Read> Read for Patched<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.inner.read(buffer)?;
        for (place, byte) in &self.bytes {
            if let Some(k) = place.checked_sub(self.at).filter(|k| *k < n as u64) {
                buffer[k as usize] = *byte;
            }
        }
        self.at += n as u64;
        Ok(n)
    }
}

impl<R: Seek> Seek for Patched<R> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.at = self.inner.seek(to)?;
        Ok(self.at)
    }
}
