"""trackpy on a microsig dataset: particles in the image plane, linked within a sequence, pair or burst."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import pandas as pd
import trackpy as tp
from common.cli import track_main
from common.dataset import noise

DEFAULTS = {
    "diameter": 5,  # of a particle image, odd, px
    "min_snr": 4.0,  # minimum mass, in standard deviations of the noise of a sum over the particle image
    "separation": 4.0,  # minimum distance of two particles, px
    "search_range": 6.0,  # largest displacement between frames, px
    "memory": 0,  # frames in which a particle may be missing
    "predict": False,  # extrapolate with the velocity of the nearest particles
}


def locate(frame, params):
    image = frame.image()
    background, deviation = noise(image)
    found = tp.locate(image - background, params["diameter"],
                      minmass=params["min_snr"] * deviation * params["diameter"], separation=params["separation"],
                      threshold=0.5 * deviation)
    return found.assign(frame=frame.number)


def track(dataset, params):
    tp.quiet()
    rows, first = [], 0
    for group in dataset.groups():
        found = pd.concat([locate(frame, params) for frame in group], ignore_index=True)
        if found.empty:
            continue
        link = tp.predict.NearestVelocityPredict().link_df if params["predict"] else tp.link
        found = link(found, params["search_range"], memory=params["memory"], adaptive_stop=0.5, adaptive_step=0.9)
        found["particle"] += first
        first = found["particle"].max() + 1
        rows += list(found[["frame", "particle", "x", "y"]].itertuples(index=False, name=None))
    return rows


if __name__ == "__main__":
    track_main(track, DEFAULTS)
