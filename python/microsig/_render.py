"""Images of particles given as arrays."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _microsig
from ._arguments import LAST_SEED, flag, floats, one_of, whole
from ._table import Table

#: MicroSIG's settings: the path of a settings file, its text, or a dict with its 14 names.
Settings = Union[str, "os.PathLike[str]", Mapping[str, float]]

#: Columns of a table of particles, in the order of a data file.
_COLUMNS = ("x_px", "y_px", "z_um", "d_um", "e_p", "alpha_rad", "beta_rad", "c_int")


def _settings(settings: Settings) -> tuple[str, str]:
    """Text of a settings file, and its name in messages."""
    if isinstance(settings, Mapping):
        return "".join(f"{name} = {value}\n" for name, value in settings.items()), "settings"
    if isinstance(settings, str) and ("\n" in settings or ("=" in settings and not os.path.exists(settings))):
        return settings, "settings"
    path = Path(settings)
    return _microsig.read_settings(path), str(path)


def _particles(particles: Any) -> NDArray[np.float64]:
    """Rows of a data file: (n, 4, 5, 7 or 8)."""
    if isinstance(particles, Table):
        particles = particles.origin(1).to_dict()
    columns: Any = particles.keys() if isinstance(particles, Mapping) else getattr(particles, "columns", None)
    if columns is not None:
        names = {str(name) for name in columns}
        # The truth of spheres has these columns too; a spheroid of aspect ratio 1 emits according to a
        # different law from a sphere.
        spheroids = {"e_p", "alpha_rad", "beta_rad"} <= names and bool(np.any(np.asarray(particles["e_p"]) != 1))
        used = [c for c in _COLUMNS[:4]]
        used += [c for c in _COLUMNS[4:7] if spheroids]
        used += [c for c in _COLUMNS[7:] if c in names]
        missing = [c for c in used if c not in names]
        if missing:
            raise ValueError(f"particles: columns {', '.join(missing)} are missing")
        rows = np.column_stack([floats(f"particles: {c}", particles[c]) for c in used])
        if "c_int" in used and "light" in names:
            rows[:, -1] *= floats("particles: light", particles["light"])
    else:
        rows = floats("particles", particles)
    if rows.ndim != 2 or rows.shape[1] not in (4, 5, 7, 8):
        raise ValueError(f"particles of shape {rows.shape}: expected (n, 4), (n, 5), (n, 7) or (n, 8)")
    return np.ascontiguousarray(rows)


def render(
    settings: Settings,
    particles: ArrayLike | Table | Mapping[str, ArrayLike],
    mode: Literal["rays", "expected"] = "rays",
    seed: int = 0,
    *,
    frame: int = 0,
    spheroids: Literal["original", "uniform"] = "original",
    round_once: bool = False,
    image_format: Literal["integer", "float32"] = "integer",
) -> NDArray[np.uint16] | NDArray[np.float32]:
    """Render an image of particles, as ``microsig render`` does.

    :param settings: path or text of a MicroSIG settings file, or a dict of its 14 names (as ``Dataset.settings``)
    :param particles: (n, 4): x (px), y (px), z (um, depth in MicroSIG's sense), d (um); (n, 5): also c_int;
        (n, 7): x, y, z, d, e_p, alpha (rad), beta (rad); (n, 8): also c_int; or a table, data frame or dict with columns
        ``x_px, y_px, z_um, d_um [, e_p, alpha_rad, beta_rad] [, c_int [, light]]``, as rows of ``Dataset.tracks`` (where
        ``depth_factor`` is 1). The first pixel's center is (1, 1).
    :param mode: ``rays`` counts discrete rays, the paper's method; ``expected`` is the limit of many rays
    :param seed: seed of rays and noise, 0 to 2^64 - 1
    :param frame: number of the frame; it selects the random numbers
    :param spheroids: which points of a spheroid emit light: as in MicroSIG's program, or uniform in area
    :param round_once: round once after adding noise, as in datasets; MicroSIG's program rounds the noise separately
    :param image_format: ``float32`` returns counts before they are rounded and clamped to 16 bit
    :returns: uint16 (rows, columns), counts; float32 with ``image_format="float32"``
    :raises ValueError: settings or particles that cannot be rendered, with the number of the particle; another argument out
    of range
    :raises TypeError: particles or another argument of the wrong type
    """
    how = (
        one_of("mode", mode, ("rays", "expected")) == "expected",
        one_of("spheroids", spheroids, ("original", "uniform")) == "uniform",
        flag("round_once", round_once),
        one_of("image_format", image_format, ("integer", "float32")) == "float32",
    )
    seed, frame = whole("seed", seed, 0, LAST_SEED), whole("frame", frame, 0, 2**32 - 1)
    text, name = _settings(settings)
    rows = _particles(particles)
    image, said = _microsig.render(text, name, rows, *how, seed, frame)
    for warning in said:
        warnings.warn(warning, stacklevel=2)
    return image
