"""Code shared by both Picasso trackers: identification of spots, and images padded beyond their edges."""

import numpy as np
import pandas as pd
from picasso import localize
from scipy import ndimage

from .dataset import noise, smooth_noise


def camera(background, deviation):
    """Scaling for which the variance of the background equals its mean, as Picasso's Poisson likelihood expects."""
    return {"Baseline": background - deviation**2, "Sensitivity": 1.0, "Gain": 1, "Pixelsize": 1000}


def continued(frames, edge):
    """Images padded with background, so that particles near the edge are found, too."""
    return np.array([np.pad(frame, edge, constant_values=noise(frame)[0]) for frame in frames])


def identify(frames, edge, params):
    """Spots by Picasso's net gradient on filtered images, within the original images."""
    tables = []
    for number, frame in enumerate(frames):
        for width in params["filters"]:
            smooth = ndimage.gaussian_filter(frame, width)
            _, deviation = smooth_noise(frame[edge:-edge, edge:-edge], width)
            y, x, gradient = localize.identify_in_image(smooth, params["min_gradient"] * deviation, params["identify"])
            inside = (x >= edge) & (x < frame.shape[1] - edge) & (y >= edge) & (y < frame.shape[0] - edge)
            y, x, gradient = y[inside], x[inside], gradient[inside]
            tables.append(pd.DataFrame({"frame": number, "x": x, "y": y, "net_gradient": gradient}))
    found = pd.concat(tables, ignore_index=True)
    if len(params["filters"]) == 1:
        return found
    # Spots that several filters find within a few pixels are fitted once, starting from the position that the
    # widest filter gives.
    places = (found[["x", "y"]] // 4).assign(frame=found["frame"])
    return found[~places.duplicated(keep="last")].reset_index(drop=True)
