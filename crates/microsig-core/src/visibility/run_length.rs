//! Masks as run lengths, in the compressed text of COCO (pycocotools, `rleToString`).
//!
//! Lengths of runs outside and inside the mask alternate, starting outside, down the columns of the image. In
//! the text, each length (from the fourth on, its difference from the second-to-last one) is a number with
//! five bits per character, lowest bits first; bit 5 marks that more characters follow, and 48 is added.

/// Longest text of a number: 13 characters of five bits.
const LONGEST: u32 = 13;

/// A mask.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RunLengths {
    /// Lengths of alternating runs outside and inside the mask.
    runs: Vec<usize>,
    /// The pixel after the last run.
    end: usize,
}

impl RunLengths {
    /// Adds a pixel, which comes after all others; pixels are numbered down the columns.
    pub fn push(&mut self, pixel: usize) {
        if pixel == self.end && !self.runs.is_empty() {
            if let Some(last) = self.runs.last_mut() {
                *last += 1;
            }
        } else {
            self.runs.extend([pixel - self.end, 1]);
        }
        self.end = pixel + 1;
    }

    /// The pixels of the mask.
    pub fn pixels(&self) -> impl Iterator<Item = usize> + '_ {
        let mut first = 0;
        self.runs.chunks(2).flat_map(move |pair| {
            let start = first + pair[0];
            first = start + pair.get(1).copied().unwrap_or(0);
            start..first
        })
    }

    /// The text for an image of this many pixels.
    pub fn text(&self, pixels: usize) -> String {
        let mut runs: Vec<i64> = self.runs.iter().map(|run| *run as i64).collect();
        if pixels > self.end {
            runs.push((pixels - self.end) as i64);
        }
        let mut text = String::new();
        for (k, run) in runs.iter().enumerate() {
            let mut rest = if k > 2 { run - runs[k - 2] } else { *run };
            loop {
                let low = rest & 0x1f;
                rest >>= 5;
                let more = if low & 0x10 != 0 { rest != -1 } else { rest != 0 };
                text.push(char::from((low | if more { 0x20 } else { 0 }) as u8 + 48));
                if !more {
                    break;
                }
            }
        }
        text
    }

    /// Reads a mask of an image of this many pixels; `None` if the text is invalid.
    pub fn parse(text: &str, pixels: usize) -> Option<Self> {
        let mut runs: Vec<usize> = Vec::new();
        let mut bytes = text.bytes();
        while bytes.len() > 0 {
            let (mut value, mut shift) = (0i64, 0);
            loop {
                let bits = bytes.next()?.checked_sub(48).filter(|bits| *bits < 64)?;
                value |= i64::from(bits & 0x1f) << (5 * shift);
                shift += 1;
                if bits & 0x20 == 0 {
                    if bits & 0x10 != 0 && 5 * shift < i64::BITS {
                        value |= -1 << (5 * shift);
                    }
                    break;
                }
                if shift >= LONGEST {
                    return None;
                }
            }
            if runs.len() > 2 {
                value = value.checked_add_unsigned(runs[runs.len() - 2] as u64)?;
            }
            runs.push(usize::try_from(value).ok().filter(|run| *run <= pixels)?);
        }
        let sum = runs.iter().try_fold(0usize, |sum, run| sum.checked_add(*run))?;
        // A run outside the mask at the end is implied.
        let after = if runs.len() % 2 == 1 { runs.pop()? } else { 0 };
        (sum == pixels).then_some(RunLengths { runs, end: pixels - after })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(pixels: &[usize]) -> RunLengths {
        let mut mask = RunLengths::default();
        pixels.iter().for_each(|pixel| mask.push(*pixel));
        mask
    }

    /// Texts by `mask.encode` of pycocotools 2.0.11: images of 6 x 5 and of 100 x 100 px.
    #[test]
    fn texts_are_those_of_pycocotools() {
        let ring: Vec<usize> = (0..10_000usize)
            .filter(|p| (145..400).contains(&((p / 100).abs_diff(40).pow(2) + (p % 100).abs_diff(60).pow(2))))
            .collect();
        assert_eq!(ring.len(), 804);
        let ring_text = "ZS2=e24L4M2M4M2N2O@lM0S2MUN0i1O[N0d1O^N0a10aN0^1OdN0[10gN0X10hN0X1OjN0V10jN0V10jN0V10jN0V1OlN0\
                       T11jN0V10jN0V10jN0V10jN0V11hN0X10hN0Y10eN0\\11bN0_10_N0b11\\N0e11WN0k13mM0T2`01N2N3L3N3L4L\\k3";
        for (pixels, size, text) in [
            (vec![14, 19, 20, 26], 30, ">1411ON"),
            (vec![0, 1, 2, 29], 30, "03j0N"),
            (vec![5, 5000, 9999], 10_000, "51Rl4040"),
            ((0..10_000).collect(), 10_000, "0`h9"),
            (ring, 10_000, ring_text),
        ] {
            assert_eq!(mask(&pixels).text(size), text);
            assert_eq!(RunLengths::parse(text, size), Some(mask(&pixels)));
        }
    }

    #[test]
    fn what_is_written_is_read() {
        for step in 1..40 {
            let pixels: Vec<usize> = (0..2000).filter(|p| (p * p / 7) % step < step / 2).collect();
            let mask = mask(&pixels);
            assert_eq!(mask.pixels().collect::<Vec<_>>(), pixels);
            assert_eq!(RunLengths::parse(&mask.text(2000), 2000), Some(mask));
        }
    }

    #[test]
    fn other_texts_are_refused() {
        for text in ["a", "~", "T", "00000", "\u{e9}", "oooooooooooooooooooooooo", "1"] {
            assert_eq!(RunLengths::parse(text, 30), None, "{text}");
        }
    }
}
