//! The frames of a dataset: their times, names and links.

use microsig_core::problem::Problems;
use microsig_core::random::normal;
use microsig_core::stream::{Purpose, Streams};

use super::timing::{FourPulse, PairSeeding, Pairs, Sequence, Timing};

/// Frame times that deviate by more than this many standard deviations are redrawn.
const MAX_JITTER: f64 = 4.0;

/// The frames of a dataset, grouped into recordings; each recording has its own particles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recordings {
    timing: Timing,
}

impl Recordings {
    /// Checks a timing and returns its frames.
    pub(super) fn checked(timing: Timing, problems: &mut Problems) -> Self {
        let key = |name: &str| format!("timing.{}.{name}", timing.mode());
        let recordings = Recordings { timing };
        if let Timing::Pairs(Pairs { seeding: PairSeeding::Continuing, dt_s, interval_s, .. }) = timing
            && interval_s < dt_s * (1.0 + 1e-12)
        {
            let allowed = format!("a time > dt_s = {dt_s} s, because all pairs show the same particles");
            problems.value(&key("interval_s"), interval_s, &allowed);
        }
        let (exposure_s, flashes, jitter_s) = timing.exposure();
        let shortest = recordings.shortest_dt_s();
        if shortest <= 0.0 {
            return recordings;
        }
        let span = exposure_s + flashes.map_or(0.0, |f| f64::from(f.count.max(1) - 1) * f.spacing_s);
        if span > shortest {
            let allowed = format!("exposure and flashes within {shortest} s, the time to the next frame");
            problems.value(&key("exposure_s"), format!("{exposure_s} ({span} s in total)"), &allowed);
        }
        // Frames must stay in order.
        if jitter_s > 0.1 * shortest {
            let allowed = format!("0 to a tenth of the time between frames, {} s", 0.1 * shortest);
            problems.value(&key("jitter_s"), jitter_s, &allowed);
        }
        recordings
    }

    /// The timing as given in the scenario.
    pub fn timing(&self) -> &Timing {
        &self.timing
    }

    /// The longest time between consecutive frames of a recording, and the time from its first to its last
    /// frame, s.
    pub fn spans_s(&self) -> (f64, f64) {
        match self.timing {
            Timing::Pairs(Pairs { seeding: PairSeeding::Continuing, count, dt_s, interval_s, .. }) => {
                (dt_s.max(interval_s - dt_s), f64::from(count.max(1) - 1) * interval_s + dt_s)
            }
            Timing::Pairs(p) => (p.dt_s, p.dt_s),
            Timing::Sequence(s) => (s.dt_s, f64::from(s.frames.max(1) - 1) * s.dt_s),
            Timing::FourPulse(f) => (f.dt_s.max(f.gap_s), 2.0 * f.dt_s + f.gap_s),
        }
    }

    /// Number of recordings.
    pub fn count(&self) -> u32 {
        match self.timing {
            Timing::Pairs(Pairs { seeding: PairSeeding::Continuing, .. }) | Timing::Sequence(_) => 1,
            Timing::Pairs(p) => p.count,
            Timing::FourPulse(f) => f.count,
        }
    }

    /// Number of frames in each recording.
    pub fn frames_each(&self) -> u32 {
        match self.timing {
            Timing::Pairs(Pairs { seeding: PairSeeding::Continuing, count, .. }) => 2 * count,
            Timing::Pairs(_) => 2,
            Timing::Sequence(s) => s.frames,
            Timing::FourPulse(_) => 4,
        }
    }

    /// Total number of frames.
    pub fn frames(&self) -> u32 {
        self.count() * self.frames_each()
    }

    /// Nominal time between frames, s: in a pair from A to B, in a burst from the first frame to the second.
    pub fn dt_s(&self) -> f64 {
        match self.timing {
            Timing::Pairs(Pairs { dt_s, .. })
            | Timing::Sequence(Sequence { dt_s, .. })
            | Timing::FourPulse(FourPulse { dt_s, .. }) => dt_s,
        }
    }

    /// Whether frames form pairs, A and B.
    pub fn are_pairs(&self) -> bool {
        matches!(self.timing, Timing::Pairs(_))
    }

    /// Pair of a frame and its role in it, if frames are pairs.
    pub fn pair(&self, frame: u32) -> Option<(u32, char)> {
        self.are_pairs().then(|| (frame / 2, self.role(frame).unwrap_or('a')))
    }

    /// Role of a frame: a or b in a pair, a to d in a burst of four.
    pub fn role(&self, frame: u32) -> Option<char> {
        let of = match self.timing {
            Timing::Pairs(_) => 2,
            Timing::Sequence(_) => return None,
            Timing::FourPulse(_) => 4,
        };
        Some(['a', 'b', 'c', 'd'][(frame % of) as usize])
    }

    /// Names of the files of a frame, without extension.
    pub fn stem(&self, frame: u32) -> String {
        match (self.timing, self.role(frame)) {
            (Timing::Pairs(_), Some(role)) => format!("pair_{:05}_{role}", frame / 2),
            (Timing::FourPulse(_), Some(role)) => format!("burst_{:05}_{role}", frame / 4),
            _ => format!("frame_{frame:05}"),
        }
    }

    /// Number of the pair that a frame forms with the previous one, if the truth links the two: A and B of a
    /// pair; otherwise consecutive frames of a recording, numbered by the first of them.
    pub fn link_to(&self, frame: u32) -> Option<u32> {
        if frame.is_multiple_of(self.frames_each()) {
            return None;
        }
        match self.pair(frame) {
            Some((pair, role)) => (role == 'b').then_some(pair),
            None => Some(frame - 1),
        }
    }

    /// Times of the frames of a recording, s: the middles of their exposures.
    pub fn times_s(&self, recording: u32, streams: Streams) -> Vec<f64> {
        let first = recording * self.frames_each();
        (first..first + self.frames_each()).map(|frame| self.time_s(frame, streams)).collect()
    }

    /// Time at which one more frame would be recorded, s; `None` if recordings have a fixed length.
    pub fn next_s(&self, streams: Streams) -> Option<f64> {
        self.is_open_ended().then(|| self.time_s(self.frames(), streams))
    }

    /// Whether a recording could have more frames: not if it is a pair or a burst.
    fn is_open_ended(&self) -> bool {
        match self.timing {
            Timing::Pairs(p) => p.seeding == PairSeeding::Continuing,
            Timing::Sequence(_) => true,
            Timing::FourPulse(_) => false,
        }
    }

    /// Time of a frame, s: the middle of its exposure.
    pub fn time_s(&self, frame: u32, streams: Streams) -> f64 {
        self.nominal_s(frame) + self.jitter_s(frame, streams)
    }

    /// Nominal time of a frame, s: without jitter.
    pub fn nominal_s(&self, frame: u32) -> f64 {
        match self.timing {
            Timing::Pairs(p) => f64::from(frame / 2) * p.interval_s + f64::from(frame % 2) * p.dt_s,
            Timing::Sequence(s) => f64::from(frame) * s.dt_s,
            Timing::FourPulse(f) => {
                let within = [0.0, f.dt_s, f.dt_s + f.gap_s, 2.0 * f.dt_s + f.gap_s];
                f64::from(frame / 4) * f.interval_s + within[(frame % 4) as usize]
            }
        }
    }

    fn jitter_s(&self, frame: u32, streams: Streams) -> f64 {
        let (_, _, sd) = self.timing.exposure();
        if sd == 0.0 {
            return 0.0;
        }
        let mut stream = streams.stream(Purpose::Timing, frame, 0);
        loop {
            let deviation = normal(&mut stream);
            if deviation.abs() <= MAX_JITTER {
                break sd * deviation;
            }
        }
    }

    /// The shortest nominal time between two frames of a recording, s.
    fn shortest_dt_s(&self) -> f64 {
        match self.timing {
            Timing::Pairs(p) if p.seeding == PairSeeding::Continuing && p.count > 1 => {
                p.dt_s.min(p.interval_s - p.dt_s)
            }
            Timing::Pairs(p) => p.dt_s,
            Timing::Sequence(s) => s.dt_s,
            Timing::FourPulse(f) => f.dt_s.min(f.gap_s),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use super::*;

    fn recordings(text: &str) -> Result<Recordings, String> {
        let text = format!("(name: \"t\", motion: flow(field: poiseuille()), timing: {text})");
        let timing = parse(&text, "t.ron").map_err(|e| e.to_string())?.timing;
        let mut problems = Problems::default();
        let recordings = Recordings::checked(timing, &mut problems);
        timing.shutter(0.645, &mut problems);
        problems.finish(storage::Error::Problems).map(|()| recordings).map_err(|e| e.to_string())
    }

    #[test]
    fn every_mode_has_its_times_stems_and_links() {
        let of = |text, recording: u32| {
            let r = recordings(text).unwrap();
            let frames = recording * r.frames_each()..(recording + 1) * r.frames_each();
            let stems: Vec<String> = frames.clone().map(|f| r.stem(f)).collect();
            let links: Vec<Option<u32>> = frames.map(|f| r.link_to(f)).collect();
            (r.times_s(recording, Streams::new(7)), stems, links)
        };
        assert_eq!(
            of("pairs(count: 5, dt_s: 0.5, interval_s: 2)", 3),
            (vec![6.0, 6.5], vec!["pair_00003_a".into(), "pair_00003_b".into()], vec![None, Some(3)])
        );
        let (times, stems, links) = of("pairs(count: 2, dt_s: 0.5, interval_s: 2, seeding: continuing)", 0);
        assert_eq!(times, [0.0, 0.5, 2.0, 2.5]);
        assert_eq!(stems[2], "pair_00001_a");
        // Links go from A to B only, although all pairs show the same particles.
        assert_eq!(links, [None, Some(0), None, Some(1)]);
        let (times, stems, links) = of("four_pulse(count: 3, dt_s: 0.5, gap_s: 2, interval_s: 10)", 1);
        assert_eq!(times, [10.0, 10.5, 12.5, 13.0]);
        assert_eq!(stems, ["burst_00001_a", "burst_00001_b", "burst_00001_c", "burst_00001_d"]);
        assert_eq!(links, [None, Some(4), Some(5), Some(6)]);
        let (times, stems, links) = of("sequence(frames: 3, dt_s: 0.25)", 0);
        assert_eq!(times, [0.0, 0.25, 0.5]);
        assert_eq!(stems[2], "frame_00002");
        assert_eq!(links, [None, Some(0), Some(1)]);
    }

    #[test]
    fn jitter_moves_frames_by_its_deviation_and_never_past_each_other() {
        let steady = recordings("sequence(frames: 4000, dt_s: 1)").unwrap().times_s(0, Streams::new(7));
        let uneven =
            recordings("sequence(frames: 4000, dt_s: 1, jitter_s: 0.1)").unwrap().times_s(0, Streams::new(7));
        let squares: f64 = steady.iter().zip(&uneven).map(|(a, b)| (a - b) * (a - b)).sum();
        // Standard error of a deviation of 0.1 from 4000 values: 0.0011.
        assert!(((squares / 4000.0).sqrt() - 0.1).abs() < 0.0045);
        assert!(uneven.windows(2).all(|w| w[0] < w[1]));
        assert_eq!(
            uneven[..100],
            recordings("sequence(frames: 100, dt_s: 1, jitter_s: 0.1)").unwrap().times_s(0, Streams::new(7))
        );
    }

    #[test]
    fn impossible_times_are_refused() {
        for (text, expected) in [
            ("pairs(count: 0)", "timing.pairs.count = 0: expected a whole number, 1 to 5e6"),
            ("pairs(count: 2, seeding: continuing)", "timing.pairs.interval_s = 0: expected a time > dt_s"),
            ("pairs(count: 2, dt_s: NaN)", "timing.pairs.dt_s = NaN"),
            (
                "four_pulse(count: 2, gap_s: 0)",
                "timing.four_pulse.gap_s = 0: expected a number > 0 and <= 1e9 s",
            ),
            ("sequence(frames: 2, exposure_s: 0.006)", "timing.sequence.exposure_s = 0.006"),
            (
                "sequence(frames: 2, exposure_s: -1)",
                "timing.sequence.exposure_s = -1: expected a number, 0 to 1e9 s",
            ),
            (
                "sequence(frames: 2, jitter_s: 0.001)",
                "timing.sequence.jitter_s = 0.001: expected 0 to a tenth",
            ),
            (
                "sequence(frames: 2, flashes: (count: 0, spacing_s: 1))",
                "flashes.count = 0: expected a whole number, 1 to 100",
            ),
            (
                "sequence(frames: 2, exposure_s: 0.001, flashes: (count: 2, spacing_s: 0.0005))",
                "flashes do not overlap",
            ),
        ] {
            let message = recordings(text).unwrap_err();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }
}
