"""Benchmark datasets, training streams and scores for PIV and PTV with defocused and astigmatic particle images.

>>> import microsig as ms
>>> ds = ms.generate("quickstart", seed=7)        # doctest: +SKIP
>>> ds.images, ds.tracks["x_px"], ds.displacements              # doctest: +SKIP

Everything is computed by the same code as the ``microsig`` command, with identical numbers to the last digit.
Positions are pixel coordinates with the first pixel's center at 1 (``table.origin(0)`` gives array indices), x along
columns, y along rows, depth z in um growing away from the lens; names of arguments and columns end in their units.
"""

from . import suite
from ._dataset import Calibration, Dataset, generate, open, resolve, set_threads
from ._fields import Field, FieldInfo, field, fields
from ._geff import read_geff
from ._microsig import __version__
from ._recording import import_recording
from ._render import Settings, render
from ._scenario import Scenario
from ._scores import Comparison, Scores, compare, evaluate, methods, sweep, track
from ._stream import PARTICLE_COLUMNS, Distribution, Stream, choice, integers, log_uniform, uniform
from ._table import Table
from ._verbs import Fit, Optics, export, fit, optics, release, reveal, verify

__all__ = [
    "Calibration",
    "Comparison",
    "Dataset",
    "Distribution",
    "Field",
    "FieldInfo",
    "Fit",
    "Optics",
    "PARTICLE_COLUMNS",
    "Scenario",
    "Scores",
    "Settings",
    "Stream",
    "Table",
    "__version__",
    "choice",
    "compare",
    "evaluate",
    "export",
    "field",
    "fields",
    "fit",
    "generate",
    "import_recording",
    "integers",
    "log_uniform",
    "methods",
    "open",
    "optics",
    "read_geff",
    "release",
    "reveal",
    "render",
    "resolve",
    "set_threads",
    "suite",
    "sweep",
    "track",
    "uniform",
    "verify",
]
