"""Parameters of OpenPIV for a kind of dataset."""

from track import DEFAULTS, track  # first: it finds the common code
from common.tuning import field_score, tune_main, write_field

GRID = {
    "windows": [[64, 32], [32, 16], [64, 32, 16, 8], [32, 24], [48, 24]],
    "correlation": ["circular"],
    "normalized": [False],
    "last_passes": [0, 2],
    "overlap": [0.75],
    "median_threshold": [1.5, 3.0, 5.0],
}

if __name__ == "__main__":
    tune_main(track, DEFAULTS, GRID, score=field_score, write=write_field, budget=12)
