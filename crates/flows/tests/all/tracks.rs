//! Recorded tracks: reading, derived quantities, and rejected input.

use flows::scale::Scale;
use flows::tracks::ParticleDefaults;
use flows::{Diameters, Frame, Intensities, Orientation, RecordedTracks, RecordingStart, Shutter, Spheroids};
use glam::DVec3;
use microsig_core::stream::Streams;

/// 101 x 51 px of 0.5 um: the center of the image is at (51, 26) px.
fn scale() -> Scale {
    Scale::new(0.5, 101, 51, 1.33).unwrap()
}

fn read(text: &str) -> Result<RecordedTracks, Vec<String>> {
    RecordedTracks::from_csv(text.as_bytes(), &scale())
        .map_err(|faults| faults.iter().map(ToString::to_string).collect())
}

fn record(text: &str, times_s: &[f64], shutter: Option<Shutter>) -> Vec<Frame> {
    let diameters = Diameters::uniform(1.0, 3.0).unwrap();
    let kind = ParticleDefaults {
        diameters: &diameters,
        intensities: Intensities::Uniform { min: 0.5, max: 1.5 },
        spheroids: Some(Spheroids { e_p: 2.0, orientation: Orientation::Random }),
    };
    let tracks = read(text).unwrap();
    let frames =
        tracks.record(times_s.to_vec(), None, kind, shutter, Streams::new(5), RecordingStart::default());
    frames.collect()
}

#[test]
fn positions_may_be_in_um_or_in_px_in_any_order_of_columns() {
    let um = read("frame,track,x_um,y_um,z_um\n0,7,1,-2,-30\n").unwrap();
    // z is physical depth in both formats, whatever the depth factor.
    let px = read("z_um, track ,y_px,x_px,frame\n-30,7,22,53,0\n").unwrap();
    assert_eq!(um.rows()[0].position, DVec3::new(1.0, -2.0, -30.0));
    assert_eq!(px.rows()[0].position, um.rows()[0].position);
    assert_eq!((um.units(), px.units()), ("um", "px"));
    // The track table of a dataset has both: coordinates in object space are used.
    let both = read("frame,track,x_px,y_px,z_um,x_um,y_um,seen\n0,1,0,0,5,10,20,yes\n").unwrap();
    assert_eq!(both.rows()[0].position, DVec3::new(10.0, 20.0, 5.0));
    assert_eq!(both.unused_columns(), ["seen"]);
}

#[test]
fn velocities_are_slopes_of_parabolas_and_at_ends_and_gaps_differences() {
    // x = 3 + 4 t - 2 t^2 at unequally spaced times; track 9 is in frames 0, 1 and 3, track 4 in frame 2
    // only.
    let times: [f64; 4] = [0.0, 0.5, 2.0, 3.0];
    let x = |t: f64| 3.0 + 4.0 * t - 2.0 * t * t;
    let mut text = "frame,track,x_um,y_um,z_um\n".to_owned();
    for (frame, t) in times.iter().enumerate() {
        text += &format!("{frame},1,{},0,0\n", x(*t));
    }
    text += "0,9,0,0,0\n1,9,1,0,0\n3,9,5,0,0\n2,4,8,8,8\n";
    let frames = record(&text, &times, None);
    let velocity = |frame: usize, id: u64| {
        frames[frame].tracers.iter().find(|tracer| tracer.id == id).unwrap().velocity.map(|v| v.x)
    };
    for frame in [1, 2] {
        let exact = 4.0 - 4.0 * times[frame];
        assert!((velocity(frame, 1).unwrap() - exact).abs() < 1e-12, "{frame}");
    }
    assert_eq!(velocity(0, 1), Some((x(0.5) - x(0.0)) / 0.5));
    assert_eq!(velocity(3, 1), Some(x(3.0) - x(2.0)));
    assert_eq!((velocity(0, 9), velocity(1, 9), velocity(3, 9)), (Some(2.0), Some(2.0), None));
    assert_eq!(velocity(2, 4), None);
    // There is no link across a gap; after it the track continues.
    assert_eq!(frames[1].links(&frames[2]).count(), 1);
    let steps: Vec<bool> = frames[3].tracers.iter().map(|tracer| tracer.step.is_some()).collect();
    assert_eq!(steps, [true, false]);
}

#[test]
fn what_the_file_says_counts_and_the_rest_is_drawn_by_the_number_of_the_track() {
    let text = "frame,track,x_um,y_um,z_um,d_um,c_int,e_p,axis_x,axis_y,axis_z,u_um_s,v_um_s,w_um_s\n\
                0,1,0,0,0,2.5,0.25,3,0,3,4,7,8,9\n0,2,5,0,0,,,,,,,,,\n1,2,6,0,0,,,,,,,,,\n";
    let frames = record(text, &[0.0, 0.1], None);
    let [told, drawn] = [frames[0].tracers[0], frames[0].tracers[1]];
    assert_eq!((told.d_um, told.c_int, told.aspect), (2.5, 0.25, 3.0));
    assert!((told.axis - DVec3::new(0.0, 0.6, 0.8)).length() < 1e-15);
    assert_eq!(told.velocity, Some(DVec3::new(7.0, 8.0, 9.0)));
    assert!((1.0..3.0).contains(&drawn.d_um) && (0.5..1.5).contains(&drawn.c_int) && drawn.aspect == 2.0);
    let later = frames[1].tracers[0];
    assert_eq!((later.d_um, later.c_int, later.axis), (drawn.d_um, drawn.c_int, drawn.axis));
    assert!((drawn.velocity.unwrap() - DVec3::X * 10.0).length() < 1e-12);
    let angles = "frame,track,x_um,y_um,z_um,e_p,alpha_rad,beta_rad\n0,1,0,0,0,2,0,0\n";
    assert_eq!(record(angles, &[0.0], None)[0].tracers[0].axis, DVec3::Y);
}

#[test]
fn a_recording_begins_where_it_should_and_frames_may_be_empty() {
    let text = "frame,track,x_um,y_um,z_um\n4,1,0,0,0\n5,1,1,0,0\n7,1,2,0,0\n";
    let diameters = Diameters::equal(2.0).unwrap();
    let kind =
        ParticleDefaults { diameters: &diameters, intensities: Intensities::default(), spheroids: None };
    let tracks = read(text).unwrap();
    let start = RecordingStart { recording: 2, first_frame: 4, first_id: 0 };
    let frames: Vec<Frame> =
        tracks.record(vec![2.0, 2.5, 3.0], None, kind, None, Streams::new(1), start).collect();
    let numbers: Vec<(u32, usize)> = frames.iter().map(|f| (f.index, f.tracers.len())).collect();
    assert_eq!(numbers, [(4, 1), (5, 1), (6, 0)]);
    // The previous frame belongs to another recording.
    assert!(frames[0].tracers[0].step.is_none());
    assert_eq!(frames[0].tracers[0].velocity, Some(DVec3::X * 2.0));
    // A recording that ends earlier is the beginning of a longer one.
    let shorter: Vec<Frame> =
        tracks.record(vec![2.0], Some(2.5), kind, None, Streams::new(1), start).collect();
    assert_eq!(shorter[..], frames[..1]);
}

#[test]
fn streaks_of_tracks_are_straight_and_centered() {
    let text = "frame,track,x_um,y_um,z_um\n0,1,0,0,0\n1,1,4,3,0\n0,2,9,9,9\n";
    let shutter = Shutter::new(0.5, 1, 0.0, 0.25).unwrap();
    let frames = record(text, &[0.0, 1.0], Some(shutter));
    let streak = &frames[0].streaks[0];
    // 5 um/s over 0.5 s is 2.5 um: 10 points 0.25 um apart.
    assert_eq!((streak.points.len(), streak.share), (10, 0.1));
    let mean = streak.points.iter().map(|p| p.position).sum::<DVec3>() / 10.0;
    assert!(mean.length() < 1e-15);
    assert!((streak.points[9].position - DVec3::new(0.9, 0.675, 0.0)).length() < 1e-12);
    // A track with a single point does not move.
    assert_eq!(frames[0].streaks[1].points.len(), 1);
}

#[test]
fn faults_name_their_lines_all_at_once() {
    let faults = |text: &str| read(text).unwrap_err().join("\n");
    assert_eq!(faults(""), "tracks, line 1: nothing: expected a header");
    assert!(faults("frame,x_um,y_um,z_um\n").contains("expected track"));
    assert!(faults("frame,track,x_px,y_um,z_um\n").contains("x_um, y_um and z_um, or x_px, y_px and z_um"));
    assert!(faults("frame,track,track,x_um,y_um,z_um\n").contains("the column track twice"));
    assert!(faults("frame,track,x_um,y_um,z_um,axis_x\n").contains("all of axis_x, axis_y, axis_z or none"));
    assert!(faults("frame,track,x_um,y_um,z_um\n\n").contains("line 1: a header only"));
    let many = faults(
        "frame,track,x_um,y_um,z_um,d_um,c_int\n0,1,0,0,nan,1,1\n-1,1,0,0,0,1,1\n0,1.5,0,0,0,1,1\n0,1,0,0\n\
         0,2,0,0,0,0,1\n0,3,0,0,0,1,-1\n5000000000,3,0,0,0,1,1\n0,4,1e999,0,0,1,1\n0,5,0,0,0,1,1\n0,5,1,1,1,1,1\n",
    );
    for expected in [
        "line 2: z = \"nan\": expected a finite number",
        "line 3: frame = \"-1\": expected a whole number from 0 to",
        "line 4: track = \"1.5\"",
        "line 5: 4 columns: expected 7, as in the header",
        "line 6: d_um = \"0\": expected a number > 0",
        "line 7: c_int = \"-1\": expected a number >= 0",
        "line 8: frame = \"5000000000\"",
        "line 9: x = \"1e999\"",
        "line 11: a second row for track 5 in frame 0: expected one, as in line 10",
    ] {
        assert!(many.contains(expected), "{expected} is not in\n{many}");
    }
    let axis = faults("frame,track,x_um,y_um,z_um,axis_x,axis_y,axis_z\n0,1,0,0,0,0,0,0\n");
    assert!(axis.contains("line 2: an axis of length 0"));
    // The number of errors reported for garbage input is limited.
    let noise = "frame,track,x_um,y_um,z_um\n".to_owned() + &"?\n".repeat(1000);
    assert_eq!(read(&noise).unwrap_err().len(), 20);
}
