"""fluidimage on microsig image pairs: multi-pass correlation (`fluidimage.piv.Work`)."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from common.cli import track_main
from common.dataset import fail, write_field
from fluidimage.data_objects.piv import ArrayCouple
from fluidimage.piv import Work

DEFAULTS = {
    "window": 64,  # of the first pass, px
    "passes": 3,  # each with half the window of the one before
    "overlap": 0.5,  # share of a window
    "min_correlation": 0.2,
    "neighbour_threshold": 3.0,  # largest difference to the neighbours, px
    "max_displacement": 16,  # px, in each pass
}


def work(params):
    value = Work.create_default_params()
    value.piv0.shape_crop_im0 = params["window"]
    value.piv0.displacement_max = params["max_displacement"]
    value.piv0.grid.overlap = params["overlap"]
    value.multipass.number = params["passes"]
    value.multipass.use_tps = False
    value.fix.correl_min = params["min_correlation"]
    value.fix.threshold_diff_neighbour = params["neighbour_threshold"]
    return Work(value)


def track(dataset, params):
    rows, piv = [], work(params)
    for pair, group in enumerate(dataset.groups()):
        if len(group) != 2:
            fail(f"{dataset.folder} is not a dataset of image pairs")
        images = tuple(frame.image() for frame in group)
        found = piv.calcul(ArrayCouple(("a", "b"), images)).passes[-1]
        name = group[0].group if group[0].group is not None else pair
        for x, y, dx, dy in zip(found.xs, found.ys, found.deltaxs, found.deltays):
            # Windows of even width are centered half a pixel before their position. Rejected vectors are NaN;
            # `write_field` flags them.
            rows.append((name, x - 0.5, y - 0.5, dx, dy, 0))
    return rows


if __name__ == "__main__":
    track_main(track, DEFAULTS, write=write_field)
