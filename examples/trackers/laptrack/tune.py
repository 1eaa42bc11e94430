"""Parameters of LapTrack and of its detector for a kind of dataset."""

from track import DEFAULTS, track  # first: it finds the common code
from common.tuning import tracks_score, tune_main

GRID = {
    "sigma": [1.0, 2.0, 3.0, 5.0],
    "min_snr": [2.0, 3.0, 4.0, 5.0, 8.0, 12.0],
    "max_distance": [3.0, 4.0, 10.0, 15.0],
    "gap_frames": [0, 2],
}

if __name__ == "__main__":
    tune_main(track, DEFAULTS, GRID, score=tracks_score)
