"""Parameters of magtrack and of its detector for a kind of dataset."""

from track import DEFAULTS, track  # first: it finds the common code
from common.tuning import points_score, tune_main

GRID = {
    "min_correlation": [0.8, 0.95, 0.98],
    "filters": [[6.0], [6.0, 12.0], [4.0, 8.0, 12.0]],
    "region": [48, 80],
    "min_snr": [10.0, 40.0],
    "separation": [20.0, 28.0],
    "n_local": [3, 7],
}

if __name__ == "__main__":
    tune_main(track, DEFAULTS, GRID, score=points_score, budget=16)
