"""LapTrack on a microsig dataset: links of spots that a Laplacian of Gaussian finds."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import pandas as pd
from common.cli import track_main
from common.spots import find_spots
from laptrack import LapTrack

DEFAULTS = {
    "sigma": 1.5,  # of the Laplacian of Gaussian, px
    "min_snr": 6.0,  # minimum response, in standard deviations of the filtered noise
    "max_distance": 6.0,  # largest displacement between frames, px
    "gap_frames": 1,  # frames in which a particle may be missing
}


def track(dataset, params):
    linker = LapTrack(cutoff=params["max_distance"] ** 2, gap_closing_cutoff=params["max_distance"] ** 2,
                      gap_closing_max_frame_count=params["gap_frames"], splitting_cutoff=False, merging_cutoff=False)
    rows, first = [], 0
    for group in dataset.groups():
        found = []
        for frame in group:
            x, y = find_spots(frame.image(), params["sigma"], params["min_snr"])
            found.append(pd.DataFrame({"frame": frame.number, "x": x, "y": y}))
        found = pd.concat(found, ignore_index=True)
        if found.empty:
            continue
        linked, _, _ = linker.predict_dataframe(found, ["x", "y"], frame_col="frame", only_coordinate_cols=False)
        linked["track_id"] += first
        first = linked["track_id"].max() + 1
        frame = "frame_y" if "frame_y" in linked else "frame"
        rows += list(linked.reset_index()[["frame", "track_id", "x", "y"]].itertuples(index=False, name=None))
    return rows


if __name__ == "__main__":
    track_main(track, DEFAULTS)
