"""A spot detector for packages that link but do not detect: maxima of the Laplacian of Gaussian."""

import numpy as np
from scipy import ndimage
from skimage.feature import peak_local_max

from .dataset import noise


def parabola(low, middle, high):
    """Offset of the vertex of a parabola through three equidistant values, within half a step."""
    curvature = low - 2 * middle + high
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = np.where(curvature < 0, 0.5 * (low - high) / curvature, 0.0)
    return np.clip(offset, -0.5, 0.5)


def find_spots(image, sigma, min_snr):
    """x, y (from 0) of bright spots: scikit-image's `peak_local_max` on scipy's `gaussian_laplace`, above `min_snr`
    standard deviations of the filtered noise, between pixels by parabolas."""
    response = -ndimage.gaussian_laplace(image, sigma, mode="nearest")
    _, deviation = noise(response)
    peaks = peak_local_max(response, min_distance=max(1, round(sigma)), threshold_abs=min_snr * deviation,
                           exclude_border=1)
    y, x = peaks[:, 0], peaks[:, 1]
    dx = parabola(response[y, x - 1], response[y, x], response[y, x + 1])
    dy = parabola(response[y - 1, x], response[y, x], response[y + 1, x])
    return x + dx, y + dy
