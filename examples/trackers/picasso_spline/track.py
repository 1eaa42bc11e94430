"""Picasso's spline fit on a microsig dataset: the calibration stack as a 3-D spline, fitted to every spot."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
import pandas as pd
from common.cli import track_main
from common.dataset import noise
from common.picasso_spots import camera, continued, identify
from common.select import strongest_within
from picasso import localize, spline

DEFAULTS = {
    "box": 41,  # width of the fitted part of the image, odd, px
    "filters": [6.0, 12.0],  # widths of the Gaussian filters before spots are identified, px
    "identify": 15,  # box in which a spot is the maximum, odd, px
    "min_gradient": 400.0,  # minimum net gradient, in standard deviations of the noise of the filtered image
    "starts": 5,  # depths from which the fit begins
    "iterations": 20,  # maximum number per fit
    "min_photons": 0.3,  # minimum and largest brightness relative to the calibration particle
    "max_photons": 3.0,
    "min_explained": 0.7,  # minimum share of the variance of the pixels that the fit explains
    "separation": 4.0,  # of two fits to the same particle, the worse is dropped, px
}


def calibrate(dataset, box, info):
    """Picasso's calibration of the stack, and the depth (um) of its zero."""
    z, stack, (x, y) = dataset.calibration()
    box = min(box, 2 * int(min(x, y)) - 1)
    bead = pd.DataFrame({"x": [round(x)], "y": [round(y)]})
    step = 1000 * (z[-1] - z[0]) / (len(z) - 1)
    built = spline.build_psf_template(stack, info, box, 0, step, beads=bead, threaded=False)
    template = np.ascontiguousarray(built["template"].transpose(1, 0, 2))
    coefficients = spline.spline_coefficients(template)
    middle = (len(z) - 1) / 2
    calibration = {
        "model": "spline-3d", "coefficients": coefficients, "n_data": list(template.shape),
        "n_intervals": list(coefficients.shape[1:]), "oversampling": 1.0, "lateral_centered": True,
        "z_center": middle, "z_init": float(built["z_center"]), "z_step_nm": step, "magnification_factor": 1.0,
        "effective_sigma": float(built["effective_sigma"]), "photon_scale": float(built["photon_scale"]), "box": box,
        "pixelsize": 1000.0, "n_channels": 1, "correct_z_bias": False,
    }
    return calibration, box, (z[0] + z[-1]) / 2


def fit(images, found, calibration, box, params, info):
    """x, y (px), z (nm), brightness and explained share of variance of every identified spot: least squares."""
    spots = localize.get_spots(images, found, box, info).astype(np.float32)
    theta, _, _, residual = localize.fit_spots_spline(
        spots, calibration, n_z_starts=params["starts"], return_stats=True, use_gpu=False,
        max_iterations=params["iterations"])
    locs = localize.locs_from_fits_spline(found, theta, box, False, calibration, mle=False, chi_square=residual)
    total = pd.Series(spots.var(axis=(1, 2)) * box**2, index=found.index)
    return locs.assign(explained=1 - locs["chi_square"] / total)


def track(dataset, params):
    frames = [frame.image() for frame in dataset.frames]
    info = camera(*noise(frames[0]))
    calibration, box, zero = calibrate(dataset, params["box"], info)
    edge = box // 2 + params["identify"] // 2 + 1
    images = continued(frames, edge)
    found = identify(images, edge, params)
    if found.empty:
        return []
    locs = fit(images, found, calibration, box, params, info)
    locs[["x", "y"]] -= edge
    low, high = dataset.depth_range
    locs["z_um"] = zero - locs["z"] / 1000  # Picasso's z falls from step to step of a stack
    unit = np.median(reference_photons(dataset, calibration, box, info, params))
    height, width = frames[0].shape
    good = (locs["photons"].between(params["min_photons"] * unit, params["max_photons"] * unit)
            & (locs["explained"] > params["min_explained"]) & locs["z_um"].between(low, high) & locs["x"].between(-0.5, width - 0.5)
            & locs["y"].between(-0.5, height - 0.5))
    rows = []
    for number, group in locs[good].groupby("frame"):
        kept = strongest_within(group[["x", "y"]].to_numpy(), group["explained"].to_numpy(), params["separation"])
        rows += [(int(number), None, *row) for row in group.iloc[kept][["x", "y", "z_um"]].itertuples(index=False)]
    return rows


def reference_photons(dataset, calibration, box, info, params):
    """Brightness of the calibration particle, as the fit measures it at some of the steps."""
    _, stack, (x, y) = dataset.calibration()
    stack = stack[::8]
    found = pd.DataFrame({"frame": range(len(stack)), "x": round(x), "y": round(y), "net_gradient": 1.0})
    return fit(stack, found, calibration, box, params, info)["photons"]


if __name__ == "__main__":
    track_main(track, DEFAULTS)
