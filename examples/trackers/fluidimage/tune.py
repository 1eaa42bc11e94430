"""Parameters of fluidimage for a kind of dataset."""

from track import DEFAULTS, track  # first: it finds the common code
from common.tuning import field_score, tune_main, write_field

GRID = {
    "window": [48, 96, 128],
    "passes": [1, 2],
    "overlap": [0.75],
    "neighbour_threshold": [1.5, 6.0],
    "min_correlation": [0.1, 0.4],
    "max_displacement": [8],
}

if __name__ == "__main__":
    tune_main(track, DEFAULTS, GRID, score=field_score, write=write_field, budget=16)
