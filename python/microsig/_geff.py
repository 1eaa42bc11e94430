"""Tracks in GEFF, the graph exchange file format (Zarr; github.com/live-image-tracking-tools/geff); needs ``zarr``."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._arguments import optional, real
from ._table import Table

#: um in units of length.
_UM = {"micrometer": 1.0, "um": 1.0, "µm": 1.0, "micron": 1.0, "nanometer": 1e-3, "nm": 1e-3, "millimeter": 1e3, "mm": 1e3}
_PIXELS = ("pixel", "px", "pix")


def read_geff(path: str | os.PathLike[str], *, um_per_px: float | None = None) -> Table:
    """Read the tracks of a GEFF graph, as LapTrack, TrackMate, ultrack, motile and others write them, for :func:`evaluate`.

    Axes x and y are array indices (the first pixel's center at 0) or lengths from there; time is the number of the frame.
    Tracks are the graph's tracklets, or else chains of edges: a node that divides or merges ends them.

    :param path: the folder of the graph
    :param um_per_px: object-space length of a pixel, um (:attr:`Dataset.um_per_px`), if axes have a unit of length
    :returns: ``frame, track, x_px, y_px [, z_um]``, with the first pixel's center at 1, sorted by frame and track
    :raises ImportError: without the package zarr
    :raises ValueError: no GEFF graph, axes that are missing, a unit that is not known, times that are no frames
    :raises OSError: the folder cannot be read
    """
    import zarr

    um_per_px = optional(real, "um_per_px", um_per_px, 1e-6, 1e6)
    name = os.fspath(path)
    if not os.path.isdir(name):
        raise FileNotFoundError(f"{name}: no such folder")
    try:
        group: Any = zarr.open_group(name, mode="r")
        about = dict(group.attrs)["geff"]
        ids = np.asarray(group["nodes/ids"])
    except (KeyError, ValueError, FileNotFoundError) as error:
        raise ValueError(f"{name}: expected a GEFF graph, with geff in its attributes and nodes/ids ({error})") from None
    axes = {axis["name"]: axis for axis in about.get("axes") or []}
    time = next((axis["name"] for axis in axes.values() if axis.get("type") == "time"), "t")
    columns: dict[str, NDArray[Any]] = {}

    def values(axis: str) -> NDArray[np.float64]:
        try:
            return np.asarray(group[f"nodes/props/{axis}/values"], dtype=np.float64)
        except KeyError:
            raise ValueError(f"{name}: nodes have no {axis}; expected axes {time}, y, x [, z]") from None

    times = values(time)
    if np.any(times != np.round(times)) or np.any(times < 0):
        raise ValueError(f"{name}: {time} = {times[times != np.round(times)][:1]}: expected numbers of frames, from 0")
    columns["frame"] = times.astype(np.int64)
    columns["track"] = _tracks(group, about, ids)
    for axis in ("x", "y"):
        unit = str(axes.get(axis, {}).get("unit") or "pixel").lower()
        scale = 1.0
        if unit in _UM:
            if um_per_px is None:
                raise ValueError(f"um_per_px = None: {name} has {axis} in {unit}; expected the size of a pixel, um")
            scale = _UM[unit] / um_per_px
        elif unit not in _PIXELS:
            raise ValueError(f"{name}: {axis} in {unit}: expected one of {', '.join([*_UM, *_PIXELS])}")
        columns[f"{axis}_px"] = values(axis) * scale + 1.0
    if "z" in axes:
        unit = str(axes["z"].get("unit") or "micrometer").lower()
        if unit not in _UM:
            raise ValueError(f"{name}: z in {unit}: expected one of {', '.join(_UM)}")
        columns["z_um"] = values("z") * _UM[unit]
    order = np.lexsort((columns["track"], columns["frame"]))
    return Table({column: array[order] for column, array in columns.items()}, name=name)


def _tracks(group: Any, about: dict[str, Any], ids: NDArray[Any]) -> NDArray[np.int64]:
    """The number of the track of every node."""
    tracklet = (about.get("track_node_props") or {}).get("tracklet")
    if tracklet is not None:
        return np.asarray(group[f"nodes/props/{tracklet}/values"], dtype=np.int64)
    edges = np.asarray(group["edges/ids"]).reshape(-1, 2) if "edges/ids" in group else np.empty((0, 2), ids.dtype)
    index = {int(node): k for k, node in enumerate(ids)}
    ends = np.array([[index[int(a)], index[int(b)]] for a, b in edges], dtype=np.int64).reshape(-1, 2)
    out, into = np.bincount(ends[:, 0], minlength=len(ids)), np.bincount(ends[:, 1], minlength=len(ids))
    after = {int(a): int(b) for a, b in ends if out[a] == 1 and into[b] == 1}
    tracks = np.full(len(ids), -1, dtype=np.int64)
    starts = sorted(set(range(len(ids))) - set(after.values()))
    for number, node in enumerate(starts):
        at: int | None = node
        while at is not None:
            tracks[at] = number
            at = after.get(at)
    return tracks
