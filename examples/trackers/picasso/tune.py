"""Parameters of Picasso's Gaussian fits for a kind of dataset."""

from track import DEFAULTS, track  # first: it finds the common code
from common.tuning import points_score, tune_main

GRID = {
    "z_filter": [1],
    "box": [7, 11, 21, 41],
    "filters": [[1.5], [3.0], [8.0]],
    "min_gradient": [30.0, 150.0, 1000.0],
    "identify": [5, 9, 21],
    "separation": [1.5],
    "mle": [True],
}

if __name__ == "__main__":
    tune_main(track, DEFAULTS, GRID, score=points_score, budget=16)
