"""OpenPIV on microsig image pairs: multi-pass window deformation (`openpiv.windef`)."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from common.cli import track_main
from common.dataset import fail, write_field
from openpiv import windef
from openpiv.settings import PIVSettings

DEFAULTS = {
    "windows": [64, 32, 16],  # px, one per pass
    "overlap": 0.5,  # share of a window
    "correlation": "linear",  # or circular
    "normalized": True,  # subtract the mean and divide by the deviation of each window
    "median_threshold": 2.0,  # of the normalized median test
    "last_passes": 1,  # further passes with the last window
}


def settings(params):
    windows = tuple(params["windows"]) + (params["windows"][-1],) * params["last_passes"]
    value = PIVSettings(windowsizes=windows, overlap=tuple(round(w * params["overlap"]) for w in windows))
    value.num_iterations = len(windows)
    value.correlation_method = params["correlation"]
    value.normalized_correlation = params["normalized"]
    value.median_normalized = True
    value.median_threshold = params["median_threshold"]
    value.sig2noise_validate = False
    value.sig2noise_method = None
    return value


def track(dataset, params):
    rows = []
    for pair, group in enumerate(dataset.groups()):
        if len(group) != 2:
            fail(f"{dataset.folder} is not a dataset of image pairs")
        a, b = (frame.image() for frame in group)
        x, y, u, v, flags = windef.simple_multipass(a, b, settings(params))
        # OpenPIV turns y and v upward at the end: undo it. Its positions are half a window, so half a pixel
        # beyond the windows' centers; but it deforms images as if they counted from the center of the first
        # pixel, so that the vectors of deformed passes are those at these positions from that center, as
        # `write_field` takes them.
        y = y[::-1]
        half = 0.5 if len(params["windows"]) + params["last_passes"] == 1 else 0.0  # no deformed pass
        replaced = np.asarray(flags) != 0
        for row in zip(*(np.asarray(column).ravel() for column in (x - half, y - half, u, -v, np.where(replaced, 2, 0)))):
            rows.append((group[0].group if group[0].group is not None else pair, *row))
    return rows


if __name__ == "__main__":
    track_main(track, DEFAULTS, write=write_field)
