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
_UM |= {"centimeter": 1e4, "cm": 1e4, "meter": 1e6, "m": 1e6, "inch": 25_400.0}
_PIXELS = ("pixel", "px", "pix")


def read_geff(path: str | os.PathLike[str], *, um_per_px: float | None = None) -> Table:
    """Read the tracks of a GEFF graph, as LapTrack, TrackMate, ultrack, motile and others write them, for :func:`evaluate`.

    Axes x and y are array indices (the first pixel's center at 0) or lengths from there; time is the number of the frame.
    Tracks are the graph's tracklets, or else chains of edges: a node that divides or merges ends them.

    :param path: the folder of the graph
    :param um_per_px: object-space length of a pixel, um (:attr:`Dataset.um_per_px`), if axes have a unit of length
    :returns: ``frame, track, x_px, y_px [, z_um]``, with the first pixel's center at 1, sorted by frame and track; NaN where a
        coordinate is missing
    :raises ImportError: without the package zarr
    :raises ValueError: no GEFF graph, axes that are missing, a unit that is not known, times that are no frames,
        edges to nodes that do not exist
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
    of_time = [axis["name"] for axis in axes.values() if axis.get("type") == "time"]
    if len(of_time) > 1 or len(axes) < len(about.get("axes") or []):
        raise ValueError(f"{name}: axes {[axis['name'] for axis in about['axes']]}: expected one of each name, and one of time")
    time = (of_time or ["t"])[0]
    columns: dict[str, NDArray[Any]] = {}

    def values(prop: str) -> NDArray[np.float64]:
        """A property of the nodes, NaN where it is missing."""
        try:
            array = np.asarray(group[f"nodes/props/{prop}/values"])
        except KeyError:
            raise ValueError(f"{name}: nodes have no {prop}; expected axes {time}, y, x [, z]") from None
        if array.shape != ids.shape or array.dtype.kind not in "iuf":
            raise ValueError(f"{name}: {prop} of shape {array.shape} and type {array.dtype}: expected a number for each of {len(ids)} nodes")
        missing = f"nodes/props/{prop}/missing"
        return np.where(np.asarray(group[missing], dtype=bool), np.nan, array) if missing in group else array.astype(np.float64)

    times = values(time)
    wrong = times[~((times >= 0) & (times < 2**32 - 1) & (times == np.round(times)))]
    if len(wrong) > 0:
        raise ValueError(f"{name}: {time} = {wrong[0]}: expected numbers of frames, from 0")
    columns["frame"] = times.astype(np.int64)
    tracklet = (about.get("track_node_props") or {}).get("tracklet")
    columns["track"] = _tracks(name, group, ids) if tracklet is None else np.nan_to_num(values(tracklet), nan=-1).astype(np.int64)
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


def _tracks(name: str, group: Any, ids: NDArray[Any]) -> NDArray[np.int64]:
    """The number of the track of every node."""
    edges = np.asarray(group["edges/ids"]).reshape(-1, 2) if "edges/ids" in group else np.empty((0, 2), ids.dtype)
    index = {int(node): k for k, node in enumerate(ids)}
    unknown = sorted({int(node) for node in edges.ravel()} - set(index))
    if unknown or len(index) < len(ids):
        what = f"an edge to node {unknown[0]}, which does not exist" if unknown else "two nodes with one id"
        raise ValueError(f"{name}: {what}")
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
