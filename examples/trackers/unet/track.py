"""Small U-Nets on a microsig dataset: positions and depths of defocused particles, or those and the axes of spheroids; not linked."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import onnxruntime
from common.cli import track_main
from common.select import strongest_within
from network import AXIS, HIGH, LOW, OFFSET_PX, scaled

DEFAULTS = {
    "threshold": 0.5,  # minimum probability of a particle
    "separation": 3.0,  # minimum distance of two particles, px
    "axes": False,  # whether particles are spheroids
}
ROWS_AND_COLUMNS = 16  # image sizes are multiples of this in the network


def network(name):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    model = Path(__file__).with_name(name)
    return onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])


def maps(session, image):
    """Maps of probability, depth (um) and offset (px) of the particle at or near each pixel, and of the tensor of its axis, if any."""
    rows, columns = image.shape
    padded = np.pad(image, ((0, -rows % ROWS_AND_COLUMNS), (0, -columns % ROWS_AND_COLUMNS)), mode="edge")
    seen = scaled(padded, np.arcsinh).astype(np.float32)
    (output,) = session.run(None, {"image": seen[None, None]})
    output = output[0, :, :rows, :columns].astype(float)
    place, z, x, y = 1 / (1 + np.exp(-output[:4]))
    return place, LOW + (HIGH - LOW) * z, 2 * OFFSET_PX * (x - 0.5), 2 * OFFSET_PX * (y - 0.5), output[4:]


def axis_of(elements):
    """The axis whose tensor n n^T is closest: the eigenvector of the largest eigenvalue."""
    tensor = np.zeros((3, 3))
    for (i, j), element in zip(AXIS, elements):
        tensor[i, j] = tensor[j, i] = element
    return tuple(np.linalg.eigh(tensor)[1][:, -1])


def maxima(place, threshold):
    """Rows and columns of pixels that no neighbor exceeds."""
    padded = np.pad(place, 1, constant_values=0)
    height, width = place.shape
    neighbors = [padded[1 + dy:1 + dy + height, 1 + dx:1 + dx + width] for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    return np.nonzero((place >= np.max(neighbors, axis=0)) & (place > threshold))


def track(dataset, params):
    session, rows = network("axes.onnx" if params["axes"] else "model.onnx"), []
    for frame in dataset.frames:
        place, z, dx, dy, tensor = maps(session, frame.image())
        r, c = maxima(place, params["threshold"])
        x, y = c + dx[r, c], r + dy[r, c]
        points = np.stack([x, y], axis=1)
        for i in strongest_within(points, place[r, c], params["separation"]):
            axis = axis_of(tensor[:, r[i], c[i]]) if params["axes"] else ()
            rows.append((frame.number, None, x[i], y[i], z[r[i], c[i]], *axis))
    return rows


if __name__ == "__main__":
    track_main(track, DEFAULTS)
