"""Frozen suites of datasets for comparing trackers: the actions of ``microsig suite`` (docs/suite.md).

A suite is the file or folder of one, or the name of a shipped one, such as ``odpc1``.
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from ._arguments import LAST_SEED, flag, one_of, whole
from ._progress import Progress
from ._verbs import Options

__all__ = ["check", "generate", "list", "release", "score"]

_Path = str | os.PathLike[str]
_Size = Literal["smoke", "small", "full"]
_Split = Literal["train", "val", "test"]


def _size(size: str) -> str:
    return one_of("size", size, ("smoke", "small", "full"))


def _selected(options: Options, track: str | None, case: str | None, split: str | None = None) -> Options:
    options.add("track", track).add("case", case)
    return options.add("split", None if split is None else one_of("split", split, ("train", "val", "test")))


def list(suite: _Path, *, size: _Size = "full") -> dict[str, Any]:
    """Tracks and cases of a suite.

    :returns: ``suite``, ``version``, ``size``, ``tracks`` with their gates (px, um), scores that rank, and ``cases``
    :raises ValueError: no such suite
    """
    result: dict[str, Any] = Options("suite", "list").add("size", _size(size)).call(suite)[0]
    return result


def generate(
    suite: _Path,
    out: _Path,
    *,
    size: _Size,
    track: str | None = None,
    case: str | None = None,
    split: _Split | None = None,
    resume: bool = False,
    force: bool = False,
    progress: Progress = False,
) -> dict[str, Any]:
    """Generate the datasets of a suite: ``OUT/TRACK/CASE/{train,val,test}``.

    :param track, case, split: only these datasets
    :param resume: continue an interrupted run; failed datasets are tried again
    :param force: replace the folder
    :param progress: True, a callable of (what, done, total), or tqdm
    :returns: ``out``, ``cases``, ``done``, ``made``, ``failed``, ``seconds``
    :raises ValueError: no such suite, track or case; datasets that failed
    :raises FileExistsError: the folder exists
    :raises OSError: a file cannot be written
    """
    options = _selected(Options("suite", "generate").add("size", _size(size)), track, case, split)
    options.add("resume", flag("resume", resume)).add("force", flag("force", force))
    result: dict[str, Any] = options.add("out", Path(out)).call(suite, progress=progress)[0]
    return result


def check(
    suite: _Path,
    datasets: _Path | None = None,
    *,
    size: _Size,
    track: str | None = None,
    case: str | None = None,
    split: _Split | None = None,
    progress: Progress = False,
) -> dict[str, Any]:
    """Check datasets against the frozen checksums of a suite.

    :param datasets: a generated suite; by default every dataset is generated again
    :param track, case, split: only these datasets
    :returns: ``datasets`` (their number), ``hashes``, ``seconds``, ``differences``
    :raises ValueError: no such suite; datasets that differ, all of them
    :raises OSError: a file cannot be read
    """
    options = _selected(Options("suite", "check").add("size", _size(size)), track, case, split)
    options.add("datasets", None if datasets is None else Path(datasets))
    result: dict[str, Any] = options.call(suite, progress=progress)[0]
    return result


def score(
    suite: _Path,
    datasets: _Path,
    results: _Path | Iterable[_Path],
    out: _Path,
    *,
    track: str | None = None,
    case: str | None = None,
    against: _Path | None = None,
    site: _Path | None = None,
    late: bool = False,
    seed: int = 0,
    force: bool = False,
) -> dict[str, Any]:
    """Score all results of a suite, ranked case by case.

    :param datasets: the generated or released suite
    :param results: folders of ``TRACKER/TRACK/CASE/results.csv`` or ``TRACKER.zip``
    :param out: folder of the scores
    :param against: folder of a published leaderboard, such as ``results/leaderboard/small``, whose results are ranked, too
    :param site: folder of a site of the leaderboard, to be hosted by copying it
    :param late: also score submissions whose files are newer than the deadline
    :param seed: seed of the bootstrap
    :returns: cases with their scores and ranks, as in ``suite_scores.json``
    :raises ValueError: a result that cannot be read
    :raises FileExistsError: the folder exists
    :raises OSError: a file cannot be read or written
    """
    options = _selected(Options("suite", "score"), track, case).add("results", results)
    options.add("against", against).add("site", site).add("late", flag("late", late))
    options.add("seed", whole("seed", seed, 0, LAST_SEED))
    options.add("force", flag("force", force)).add("out", Path(out))
    result: dict[str, Any] = options.call(suite, datasets)[0]
    return result


def release(
    suite: _Path,
    datasets: _Path,
    out: _Path,
    *,
    track: str | None = None,
    case: str | None = None,
    creators: Iterable[str] = (),
    deadline: datetime.date | str | None = None,
    resume: bool = False,
    force: bool = False,
    new_keys: bool = False,
    codabench: bool = False,
    wheel: _Path | None = None,
    baselines: Iterable[str] = (),
    progress: Progress = False,
) -> Any:
    """Make a challenge of each case, ``OUT/TRACK/CASE/{public,withheld}``, and the folder ``OUT/public`` to be published; arguments as
    of :func:`microsig.release`.

    :param baselines: methods of :func:`microsig.track` that run on the published test splits, into ``OUT/baselines``
    :param datasets: the generated suite, whose train splits become those of the challenges
    :returns: a dict for every challenge
    :raises ValueError: a dataset that does not verify
    :raises FileExistsError: a challenge exists
    :raises OSError: a file cannot be read or written
    """
    options = _selected(Options("suite", "release"), track, case)
    options.add("creator", [str(name) for name in creators])
    options.add("deadline", None if deadline is None else str(deadline))
    options.add("resume", flag("resume", resume)).add("force", flag("force", force))
    options.add("new_keys", flag("new_keys", new_keys))
    options.add("codabench", flag("codabench", codabench)).add("wheel", wheel)
    options.add("baselines", [str(method) for method in baselines])
    return options.add("out", Path(out)).call(suite, datasets, progress=progress)[0]
