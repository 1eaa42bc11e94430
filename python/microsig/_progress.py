"""The argument ``progress`` of long calls."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, Union

#: Receiver of progress reports: True for a bar, a callable of (what, done, total), or tqdm (the class or a bar).
Progress = Union[bool, Callable[..., Any]]


class _Tqdm:
    """Moves bars of tqdm: the given one, or a new one for each part of the work."""

    def __init__(self, tqdm: Any) -> None:
        self._class: Any = tqdm if isinstance(tqdm, type) else None
        self._bar: Any = None if isinstance(tqdm, type) else tqdm
        self._what: str | None = None

    def __call__(self, what: str, done: int, total: int) -> None:
        if self._class is not None and what != self._what:
            self.close()
            self._bar = self._class(total=total or None, desc=what)
        self._what = what
        if self._bar.total != (total or None):
            self._bar.total = total or None
        self._bar.update(done - self._bar.n)

    def close(self) -> None:
        if self._class is not None and self._bar is not None:
            self._bar.close()


class _Line:
    """One line that is written again, for notebooks without tqdm."""

    def __call__(self, what: str, done: int, total: int) -> None:
        of = f"/{total}" if total else ""
        print(f"\r{what}: {done}{of}", end="", file=sys.stderr, flush=True)


def _is_notebook() -> bool:
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return type(shell).__name__ == "ZMQInteractiveShell"


def shown(progress: Any) -> bool | Callable[[str, int, int], Any]:
    """What the compiled part takes: whether to show bars on a terminal, or a callable."""
    if progress is True and _is_notebook():
        try:
            from tqdm.auto import tqdm
        except ImportError:
            return _Line()
        return _Tqdm(tqdm)
    if progress is True or progress is False:
        return bool(progress)
    if hasattr(progress, "update") and (isinstance(progress, type) or hasattr(progress, "n")):
        return _Tqdm(progress)
    if callable(progress):
        receiver: Callable[[str, int, int], Any] = progress
        return receiver
    raise TypeError(f"progress = {progress!r}: expected True, False, a callable of (what, done, total), or tqdm")
