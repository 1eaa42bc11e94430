"""Datasets in memory and in folders."""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, Protocol, TypeVar, Union

import numpy as np
from numpy.typing import NDArray

from . import _microsig, _scenario
from ._arguments import flag, one_of, real, whole
from ._progress import Progress, shown
from ._scenario import Scenario
from ._table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A table from the compiled part: path, meaning of a row, (unit, meaning) by column, values by column.
_RawTable = tuple[str, str, dict[str, tuple[str, str]], dict[str, Any]]

_FRAMES, _TRACKS = "truth/frames.csv", "truth/tracks.csv"
#: The frames of a released test split, which has no ``truth/``.
_RELEASED_FRAMES = "frames.csv"
_DISPLACEMENTS, _FIELD, _DEPTH = "truth/displacements.csv", "truth/field.csv", "truth/depth.csv"
_BOXES = "truth/boxes.csv"


#: Counts of images: integers, or unrounded counts with ``image_format: float32``.
Images = Union[NDArray[np.uint16], NDArray[np.float32]]


_Array = TypeVar("_Array", bound=NDArray[Any])


class Calibration(NamedTuple):
    """The calibration scan of one particle; for several particle sizes, the scans of all sizes, one after the other."""

    #: uint16 (or float32, see :attr:`Dataset.images`) (steps, rows, columns): an image of the particle at
    #: each depth.
    images: Images
    #: float64 (steps,): depth of the particle in each image, um, growing away from the lens.
    z_um: NDArray[np.float64]
    #: ``calibration/calibration.csv``.
    table: Table
    #: float64 (steps,): diameter of the particle in each image, um; None if all particles have the same size.
    d_um: NDArray[np.float64] | None = None

    def of_size(self, d_um: float) -> Calibration:
        """The scan of the size nearest to this diameter, um."""
        if self.d_um is None:
            return self
        rows = self.d_um == self.d_um[np.argmin(np.abs(self.d_um - d_um))]
        return Calibration(_fixed(self.images[rows]), self.z_um[rows], self.table[rows], self.d_um[rows])

    def save(self, path: str | os.PathLike[str], um_per_px: float, *, format: str = "imagej-stack") -> None:
        """Write the scan as one TIFF file with pixel size and z step, which :func:`fit`, ImageJ and napari read.

        :param path: the file, which is replaced
        :param um_per_px: object-space length of a pixel, um (:attr:`Dataset.um_per_px`)
        :param format: ``imagej-stack`` or ``ome-tiff``
        :raises ValueError: several sizes of particles or places, which are several scans
        :raises OSError: the file cannot be written
        """
        if np.any(np.diff(self.z_um) <= 0):
            raise ValueError("several scans: expected one, as calibration.of_size(d_um)")
        ome = one_of("format", format, ("imagej-stack", "ome-tiff")) == "ome-tiff"
        um_per_px = real("um_per_px", um_per_px, 1e-6, 1e6)
        _microsig.write_stack(path, np.ascontiguousarray(self.images), um_per_px, self.z_um.tolist(), ome, "calibration")


def _table(raw: _RawTable) -> Table:
    path, about, columns_about, values = raw
    columns = {c: _fixed(np.asarray(v, dtype=str) if isinstance(v, list) else v) for c, v in values.items()}
    return Table(columns, name=path, about=about, columns_about=columns_about)


def _fixed(array: _Array) -> _Array:
    """The array, made read-only: datasets return the same array every time."""
    array.flags.writeable = False
    return array


class _Source(Protocol):
    """Location of a dataset."""

    def images(self) -> Images: ...
    def image(self, frame: int) -> Images: ...
    def frames(self) -> int: ...
    def table(self, path: str) -> Table | None: ...
    def calibration(self) -> Calibration | None: ...
    def scenario(self) -> tuple[dict[str, Any], str]: ...
    def settings(self) -> dict[str, float]: ...
    def facts(self) -> tuple[float, tuple[float, float], float, int]: ...
    def title(self) -> str: ...
    def warnings(self) -> list[str]: ...
    def save(self, out: Path, force: bool, show: _microsig._Show) -> None: ...
    def place(self) -> _microsig.Made | Path: ...


class _Memory:
    """A dataset in memory."""

    def __init__(self, made: _microsig.Made) -> None:
        self.made = made

    @cached_property
    def _images(self) -> Images:
        return self.made.images()

    def images(self) -> Images:
        return self._images

    def image(self, frame: int) -> Images:
        one: Images = self._images[frame]
        return one

    def frames(self) -> int:
        return len(self._images)

    @cached_property
    def _tables(self) -> dict[str, Table]:
        return {raw[0]: _table(raw) for raw in self.made.tables()}

    @cached_property
    def _field_tables(self) -> dict[str, Table]:
        return {raw[0]: _table(raw) for raw in self.made.field_tables()}

    def table(self, path: str) -> Table | None:
        tables = self._field_tables if path in (_FIELD, _DEPTH) else self._tables
        return tables.get(path)

    def calibration(self) -> Calibration | None:
        found = self.made.calibration()
        if found is None:
            return None
        table = _table(found[0])
        return Calibration(_fixed(found[1]), table["z_um"], table, table["d_um"] if "d_um" in table else None)

    def scenario(self) -> tuple[dict[str, Any], str]:
        return self.made.scenario()

    def settings(self) -> dict[str, float]:
        return self.made.settings()

    def facts(self) -> tuple[float, tuple[float, float], float, int]:
        return self.made.facts()

    def title(self) -> str:
        return str(self.scenario()[0]["name"])

    def warnings(self) -> list[str]:
        return self.made.warnings()

    def save(self, out: Path, force: bool, show: _microsig._Show) -> None:
        self.made.save(out, force, show)

    def place(self) -> _microsig.Made:
        return self.made

    def __reduce__(self) -> NoReturn:
        raise TypeError("a dataset in memory cannot be copied or pickled; save() it, and open() the folder elsewhere")


class _Folder:
    """A dataset on disk."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        if not folder.exists():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(folder))
        self.manifest = _microsig.manifest(folder)
        self.resources = {resource["path"]: resource for resource in self.manifest.get("resources", [])}
        sensor = self.manifest["microsig"].get("sensor")
        if sensor is None:
            path = folder / "datapackage.json"
            raise ValueError(f"{path}: expected the manifest of a dataset, with the size of its images in microsig.sensor")
        self.size = (int(sensor["width_px"]), int(sensor["height_px"]))

    @cached_property
    def _paths(self) -> list[Path]:
        return [self._folder / image for image in self._frame_table()["image"]]

    def _frame_table(self) -> Table:
        table = self.table(_FRAMES)
        if table is None:
            raise FileNotFoundError(f"{self._folder / _FRAMES}: no such file, nor {_RELEASED_FRAMES}")
        return table

    @cached_property
    def _images(self) -> Images:
        return _fixed(_microsig.read_images(self._paths, *self.size))

    def images(self) -> Images:
        return self._images

    def image(self, frame: int) -> Images:
        images = self.__dict__.get("_images")
        if images is not None:
            one: Images = images[frame]
            return one
        alone: Images = _fixed(_microsig.read_images([self._paths[frame]], *self.size)[0])
        return alone

    def frames(self) -> int:
        return len(self._paths)

    def table(self, path: str) -> Table | None:
        if path == _FRAMES and path not in self.resources and not (self._folder / path).exists():
            path = _RELEASED_FRAMES
        file = self._folder / path
        # Files that the manifest lists must exist.
        if path not in self.resources and not file.exists():
            return None
        resource = self.resources.get(path, {})
        fields = resource.get("schema", {}).get("fields", [])
        kinds = {field["name"]: field["type"] for field in fields}
        about = {f["name"]: (f.get("unit", ""), f.get("description", "")) for f in fields}
        columns = _microsig.read_table(file, kinds)
        missing = [name for name in kinds if name not in columns]
        if missing:
            raise ValueError(f"{file}: columns {', '.join(missing)} are missing; expected those that the manifest lists")
        return _table((path, resource.get("description", ""), about, columns))

    def calibration(self) -> Calibration | None:
        table = self.table("calibration/calibration.csv")
        if table is None:
            return None
        paths = [self._folder / image for image in table["image"]]
        settings = self._folder / "calibration/settings.txt"
        first = self.resources.get(str(table["image"][0]), {}) if len(table) else {}
        # Recordings may have no settings; their manifest has the size.
        size = (first["width_px"], first["height_px"]) if "width_px" in first else _microsig.image_size(settings)
        images = _microsig.read_images(paths, *size)
        return Calibration(_fixed(images), table["z_um"], table, table["d_um"] if "d_um" in table else None)

    def scenario(self) -> tuple[dict[str, Any], str]:
        return _microsig.scenario_of(self._folder)[:2]

    def settings(self) -> dict[str, float]:
        return _microsig.scenario_of(self._folder)[2]

    def title(self) -> str:
        return self.manifest.get("name") or self._folder.resolve().name

    def facts(self) -> tuple[float, tuple[float, float], float, int]:
        facts = self.manifest["microsig"]
        low, high = facts.get("depth_range_um") or (float("nan"), float("nan"))
        dt_s = facts.get("timing", {}).get("dt_s", float("nan"))
        bits = int((facts.get("sensor") or {}).get("bit_depth", 16))
        return float(facts.get("um_per_px", float("nan"))), (float(low), float(high)), float(dt_s), bits

    def warnings(self) -> list[str]:
        return []

    def save(self, out: Path, force: bool, show: _microsig._Show) -> None:
        _microsig.copy_dataset(self._folder, out, force)

    def place(self) -> Path:
        return self._folder


class Dataset:
    """A dataset: images with their truth, in memory (:func:`generate`) or in a folder (:func:`open`).

    Arrays and table columns are read-only. Data are loaded lazily: tables of the field and of depths, and the calibration
    scan, are computed, or read from a folder, on first access.
    """

    def __init__(self, source: _Source) -> None:
        """Use :func:`generate` or :func:`open`."""
        self._source = source

    @classmethod
    def of_text(cls, text: _microsig.ScenarioText, progress: Progress = False) -> Dataset:
        """A dataset in memory, from arguments of the compiled part."""
        return cls.of_made(_microsig.generate(text, shown(progress)))

    @classmethod
    def of_made(cls, made: _microsig.Made) -> Dataset:
        """A dataset in memory that the compiled part made."""
        return cls(_Memory(made))

    @property
    def images(self) -> Images:
        """uint16 (frames, rows, columns): all images, counts; read-only, not a copy.

        float32 with ``image_format: float32``: counts before they are rounded and clamped to the sensor's range.
        """
        return self._source.images()

    def image(self, frame: int) -> Images:
        """uint16 or float32 (rows, columns): one image, counts; for a dataset in a folder, only this file is read."""
        return self._source.image(frame)

    def __len__(self) -> int:
        """Number of frames."""
        return self._source.frames()

    def _need(self, path: str) -> Table:
        table = self._source.table(path)
        if table is None:
            raise ValueError(f"{path}: this dataset has no such table")
        return table

    @cached_property
    def frames(self) -> Table:
        """One row per frame: number, pair, role, time, names of files, numbers of particles."""
        return self._need(_FRAMES)

    @cached_property
    def tracks(self) -> Table:
        """One row per particle and frame: position (px, um), size, velocity, visibility."""
        return self._need(_TRACKS)

    @cached_property
    def displacements(self) -> Table:
        """One row per particle that is in both frames of a pair: its displacement (px, um)."""
        return self._need(_DISPLACEMENTS)

    @cached_property
    def boxes(self) -> Table | None:
        """One row per particle image and frame: box (px), mask, fraction hidden by others; None without ``truth.boxes``."""
        return self._source.table(_BOXES)

    @cached_property
    def depth(self) -> Table:
        """The image of a particle over depth: peak, SNR, area, weight."""
        return self._need(_DEPTH)

    @cached_property
    def field(self) -> Table | None:
        """The displacement of the fluid on a grid (px, um); None for recorded tracks, and if the scenario requests none."""
        return self._source.table(_FIELD)

    @cached_property
    def calibration(self) -> Calibration | None:
        """The calibration scan: ``images`` uint16 (steps, rows, columns), ``z_um`` (steps,), ``table``; None without one.

        For several particle sizes: all scans, one after the other, with ``d_um`` (steps,); ``of_size`` selects one.
        """
        return self._source.calibration()

    @cached_property
    def scenario(self) -> dict[str, Any]:
        """The scenario with all defaults written out; :func:`generate` generates the same dataset from it.

        Files that it refers to have absolute paths: for a dataset in memory, those of the original files; for a dataset in a
        folder, those of the copies in it. The files must exist as long as the scenario is used.
        """
        return self._source.scenario()[0]

    @property
    def scenario_text(self) -> str:
        """The scenario with all defaults written out, in RON: ``scenario.ron``, with paths relative to the dataset."""
        return self._source.scenario()[1]

    @cached_property
    def settings(self) -> dict[str, float]:
        """The 14 optical settings of MicroSIG, by name (units as in its settings file)."""
        return self._source.settings()

    @property
    def name(self) -> str:
        """Name of the dataset; of one without a scenario that of its manifest or folder."""
        try:
            return str(self.scenario["name"])
        except FileNotFoundError:
            return self._title

    @property
    def _title(self) -> str:
        """Name of the dataset, or of the folder of a dataset whose scenario is withheld or unknown."""
        return str(self._source.title())

    @property
    def _known_tracks(self) -> Table | None:
        """:attr:`tracks`, or None if the truth is withheld or unknown."""
        return self._source.table(_TRACKS)

    @property
    def um_per_px(self) -> float:
        """Object-space length of a pixel, um."""
        return self._source.facts()[0]

    @property
    def depth_range_um(self) -> tuple[float, float]:
        """Minimum and maximum depth of the measurement, um."""
        return self._source.facts()[1]

    @property
    def dt_s(self) -> float:
        """Time between consecutive frames, s; for pairs, between the two frames of a pair."""
        return self._source.facts()[2]

    @property
    def bits(self) -> int:
        """Bit depth of the images."""
        return self._source.facts()[3]

    @property
    def warnings(self) -> list[str]:
        """Warnings about a dataset that was generated in this process."""
        return self._source.warnings()

    @property
    def path(self) -> Path | None:
        """The folder of a dataset on disk, None in memory."""
        return self._source.place() if isinstance(self._source, _Folder) else None

    def save(self, path: str | os.PathLike[str] | None = None, *, force: bool = False, progress: Progress = False) -> Path:
        """Write the dataset to a folder, with bytes identical to ``microsig generate``.

        :param path: the folder, by default ``datasets/NAME``; it appears complete or not at all
        :param force: replace an existing dataset
        :param progress: True for a bar on a terminal or in a notebook, a callable of (what, done, total), or tqdm
        :returns: the folder
        :raises FileExistsError: the folder already exists
        :raises OSError: writing failed
        """
        out = Path("datasets") / self.name if path is None else Path(path)
        self._source.save(out, flag("force", force), shown(progress))
        return out

    def show(self, frame: int = 0, *, truth: bool = True) -> Figure:
        """Plot a frame with the positions of its visible particles, colored by depth; needs matplotlib.

        :param frame: number of the frame
        :param truth: whether to mark the particles
        """
        from . import _plots

        return _plots.show(self, frame, truth)

    def to_napari(self) -> list[tuple[Any, dict[str, Any], str]]:
        """Layers of napari: data, arguments and kind of the images, of one calibration stack and of the true tracks.

        >>> viewer = napari.Viewer()                                    # doctest: +SKIP
        >>> for layer in ds.to_napari(): viewer.add_layer(napari.layers.Layer.create(*layer))   # doctest: +SKIP

        Scales are frames and um, depths um; positions are array indices, as napari's. With napari, the package also opens
        folders of datasets directly.
        """
        from . import _napari

        return _napari.layers(self)

    def _repr_html_(self) -> str:
        from html import escape

        frames, (rows, columns) = len(self), self.image(0).shape if len(self) else (0, 0)
        low, high = self.depth_range_um
        tracks = self._known_tracks
        facts = {
            "frames": f"{frames} of {columns} x {rows} px, {self.bits} bit",
            "pixel": f"{self.um_per_px:.4g} um",
            "depth": f"{low:g} to {high:g} um",
            "time step": f"{self.dt_s:g} s",
            "particles": "withheld" if tracks is None else f"{len(np.unique(tracks['track']))} tracks, {len(tracks)} positions",
            "place": "in memory" if self.path is None else str(self.path),
        }
        body = "".join(f"<tr><th>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in facts.items())
        picture = f'<img src="data:image/png;base64,{_thumbnail(self.image(0))}">' if frames else ""
        return f"<p><b>{escape(self._title)}</b></p>{picture}<table>{body}</table>"

    def __repr__(self) -> str:
        frames, (rows, columns) = len(self), self.image(0).shape if len(self) else (0, 0)
        low, high = self.depth_range_um
        where = f"in {self.path}" if self.path is not None else "in memory"
        return (
            f"Dataset {self.name} {where}: {frames} frames of {columns} x {rows} px, "
            f"{self.um_per_px:.4g} um/px, depth {low:g} to {high:g} um"
        )


def _thumbnail(image: NDArray[Any]) -> str:
    """An image as a gray PNG of at most 384 px, in base64."""
    import base64
    import struct
    import zlib

    step = max(1, -(-max(image.shape) // 384))
    small = image[::step, ::step].astype(np.float64)
    low, high = np.percentile(small, [1.0, 99.8])
    gray = np.clip((small - low) / max(high - low, 1e-9) * 255, 0, 255).astype(np.uint8)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", gray.shape[1], gray.shape[0], 8, 0, 0, 0, 0)
    rows = zlib.compress(np.hstack([np.zeros((len(gray), 1), np.uint8), gray]).tobytes())
    png = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    return base64.b64encode(png).decode("ascii")


def generate(
    scenario: Scenario, seed: int | None = None, set: Mapping[str, Any] | None = None, *, progress: Progress = False
) -> Dataset:
    """Generate a dataset in memory: images, truth, calibration; no file is written.

    >>> import microsig as ms
    >>> ds = ms.generate('(name: "a", motion: flow(field: poiseuille()), timing: pairs(count: 1))', seed=7)
    >>> ds.images.shape, ds.images.dtype
    ((2, 366, 752), dtype('uint16'))

    :param scenario: path of a scenario, name of a shipped one (``"quickstart"``; `microsig new --list` lists them), its
        text (RON or JSON), or a dict of its keys (docs/scenario.md lists them)
    :param seed: seed of all random numbers, 0 to 2^64 - 1, by default the scenario's
    :param set: scenario values by path, such as ``{"optics.background_noise": 20}``
    :param progress: True for a bar on a terminal or in a notebook, a callable of (what, done, total), or tqdm
    :raises ValueError: the scenario is invalid; the message lists all problems with their positions
    :raises OSError: a file cannot be read
    """
    return Dataset.of_text(_scenario.text(scenario, seed, set), progress)


def open(path: str | os.PathLike[str]) -> Dataset:
    """Open a dataset in a folder; images and tables are read on first access.

    :param path: the folder
    :raises OSError: the folder does not exist, or a file cannot be read (for a file in the manifest, on first access)
    :raises ValueError: the folder is not a dataset, or a file does not match the manifest (on first access)
    """
    return Dataset(_Folder(Path(path)))


def resolve(
    scenario: Scenario, seed: int | None = None, set: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Check a scenario without generating anything; return it with all defaults written out, as :attr:`Dataset.scenario`.

    Arguments and errors are those of :func:`generate`.
    """
    return _microsig.resolve(_scenario.text(scenario, seed, set))[0]


def set_threads(threads: int) -> None:
    """Set the number of threads for all following calls; results do not depend on it.

    :param threads: 1 to 1024, or 0 for one per core
    :raises TypeError, ValueError: not an integer, or out of range
    """
    _microsig.set_threads(whole("threads", threads, 0, 1024))
