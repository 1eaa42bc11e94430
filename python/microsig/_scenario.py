"""Scenarios as arguments: a path, the name of a shipped one, text in RON or JSON, or a dict."""

from __future__ import annotations

import functools
import json
import math
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Union

import numpy as np

from . import _microsig
from ._arguments import LAST_SEED, optional, whole

#: A scenario: the path of a file, the name of a shipped one, text in RON or JSON, or a dict with the same keys.
Scenario = Union[str, "os.PathLike[str]", Mapping[str, Any]]


def _value(value: Any) -> str:
    """A Python value as scenarios write it: JSON, and `inf` for infinity."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(str(k))}: {_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        # Values that are not allowed are refused by the reader, which states the range of the key.
        return "inf" if value > 0 else "-inf" if value < 0 else "NaN"
    try:
        return json.dumps(value)
    except TypeError as error:
        raise ValueError(f"{value!r}: a value of a scenario is a number, text, list or dict") from error


def _is_text(scenario: str) -> bool:
    """Whether a string is a scenario itself rather than the path of one."""
    return "\n" in scenario or (scenario.lstrip().startswith(("(", "{", "//", "#![")) and not os.path.exists(scenario))


@functools.cache
def _shipped() -> tempfile.TemporaryDirectory[str]:
    """The shipped scenarios in a folder that lasts as long as the process, for the files that they refer to."""
    place = tempfile.TemporaryDirectory(prefix="microsig-")
    _microsig.unpack_scenarios(place.name)
    return place


def values_by_path(given: Any) -> dict[str, Any]:
    """The argument ``set``: values by path."""
    if not isinstance(given, (Mapping, type(None))):
        raise TypeError(f"set = {given!r}: expected a dict of values by path, as {{'optics.gain': 1}}")
    for path in given or {}:
        if not isinstance(path, str) or not path.strip():
            raise TypeError(f"set: {path!r}: expected the path of a key, such as 'optics.gain'")
    return dict(given or {})


def text(
    scenario: Scenario, seed: int | None = None, values: Mapping[str, Any] | None = None
) -> _microsig.ScenarioText:
    """The arguments of the compiled part: text, its name in messages, folder of its files, values by path, seed."""
    replaced = [(path, _value(value)) for path, value in values_by_path(values).items()]
    if isinstance(scenario, Mapping):
        content, name, folder = _value(scenario), "scenario", Path(".")
    elif isinstance(scenario, str) and _is_text(scenario):
        content, name, folder = scenario, "scenario", Path(".")
    elif isinstance(scenario, (str, os.PathLike)):
        path = Path(scenario)
        content, relative_to = _microsig.read_scenario(path)
        name, folder = str(path), Path(_shipped().name) if relative_to is None else relative_to
    else:
        raise TypeError(f"a scenario is a path, a text or a dict, not {type(scenario).__name__}")
    return {
        "text": content,
        "name": name,
        "folder": folder,
        "values": replaced,
        "seed": optional(whole, "seed", seed, 0, LAST_SEED),
    }
