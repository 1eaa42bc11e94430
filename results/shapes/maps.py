"""Bounds of the axes of spheroids over depth and tilt, from `microsig optics --spheroids`.

    python maps.py TITLE=bounds.csv [TITLE=bounds.csv ...] --svg maps.svg

needs numpy, pandas and matplotlib.
"""

import argparse

import matplotlib
import numpy as np
import pandas as pd

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.colors import LogNorm

parser = argparse.ArgumentParser()
parser.add_argument("tables", nargs="+")
parser.add_argument("--svg", required=True)
args = parser.parse_args()

panels = []
for item in args.tables:
    title, file = item.split("=", 1)
    for e_p, table in pd.read_csv(file).groupby("e_p"):
        panels.append((f"{title}, aspect ratio {e_p:g}", table))
fig, axes = plt.subplots(2, len(panels), figsize=(3.4 * len(panels), 5.6), sharey=True, layout="constrained", squeeze=False)
for column, (title, table) in enumerate(panels):
    # At an SNR of 100 in each image.
    angle = table.assign(angle=table.crlb_axis_deg * table.snr / 100).pivot(index="tilt_deg", columns="z_um", values="angle")
    mirror = table.assign(mirror=table.mirror_sd * 100 / table.snr).pivot(index="tilt_deg", columns="z_um", values="mirror")
    for row, (values, norm, label) in enumerate(((angle, LogNorm(0.1, 10), "RMS angle, degrees"), (mirror, LogNorm(1, 1000), "mirrored tilt, sd"))):
        ax = axes[row][column]
        mesh = ax.pcolormesh(values.columns, values.index, np.clip(values.to_numpy(), norm.vmin, norm.vmax), norm=norm, cmap="viridis_r" if row == 0 else "viridis", shading="nearest", rasterized=True)
        if row == 0:
            ax.set_title(title, fontsize=9)
        else:
            ax.set_xlabel("z, um")
            ax.contour(values.columns, values.index, values.to_numpy(), levels=[4], colors="w", linewidths=1)
        if column == 0:
            ax.set_ylabel("tilt, degrees")
        if column == len(panels) - 1:
            fig.colorbar(mesh, ax=axes[row], label=label)
fig.suptitle("At a peak of 100 times the noise: Cramer-Rao bound of the axis, and separation of the two tilt signs (white: 4 sd)", fontsize=9, wrap=True)
fig.savefig(args.svg)
