"""What the command does besides datasets and scores: fits, previews of optics, exports, challenges, checks."""

from __future__ import annotations

import datetime
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _microsig, _scenario
from ._arguments import LAST_SEED, flag, floats, one_of, optional, real, whole
from ._dataset import Calibration, Dataset
from ._progress import Progress, shown
from ._scenario import Scenario
from ._table import Table

_Path = str | os.PathLike[str]


class Options:
    """Options of a verb of the command by the names of the arguments of a Python function, which are the same but for dashes."""

    def __init__(self, *verbs: str) -> None:
        self._words = ["microsig", *verbs]

    def add(self, name: str, value: Any) -> Options:
        """The option of this argument; nothing for None and False, one option for each of a list."""
        option = "--" + name.replace("_", "-")
        if value is True:
            self._words.append(option)
        elif value is not None and value is not False:
            for one in [value] if isinstance(value, (str, os.PathLike, int, float)) else value:
                text = repr(float(one)) if isinstance(one, float) else os.fspath(one) if isinstance(one, os.PathLike) else str(one)
                self._words.append(f"{option}={text}")
        return self

    def call(self, *paths: _Path, progress: Progress = False, must_hold: bool = True) -> tuple[Any, str]:
        """Runs the verb on these paths; gives its result and the same as text.

        :param must_hold: whether a check that failed raises ValueError; otherwise it is a warning
        """
        words = [*self._words, "--", *(os.fspath(path) for path in paths)]
        result, text, warned, failed = _microsig.call(words, shown(progress))
        if failed and must_hold:
            raise ValueError("\n".join(failed))
        for warning in [*warned, *failed]:
            warnings.warn(warning, stacklevel=3)
        return result, text


class Fit:
    """The settings of a microscope, fitted to its calibration scan; made by :func:`fit`."""

    def __init__(self, made: _microsig.FittedMicroscope, path: Path | None) -> None:
        """Use :func:`fit`."""
        self._made, self._path = made, path
        self._result: dict[str, Any] = made.result()

    @property
    def parameters(self) -> Table:
        """One row per quantity: ``name``, ``unit``, ``value``, ``sd``, ``low_95``, ``high_95`` (95 % interval), ``free``
        (1 if it was fitted); of a fit by waves ``name``, ``unit``, ``value``, ``sd``."""
        rows = self._result.get("parameters") or self._result.get("coefficients") or []
        names = {"name": "name", "key": "name", "unit": "unit", "value": "value", "sd": "sd"}
        names |= {"low_95": "low_95", "high_95": "high_95", "free": "free"}
        columns = {names[key]: np.array([row[key] for row in rows]) for key in (rows[0] if rows else {}) if key in names}
        return Table({c: a.astype(np.int64) if a.dtype == bool else a for c, a in columns.items()}, name="parameters of a fit")

    def __getitem__(self, name: str) -> float:
        """The value of a parameter, such as ``fit["numerical_aperture"]``."""
        table = self.parameters
        found = np.flatnonzero(table["name"] == name)
        if len(found) == 0:
            raise KeyError(f"no parameter {name}; there are {', '.join(table['name'])}")
        return float(table["value"][found[0]])

    @property
    def scenario(self) -> str:
        """A scenario of the fitted microscope (RON), for :func:`generate`: its digital twin."""
        return self._made.file("scenario.ron")

    @property
    def settings_text(self) -> str:
        """MicroSIG's settings file of the fitted microscope, for :func:`render`."""
        return self._made.file("settings.txt")

    @property
    def path(self) -> Path | None:
        """The folder that :func:`fit` or :meth:`save` wrote; None if there is none."""
        return self._path

    def save(self, path: _Path, *, force: bool = False) -> Path:
        """Write report, settings, scenario and images of the model, as ``microsig fit`` does.

        :param path: the new folder
        :param force: replace an earlier fit
        :returns: the folder
        :raises FileExistsError: the folder exists
        :raises OSError: writing failed
        """
        warning = self._made.save(Path(path), flag("force", force))
        if warning is not None:
            warnings.warn(warning, stacklevel=2)
        self._path = Path(path)
        return self._path

    def to_dict(self) -> dict[str, Any]:
        """The whole result, as in ``fit.json`` or ``field.json``."""
        return self._result

    def __repr__(self) -> str:
        return self._made.text()

    def _repr_html_(self) -> str:
        from html import escape

        return f"<pre>{escape(repr(self))}</pre>"


def _scan(scan: Any, z: Any) -> tuple[Path | NDArray[Any], Path | list[float] | None]:
    """Images and, unless they have them, stage positions."""
    if isinstance(scan, Calibration):
        if scan.d_um is not None and len(np.unique(scan.d_um)) > 1:
            raise ValueError("scan: of several sizes of particles; expected one, as calibration.of_size(d_um)")
        scan, z = scan.images, scan.z_um if z is None else z
    if z is not None and not isinstance(z, (str, os.PathLike)):
        positions_um = floats("z", z)
        if positions_um.ndim != 1:
            raise ValueError(f"z of shape {positions_um.shape}: expected (steps,)")
        z = positions_um.tolist()
    positions = Path(z) if isinstance(z, (str, os.PathLike)) else z
    if isinstance(scan, (str, os.PathLike)):
        return Path(scan), positions
    array = np.asarray(scan)
    if np.ma.is_masked(scan):
        raise ValueError(f"scan: {np.ma.getmaskarray(scan).sum()} gray values are masked; expected counts")
    kind = array.dtype.newbyteorder("=")
    if array.ndim != 3 or kind not in (np.uint8, np.uint16):
        raise ValueError(f"scan of shape {array.shape} and type {array.dtype}: expected uint8 or uint16 (steps, rows, columns)")
    return np.ascontiguousarray(array, dtype=kind), positions


def _planes(planes: tuple[int, int]) -> tuple[int, int]:
    """First and last plane."""
    if not isinstance(planes, Sequence) or isinstance(planes, str) or len(planes) != 2:
        raise TypeError(f"planes = {planes!r}: expected the first and the last one")
    return whole("planes", planes[0]), whole("planes", planes[1])


def fit(
    scan: _Path | Calibration | ArrayLike,
    out: _Path | None = None,
    *,
    magnification: float,
    pixel_size_um: float,
    z: _Path | ArrayLike | None = None,
    z_step_um: float | None = None,
    z_direction: Literal["auto", "away", "toward"] = "auto",
    depth_factor: float = 1.0,
    medium: float = 1.0,
    diameter_um: float | None = None,
    particles: _Path | ArrayLike | None = None,
    astigmatic: Literal["auto", "yes", "no"] = "auto",
    flux: Literal["free", "model"] = "free",
    free: Sequence[str] = (),
    model: Literal["geometric", "waves"] = "geometric",
    wavelength_um: float | None = None,
    emission: Literal["surface", "volume"] = "surface",
    fluid: float | None = None,
    fluid_depth_um: float | None = None,
    field: bool = False,
    page: int | None = None,
    planes: tuple[int, int] | None = None,
    window_px: int | None = None,
    bootstrap: int = 0,
    seed: int = 0,
    force: bool = False,
    progress: Progress = False,
) -> Fit:
    """Fit the settings of a microscope to its calibration scan, as ``microsig fit`` does (docs/twin.md).

    >>> fitted = ms.fit("scan.tif", z_step_um=2, magnification=10, pixel_size_um=6.45)   # doctest: +SKIP
    >>> fitted["numerical_aperture"], ms.generate(fitted.scenario)                       # doctest: +SKIP

    :param scan: a TIFF file of pages (ImageJ's and OME's state their z step), a folder of TIFF files, the
        :attr:`Dataset.calibration` of a dataset, or an array (steps, rows, columns) of uint8 or uint16 counts
    :param out: folder for report, settings, scenario and images of the model; by default nothing is written
    :param magnification: magnification of the microscope
    :param pixel_size_um: edge of a pixel on the sensor, um
    :param z: stage positions: a CSV file with ``page`` (from 0) or ``image``, and ``z_um``; or an array (steps,), um
    :param z_step_um: step of the stage between planes, um, instead of ``z``
    :param z_direction: whether stage positions increase away from the lens or toward it
    :param depth_factor: physical depth over depth in the model
    :param medium: refractive index of the medium in the model
    :param diameter_um: particle diameter, um; fitted if None, with ``waves`` together with the blur of the camera
    :param particles: positions of the particles to use: a CSV file with ``x_px`` and ``y_px``, or an array (particles, 2),
        with the first pixel's center at (1, 1); detected if None
    :param astigmatic: whether the microscope has a cylindrical lens
    :param flux: brightness of each plane: fitted, or as the model predicts
    :param free: additional quantities to fit
    :param model: rays, or diffraction (``waves``, with ``wavelength_um``)
    :param wavelength_um: wavelength in vacuum, um
    :param emission: the part of a particle that emits light, with ``waves``
    :param fluid: refractive index of the fluid below a cover slip of 0.17 mm, with ``waves``
    :param fluid_depth_um: depth of the plane in focus below the cover slip, um, with ``fluid``
    :param field: fit how the optics vary over the field of view, with ``waves``
    :param page: the channel with the particles, from 0, if the file states several
    :param planes: first and last plane to use, counted from 0
    :param window_px: width of the window around each particle, 7 to 129 px; from the images if None
    :param bootstrap: number of resamples of the particles for a second estimate of standard deviations
    :param seed: seed of the resamples, 0 to 2^64 - 1
    :param force: replace the files of an earlier fit in ``out``
    :param progress: True, a callable of (what, done, total), or tqdm
    :returns: the fit; a model that does not describe the scan is a warning
    :raises ValueError: a scan or an option that cannot be used, with value and range
    :raises FileExistsError: ``out`` exists
    :raises OSError: a file cannot be read or written
    """
    images, positions = _scan(scan, z)
    if positions is not None and z_step_um is not None:
        raise ValueError("z and z_step_um: expected one of them")
    wavelength_um = optional(real, "wavelength_um", wavelength_um)
    if (one_of("model", model, ("geometric", "waves")) == "waves") != (wavelength_um is not None):
        raise ValueError('wavelength_um: expected with model="waves", and only there')
    for name, value, needs in (("fluid", fluid, wavelength_um), ("fluid_depth_um", fluid_depth_um, fluid)):
        if value is not None and needs is None:
            raise ValueError(f"{name}: expected with {'fluid' if name == 'fluid_depth_um' else 'model=' + repr('waves')}")
    if particles is not None and not isinstance(particles, (str, os.PathLike)):
        places = floats("particles", particles)
        if places.ndim != 2 or places.shape[1] != 2:
            raise ValueError(f"particles of shape {places.shape}: expected (particles, 2)")
        given: Path | list[list[float]] | None = places.tolist()
    else:
        given = None if particles is None else Path(particles)
    how = {
        "magnification": real("magnification", magnification),
        "pixel_size_um": real("pixel_size_um", pixel_size_um),
        "z_step_um": optional(real, "z_step_um", z_step_um),
        "direction": {"auto": None, "away": 1.0, "toward": -1.0}[one_of("z_direction", z_direction, ("auto", "away", "toward"))],
        "depth_factor": real("depth_factor", depth_factor),
        "medium": real("medium", medium),
        "diameter_um": optional(real, "diameter_um", diameter_um),
        "particles": given,
        "astigmatic": {"auto": None, "yes": True, "no": False}[one_of("astigmatic", astigmatic, ("auto", "yes", "no"))],
        "free_flux": one_of("flux", flux, ("free", "model")) == "free",
        "free": [str(name) for name in free],
        "wavelength_um": wavelength_um,
        "emission": one_of("emission", emission, ("surface", "volume")),
        "fluid": optional(real, "fluid", fluid),
        "fluid_depth_um": optional(real, "fluid_depth_um", fluid_depth_um),
        "field": flag("field", field),
        "page": None if page is None else whole("page", page, 0, 2**31),
        "planes": None if planes is None else _planes(planes),
        "window_px": optional(whole, "window_px", window_px, 7, 129),
        "bootstrap": whole("bootstrap", bootstrap, 0, 10_000),
        "seed": whole("seed", seed, 0, LAST_SEED),
    }
    place = None if out is None else Path(out)
    into = None if place is None else (place, flag("force", force))
    made = _microsig.fit_scan(images, positions, how, into, shown(progress))
    for warning in made.warnings():
        warnings.warn(warning, stacklevel=2)
    return Fit(made, place)


class Optics:
    """Predicted particle images of a scenario's optics over depth; made by :func:`optics`."""

    def __init__(self, result: dict[str, Any], text: str, svg: str) -> None:
        """Use :func:`optics`."""
        self._result, self._text = result, text
        #: A particle of each size over depth, with curves of peak and size, as SVG.
        self.svg = svg

    @property
    def sizes_um(self) -> NDArray[np.float64]:
        """float64 (sizes,): diameters of the particles, um."""
        return np.array([size["d_um"] for size in self._result["sizes"]], dtype=np.float64)

    def curves(self, d_um: float | None = None) -> Table:
        """Images of one size over depth: ``z_um``, ``peak_counts``, ``snr`` (NaN without noise), ``width_px``, ...

        :param d_um: the size nearest to this diameter, um; by default the first
        """
        sizes = self.sizes_um
        at = 0 if d_um is None else int(np.argmin(np.abs(sizes - real("d_um", d_um))))
        depths = self._result["sizes"][at]["depths"]
        columns = {
            name: np.array([np.nan if row[name] is None else row[name] for row in depths], dtype=np.float64)
            for name in (depths[0] if depths else {})
        }
        return Table(columns, name=f"images of {sizes[at]:g} um particles over depth")

    def to_dict(self) -> dict[str, Any]:
        """All numbers, as ``microsig optics --json`` prints them."""
        return self._result

    def __getitem__(self, name: str) -> Any:
        """One of them, such as ``optics["depth_of_field_um"]``."""
        return self._result[name]

    def __repr__(self) -> str:
        return self._text

    def _repr_svg_(self) -> str:
        return self.svg


def optics(scenario: Scenario, seed: int | None = None, set: Mapping[str, Any] | None = None) -> Optics:
    """Predict particle images of a scenario's optics over depth, as ``microsig optics`` does: focus, size, light.

    Arguments and errors are those of :func:`generate`; implausible optics cause warnings.
    """
    result, text, svg, warned = _microsig.optics(_scenario.text(scenario, seed, set))
    for warning in warned:
        warnings.warn(warning, stacklevel=2)
    return Optics(result, text, svg)


def _folder(dataset: Dataset | _Path) -> Path:
    """The folder of a dataset.

    :raises ValueError: a dataset in memory
    """
    if not isinstance(dataset, Dataset):
        return Path(dataset)
    if dataset.path is None:
        raise ValueError("dataset: expected one in a folder; save() writes one that is in memory")
    return dataset.path


def export(
    dataset: Dataset | _Path,
    out: _Path,
    *,
    format: str,
    images: Literal["frames", "calibration"] = "frames",
    stack: str | None = None,
    pair: int | None = None,
    displacement: Literal["central", "forward", "weighted"] = "central",
    force: bool = False,
) -> Path:
    """Write the truth or the images of a dataset in the format of another program, as ``microsig export`` does.

    :param dataset: a dataset or its folder
    :param out: the new file
    :param format: ``trackpy``, ``napari``, ``isbi``, ``coco``, ``openpiv``, ..., or ``ome-tiff`` and ``imagej-stack`` for images
    :param images: images of a stack: the frames over time, or a calibration stack over depth
    :param stack: folder below ``calibration/images``, such as ``d_2um``, if there are several calibration stacks
    :param pair: image pair of a field that changes with time
    :param displacement: definition of the displacement field
    :param force: replace an existing file
    :returns: the file
    :raises ValueError: a dataset without what the format needs, or an unknown format
    :raises FileExistsError: the file exists
    :raises OSError: a file cannot be read or written
    """
    _microsig.export(
        dataset._source.place() if isinstance(dataset, Dataset) else Path(dataset),
        Path(out),
        str(format),
        one_of("images", images, ("frames", "calibration")),
        None if stack is None else str(stack),
        optional(whole, "pair", pair, 0, 2**32 - 1),
        one_of("displacement", displacement, ("central", "forward", "weighted")),
        flag("force", force),
    )
    return Path(out)


def release(
    dataset: Dataset | _Path,
    out: _Path,
    *,
    val: int | None = None,
    test: int | None = None,
    test_set: Mapping[str, Any] | None = None,
    exact_times: bool = False,
    fields: bool = False,
    gate_xy_px: float | None = None,
    gate_z_um: float | None = None,
    dims: Literal[2, 3] | None = None,
    codabench: bool = False,
    wheel: _Path | None = None,
    title: str | None = None,
    creators: Iterable[str] = (),
    deadline: datetime.date | str | None = None,
    release_version: str | None = None,
    resume: bool = False,
    force: bool = False,
    new_keys: bool = False,
    progress: Progress = False,
) -> dict[str, Any]:
    """Make a challenge from a dataset: a public package and the withheld truth, as ``microsig release`` does (docs/challenge.md).

    :param dataset: a dataset or its folder; it becomes the train split
    :param out: the new folder
    :param val: pairs or frames of the validation split, by default as many as the dataset has
    :param test: the same of the test split
    :param test_set: values of motion or particles in the test split by path, such as ``{"particles.number.count": 40}``
    :param exact_times: publish the exact times of the test split's frames
    :param fields: score displacement fields instead of particles
    :param gate_xy_px, gate_z_um, dims: gates and dimensions of scoring, by default the dataset's
    :param codabench: also write a bundle for the platform Codabench
    :param wheel: wheel of microsig for its scoring program
    :param title: title of the challenge
    :param creators: authors, as ``Family, Given`` or names of groups
    :param deadline: last day for submissions, a date or text such as ``2027-03-01``
    :param release_version: version of the challenge, by default 1.0.0
    :param resume: continue an interrupted run, also one with ``new_keys``; a finished challenge of this dataset is left unchanged
    :param force: with ``new_keys``, replace a challenge
    :param new_keys: draw a new secret key, which invalidates everything published of an earlier challenge
    :param progress: True, a callable of (what, done, total), or tqdm
    :returns: ``out``, ``name``, ``images`` of train, val and test, ``commitment``, ``scored``, ...
    :raises ValueError: a dataset that does not verify or whose truth cannot be hidden
    :raises FileExistsError: the folder exists
    :raises OSError: a file cannot be read or written
    """
    values = [f"{path}={_scenario._value(value)}" for path, value in (test_set or {}).items()]
    options = (
        Options("release")
        .add("val", optional(whole, "val", val))
        .add("test", optional(whole, "test", test))
        .add("test_set", values)
        .add("exact_times", flag("exact_times", exact_times))
        .add("fields", flag("fields", fields))
        .add("gate_xy_px", optional(real, "gate_xy_px", gate_xy_px))
        .add("gate_z_um", optional(real, "gate_z_um", gate_z_um))
        .add("dims", optional(one_of, "dims", dims, (2, 3)))
        .add("codabench", flag("codabench", codabench))
        .add("wheel", wheel)
        .add("title", title)
        .add("creator", [str(name) for name in creators])
        .add("deadline", None if deadline is None else str(deadline))
        .add("release_version", None if release_version is None else str(release_version))
        .add("resume", flag("resume", resume))
        .add("force", flag("force", force))
        .add("new_keys", flag("new_keys", new_keys))
        .add("out", Path(out))
    )
    result: dict[str, Any] = options.call(_folder(dataset), progress=progress)[0]
    return result


def reveal(challenge: _Path, out: _Path, *, early: bool = False, force: bool = False) -> dict[str, Any]:
    """Write the truth of a challenge for publication, after its deadline, as ``microsig reveal`` does (docs/challenge.md).

    :param challenge: folder of the challenge, with ``public`` and ``withheld``
    :param out: the new folder, to be published
    :param early: also before the deadline, or without one
    :param force: replace an earlier publication
    :returns: ``out``, ``name``, ``deadline`` and ``commitment``
    :raises ValueError: a deadline that has not passed, or a truth that does not match the commitment
    :raises FileExistsError: the folder exists
    :raises OSError: a file cannot be read or written
    """
    options = (
        Options("reveal")
        .add("early", flag("early", early))
        .add("force", flag("force", force))
        .add("out", Path(out))
    )
    result: dict[str, Any] = options.call(Path(challenge))[0]
    return result


def verify(dataset: Dataset | _Path, *, regenerate: bool = False, progress: Progress = False) -> dict[str, Any]:
    """Check that a dataset is complete and unchanged, as ``microsig verify`` does: checksums, manifest, tables.

    :param dataset: a dataset or its folder
    :param regenerate: also generate it again from its scenario and compare all bytes
    :param progress: True, a callable of (what, done, total), or tqdm
    :returns: ``files``, ``bytes`` and ``regenerated``
    :raises ValueError: not a dataset, or checks that failed, all of them
    :raises OSError: a file cannot be read
    """
    options = Options("verify").add("regenerate", flag("regenerate", regenerate))
    result: dict[str, Any] = options.call(_folder(dataset), progress=progress)[0]
    return result
