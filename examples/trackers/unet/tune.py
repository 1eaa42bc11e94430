"""Parameters of the network's detections for a kind of dataset."""

from track import DEFAULTS, track  # first: it finds the common code
from common.tuning import points_score, tune_main

GRID = {
    "threshold": [0.3, 0.4, 0.6, 0.7, 0.8],
    "separation": [1.5, 5.0, 8.0],
}

if __name__ == "__main__":
    tune_main(track, DEFAULTS, GRID, score=points_score, budget=16)
