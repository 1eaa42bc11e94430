//! Export of particles to the formats of tracking programs.

use std::fmt::Write;

use maud::Render;

use super::ExportFormat;
use scoring::evaluate::truth::TrueParticles;
use scoring::results::Position;
use storage::dataset::{DatasetPlace, RecordingFacts};
use storage::error::{Error, Result};

/// A true particle in one frame.
#[derive(Debug, Clone, Copy)]
struct Spot {
    frame: u32,
    track: i64,
    t_s: f64,
    at: Position,
    d_um: f64,
    /// Displacement to the next frame of its section (px, px, um); NaN in the last.
    step: [f64; 3],
}

/// The scored true particles, sorted by section and frame.
#[derive(Debug)]
pub(super) struct Spots {
    spots: Vec<Spot>,
    facts: RecordingFacts,
}

impl Spots {
    pub(super) fn read(dataset: &DatasetPlace) -> Result<Self> {
        let truth = TrueParticles::from_place(dataset)?;
        let mut spots: Vec<Spot> = (truth.rows.iter().zip(&truth.sizes).enumerate())
            .filter(|(i, _)| truth.is_scored(*i, 0.0))
            .map(|(_, (row, [d_um, _]))| Spot {
                frame: row.frame,
                track: row.track,
                t_s: truth.times_s.get(&row.frame).copied().unwrap_or(f64::NAN),
                at: row.at,
                d_um: *d_um,
                step: [f64::NAN; 3],
            })
            .collect();
        spots.sort_by_key(|s| (s.track, s.frame));
        number_runs(&mut spots, truth.facts.pairs);
        Ok(Spots { spots, facts: truth.facts })
    }

    pub(super) fn len(&self) -> usize {
        self.spots.len()
    }

    pub(super) fn tracks(&self) -> usize {
        self.runs().count()
    }

    /// The uninterrupted sections of tracks, each in the order of frames.
    fn runs(&self) -> impl Iterator<Item = &[Spot]> {
        self.spots.chunk_by(|a, b| a.track == b.track)
    }

    /// The particles sorted by frame, as most tables are.
    fn by_frame(&self) -> Vec<&Spot> {
        let mut spots: Vec<&Spot> = self.spots.iter().collect();
        spots.sort_by_key(|s| (s.frame, s.track));
        spots
    }

    /// The contents of the file.
    pub(super) fn write(&self, format: ExportFormat) -> Result<Vec<u8>> {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let written = match format {
            ExportFormat::Isbi => self.isbi(&mut text),
            ExportFormat::Trackpy => self.trackpy(&mut text),
            ExportFormat::Napari => self.napari(&mut text),
            ExportFormat::Defocustracker => {
                let range = self.facts.depth_um.filter(|(low, high)| low < high);
                let range = range
                    .ok_or_else(|| self.missing("a depth range, by which DefocusTracker normalizes Z"))?;
                self.defocustracker(&mut text, range)
            }
            ExportFormat::TrackmateSpots => {
                let um_per_px = self
                    .facts
                    .um_per_px
                    .ok_or_else(|| self.missing("um_per_px, to convert positions to TrackMate's um"))?;
                self.trackmate(&mut text, um_per_px)
            }
            _ => Ok(()),
        };
        written.map_err(|e| Error::input(e.to_string()))?;
        Ok(text.into_bytes())
    }

    fn missing(&self, what: &str) -> Error {
        Error::input(format!("{}: the manifest lacks {what}", self.facts.name))
    }

    /// The challenge's XML as read by Icy and TrackMate; its `snr` and `density` are free text.
    fn isbi(&self, out: &mut String) -> std::fmt::Result {
        // The name of a recording may have any characters.
        let name = self.facts.name.render().into_string();
        writeln!(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<root>")?;
        writeln!(out, "<TrackContestISBI2012 snr=\"unknown\" density=\"unknown\" scenario=\"{name}\">")?;
        for run in self.runs() {
            writeln!(out, "<particle>")?;
            for Spot { frame, at, .. } in run {
                let (x, y) = (at.x_px - 1.0, at.y_px - 1.0);
                writeln!(out, "<detection t=\"{frame}\" x=\"{x}\" y=\"{y}\" z=\"{}\"/>", at.z_um)?;
            }
            writeln!(out, "</particle>")?;
        }
        writeln!(out, "</TrackContestISBI2012>\n</root>")
    }

    /// The columns required by trackpy, which has no units: z stays in um.
    fn trackpy(&self, out: &mut String) -> std::fmt::Result {
        writeln!(out, "y,x,z,frame,particle")?;
        for Spot { frame, track, at, .. } in self.by_frame() {
            writeln!(out, "{},{},{},{frame},{track}", at.y_px - 1.0, at.x_px - 1.0, at.z_um)?;
        }
        Ok(())
    }

    /// Sorted by track and time, as required by napari's tracks layer.
    fn napari(&self, out: &mut String) -> std::fmt::Result {
        writeln!(out, "track_id,t,z,y,x")?;
        for Spot { frame, track, at, .. } in &self.spots {
            writeln!(out, "{track},{frame},{},{},{}", at.z_um, at.y_px - 1.0, at.x_px - 1.0)?;
        }
        Ok(())
    }

    /// DefocusTracker's dataset table: id 0 means not tracked, so ids begin at 1; cm = 1 is a perfect match.
    fn defocustracker(&self, out: &mut String, (low, high): (f64, f64)) -> std::fmt::Result {
        writeln!(out, "fr,X,Y,Z,DX,DY,DZ,id,cm")?;
        for Spot { frame, track, at, step, .. } in self.by_frame() {
            let (z, [dx, dy, dz]) = ((at.z_um - low) / (high - low), *step);
            let dz = dz / (high - low);
            writeln!(out, "{},{},{},{z},{dx},{dy},{dz},{},1", frame + 1, at.x_px, at.y_px, track + 1)?;
        }
        Ok(())
    }

    fn trackmate(&self, out: &mut String, um_per_px: f64) -> std::fmt::Result {
        out.push_str(
            "LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME,RADIUS,VISIBILITY\n\
             Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame,Radius,Visibility\n\
             Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame,R,Visibility\n\
             ,,,(quality),(micron),(micron),(micron),(sec),,(micron),\n",
        );
        for (id, Spot { frame, track, t_s, at, d_um, .. }) in self.by_frame().into_iter().enumerate() {
            let (x, y, z) = ((at.x_px - 1.0) * um_per_px, (at.y_px - 1.0) * um_per_px, at.z_um);
            writeln!(out, "ID{id},{id},{track},1,{x},{y},{z},{t_s},{frame},{},1", d_um / 2.0)?;
        }
        Ok(())
    }
}

/// Numbers the uninterrupted sections of tracks: the first section keeps the track's number, later ones get
/// unused numbers.
fn number_runs(spots: &mut [Spot], pairs: bool) {
    let mut next = spots.iter().map(|s| s.track).max().unwrap_or(-1) + 1;
    let mut before: Option<(usize, i64)> = None;
    for i in 0..spots.len() {
        let own = spots[i].track;
        if let Some((b, track)) = before.filter(|(_, track)| *track == own) {
            let (last, this) = (spots[b], spots[i]);
            let goes_on = this.frame == last.frame + 1 && !(pairs && this.frame / 2 != last.frame / 2);
            if goes_on {
                spots[b].step =
                    [this.at.x_px - last.at.x_px, this.at.y_px - last.at.y_px, this.at.z_um - last.at.z_um];
                spots[i].track = last.track;
            } else {
                spots[i].track = next;
                next += 1;
            }
            before = Some((i, track));
        } else {
            before = Some((i, own));
        }
    }
    spots.sort_by_key(|s| (s.track, s.frame));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spot(track: i64, frame: u32) -> Spot {
        let at = Position { x_px: f64::from(frame), y_px: 1.0, z_um: 0.0 };
        Spot { frame, track, t_s: 0.0, at, d_um: 2.0, step: [f64::NAN; 3] }
    }

    #[test]
    fn runs_are_numbered_anew_where_a_particle_was_away() {
        let mut spots: Vec<Spot> = [0, 1, 3, 4, 6].map(|f| spot(5, f)).to_vec();
        spots.extend([2, 3].map(|f| spot(7, f)));
        number_runs(&mut spots, false);
        let numbers: Vec<(i64, u32)> = spots.iter().map(|s| (s.track, s.frame)).collect();
        assert_eq!(numbers, [(5, 0), (5, 1), (7, 2), (7, 3), (8, 3), (8, 4), (9, 6)]);
        assert_eq!(spots[0].step, [1.0, 0.0, 0.0]);
        assert!(spots[1].step[0].is_nan());
    }

    #[test]
    fn runs_of_pair_recordings_end_with_the_pair() {
        let mut spots: Vec<Spot> = [0, 1, 2, 3].map(|f| spot(0, f)).to_vec();
        number_runs(&mut spots, true);
        assert_eq!(spots.iter().map(|s| s.track).collect::<Vec<_>>(), [0, 0, 1, 1]);
    }
}
