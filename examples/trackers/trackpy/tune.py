"""Parameters of trackpy for a kind of dataset."""

from track import DEFAULTS, track  # first: it finds the common code
from common.tuning import tracks_score, tune_main

GRID = {
    "min_snr": [0.25, 0.5, 1.0, 2.0],
    "diameter": [3, 7, 9, 13],
    "separation": [2.0, 3.0, 6.0],
    "search_range": [3.0, 4.0, 10.0, 15.0],
    "predict": [True],
    "memory": [1],
}

if __name__ == "__main__":
    tune_main(track, DEFAULTS, GRID, score=tracks_score)
