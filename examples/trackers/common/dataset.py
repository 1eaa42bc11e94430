"""A microsig dataset folder, read the way a participant sees it (never `truth/`), and results in microsig's own CSV.

Arrays are indexed [row, column] = [y, x] from 0; results are written with the first pixel's center at (1, 1).
"""

import csv
import json
import math
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tifffile

NAME = re.compile(r"(frame|pair|burst)_(\d+)(?:_([a-d]))?\.tiff?$")


def fail(text):
    """Exits with a message and exit code 2."""
    print(f"error: {text}", file=sys.stderr)
    raise SystemExit(2)


@dataclass
class Frame:
    number: int  # as in results, from 0
    group: int | None  # number of its pair or burst; None in a sequence
    role: str  # a, b, c, d; empty in a sequence
    path: Path

    def image(self):
        """The image as float32, [y, x]."""
        return tifffile.imread(self.path).astype(np.float32)


@dataclass
class Dataset:
    folder: Path
    frames: list[Frame]
    manifest: dict = field(repr=False)

    @classmethod
    def open(cls, folder):
        folder = Path(folder)
        if not (folder / "images").is_dir():
            fail(f"{folder} has no folder images: is it a microsig dataset?")
        manifest = {}
        if (folder / "datapackage.json").exists():
            manifest = json.loads((folder / "datapackage.json").read_text()).get("microsig", {})
        # Test splits have a table of frames. In other datasets, the names of the images give the same
        # information in the same order.
        frames = []
        if (folder / "frames.csv").exists():
            with open(folder / "frames.csv", newline="") as file:
                names = [row["image"].split("/")[-1] for row in csv.DictReader(file)]
        else:
            names = sorted(path.name for path in (folder / "images").iterdir() if NAME.match(path.name))
        for number, name in enumerate(names):
            match = NAME.match(name)
            if not match:
                fail(f"{name} is not named like an image of a dataset (frame_00000.tif, pair_00000_a.tif)")
            kind, group, role = match.groups()
            frames.append(Frame(number, None if kind == "frame" else int(group), role or "", folder / "images" / name))
        if not frames:
            fail(f"{folder}/images has no images")
        return cls(folder, frames, manifest)

    @property
    def depth_range(self):
        """(low, high) in um."""
        if "depth_range_um" not in self.manifest:
            fail(f"{self.folder}/datapackage.json states no depth range")
        return tuple(self.manifest["depth_range_um"])

    @property
    def settings(self):
        """The numbers of settings.txt."""
        values = {}
        for line in (self.folder / "settings.txt").read_text().splitlines():
            name, _, value = line.partition("=")
            try:
                values[name.strip()] = float(value)
            except ValueError:
                pass
        return values

    def groups(self):
        """Frames that belong together in time: one list for a sequence, one for each pair or burst."""
        lists = {}
        for frame in self.frames:
            lists.setdefault(frame.group, []).append(frame)
        return list(lists.values())

    def calibration(self):
        """Depths (um, ascending), images [step, y, x], and the particle's center (x, y) counted from 0.

        For several particle sizes, the stack of the middle size, because these trackers support one size.
        """
        table = self.folder / "calibration" / "calibration.csv"
        if not table.exists():
            fail(f"{self.folder} has no calibration stack (calibration/calibration.csv)")
        with open(table, newline="") as file:
            rows = sorted(csv.DictReader(file), key=lambda row: float(row["z_um"]))
        sizes = sorted({float(row["d_um"]) for row in rows if "d_um" in row})
        if len(sizes) > 1:
            d_um = sizes[len(sizes) // 2]
            rows = [row for row in rows if float(row["d_um"]) == d_um]
            print(f"calibration of {d_um:g} um for particles of {sizes[0]:g} to {sizes[-1]:g} um", file=sys.stderr)
        z = np.array([float(row["z_um"]) for row in rows])
        images = np.array([tifffile.imread(self.folder / row["image"]) for row in rows], dtype=np.float32)
        center = (float(rows[0]["x_px"]) - 1, float(rows[0]["y_px"]) - 1)
        return z, images, center


def noise(image):
    """Background and its standard deviation, from median and median absolute deviation."""
    background = float(np.median(image))
    return background, max(1.4826 * float(np.median(np.abs(image - background))), 1e-6)


def smooth_noise(image, sigma):
    """The same after a Gaussian filter of width sigma; for white noise, the standard deviation is lower."""
    background, deviation = noise(image)
    return background, deviation / (2 * math.sqrt(math.pi) * sigma)


def write_points(path, rows):
    """Rows of (frame, track or None, x, y[, z_um[, axis_x, axis_y, axis_z]]), x and y counted from 0."""
    rows = [row for row in rows if all(math.isfinite(value) for value in row[2:])]
    more = ["z_um", "axis_x", "axis_y", "axis_z"][: max((len(row) - 4 for row in rows), default=0)]
    with open(path, "w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["frame", "track", "x_px", "y_px", *more])
        for frame, track, x, y, *values in rows:
            track = -1 if track is None else int(track)
            out.writerow([int(frame), track, f"{x + 1:.4f}", f"{y + 1:.4f}"] + [f"{value:.4f}" for value in values])


def write_field(path, rows):
    """Rows of (pair, x, y, dx, dy, flag), x and y counted from 0; flag 0 valid, 1 invalid, 2 replaced."""
    with open(path, "w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["pair", "x_px", "y_px", "dx_px", "dy_px", "flag"])
        for pair, x, y, dx, dy, flag in rows:
            if not (math.isfinite(dx) and math.isfinite(dy)):
                dx, dy, flag = 0.0, 0.0, 1
            out.writerow([pair, f"{x + 1:.4f}", f"{y + 1:.4f}", f"{dx:.4f}", f"{dy:.4f}", flag])
