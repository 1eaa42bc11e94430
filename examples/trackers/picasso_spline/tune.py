"""Parameters of Picasso's spline fits for a kind of dataset."""

from track import DEFAULTS, track  # first: it finds the common code
from common.tuning import points_score, tune_main

GRID = {
    "min_explained": [0.5, 0.85],
    "box": [31, 51],
    "filters": [[4.0, 8.0], [8.0]],
    "min_gradient": [100.0, 1000.0],
}

if __name__ == "__main__":
    tune_main(track, DEFAULTS, GRID, score=points_score, budget=10)
