"""Plots with matplotlib; the only module that needs it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ._dataset import Dataset
    from ._scores import Scores


def show(dataset: Dataset, frame: int, truth: bool) -> Figure:
    """A frame with the positions of its particles."""
    import matplotlib.pyplot as plt

    image = dataset.image(frame)
    rows, columns = image.shape
    width = 9.0
    figure, axes = plt.subplots(figsize=(width, max(2.0, width * rows / columns)), layout="constrained")
    low, high = np.percentile(image, [1.0, 99.8])
    # Pixel k covers [k - 0.5, k + 0.5), counted from 1.
    extent = (0.5, columns + 0.5, rows + 0.5, 0.5)
    axes.imshow(image, cmap="gray", vmin=low, vmax=max(high, low + 1), extent=extent, interpolation="nearest")
    if truth:
        tracks = dataset.tracks
        seen = tracks[(tracks["frame"] == frame) & (tracks["visible"] == 1)]
        least, most = dataset.depth_range_um
        marks = axes.scatter(
            seen["x_px"], seen["y_px"], c=seen["z_um"], vmin=least, vmax=most, cmap="viridis", s=30, marker="+"
        )
        figure.colorbar(marks, label="z, um", shrink=0.8)
    axes.set(xlim=(0.5, columns + 0.5), ylim=(rows + 0.5, 0.5), xlabel="x, px", ylabel="y, px")
    axes.set_title(f"{dataset.name}, frame {frame}")
    return figure


def curve(scores: Scores, quantity: str, against: str) -> Axes:
    """A quantity as a function of a property of the true particles."""
    import matplotlib.pyplot as plt

    table = scores.curve(against)
    if quantity not in table:
        raise ValueError(f"quantity = {quantity!r}: expected one of {', '.join(table.columns)}")
    closed = np.isfinite(table["to"])
    middle = 0.5 * (table["from"] + table["to"])[closed]
    _, axes = plt.subplots(figsize=(6, 3.5), layout="constrained")
    axes.plot(middle, table[quantity][closed], marker="o", markersize=3)
    axes.set(xlabel=against.replace("_", ", "), ylabel=quantity.replace("_", " "))
    axes.grid(alpha=0.3)
    return axes
