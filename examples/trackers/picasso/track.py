"""Picasso on a microsig dataset: Gaussian fits, and behind a cylindrical lens depth from their two widths."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
os.environ.setdefault("MPLBACKEND", "Agg")

import numpy as np
import pandas as pd
from common.cli import track_main
from common.dataset import noise
from common.picasso_spots import camera, continued, identify
from common.select import strongest_within
from picasso import localize, zfit

DEFAULTS = {
    "box": 31,  # width of the fitted part of the image, odd, px
    "filters": [5.0],  # widths of the Gaussian filters before spots are identified, px
    "identify": 15,  # box in which a spot is the maximum, odd, px
    "min_gradient": 400.0,  # minimum net gradient, in standard deviations of the noise of the filtered image
    "mle": False,  # maximum likelihood instead of least squares
    "z_filter": 2,  # largest distance from the calibration curve, in RMS distances; 0 is unlimited
    "separation": 3.0,  # of two fits to the same particle, the weaker one is dropped, px
}


# Picasso looks for z in the range of single molecules, about a micrometer: depths are given to it a hundred
# times smaller, in units of 0.1 um instead of nm.
UNIT_UM = 0.1


def fit(images, found, info, params):
    spots = localize.get_spots(images, found, params["box"], info).astype(np.float32)
    theta = localize.fit_spots_gauss(spots, mle=params["mle"])
    locs = localize.locs_from_fits_gauss(found, theta, params["box"], False, mle=params["mle"])
    good = np.isfinite(locs[["x", "y", "sx", "sy"]]).all(axis=1) & (locs["photons"] > 0)
    return locs[good & locs["sx"].between(0.3, params["box"]) & locs["sy"].between(0.3, params["box"])]


def metadata(images):
    frames, height, width = images.shape
    return [{"Frames": frames, "Height": height, "Width": width, "Pixelsize": 1000}]


def calibrate(dataset, info, params):
    """Picasso's calibration curve of the stack, and the depth (um) of its zero."""
    z, stack, (x, y) = dataset.calibration()
    beads = pd.DataFrame({"frame": range(len(stack)), "x": round(x), "y": round(y), "net_gradient": 1.0})
    locs = fit(stack, beads, info, params)
    # Without scatter between beads nothing is an outlier: three copies, slightly apart, keep `calibrate_z`
    # from comparing with a variance that is undefined.
    copies = pd.concat([locs.assign(sx=locs["sx"] * f, sy=locs["sy"] * f) for f in (0.999, 1.0, 1.001)])
    meta = metadata(stack)
    curve = zfit.calibrate_z(copies, meta, (z[-1] - z[0]) / (len(z) - 1) / UNIT_UM, 1.0)
    fitted, _ = zfit.zfit(locs, metadata(stack), calibration=curve, filter=0)
    # Picasso's z falls from step to step of a stack, and is zero where both widths are equal.
    return curve, float(np.median(z[fitted["frame"]] + UNIT_UM * fitted["z"]))


def track(dataset, params):
    frames = [frame.image() for frame in dataset.frames]
    info = camera(*noise(frames[0]))
    height, width = frames[0].shape
    edge = max(params["box"], params["identify"]) // 2 + 1
    images = continued(frames, edge)
    found = identify(images, edge, params)
    if found.empty:
        return []
    locs = fit(images, found, info, params)
    columns = ["x", "y"]
    if dataset.settings.get("cyl_focal_length", 0) > 0:
        curve, zero = calibrate(dataset, info, params)
        locs, _ = zfit.zfit(locs, metadata(images), calibration=curve, filter=params["z_filter"])
        low, high = dataset.depth_range
        locs["z_um"] = zero - UNIT_UM * locs["z"]
        locs = locs[locs["z_um"].between(low, high)]
        columns.append("z_um")
    locs = locs.assign(x=locs["x"] - edge, y=locs["y"] - edge)
    locs = locs[locs["x"].between(-0.5, width - 0.5) & locs["y"].between(-0.5, height - 0.5)]
    rows = []
    for number, group in locs.groupby("frame"):
        kept = strongest_within(group[["x", "y"]].to_numpy(), group["net_gradient"].to_numpy(), params["separation"])
        rows += [(int(number), None, *row) for row in group.iloc[kept][columns].itertuples(index=False)]
    return rows


if __name__ == "__main__":
    track_main(track, DEFAULTS)
