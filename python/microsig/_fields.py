"""Velocity fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _microsig, _scenario
from ._arguments import floats


@dataclass(frozen=True)
class FieldInfo:
    """An available velocity field."""

    #: Its name in scenarios.
    name: str
    #: The velocity as a one-line formula.
    formula: str
    #: Source of the formula.
    source: str
    #: Default, range and meaning of each parameter, by name.
    parameters: dict[str, tuple[str, str, str]]


def fields() -> dict[str, FieldInfo]:
    """The available velocity fields, by name: formula, source, parameters (as listed by ``microsig flows``)."""
    offers = {}
    for name, formula, source, parameters in _microsig.fields():
        offers[name] = FieldInfo(name, formula, source, {p[0]: (p[1], p[2], p[3]) for p in parameters})
    return offers


class Field:
    """A velocity field, created by :func:`field`.

    Positions are in um: x along columns, y along rows (down), z along the optical axis, growing away from the lens; the
    origin is the center of the image, in focus.
    """

    def __init__(self, compiled: _microsig.FlowField) -> None:
        """Use :func:`field`."""
        self._field = compiled
        self._spec: dict[str, Any] = compiled.scenario()["motion"]["flow"]["field"]

    def velocity(self, points_um: ArrayLike, t_s: float = 0.0) -> NDArray[np.float64]:
        """Velocities at the given points and time.

        :param points_um: (n, 3), um
        :param t_s: time, s
        :returns: float64 (n, 3), um/s; NaN or infinite at a singular point, 0 inside walls
        """
        return self._field.velocity(_points(points_um), t_s)

    def gradient(self, points_um: ArrayLike, t_s: float = 0.0) -> NDArray[np.float64]:
        """Velocity gradients: ``[:, i, j]`` is the derivative of component i along axis j.

        :param points_um: (n, 3), um
        :param t_s: time, s
        :returns: float64 (n, 3, 3), 1/s
        """
        return self._field.gradient(_points(points_um), t_s)

    def displacement(
        self, points_um: ArrayLike, t0_s: float, t1_s: float, *, halfway: bool = False
    ) -> NDArray[np.float64]:
        """Displacements of fluid elements from one time to another, along their paths.

        :param points_um: (n, 3), um: positions at ``t0_s``, or half-way in time if ``halfway``
        :param t0_s: time, s
        :param t1_s: time, s
        :returns: float64 (n, 3), um
        :raises ValueError: a path cannot be integrated
        """
        return self._field.displacement(_points(points_um), t0_s, t1_s, halfway)

    @property
    def name(self) -> str:
        """Name of the field."""
        return next(iter(self._spec))

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters given to :func:`field`, by name; :func:`fields` lists the defaults of the others."""
        inner = self._spec[self.name]
        return {k: v for k, v in inner.items() if v is not None} if isinstance(inner, dict) else {"of": inner}

    @property
    def is_steady(self) -> bool:
        """Whether the velocity does not depend on time."""
        return self._field.is_steady()

    def __repr__(self) -> str:
        given = ", ".join(f"{name}={value}" for name, value in self.parameters.items())
        return f"Field {self.name}({given})"


def _points(points_um: ArrayLike) -> NDArray[np.float64]:
    points = floats("points_um", points_um)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points_um of shape {points.shape}: expected (n, 3), in um")
    return np.ascontiguousarray(points)


def field(
    name: str | Mapping[str, Any], /, *, depth_range_um: tuple[float, float] = (-80.0, 20.0), **parameters: Any
) -> Field:
    """Create a velocity field from name and parameters, or from a dict as in a scenario (``motion.flow.field``).

    >>> import microsig as ms
    >>> ms.field("poiseuille", max_speed_um_s=1290).velocity([[0.0, 0.0, -30.0]]).round(6).tolist()
    [[1290.0, 0.0, 0.0]]

    :param name: name of a field (:func:`fields` lists them), or a dict such as ``{"sum": [{"hill": {}}, ...]}``
    :param depth_range_um: the channel, from which some parameters have their defaults (walls, centers)
    :param parameters: parameters by name; names end in units
    :raises ValueError: an unknown field or parameter, or a value out of range
    """
    spec = {name: parameters} if isinstance(name, str) else dict(name)
    if not isinstance(name, str) and parameters:
        raise TypeError("give the parameters inside the dict of the field")
    scenario = {
        "name": "field",
        "motion": {"flow": {"field": spec}},
        "boundaries": {"z_um": list(depth_range_um)},
        "particles": {"number": {"count": 0}},
        "timing": {"pairs": {"count": 1}},
    }
    return Field(_microsig.field(_scenario.text(scenario)))
