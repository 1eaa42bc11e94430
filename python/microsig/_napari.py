"""Datasets as layers of napari, and the reader of the plugin (``napari.yaml``). Nothing here needs napari."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ._dataset import Dataset

#: Data, arguments and kind of a layer.
Layer = tuple[Any, dict[str, Any], str]


def layers(dataset: Dataset) -> list[Layer]:
    """See :meth:`Dataset.to_napari`."""
    um = dataset.um_per_px
    in_plane = (um, um) if np.isfinite(um) else (1.0, 1.0)
    units = ("um", "um") if np.isfinite(um) else ("pixel", "pixel")
    made: list[Layer] = []

    def layer(data: Any, name: str, kind: str, **more: Any) -> None:
        made.append((data, {"name": name, "scale": (1.0, *in_plane), **more}, kind))

    low, high = np.percentile(dataset.images[0], [1.0, 99.8]) if len(dataset) else (0.0, 1.0)
    limits = (float(low), float(max(high, low + 1)))
    layer(dataset.images, dataset._title, "image", contrast_limits=limits, metadata={"units": ("frame", *units)})
    calibration = dataset.calibration
    if calibration is not None and calibration.d_um is None and "place" not in calibration.table:
        z = calibration.z_um
        step = float((z[-1] - z[0]) / (len(z) - 1)) if len(z) > 1 else 1.0
        arguments = {"name": "calibration", "scale": (step, *in_plane), "translate": (float(z[0]), 0.0, 0.0), "visible": False}
        arguments["metadata"] = {"units": ("um", *units)}
        made.append((calibration.images, arguments, "image"))
    tracks = dataset._known_tracks
    if tracks is not None:
        seen = tracks[tracks["visible"] == 1] if "visible" in tracks else tracks
        seen = seen[np.lexsort((seen["frame"], seen["track"]))].origin(0)
        data = np.column_stack([seen["track"], seen["frame"], seen["y_px"], seen["x_px"]]).astype(float)
        more = {"features": {"z_um": seen["z_um"]}} if "z_um" in seen else {}
        if len(data):
            layer(data, "truth", "tracks", tail_length=2, **more)
    return made


def get_reader(path: str | list[str]) -> Callable[[Any], list[Layer]] | None:
    """The reader of a dataset's folder or its ``datapackage.json``; None for everything else."""
    if isinstance(path, list):
        if len(path) != 1:
            return None
        path = path[0]
    folder = Path(path)
    folder = folder.parent if folder.name == "datapackage.json" else folder
    if not (folder / "datapackage.json").is_file() or not (folder / "SHA256SUMS").is_file():
        return None

    def read(_: Any) -> list[Layer]:
        from ._dataset import open

        return layers(open(folder))

    return read
