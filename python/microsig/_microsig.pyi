"""The compiled part of microsig. Not for users: names here may change."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypedDict, final, type_check_only

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Ahead",
    "FittedMicroscope",
    "FlowField",
    "Made",
    "PARTICLE_COLUMNS",
    "Samples",
    "Scored",
    "SweepCases",
    "__version__",
    "arrow_stream",
    "call",
    "command",
    "compare",
    "copy_dataset",
    "evaluate",
    "export",
    "field",
    "fields",
    "fit_scan",
    "generate",
    "image_size",
    "manifest",
    "methods",
    "optics",
    "read_images",
    "read_scenario",
    "read_settings",
    "read_table",
    "render",
    "resolve",
    "scenario_of",
    "set_threads",
    "sweep",
    "track",
    "unpack_scenarios",
    "write_stack",
]

__version__: str

@type_check_only
class ScenarioText(TypedDict):
    text: str
    name: str
    folder: Path
    values: list[tuple[str, str]]
    seed: int | None

_Show = bool | Callable[[str, int, int], Any]
_Images = NDArray[np.uint16] | NDArray[np.float32]
_Table = tuple[str, str, dict[str, tuple[str, str]], dict[str, Any]]

def command(arguments: list[str]) -> int: ...
def set_threads(threads: int) -> None: ...
def call(arguments: list[str], show: _Show) -> tuple[Any, str, list[str], list[str]]: ...
def optics(of: ScenarioText) -> tuple[dict[str, Any], str, str, list[str]]: ...
def write_stack(
    path: str | os.PathLike[str],
    images: NDArray[Any],
    um_per_px: float,
    depths_um: list[float],
    ome: bool,
    name: str,
) -> None: ...
def arrow_stream(given: list[tuple[str, NDArray[Any] | list[str]]]) -> object: ...
def generate(text: ScenarioText, show: _Show) -> Made: ...
def resolve(text: ScenarioText) -> tuple[dict[str, Any], str, list[str]]: ...
def manifest(dataset: str | os.PathLike[str]) -> dict[str, Any]: ...
def scenario_of(dataset: str | os.PathLike[str]) -> tuple[dict[str, Any], str, dict[str, float]]: ...
def read_table(path: str | os.PathLike[str], kinds: dict[str, str]) -> dict[str, Any]: ...
def read_images(paths: list[Path], width: int, height: int) -> _Images: ...
def read_scenario(path: str | os.PathLike[str]) -> tuple[str, Path | None]: ...
def unpack_scenarios(folder: str | os.PathLike[str]) -> None: ...
def read_settings(path: str | os.PathLike[str]) -> str: ...
def image_size(settings: str | os.PathLike[str]) -> tuple[int, int]: ...
def copy_dataset(dataset: str | os.PathLike[str], out: str | os.PathLike[str], force: bool) -> None: ...
@final
class Made:
    def images(self) -> _Images: ...
    def tables(self) -> list[_Table]: ...
    def field_tables(self) -> list[_Table]: ...
    def calibration(self) -> tuple[_Table, _Images] | None: ...
    def scenario(self) -> tuple[dict[str, Any], str]: ...
    def settings(self) -> dict[str, float]: ...
    def facts(self) -> tuple[float, tuple[float, float], float, int]: ...
    def warnings(self) -> list[str]: ...
    def save(self, out: str | os.PathLike[str], force: bool, show: _Show) -> None: ...

@final
class FittedMicroscope:
    def result(self) -> dict[str, Any]: ...
    def text(self) -> str: ...
    def warnings(self) -> list[str]: ...
    def file(self, name: str) -> str: ...
    def save(self, out: Path, force: bool) -> str | None: ...

@final
class Scored:
    def scores(self) -> dict[str, Any]: ...
    def json(self) -> str: ...
    def table(self) -> str: ...
    @staticmethod
    def of_files(score: str, units: str) -> Scored: ...

@type_check_only
class How(TypedDict):
    format: str | None
    gate: str | None
    gate_xy_px: float | None
    gate_z_um: float | None
    dims: int | None
    isbi_gate_px: float | None
    border_px: float
    origin: str | None
    unit: str | None
    y_up: bool | None
    shift_px: tuple[float, float]
    frame_base: int | None
    um_per_px: float | None
    dt_s: float | None
    pair: str | None
    depth_um: tuple[float, float] | None
    plane_um: float | None
    auto_offset: bool
    crlb: bool
    seed: int

@type_check_only
class Labels(TypedDict):
    boxes: bool
    shapes: bool
    instances: bool
    depth: bool
    heatmap: bool
    flow: bool
    flow_depth_um: float | None
    flow_z: bool
    clean: bool
    share: float
    heatmap_sigma_px: float

PARTICLE_COLUMNS: list[str]

def render(
    settings: str,
    name: str,
    rows: NDArray[np.float64],
    expected: bool,
    uniform: bool,
    round_once: bool,
    unrounded: bool,
    seed: int,
    frame: int,
) -> tuple[_Images, list[str]]: ...
def field(text: ScenarioText) -> FlowField: ...
def fields() -> list[tuple[str, str, str, list[tuple[str, str, str, str]]]]: ...
def evaluate(
    dataset: Made | str | os.PathLike[str],
    result: str | os.PathLike[str] | list[tuple[str, NDArray[Any] | list[str]]],
    how: How,
) -> Scored: ...
def compare(scores: list[tuple[str, Scored]]) -> tuple[list[dict[str, Any]], list[str], str]: ...
def export(
    dataset: Made | str | os.PathLike[str],
    out: Path,
    format: str,
    images: str,
    stack: str | None,
    pair: int | None,
    displacement: str,
    force: bool,
) -> None: ...
def fit_scan(
    scan: Path | NDArray[Any],
    z: Path | list[float] | None,
    how: dict[str, Any],
    out: tuple[Path, bool] | None,
    show: _Show,
) -> FittedMicroscope: ...
def track(
    dataset: Made | str | os.PathLike[str],
    method: str,
    max_displacement_px: float,
    diameter_px: float,
    noise_xy_px: float,
    noise_z_um: float,
    ensemble: bool,
    spheroids: bool,
    aspect_ratio: float | str,
    fit_diameter: bool,
    positions: Path | None,
    seed: int,
    show: _Show,
) -> tuple[dict[str, Any], list[str]]: ...
def methods() -> list[tuple[str, str]]: ...
def sweep(text: str, name: str, folder: str | os.PathLike[str], seed: int | None) -> SweepCases: ...
@final
class FlowField:
    def velocity(self, at: NDArray[np.float64], t_s: float) -> NDArray[np.float64]: ...
    def gradient(self, at: NDArray[np.float64], t_s: float) -> NDArray[np.float64]: ...
    def displacement(
        self, at: NDArray[np.float64], t0_s: float, t1_s: float, halfway: bool
    ) -> NDArray[np.float64]: ...
    def is_steady(self) -> bool: ...
    def scenario(self) -> dict[str, Any]: ...
    def displacement_px(self, dx_um: float, dy_um: float) -> tuple[float, float]: ...
@final
class SweepCases:
    def axes(self) -> list[str]: ...
    def cases(self) -> list[tuple[str, list[Any], int, int]]: ...
    def generate(self, index: int) -> Made: ...
@final
class Samples:
    def __new__(
        cls,
        text: ScenarioText,
        vary: list[tuple[str, tuple[str, list[float], list[str]]]],
        seed: int,
        validation: bool,
        frames: int,
        labels: Labels,
        rows: int,
        window: tuple[int, int] | None,
    ) -> Samples: ...
    def warning(self) -> str | None: ...
    def size(self) -> tuple[int, int]: ...
    def seed_of(self, index: int) -> int: ...
    def values(self, index: int) -> list[tuple[str, Any]]: ...
    def window(self, index: int) -> tuple[int, int] | None: ...
    def scenario(self, index: int) -> tuple[dict[str, Any], str]: ...
    def check_memory(self, what: str, n: int, batches: int) -> None: ...
    def batch(self, first: int, n: int) -> dict[str, NDArray[Any]]: ...
    def ahead(self, first: int, n: int, step: int, ahead: int) -> Ahead: ...
@final
class Ahead:
    def next(self) -> dict[str, NDArray[Any]]: ...
