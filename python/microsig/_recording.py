"""Recordings of one's own."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from ._arguments import flag, optional, real, whole
from ._dataset import Dataset, open
from ._progress import Progress
from ._verbs import Options

_Path = str | os.PathLike[str]


def import_recording(
    images: _Path | Sequence[_Path],
    scan: _Path | None,
    out: _Path,
    *,
    z: _Path | None = None,
    z_step_um: float | None = None,
    z_toward: bool = False,
    magnification: float | None = None,
    pixel_size_um: float | None = None,
    optics: _Path | None = None,
    dt_s: float | None = None,
    pairs: bool = False,
    pages_per_time: int | None = None,
    page: int | None = None,
    truth: _Path | Sequence[_Path] = (),
    all_particles: bool = False,
    dark: _Path | None = None,
    flat: _Path | None = None,
    field: int = 1,
    particles: int = 6,
    window_px: int | None = None,
    copy: bool = False,
    force: bool = False,
    progress: Progress = False,
) -> Dataset:
    """Make a folder like a dataset's from recorded images, with a calibration scan or without, as ``microsig import`` does, and open it.

    :param images: TIFF files of 8 or 16 bit with one page or many, folders, or names with ``*`` and ``?``
    :param scan: the calibration scan: a file of pages, or a folder; None: images in focus, for ``piv`` and ``spots``
    :param out: the new folder
    :param z: stage positions of the scan: a CSV file with ``page`` (from 0) or ``image``, and ``z_um``
    :param z_step_um: step of the stage between planes, instead of ``z``
    :param z_toward: stage positions increase toward the lens
    :param magnification: magnification of the microscope, with ``pixel_size_um``; by default from ``optics``
    :param pixel_size_um: edge of a pixel on the sensor, um
    :param optics: a scenario with the optics, such as ``microsig fit`` writes; for ``mle``
    :param dt_s: time between frames, or between the frames of a pair, s
    :param pairs: frames 2k and 2k + 1 are an image pair; files whose names differ in a and b only are paired by these
    :param pages_per_time: pages of a file that belong to one time; by default as the file says
    :param page: which of these is the image, from 0; also the channel of a scan that states several
    :param truth: CSV files with ``frame, z_um`` (heights of planes) or ``frame, x_px, y_px`` (positions of particles)
    :param all_particles: the known positions are those of all particles of their frames
    :param dark: an image without light, of one page or many
    :param flat: an image of uniform light, of one page or many
    :param field: calibration stacks at ``field`` x ``field`` places of the field of view
    :param particles: largest number of particles that are averaged to a stack
    :param window_px: width of the calibration images, px
    :param copy: copy images that could be linked
    :param force: replace an earlier folder
    :param progress: True for a bar on a terminal or in a notebook, a callable of (what, done, total), or tqdm
    :raises ValueError: input that cannot be used, by file, page or line, and value
    :raises FileExistsError: the folder exists
    :raises OSError: a file cannot be read or written
    """
    if (magnification is None) != (pixel_size_um is None):
        raise ValueError("magnification and pixel_size_um: expected both or neither")
    options = (
        Options("import")
        .add("images", _paths(images))
        .add("scan", _path(scan))
        .add("z", _path(z))
        .add("z_step", optional(real, "z_step_um", z_step_um))
        .add("z_toward", flag("z_toward", z_toward))
        .add("magnification", optional(real, "magnification", magnification))
        .add("pixel_size", optional(real, "pixel_size_um", pixel_size_um))
        .add("optics", _path(optics))
        .add("dt", optional(real, "dt_s", dt_s))
        .add("pairs", flag("pairs", pairs))
        .add("pages_per_time", optional(whole, "pages_per_time", pages_per_time, 1, 2**31))
        .add("page", optional(whole, "page", page, 0, 2**31))
        .add("truth", _paths(truth))
        .add("all_particles", flag("all_particles", all_particles))
        .add("dark", _path(dark))
        .add("flat", _path(flat))
        .add("field", whole("field", field, 1, 9))
        .add("particles", whole("particles", particles, 1, 1000))
        .add("window", optional(whole, "window_px", window_px, 11, 1023))
        .add("copy", flag("copy", copy))
        .add("force", flag("force", force))
        .add("out", Path(out))
    )
    options.call(progress=progress)
    return open(out)


def _path(path: _Path | None) -> Path | None:
    return None if path is None else Path(path)


def _paths(paths: _Path | Sequence[_Path]) -> list[Path]:
    return [Path(paths)] if isinstance(paths, (str, os.PathLike)) else [Path(path) for path in paths]
