"""Reads a microsig dataset, finds bright spots, writes a result: python start.py DATASET results.csv"""

import sys
from pathlib import Path

import numpy as np
import tifffile

RADIUS = 4  # of the neighborhood of a particle, px
MIN_SNR = 5.0  # minimum height above the background, in standard deviations of the smoothed noise


def shifted(image, dy, dx):
    """The image shifted by whole pixels; the edge is repeated."""
    r = max(abs(dy), abs(dx))
    wide = np.pad(image, r, mode="edge")
    return wide[r + dy : r + dy + image.shape[0], r + dx : r + dx + image.shape[1]]


def find_particles(image):
    """Positions (x, y) of particles, the first pixel being (0, 0). Put your method here."""
    near = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    smooth = sum(shifted(image, dy, dx) for dy, dx in near) / 9
    background = np.median(smooth)
    noise = 1.4826 * np.median(np.abs(smooth - background))
    around = [(dy, dx) for dy in range(-RADIUS, RADIUS + 1) for dx in range(-RADIUS, RADIUS + 1)
              if dy**2 + dx**2 <= RADIUS**2]
    highest = np.max([shifted(smooth, dy, dx) for dy, dx in around], axis=0)
    peaks = np.argwhere((smooth == highest) & (smooth > background + MIN_SNR * noise))
    found = []
    for y, x in peaks:
        light = [(max(image[y + dy, x + dx] - background, 0), y + dy, x + dx) for dy, dx in around
                 if 0 <= y + dy < image.shape[0] and 0 <= x + dx < image.shape[1]]
        weight, ys, xs = np.array(light).T
        found.append(((weight * xs).sum() / weight.sum(), (weight * ys).sum() / weight.sum()))
    return found


def main():
    if len(sys.argv) != 3:
        sys.exit("usage: python start.py DATASET results.csv")
    images = sorted(Path(sys.argv[1], "images").glob("*.tif"))
    if not images:
        sys.exit(f"error: {sys.argv[1]}/images contains no TIFF images")
    with open(sys.argv[2], "w") as out:
        out.write("frame,track,x_px,y_px\n")
        for frame, path in enumerate(images):  # frames count from 0, in the order of the names
            for x, y in find_particles(tifffile.imread(path).astype(float)):
                out.write(f"{frame},-1,{x + 1:.4f},{y + 1:.4f}\n")  # the first pixel is (1, 1) in a result
    print(f"{len(images)} images, result in {sys.argv[2]}")


if __name__ == "__main__":
    main()
