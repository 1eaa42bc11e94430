//! Stacks of images as the pages of one TIFF file, with their scale: as ImageJ and Fiji write it
//! (ij.io.FileSaver), or as OME-XML (schema 2016-06, openmicroscopy.org/Schemas/OME/2016-06), which
//! Bio-Formats, OMERO and napari read.
//!
//! OME-TIFF also holds stacks of more than 4 GB (BigTIFF) and depths or times in unequal steps.

use std::fmt::Write as _;
use std::io::{Seek, Write};

use ::tiff::encoder::{TiffEncoder, TiffKind};

use super::tiff::{PixelScale, StackPlane, append};
use crate::error::Error;
use crate::sensor::{Counts, Image};

/// What changes from page to page.
#[derive(Debug, Clone, PartialEq)]
pub enum StackAxis {
    /// Depth of every page, um, growing away from the lens.
    Depth(Vec<f64>),
    /// Number of pages, the time of each, s, if it is known, and the interval if all are equally far apart.
    Time {
        /// Number of pages.
        pages: usize,
        /// Time of every page, s; `None` if they are unknown.
        at_s: Option<Vec<f64>>,
        /// Interval between pages, s; `None` if there are several.
        interval_s: Option<f64>,
    },
}

impl StackAxis {
    /// Number of pages.
    pub fn pages(&self) -> usize {
        match self {
            StackAxis::Depth(depths_um) => depths_um.len(),
            StackAxis::Time { pages, .. } => *pages,
        }
    }

    /// The step between depths, um; `None` if there are several, and for times.
    pub fn step_um(&self) -> Option<f64> {
        let StackAxis::Depth(depths_um) = self else { return None };
        equal_step(depths_um)
    }
}

/// The step of equally spaced values, to a millionth of it; `None` if there are several or less than two
/// values.
pub fn equal_step(values: &[f64]) -> Option<f64> {
    let (first, last) = (values.first()?, values.last()?);
    let step = (last - first) / (values.len() - 1) as f64;
    let is_equal = |(k, value): (usize, &f64)| (first + k as f64 * step - value).abs() <= 1e-6 * step.abs();
    // Without digits that come from the division.
    let rounded = (step * 1e9).round() / 1e9;
    let step = if (rounded - step).abs() < 1e-12 * step.abs().max(1e-3) { rounded } else { step };
    (step != 0.0 && step.is_finite() && values.iter().enumerate().all(is_equal)).then_some(step)
}

/// The program that a stack is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StackFormat {
    /// ImageJ's description.
    ImageJ,
    /// OME-XML.
    Ome,
}

/// A stack without its images.
#[derive(Debug, Clone, PartialEq)]
pub struct Stack {
    /// Name of the image in OME-XML.
    pub name: String,
    /// Pixel size in object space, um.
    pub um_per_px: f64,
    /// What changes from page to page.
    pub axis: StackAxis,
}

/// Bytes of pixels up to which a file is a plain TIFF file, whose offsets have 32 bit.
const PLAIN: u64 = u32::MAX as u64 - (64 << 20);

impl Stack {
    /// Writes a stack; `page` gives its images, which have the size and type of the first. `name` is the name
    /// of the output in errors. Errors: as for `page`; images of different sizes or types; more than 4 GB
    /// for ImageJ; writing.
    pub fn write<E: From<Error>>(
        &self,
        writer: impl Write + Seek,
        format: StackFormat,
        name: &str,
        mut page: impl FnMut(usize) -> Result<Image, E>,
    ) -> Result<(), E> {
        let pages = self.axis.pages();
        if pages == 0 {
            return Err(Error::malformed(name, "no images: expected a stack of at least one").into());
        }
        let first = page(0)?;
        let description = match format {
            StackFormat::ImageJ => self.image_j(),
            StackFormat::Ome => self.ome(&first),
        };
        let bytes =
            u64::from(bytes_per_px(&first)) * u64::from(first.width) * u64::from(first.height) * pages as u64;
        match (bytes > PLAIN, format) {
            (false, _) => {
                let encoder = TiffEncoder::new(writer).map_err(|e| failed(name, e))?;
                self.append_all(encoder, &description, name, first, page)
            }
            (true, StackFormat::Ome) => {
                let encoder = TiffEncoder::new_big(writer).map_err(|e| failed(name, e))?;
                self.append_all(encoder, &description, name, first, page)
            }
            (true, StackFormat::ImageJ) => {
                let what = format!(
                    "{bytes} bytes of pixels: expected at most 4 GB in an ImageJ stack; OME-TIFF holds more"
                );
                Err(Error::malformed(name, &what).into())
            }
        }
    }

    fn append_all<W: Write + Seek, K: TiffKind, E: From<Error>>(
        &self,
        mut encoder: TiffEncoder<W, K>,
        description: &str,
        name: &str,
        first: Image,
        mut page: impl FnMut(usize) -> Result<Image, E>,
    ) -> Result<(), E> {
        let scale = PixelScale::um_per_px(self.um_per_px);
        let kind = |image: &Image| (image.width, image.height, bytes_per_px(image));
        let (expected, mut image) = (kind(&first), first);
        for k in 0..self.axis.pages() {
            if k > 0 {
                image = page(k)?;
            }
            if kind(&image) != expected {
                let ([a, b, c], [d, e, f]) = (<[u32; 3]>::from(kind(&image)), <[u32; 3]>::from(expected));
                let what = format!(
                    "image {k}: {a} x {b} px of {c} bytes: expected {d} x {e} px of {f} bytes, as the first"
                );
                return Err(Error::malformed(name, &what).into());
            }
            let text = (k == 0).then_some(description);
            append(&mut encoder, &image, &scale, text).map_err(|e| failed(name, e))?;
        }
        Ok(())
    }

    /// ImageJ's description. Depths that are not equally spaced and unknown times are left out.
    fn image_j(&self) -> String {
        let pages = self.axis.pages();
        let mut text = format!("ImageJ=1.11a\nimages={pages}\n");
        // Writing to a string cannot fail.
        let _ = match &self.axis {
            StackAxis::Depth(depths_um) => {
                let step = StackPlane::of(depths_um, 0).map_or_else(String::new, |first| first.image_j());
                write!(text, "slices={pages}\nunit=um\n{step}")
            }
            StackAxis::Time { interval_s, .. } => {
                let interval = interval_s.map_or_else(String::new, |s| format!("finterval={s}\n"));
                write!(text, "frames={pages}\nhyperstack=true\nunit=um\n{interval}")
            }
        };
        text
    }

    /// OME-XML, in ASCII.
    fn ome(&self, first: &Image) -> String {
        let (pages, um_per_px) = (self.axis.pages(), self.um_per_px);
        let kind = match (&first.counts, bytes_per_px(first)) {
            (Counts::Unrounded(_), _) => "float",
            (_, 1) => "uint8",
            _ => "uint16",
        };
        let (z, t) = if matches!(self.axis, StackAxis::Depth(_)) { (pages, 1) } else { (1, pages) };
        let scale = match &self.axis {
            StackAxis::Depth(_) => self
                .axis
                .step_um()
                .map_or_else(String::new, |step| format!(" PhysicalSizeZ=\"{}\"", step.abs())),
            StackAxis::Time { interval_s, .. } => {
                interval_s.map_or_else(String::new, |s| format!(" TimeIncrement=\"{s}\""))
            }
        };
        let big = cfg!(target_endian = "big");
        let mut planes = String::new();
        for k in 0..pages {
            // Writing to a string cannot fail. Positions have no unit of length by default.
            let _ = match &self.axis {
                StackAxis::Depth(depths_um) => {
                    let at = depths_um[k];
                    write!(
                        planes,
                        "<Plane TheZ=\"{k}\" TheT=\"0\" TheC=\"0\" PositionZ=\"{at}\" PositionZUnit=\"&#181;m\"/>"
                    )
                }
                StackAxis::Time { at_s: Some(at_s), .. } => {
                    let at = at_s[k];
                    write!(planes, "<Plane TheZ=\"0\" TheT=\"{k}\" TheC=\"0\" DeltaT=\"{at}\"/>")
                }
                StackAxis::Time { .. } => Ok(()),
            };
        }
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\
             <OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
             xsi:schemaLocation=\"http://www.openmicroscopy.org/Schemas/OME/2016-06 \
             http://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd\" Creator=\"microsig\">\
             <Image ID=\"Image:0\" Name=\"{}\">\
             <Pixels ID=\"Pixels:0\" DimensionOrder=\"XYZTC\" Type=\"{kind}\" SignificantBits=\"{}\" BigEndian=\"{big}\" \
             SizeX=\"{}\" SizeY=\"{}\" SizeZ=\"{z}\" SizeC=\"1\" SizeT=\"{t}\" \
             PhysicalSizeX=\"{um_per_px}\" PhysicalSizeY=\"{um_per_px}\"{scale}>\
             <Channel ID=\"Channel:0:0\" SamplesPerPixel=\"1\"/><TiffData IFD=\"0\" PlaneCount=\"{pages}\"/>{planes}</Pixels></Image></OME>",
            ascii(&self.name),
            first.bits,
            first.width,
            first.height,
        )
    }
}

/// Text for an attribute of XML, in ASCII.
fn ascii(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' | '<' | '>' | '"' | '\'' => out += &format!("&#{};", u32::from(c)),
            ' '..='~' => out.push(c),
            c if c.is_control() => out.push(' '),
            c => out += &format!("&#{};", u32::from(c)),
        }
    }
    out
}

fn bytes_per_px(image: &Image) -> u32 {
    match &image.counts {
        Counts::Unrounded(_) => 4,
        Counts::Whole(_) => 1 + u32::from(image.bits > 8),
    }
}

fn failed(name: &str, error: ::tiff::TiffError) -> Error {
    Error::io(name, std::io::Error::other(error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::pages::{PageSize, Pages};
    use std::io::Cursor;

    fn image(k: usize) -> Image {
        Image { width: 2, height: 1, bits: 12, counts: Counts::Whole(vec![k as u16, 4095]) }
    }

    fn written(axis: StackAxis, format: StackFormat) -> Pages<Cursor<Vec<u8>>> {
        let stack = Stack { name: "a < \u{b5}".to_owned(), um_per_px: 0.645, axis };
        let mut file = Cursor::new(Vec::new());
        stack.write::<Error>(&mut file, format, "a.tif", |k| Ok(image(k))).unwrap();
        file.set_position(0);
        Pages::open(file, "a.tif").unwrap()
    }

    #[test]
    fn pages_order_and_step_are_read_back() {
        let times = StackAxis::Time { pages: 3, at_s: Some(vec![0.0, 0.1, 0.5]), interval_s: None };
        for format in [StackFormat::ImageJ, StackFormat::Ome] {
            for (axis, step) in [
                (StackAxis::Depth(vec![-1.0, 1.5, 4.0]), Some(2.5)),
                (StackAxis::Depth(vec![0.0, 1.0, 4.0]), None),
                (times.clone(), None),
            ] {
                let mut pages = written(axis.clone(), format);
                let arranged = pages.arrangement(3).unwrap().unwrap();
                assert_eq!(arranged.step_um(), Ok(step), "{format:?}");
                let sizes = if axis == times { [1, 1, 3] } else { [1, 3, 1] };
                assert_eq!(arranged.sizes, sizes, "{format:?}");
                if format == StackFormat::Ome && axis != times {
                    let at = |k| arranged.position(k).unwrap().map(|at| at.um);
                    assert_eq!(StackAxis::Depth((0..3).filter_map(at).collect()), axis);
                }
                for k in 0..3 {
                    let size = pages.size().unwrap();
                    assert_eq!(size, PageSize { width: 2, height: 1, bits: 16 });
                    assert_eq!(pages.counts(size).unwrap(), [k, 4095]);
                    assert_eq!(pages.go_on().unwrap(), k < 2);
                }
            }
        }
    }

    #[test]
    fn descriptions_hold_the_scale() {
        let depths = StackAxis::Depth(vec![-1.0, 1.5, 4.0]);
        let text = written(depths.clone(), StackFormat::ImageJ).description().unwrap().to_owned();
        assert_eq!(text, "ImageJ=1.11a\nimages=3\nslices=3\nunit=um\nspacing=2.5\nzorigin=0.4\n");
        let text = written(depths, StackFormat::Ome).description().unwrap().to_owned();
        for part in [
            "Name=\"a &#60; &#181;\"",
            "SignificantBits=\"12\"",
            "SizeZ=\"3\" SizeC=\"1\" SizeT=\"1\" PhysicalSizeX=\"0.645\" PhysicalSizeY=\"0.645\" PhysicalSizeZ=\"2.5\"",
            "<Plane TheZ=\"2\" TheT=\"0\" TheC=\"0\" PositionZ=\"4\" PositionZUnit=\"&#181;m\"/>",
        ] {
            assert!(text.contains(part), "{text}");
        }
        let times = StackAxis::Time { pages: 2, at_s: Some(vec![0.0, 0.1]), interval_s: Some(0.1) };
        assert!(
            written(times.clone(), StackFormat::ImageJ).description().unwrap().contains("finterval=0.1\n")
        );
        let text = written(times, StackFormat::Ome).description().unwrap().to_owned();
        assert!(
            text.contains("TimeIncrement=\"0.1\"") && text.contains("TheT=\"1\" TheC=\"0\" DeltaT=\"0.1\"")
        );
    }

    #[test]
    fn images_of_a_stack_are_alike() {
        let axis = StackAxis::Time { pages: 2, at_s: None, interval_s: None };
        let stack = Stack { name: String::new(), um_per_px: 1.0, axis };
        let page = |k| Ok::<_, Error>(Image { bits: 12 - 4 * k as u8, ..image(k) });
        let error = stack.write(Cursor::new(Vec::new()), StackFormat::Ome, "a.tif", page).unwrap_err();
        assert!(
            error.to_string().contains("image 1: 2 x 1 px of 1 bytes: expected 2 x 1 px of 2 bytes"),
            "{error}"
        );
    }

    #[test]
    fn equal_steps_are_recognized() {
        assert_eq!(equal_step(&[0.0, 0.1, 0.2, 0.30000000000000004]), Some(0.1));
        assert_eq!(equal_step(&[4.0, 2.0, 0.0]), Some(-2.0));
        for values in [vec![], vec![1.0], vec![1.0, 1.0], vec![0.0, 1.0, 2.1]] {
            assert_eq!(equal_step(&values), None, "{values:?}");
        }
    }
}
