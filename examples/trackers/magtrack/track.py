"""magtrack on a microsig dataset: depth of round particle images by their radial profile."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import warnings

import numpy as np
from common.cli import track_main
from common.dataset import noise, smooth_noise
from common.select import strongest_within
from scipy import ndimage

with warnings.catch_warnings(action="ignore"):  # warning about a missing GPU
    import magtrack

DEFAULTS = {
    "region": 64,  # width of the square around a particle, even, px
    "filters": [4.0, 12.0],  # widths of the Gaussian filters before particles are looked for, px
    "min_snr": 20.0,  # minimum height of a maximum, in standard deviations of the filtered noise
    "separation": 12.0,  # minimum distance of two particles, px
    "min_correlation": 0.9,  # of a radial profile with that of the calibration at its depth
    "n_local": 5,  # steps of the stack in the parabola that refines the depth
}


def find(image, params):
    """Centers (x, y) of maxima of the filtered images: ours, because magtrack expects manually selected regions."""
    size = 2 * round(params["separation"] / 2) + 1
    centers = []
    for width in params["filters"]:
        smooth = ndimage.gaussian_filter(image, width, mode="nearest")
        background, deviation = smooth_noise(image, width)
        high = smooth > background + params["min_snr"] * deviation
        y, x = np.nonzero((smooth == ndimage.maximum_filter(smooth, size)) & high)
        centers.append(np.stack([x, y], axis=1))
    return np.unique(np.concatenate(centers), axis=0)


def cut(image, centers, width):
    """Regions [y, x, particle] around the centers, and the positions of their first pixels."""
    corners = np.round(centers).astype(int) - width // 2
    padded = np.pad(image, width, constant_values=noise(image)[0])
    parts = [padded[y + width:y + 2 * width, x + width:x + 2 * width] for x, y in corners]
    return np.stack(parts, axis=2).astype(float), corners


def center(stack):
    """magtrack's own sequence (`stack_to_xyzp`): center of mass, then symmetry of the middle rows and columns."""
    x, y = magtrack.center_of_mass(stack)
    x, y = magtrack.auto_conv(stack, x, y)
    for _ in range(5):
        x, y = magtrack.auto_conv_multiline_sub_pixel(stack, x, y)
    return x, y


def correlation(profiles, table, depths, z):
    """Pearson correlation of each profile with the table at depth z, without the first bin as in magtrack."""
    columns = np.array([np.interp(z, depths, row) for row in table[1:]])
    a = profiles[1:] - profiles[1:].mean(axis=0)
    b = columns - columns.mean(axis=0)
    return (a * b).sum(axis=0) / np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))


def track(dataset, params):
    width = params["region"]
    depths, stack, (x, y) = dataset.calibration()
    regions = np.concatenate([cut(image, np.array([[x, y]]), width)[0] for image in stack], axis=2)
    at = np.full(len(depths), width // 2, float)
    table = magtrack.radial_profile(regions, at + x - round(x), at + y - round(y))
    lookup = np.vstack([depths, table])
    rows = []
    for frame in dataset.frames:
        image = frame.image()
        height, across = image.shape
        centers = find(image, params)
        if len(centers) == 0:
            continue
        regions, corners = cut(image, centers, width)
        with np.errstate(all="ignore"):
            x, y = center(regions.copy())
            inside = (np.abs(x - width / 2) < width / 4) & (np.abs(y - width / 2) < width / 4)
            x, y = np.where(inside, x, width / 2), np.where(inside, y, width / 2)
            found = magtrack.radial_profile(regions, x, y)
            z = magtrack.lookup_z(found, lookup, n_local=params["n_local"])
            fits = correlation(found, table, depths, z)
        x, y = x + corners[:, 0], y + corners[:, 1]
        good = (inside & (fits > params["min_correlation"]) & (x > -0.5) & (x < across - 0.5) & (y > -0.5)
                & (y < height - 0.5))
        index = np.nonzero(good)[0]
        kept = index[strongest_within(np.stack([x, y], axis=1)[index], fits[index], params["separation"])] if len(index) else index
        rows += [(frame.number, None, x[i], y[i], z[i]) for i in kept]
    return rows


if __name__ == "__main__":
    track_main(track, DEFAULTS)
