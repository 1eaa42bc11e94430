//! The outline of a particle image: the pixels that belong to it, for detectors.

use crate::sensor::Sensor;

use super::noise_free::Patch;
use super::overlap::TotalLight;
use super::run_length::RunLengths;

/// The pixels in which a particle's own noise-free light exceeds a fraction of its peak and the standard
/// deviation of the background.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Left column and top row of the bounding box, from 0.
    pub corner: (usize, usize),
    /// Width and height of the bounding box, px.
    pub size: (usize, usize),
    /// Number of pixels.
    pub area: usize,
    /// Fraction of the pixels in which the light of all other particles exceeds its own.
    pub hidden: f64,
    /// The pixels.
    pub mask: RunLengths,
}

impl Outline {
    /// The outline of a patch; `total`: light of all particles on a sensor of this width and height, px.
    /// `None` if nothing stands out from the noise.
    pub(super) fn of(
        patch: &Patch,
        share: f64,
        total: &TotalLight,
        (width, height): (usize, usize),
        sensor: &Sensor,
    ) -> Option<Self> {
        let (mut low, mut high) = ((usize::MAX, usize::MAX), (0, 0));
        let (mut area, mut hidden) = (0, 0);
        let mut mask = RunLengths::default();
        for (x, y, light) in patch.belonging(share, sensor, width) {
            low = (low.0.min(x), low.1.min(y));
            high = (high.0.max(x), high.1.max(y));
            area += 1;
            hidden += usize::from(total.from(y * width + x)[0] - light > light);
            mask.push(x * height + y);
        }
        (area > 0).then(|| Outline {
            corner: low,
            size: (high.0 - low.0 + 1, high.1 - low.1 + 1),
            area,
            hidden: hidden as f64 / area as f64,
            mask,
        })
    }
}

impl Patch {
    /// The pixels that belong to the particle image, column by column like COCO's masks: column and row on a
    /// sensor of this width (px), from 0, and light. They exceed a fraction of the peak of the image and
    /// stand out from the noise.
    pub fn belonging<'a>(
        &'a self,
        share: f64,
        sensor: &'a Sensor,
        width: usize,
    ) -> impl Iterator<Item = (usize, usize, f64)> + 'a {
        let least = share * self.values.iter().copied().fold(0.0, f64::max);
        let rows = self.values.len() / self.width.max(1);
        let all = (0..self.width).flat_map(move |column| (0..rows).map(move |row| (column, row)));
        all.filter_map(move |(column, row)| {
            let light = self.values[row * self.width + column];
            if light <= least {
                return None;
            }
            let (x, y) = (self.corner.0 + column, self.corner.1 + row);
            let response = sensor.response(y * width + x);
            // Less than half a count is rounded to zero.
            let stands_out = response.slope * light > response.background_noise.max(0.5);
            stands_out.then_some((x, y, light))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Settings;

    #[test]
    fn an_outline_ends_at_the_share_of_the_peak_and_in_the_noise() {
        let settings = Settings { gain: 1.0, background_noise: 4.0, ..Settings::setting1() };
        let sensor = Sensor::new(&settings);
        let patch = Patch { corner: (2, 1), width: 3, values: vec![1.0, 30.0, 5.0, 50.0, 100.0, 11.0] };
        let mut buffer = Vec::new();
        let mut total = TotalLight::dark(8, 0..6, &mut buffer);
        let others = Patch { corner: (3, 1), width: 1, values: vec![31.0, 99.0] };
        total.add(&[patch.clone(), others]);
        let outline = Outline::of(&patch, 0.1, &total, (8, 6), &sensor).unwrap();
        assert_eq!((outline.corner, outline.size, outline.area), ((2, 1), (3, 2), 4));
        assert_eq!(outline.hidden, 0.25);
        // Columns 2, 3, 4 of 6 rows: pixels 14; 19, 20; 26.
        assert_eq!(outline.mask.pixels().collect::<Vec<_>>(), [14, 19, 20, 26]);
        let outline = Outline::of(&patch, 0.01, &total, (8, 6), &sensor).unwrap();
        assert_eq!(outline.area, 5, "the pixel of 1 count is within the noise");
        assert_eq!(Outline::of(&Patch::default(), 0.1, &total, (8, 6), &sensor), None);
    }
}
