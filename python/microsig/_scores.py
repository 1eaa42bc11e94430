"""Trackers, scores, comparisons, sweeps."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Union

import numpy as np
from numpy.typing import NDArray

from . import _microsig, _scenario
from ._arguments import LAST_SEED, flag, interval, one_of, optional, real, whole
from ._dataset import Dataset, generate
from ._progress import Progress, shown
from ._table import Table, plain

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: A tracker's result: a file, a table, a pandas or polars data frame, or a dict of columns.
Result = Union[str, "os.PathLike[str]", Table, Mapping[str, Any], Any]


class Scores:
    """Scores of a result: the keys of ``score.json`` are attributes.

    ``scores.detection.f1``, ``scores["isbi"]["jsc"]``; a score that is not defined is None. ``print(scores)`` shows the
    command's table. :attr:`curves` are recall and errors over depth, SNR, overlap and the distance of the nearest neighbor.
    """

    def __init__(self, scored: _microsig.Scored) -> None:
        """Use :func:`evaluate`."""
        self._scored = scored
        self._scores = scored.scores()

    def __getattr__(self, name: str) -> Any:
        scores = self.__dict__.get("_scores", {})
        if name in scores:
            return _Part.of(scores[name])
        raise AttributeError(f"no score {name}; there are {', '.join(scores)}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._scores]

    def __getitem__(self, name: str) -> Any:
        return self._scores[name]

    def keys(self) -> Sequence[str]:
        """Names of the groups of scores."""
        return list(self._scores)

    @property
    def json(self) -> str:
        """The bytes of ``score.json`` as the command writes it."""
        return self._scored.json()

    def to_dict(self) -> dict[str, Any]:
        """All scores, as in ``score.json``."""
        return self._scored.scores()

    def to_pandas(self) -> pandas.DataFrame:
        """All single numbers: columns ``score`` (``detection.f1``) and ``value``; raises ImportError without pandas."""
        import pandas

        rows = list(_numbers("", self._scores))
        return pandas.DataFrame({"score": [row[0] for row in rows], "value": [row[1] for row in rows]})

    def curve(self, against: str) -> Table:
        """Recall and errors in bins of a property of the true particles.

        :param against: ``z_um``, ``neighbor_px``, ``snr``, ``overlap``, if the truth has it
        :returns: a table with ``from``, ``to``, ``n_true``, ``tp``, ``recall``, ``bias_x_px``, ...
        :raises ValueError: there is no such curve
        """
        curves = {curve["against"]: curve["bins"] for curve in self._scores.get("curves", [])}
        if against not in curves:
            raise ValueError(f"against = {against!r}: expected one of {', '.join(curves) or 'none here'}")
        bins = curves[against]
        names = list(bins[0]) if bins else []
        columns = {n: np.array([_number(b[n], n) for b in bins], dtype=np.float64) for n in names}
        return Table(columns, name=f"curve against {against}")

    def plot(self, quantity: str = "recall", against: str = "z_um") -> Axes:
        """Plot a quantity over a property of the true particles; needs matplotlib.

        :param quantity: ``recall``, ``rms_x_px``, ``rms_z_um``, ``bias_z_um``, ...: a column of :meth:`curve`
        :param against: as of :meth:`curve`
        """
        from . import _plots

        return _plots.curve(self, quantity, against)

    def __repr__(self) -> str:
        return self._scored.table()

    def _repr_html_(self) -> str:
        from html import escape

        return f"<pre>{escape(repr(self))}</pre>"


def _number(value: Any, name: str) -> float:
    if value is None:
        return float("inf") if name == "to" else float("nan")
    return float(value)


def _numbers(path: str, value: Any) -> Iterator[tuple[str, float]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _numbers(f"{path}.{name}" if path else name, inner)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield path, float(value)


class _Part:
    """A group of scores, with its keys as attributes."""

    def __init__(self, values: dict[str, Any]) -> None:
        self._values = values

    @staticmethod
    def of(value: Any) -> Any:
        return _Part(value) if isinstance(value, dict) else value

    def __getattr__(self, name: str) -> Any:
        values = self.__dict__.get("_values", {})
        if name in values:
            return _Part.of(values[name])
        raise AttributeError(f"no score {name}; there are {', '.join(values)}")

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._values]

    def __repr__(self) -> str:
        return ", ".join(f"{name}: {value}" for name, value in self._values.items())


def _columns(result: Any) -> list[tuple[str, Any]]:
    """Columns of a table of whatever kind. Names may recur, as after ``set_index("frame", drop=False)``: the compiled part
    refuses columns that it reads and that differ."""
    if isinstance(result, Table):
        return list(result.origin(1).items())
    if isinstance(result, Mapping):
        return [(str(name), values) for name, values in result.items()]
    if hasattr(result, "iloc"):
        columns = [(str(name), result.iloc[:, k]) for k, name in enumerate(result.columns)]
        levels = [(str(name), result.index.get_level_values(k)) for k, name in enumerate(result.index.names) if name is not None]
        return columns + levels
    if hasattr(result, "columns"):
        return [(str(name), result[name]) for name in result.columns]
    raise TypeError(f"a result is a path, a table, a data frame or a dict, not {type(result).__name__}")


def _given(result: Any) -> list[tuple[str, NDArray[Any] | list[str]]]:
    columns = [(name, plain(f"result: {name}", values)) for name, values in _columns(result)]
    if not columns:
        raise ValueError("result: no columns; expected frame, track, x_px, y_px [, z_um] or x_px, y_px, dx_px, dy_px")
    if len({len(values) for _, values in columns}) > 1:
        lengths = ", ".join(f"{name} {len(values)}" for name, values in columns)
        raise ValueError(f"result: columns of different lengths: {lengths}")
    return columns


def _place(dataset: Dataset | str | os.PathLike[str]) -> _microsig.Made | Path:
    return dataset._source.place() if isinstance(dataset, Dataset) else Path(dataset)


def evaluate(
    dataset: Dataset | str | os.PathLike[str],
    result: Result,
    *,
    format: str | None = None,
    gate: Literal["radial", "ellipsoid", "box"] | None = None,
    gate_xy_px: float | None = None,
    gate_z_um: float | None = None,
    dims: Literal[2, 3] | None = None,
    isbi_gate_px: float | None = None,
    border_px: float = 0.0,
    origin: Literal["center1", "center0", "corner0", "middle"] | None = None,
    unit: str | None = None,
    y: Literal["down", "up"] | None = None,
    shift_px: tuple[float, float] = (0.0, 0.0),
    frame_base: int | None = None,
    um_per_px: float | None = None,
    dt_s: float | None = None,
    pair: int | Literal["all"] | None = None,
    depth_um: tuple[float, float] | None = None,
    plane_um: float | None = None,
    auto_offset: bool = False,
    crlb: bool = False,
    seed: int = 0,
) -> Scores:
    """Score a tracker's result against the truth: the numbers of ``microsig evaluate``, to the last digit.

    :param dataset: a dataset, its folder, or a bare table of the truth
    :param result: a file of any format that the command reads; a folder or pattern of files with a field for each image pair;
        or columns of particles ``frame, track, x_px, y_px [, z_um]``
        (track -1: not linked) or of a field ``x_px, y_px, dx_px, dy_px [, dz_um] [, flag] [, pair]``, as a table, a data frame
        or a dict of arrays. trackpy's data frames (``frame, x, y, particle``) are recognized too. Masked values are missing
        ones; a data frame's index counts as a column if it has a name.
    :param format: the result's format, by default from its header
    :param gate: shape of the gate, by default ellipsoid with depth, radial without
    :param gate_xy_px: radius of the gate in the image plane, px, of a box half its width, by default the dataset's, or 2
    :param gate_z_um: half height of the gate, um, by default the dataset's, or a tenth of the depth range
    :param dims: score in 2 or 3 dimensions, by default as the dataset states, or 3 if truth and result have a depth
    :param isbi_gate_px: radius of the gate of the ISBI scores, px, by default 5
    :param border_px: do not score particles this near to the edge of the image, px
    :param origin: where the result has the first pixel's center, by default as usual in its format
    :param unit: unit of x and y in the result (``px``, ``um``, ``mm``, ...), by default as stated in it or usual in its format
    :param y: which way y grows in the result
    :param shift_px: added to x and y in the image, px, for a result with an origin of its own
    :param frame_base: number of the result's first frame
    :param um_per_px: object-space length of a pixel, um, for a bare table. A file of a field that states no units is then in m,
        mm or um
    :param dt_s: time between the frames of a pair, s. A file of a field that states no units then has velocities per s
    :param pair: image pair of a field whose file does not state it, or of the first of several files; "all" for a field of all
        pairs (ensemble correlation)
    :param depth_um: depth range in which particles are scored, um, by default the dataset's; needed for a bare table
    :param plane_um: score a field against the plane of the truth nearest to this depth, um
    :param auto_offset: report which shift of the whole result would fit best; it is never applied
    :param crlb: add the Cramer-Rao bound of the optics
    :param seed: seed of the bootstrap
    :raises ValueError: a result that cannot be read or does not fit, with line (the header is line 1) and value; another
        argument out of its range
    :raises TypeError: an argument of another kind
    :raises OSError: a file that cannot be read
    """
    how: _microsig.How = {
        # The compiled part knows the names.
        "format": None if format is None else str(format),
        "gate": optional(one_of, "gate", gate, ("radial", "ellipsoid", "box")),
        "gate_xy_px": optional(real, "gate_xy_px", gate_xy_px),
        "gate_z_um": optional(real, "gate_z_um", gate_z_um),
        "dims": optional(one_of, "dims", dims, (2, 3)),
        "isbi_gate_px": optional(real, "isbi_gate_px", isbi_gate_px),
        "border_px": real("border_px", border_px),
        "origin": optional(one_of, "origin", origin, ("center1", "center0", "corner0", "middle")),
        "unit": None if unit is None else str(unit),
        "y_up": None if y is None else one_of("y", y, ("down", "up")) == "up",
        "shift_px": interval("shift_px", shift_px, "expected two numbers"),
        "frame_base": optional(whole, "frame_base", frame_base, -(2**31), 2**31),
        "um_per_px": optional(real, "um_per_px", um_per_px),
        "dt_s": optional(real, "dt_s", dt_s),
        "pair": None if pair is None else "all" if pair == "all" else str(whole("pair", pair, 0, 2**31)),
        "depth_um": optional(interval, "depth_um", depth_um),
        "plane_um": optional(real, "plane_um", plane_um),
        "auto_offset": flag("auto_offset", auto_offset),
        "crlb": flag("crlb", crlb),
        "seed": whole("seed", seed, 0, LAST_SEED),
    }
    given = Path(result) if isinstance(result, (str, os.PathLike)) else _given(result)
    return Scores(_microsig.evaluate(_place(dataset), given, how))


def methods() -> dict[str, str]:
    """The methods of :func:`track`, by name: what each measures, and how."""
    return dict(_microsig.methods())


def track(
    dataset: Dataset | str | os.PathLike[str],
    method: str = "ncc",
    *,
    max_displacement_px: float = 15.0,
    diameter_px: float = 3.0,
    noise_xy_px: float = 0.1,
    noise_z_um: float = 1.0,
    ensemble: bool = False,
    shape: Literal["sphere", "spheroid"] = "sphere",
    aspect_ratio: float | Literal["common", "each"] | None = None,
    fit_diameter: bool = False,
    positions: str | os.PathLike[str] | None = None,
    seed: int = 0,
    progress: Progress = False,
) -> Table:
    """The result of a baseline tracker, as of ``microsig track``.

    :param dataset: a dataset or its folder
    :param method: one of :func:`methods`
    :param max_displacement_px: largest displacement from frame to frame, px
    :param diameter_px: diameter of a particle image (``spots``), px
    :param noise_xy_px: standard deviation of the noise in x and y (``truth-noise``), px
    :param noise_z_um: the same in z, um
    :param ensemble: one field for all pairs of a steady flow (``piv``)
    :param shape: ``spheroid``: also measure the axis (``ncc``, ``mle``)
    :param aspect_ratio: polar over equatorial diameter of spheroids: 0.1 to 10; ``common`` (as if None), measured by the
        clearest particles; or ``each`` particle its own
    :param fit_diameter: fit the diameter of each sphere, from half the smallest to twice the largest calibrated one (``mle``)
    :param positions: CSV file with the columns ``x_px`` and ``y_px`` of particles whose depth is measured in all frames, or
        only in those of its column ``frame``; other particles are not searched for (``ncc``, ``mle``)
    :param seed: seed of that noise
    :param progress: True for a bar on a terminal or in a notebook, a callable of (what, done, total), or tqdm
    :returns: ``frame, track, x_px, y_px [, z_um]`` of particles, or ``x_px, y_px, dx_px, dy_px, ...`` of a field; of
        spheroids also axes and, of ``mle``, standard deviations and a second axis that fits
    :raises ValueError: an unknown method, an option out of range, a dataset without what the method needs
    :raises TypeError: an option of another kind
    """
    method = one_of("method", method, tuple(methods()))
    options = (
        real("max_displacement_px", max_displacement_px),
        real("diameter_px", diameter_px),
        real("noise_xy_px", noise_xy_px),
        real("noise_z_um", noise_z_um),
        flag("ensemble", ensemble),
        one_of("shape", shape, ("sphere", "spheroid")) == "spheroid",
        _aspect(aspect_ratio),
        flag("fit_diameter", fit_diameter),
        None if positions is None else Path(positions),
        whole("seed", seed, 0, LAST_SEED),
        shown(progress),
    )
    if aspect_ratio is not None and shape != "spheroid":
        raise ValueError("aspect_ratio: expected with shape = 'spheroid'")
    columns, warned = _microsig.track(_place(dataset), method, *options)
    for warning in warned:
        warnings.warn(warning, stacklevel=2)
    return Table(columns, name=f"result of {method}")


def _aspect(ratio: object) -> float | str:
    if ratio is None or isinstance(ratio, str):
        return one_of("aspect_ratio", "common" if ratio is None else ratio, ("common", "each"))
    return real("aspect_ratio", ratio)


class Comparison:
    """A leaderboard of scores, best first."""

    def __init__(self, entries: list[dict[str, Any]], warnings: list[str], text: str) -> None:
        """Use :func:`compare`."""
        #: One dict for every score: rank, name, dataset, f1, ...
        self.entries = entries
        #: What must be known to read it.
        self.warnings = warnings
        self._text = text

    def to_pandas(self) -> pandas.DataFrame:
        """The entries as a pandas data frame; raises ImportError without pandas."""
        import pandas

        return pandas.DataFrame(self.entries)

    def __repr__(self) -> str:
        return self._text

    def _repr_html_(self) -> str:
        from html import escape

        return f"<pre>{escape(self._text)}</pre>"


def compare(scores: Mapping[str, Scores]) -> Comparison:
    """Rank scores, as ``microsig compare`` does.

    :param scores: scores by the name of their trackers
    :raises ValueError: no scores
    :raises TypeError: anything but a dict of :class:`Scores`
    """
    allowed = "expected a dict of what evaluate() returns, by the names of trackers"
    if not isinstance(scores, Mapping):
        raise TypeError(f"scores of type {type(scores).__name__}: {allowed}")
    for name, score in scores.items():
        if not isinstance(score, Scores):
            raise TypeError(f"scores: {name!r} is of type {type(score).__name__}: {allowed}")
    if not scores:
        raise ValueError(f"scores = {{}}: {allowed}, at least one")
    entries, warnings, text = _microsig.compare([(name, score._scored) for name, score in scores.items()])
    return Comparison(entries, warnings, text)


def sweep(path: str | os.PathLike[str], seed: int | None = None) -> Iterator[tuple[dict[str, Any], Dataset]]:
    """The datasets of a sweep, one after the other, in memory.

    >>> for values, ds in ms.sweep("noise_density_sweep"): ...   # doctest: +SKIP

    :param path: the sweep's file, the name of a shipped one, or its text, whose base scenario is then relative to the working folder
    :param seed: seed, by default the sweep's
    :returns: pairs of values by path (with ``case``, ``repetition`` and ``seed``; variants such as ``constant(2)`` are dicts) and dataset
    :raises ValueError: a sweep that cannot be used, before the first case; a case that cannot be made
    """
    given = _scenario.text(path, seed)
    cases = _microsig.sweep(given["text"], given["name"], given["folder"], given["seed"])
    return _cases(cases)


def _cases(cases: _microsig.SweepCases) -> Iterator[tuple[dict[str, Any], Dataset]]:
    axes = cases.axes()
    for index, (name, given, repetition, seed) in enumerate(cases.cases()):
        values: dict[str, Any] = dict(zip(axes, given)) | {"case": name, "repetition": repetition, "seed": seed}
        yield values, Dataset.of_made(cases.generate(index))


__all__ = ["Comparison", "Scores", "compare", "evaluate", "generate", "methods", "sweep", "track"]
