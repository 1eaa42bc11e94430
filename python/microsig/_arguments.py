"""Checks of arguments: every message names the argument, its value and the expected values."""

from __future__ import annotations

import math
import numbers
import operator
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

_T = TypeVar("_T")

#: The largest seed.
LAST_SEED = 2**64 - 1


def whole(name: str, value: Any, low: int = 0, high: int = 2**63 - 1) -> int:
    """An integer, including NumPy's; floats and booleans are refused rather than rounded."""
    ends = {2**63 - 1: f" from {low}", LAST_SEED: f", {low} to 2^64 - 1"}
    allowed = "expected a whole number" + ends.get(high, f", {low} to {high}")
    try:
        number = None if isinstance(value, (bool, np.bool_)) else operator.index(value)
    except TypeError:
        number = None
    if number is None:
        raise TypeError(f"{name} = {value!r}: {allowed}")
    if not low <= number <= high:
        raise ValueError(f"{name} = {value!r}: {allowed}")
    return number


def real(name: str, value: Any, low: float = -math.inf, high: float = math.inf, what: str = "a number") -> float:
    """A number, including NumPy's; any float if no range is given."""
    is_bounded = (low, high) != (-math.inf, math.inf)
    allowed = f"expected {what}" + (f", {low:g} to {high:g}" if is_bounded else "")
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        raise TypeError(f"{name} = {value!r}: {allowed}")
    try:
        number = float(value)
    except OverflowError:
        # NaN is outside every range.
        number = math.inf
    if is_bounded and not low <= number <= high:
        raise ValueError(f"{name} = {value!r}: {allowed}")
    return number


def interval(name: str, value: Any, allowed: str = "expected two numbers, the lower one first") -> tuple[float, float]:
    """Two numbers, whose order the compiled part checks."""
    if not isinstance(value, (Sequence, np.ndarray)) or isinstance(value, str) or len(value) != 2:
        raise TypeError(f"{name} = {value!r}: {allowed}")
    low, high = (real(name, end, what="two numbers") for end in value)
    return low, high


def one_of(name: str, value: Any, allowed: Sequence[_T]) -> _T:
    """One of some names or numbers."""
    by_text = {str(option): option for option in allowed}
    if str(value) not in by_text:
        kind = ValueError if isinstance(value, tuple(map(type, allowed))) else TypeError
        raise kind(f"{name} = {value!r}: expected one of {', '.join(by_text)}")
    return by_text[str(value)]


def flag(name: str, value: Any) -> bool:
    """True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} = {value!r}: expected True or False")
    return bool(value)


def optional(check: Callable[..., _T], name: str, value: Any, *limits: Any) -> _T | None:
    """Applies a check to an argument that may be None."""
    return None if value is None else check(name, value, *limits)


def floats(name: str, value: Any) -> NDArray[np.float64]:
    """An array of real numbers; complex ones are refused rather than truncated, and so are masked ones."""
    if np.ma.is_masked(value):
        raise ValueError(f"{name}: {np.ma.getmaskarray(value).sum()} values are masked; expected numbers")
    try:
        array = np.asarray(value)
        if array.dtype.kind in "biufO":
            return array.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: expected an array of numbers: {error}") from None
    raise TypeError(f"{name} of type {array.dtype}: expected numbers")
