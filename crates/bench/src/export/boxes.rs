//! Export of boxes and masks to the formats of object detectors.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use microsig_core::formats::tiff::{self, PixelScale};
use microsig_core::sensor::{Counts, Image};
use microsig_core::visibility::RunLengths;
use serde_json::{Value, json};

use super::ExportFormat;
use arena::package::Package;
use storage::dataset::{BoxRow, DatasetPlace, FrameRow, Row, read_rows};
use storage::error::{Error, Result};

#[derive(Debug)]
pub(super) struct Boxes {
    name: String,
    /// Width and height of the images, px.
    size: (u32, u32),
    um_per_px: f64,
    /// Path of every image, and its boxes in the order of the table.
    frames: BTreeMap<u32, (String, Vec<BoxRow>)>,
}

impl Boxes {
    pub(super) fn read(dataset: &DatasetPlace) -> Result<Self> {
        let (facts, path) = (dataset.facts()?, dataset.shown(BoxRow::PATH));
        let missing =
            || Error::input(format!("{path}: missing; generate the dataset with truth: (boxes: true)"));
        let (images, rows) = match dataset {
            DatasetPlace::Memory(made) => (made.frames(), made.boxes().ok_or_else(missing)?),
            DatasetPlace::Folder(folder) => {
                facts.needs_truth(folder)?;
                if !folder.join(BoxRow::PATH).exists() {
                    return Err(missing());
                }
                let needed = BoxRow::COLUMNS.iter().map(|column| column.name).collect::<Vec<_>>();
                (read_rows::<FrameRow>(folder, &["frame", "image"])?, read_rows::<BoxRow>(folder, &needed)?)
            }
        };
        let (width, height) = facts.sensor_px.ok_or_else(|| {
            Error::input(format!("{}: the manifest lacks the size of the images", facts.name))
        })?;
        let mut frames: BTreeMap<u32, (String, Vec<BoxRow>)> =
            images.into_iter().map(|row| (row.frame, (row.image, Vec::new()))).collect();
        for row in rows {
            let frame = row.frame;
            let (_, boxes) = frames
                .get_mut(&frame)
                .ok_or_else(|| Error::input(format!("{path}: frame {frame} is not in {}", FrameRow::PATH)))?;
            boxes.push(row);
        }
        let um_per_px = facts.um_per_px.unwrap_or(1.0);
        Ok(Boxes { name: facts.name, size: (width as u32, height as u32), um_per_px, frames })
    }

    pub(super) fn len(&self) -> usize {
        self.frames.values().map(|(_, boxes)| boxes.len()).sum()
    }

    /// The contents of the file.
    pub(super) fn write(&self, format: ExportFormat) -> Result<Vec<u8>> {
        match format {
            ExportFormat::Yolo => self.archive(Self::yolo),
            ExportFormat::Masks => self.archive(Self::labels),
            _ => Ok(self.coco().to_string().into_bytes()),
        }
    }

    fn classes(&self) -> u32 {
        let all = self.frames.values().flat_map(|(_, boxes)| boxes);
        all.map(|one| one.class).max().unwrap_or(0) + 1
    }

    /// COCO's annotations of instances; particles whose centers are off the sensor are crowds, which
    /// are not scored.
    fn coco(&self) -> Value {
        let (width, height) = self.size;
        let images = self.frames.iter().map(
            |(frame, (image, _))| json!({"id": frame, "file_name": image, "width": width, "height": height}),
        );
        let all =
            self.frames.iter().flat_map(|(frame, (_, boxes))| boxes.iter().map(move |one| (frame, one)));
        // Numbers start at 1, because pycocotools treats 0 as no match.
        let annotations = all.enumerate().map(|(k, (frame, one))| {
            json!({
                "id": k + 1, "image_id": frame, "category_id": one.class, "bbox": one.rectangle(), "area": f64::from(one.area_px),
                "iscrowd": u8::from(!one.visible), "segmentation": {"size": [height, width], "counts": one.mask},
                "track": one.track, "z_um": one.z_um, "hidden": one.hidden,
            })
        });
        let categories = (0..self.classes()).map(|k| json!({"id": k, "name": format!("particle size {k}")}));
        json!({
            "info": {"description": self.name},
            "images": images.collect::<Vec<_>>(),
            "categories": categories.collect::<Vec<_>>(),
            "annotations": annotations.collect::<Vec<_>>(),
        })
    }

    /// YOLO's text of a frame, for visible particles: class, center, width and height as fractions of the
    /// image.
    fn yolo(&self, stem: &str, boxes: &[BoxRow]) -> Result<(String, Vec<u8>)> {
        let (width, height) = (f64::from(self.size.0), f64::from(self.size.1));
        let line = |one: &BoxRow| {
            let [x, y, w, h] = one.rectangle();
            let [x, y] = [(x + 0.5 * w) / width, (y + 0.5 * h) / height];
            format!("{} {x} {y} {} {}\n", one.class, w / width, h / height)
        };
        let text: String = boxes.iter().filter(|one| one.visible).map(line).collect();
        Ok((format!("labels/{stem}.txt"), text.into_bytes()))
    }

    /// The label image of a frame: the number of the row in the frame's part of the table, from 1. Where two
    /// particle images overlap, the smaller one is on top.
    fn labels(&self, stem: &str, boxes: &[BoxRow]) -> Result<(String, Vec<u8>)> {
        let (width, height) = self.size;
        if boxes.len() > usize::from(u16::MAX) {
            let n = boxes.len();
            return Err(Error::input(format!(
                "{stem}: {n} particles; label images hold at most {}",
                u16::MAX
            )));
        }
        let (columns, rows) = (width as usize, height as usize);
        let mut counts = vec![0u16; columns * rows];
        let mut order: Vec<usize> = (0..boxes.len()).collect();
        order.sort_by(|a, b| boxes[*b].area_px.cmp(&boxes[*a].area_px));
        for k in order {
            let mask = RunLengths::parse(&boxes[k].mask, columns * rows).ok_or_else(|| {
                Error::input(format!(
                    "{}: track {}: mask: expected COCO's run lengths of {width} x {height} px",
                    BoxRow::PATH,
                    boxes[k].track
                ))
            })?;
            for pixel in mask.pixels() {
                counts[pixel % rows * columns + pixel / rows] = (k + 1) as u16;
            }
        }
        let image = Image { width, height, bits: 16, counts: Counts::Whole(counts) };
        let mut file = Cursor::new(Vec::new());
        tiff::write(&mut file, &image, &PixelScale::um_per_px(self.um_per_px), stem)?;
        Ok((format!("masks/{stem}.tif"), file.into_inner()))
    }

    /// A zip archive with a file for each frame, named like its image.
    fn archive(&self, of: impl Fn(&Self, &str, &[BoxRow]) -> Result<(String, Vec<u8>)>) -> Result<Vec<u8>> {
        let mut package = Package::default();
        for (image, boxes) in self.frames.values() {
            let stem = Path::new(image).file_stem().unwrap_or_default().to_string_lossy();
            let (path, bytes) = of(self, &stem, boxes)?;
            package.write(&path, bytes);
        }
        package.zipped(&self.name)
    }
}
