"""Parameters of trackpy for a kind of dataset."""

from track import DEFAULTS, track  # first: it finds the common code
from common.cli import tracks_score, tune_main

GRID = {
    "diameter": [3, 5, 7, 9, 13],
    "min_snr": [2.0, 3.0, 6.0, 9.0],
    "separation": [2.0, 3.0, 6.0],
    "search_range": [3.0, 4.0, 10.0, 15.0],
    "predict": [True],
    "memory": [1],
}

if __name__ == "__main__":
    tune_main(track, DEFAULTS, GRID, score=tracks_score)
