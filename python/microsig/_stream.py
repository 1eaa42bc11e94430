"""Streams of samples for training."""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _microsig, _scenario
from ._arguments import LAST_SEED, one_of, real, whole
from ._scenario import Scenario

#: A batch or a sample: arrays by name.
Arrays = dict[str, NDArray[Any]]

#: Available labels.
LABELS = ("particles", "boxes", "shapes", "instances", "heatmap", "depth", "flow", "clean")


@dataclass(frozen=True)
class Distribution:
    """How a value varies from sample to sample; created by :func:`uniform`, :func:`integers`, ..."""

    name: str
    bounds: tuple[float, ...] = ()
    values: tuple[Any, ...] = ()

    def _parts(self) -> tuple[str, list[float], list[str]]:
        return self.name, [float(b) for b in self.bounds], [_scenario._value(v) for v in self.values]


def uniform(low: float, high: float) -> Distribution:
    """Uniform between two numbers.

    :raises TypeError: not a number; :class:`Stream` raises ValueError if they are not finite or ``low`` > ``high``
    """
    return Distribution("uniform", (real("low", low), real("high", high)))


def log_uniform(low: float, high: float) -> Distribution:
    """Log-uniform between two positive numbers.

    :raises TypeError: not a number; :class:`Stream` raises ValueError if they are not finite, not > 0 or ``low`` > ``high``
    """
    return Distribution("log_uniform", (real("low", low), real("high", high)))


def integers(low: int, high: int) -> Distribution:
    """Integers from ``low`` to ``high``, both included, with equal probability.

    :raises TypeError: not an integer
    :raises ValueError: outside -2^53 to 2^53; :class:`Stream` raises it if ``low`` > ``high``
    """
    return Distribution("integers", (whole("low", low, -(2**53), 2**53), whole("high", high, -(2**53), 2**53)))


def choice(values: Sequence[Any]) -> Distribution:
    """One of several values with equal probability: numbers, texts, lists, dicts, as in a scenario.

    :raises TypeError: not a sequence; :class:`Stream` raises ValueError if it is empty or contains a value that is not allowed
    """
    if not isinstance(values, (Sequence, np.ndarray)) or isinstance(values, str):
        raise TypeError(f"values = {values!r}: expected a list of values")
    return Distribution("choice", values=tuple(values))


def _distribution(path: str, given: Any) -> Distribution:
    if isinstance(given, Distribution):
        return given
    raise TypeError(f"vary {path}: expected ms.uniform, ms.log_uniform, ms.integers or ms.choice, not {given!r}")


def _check_paths(paths: Sequence[str]) -> None:
    """Refuses paths of which one contains another: samples would depend on their order."""
    for outer in paths:
        for inner in paths:
            if inner.startswith(f"{outer}."):
                raise ValueError(f"vary: {inner} is a part of {outer}, which also varies; expected only one of them")


def _sides(crop: Any) -> tuple[int, int]:
    if not isinstance(crop, (Sequence, np.ndarray)) or isinstance(crop, str) or len(crop) != 2:
        raise TypeError(f"crop = {crop!r}: expected two whole numbers, rows and columns")
    rows, columns = (whole("crop", side, 1, 2**31 - 1) for side in crop)
    return rows, columns


class Stream:
    """An endless sequence of samples for training: ``for batch in stream``, ``stream[i]``.

    Sample ``i`` is a function of (scenario, seed, i) alone: it does not depend on batch size, number of threads or workers, or
    restarts. It is the beginning of the dataset that :func:`generate` generates from :meth:`scenario` ``(i)``: a scenario with its
    own seed and, by ``vary``, its own values.

    A batch is a dict of arrays whose first axis is the sample:

    ========== ======= ============================ ==========================================================
    name       dtype   shape                        meaning
    ========== ======= ============================ ==========================================================
    index      uint64  (batch,)                     number of the sample
    image      uint16  (batch, frames, rows, cols)  counts
    particles  float32 (batch, n, 8)                :data:`PARTICLE_COLUMNS`: x_px, y_px (first pixel's center at 1), z_um,
                                                    d_um, c_int (its light included), dx_px, dy_px, dz_um (to the next
                                                    frame, NaN if not in it), of visible particles of the first frame
    mask       bool    (batch, n)                   which rows are particles; the others are 0
    boxes      float32 (batch, n, 6)                x, y of the center, width, height of what exceeds ``share`` of the
                                                    particle's own peak and the noise (px), z_um, class (index of the diameter in
                                                    ``particles.diameter_um.list``, else 0)
    shapes     float32 (batch, n, 4)                x, y, z of the axis of a spheroid (unit vector up to its sign: x right, y
                                                    down, z away from the lens), polar over equatorial diameter; of
                                                    spheres 0, 0, 0, 1
    instances  int32   (batch, rows, cols)          0, or 1 + row of the particle that is brightest at the pixel
    depth      float32 (batch, rows, cols)          z_um of that particle, NaN without a particle
    heatmap    float32 (batch, rows, cols)          Gaussians of height 1 at particle positions
    flow       float32 (batch, 2 or 3, rows, cols)  displacement of the fluid to the next frame: px, px [, um]; NaN in walls
    clean      float32 (batch, frames, rows, cols)  noise-free counts: the limit of many rays, without sensor noise
    ========== ======= ============================ ==========================================================

    Labels other than ``particles`` and ``mask`` are included on request. Batches are computed ahead in threads while Python does
    other work. A stream can be pickled, and used after a fork.
    """

    def __init__(
        self,
        scenario: Scenario,
        batch: int = 32,
        *,
        crop: tuple[int, int] | None = None,
        crop_at: Literal["center", "random"] = "center",
        vary: Mapping[str, Distribution] | None = None,
        seed: int = 0,
        set: Mapping[str, Any] | None = None,
        labels: Sequence[str] = (),
        split: Literal["train", "val"] = "train",
        frames: int | None = None,
        ahead: int = 2,
        share: float = 0.1,
        heatmap_sigma_px: float = 1.5,
        flow_depth_um: float | Literal["mean"] = "mean",
        flow_components: Literal[2, 3] = 2,
        particles: int = 0,
    ) -> None:
        """Create a stream.

        :param scenario: path, text (RON or JSON) or dict
        :param batch: number of samples in a batch
        :param crop: rows and columns of the images
        :param crop_at: ``center``: a smaller sensor in the middle of the scenario's field of view; numbers of particles refer to
        the sample. ``random``: a window of the scenario's image at a random position for each sample (:meth:`window`); the
        whole image is rendered, which takes longer.
        :param vary: distributions by path of the scenario: :func:`uniform`, :func:`log_uniform`, :func:`integers`,
        :func:`choice`. Varying light, noise and particle numbers costs almost nothing; other keys require the scenario to be
        resolved again for each sample, about a millisecond. Noise-free images (``render.mode`` ``expected`` or ``waves``, and
        labels that need them) by new optics require new tables, about a second per sample, and a warning names the keys;
        ``set={"render.images": "single"}`` computes each image for itself instead. For up to 8 different optics, tables are
        computed once.
        :param seed: seed of the stream, 0 to 2^64 - 1; that of the scenario is ignored
        :param set: values by path that are the same in all samples
        :param labels: of ``boxes, shapes, instances, heatmap, depth, flow, clean`` (``particles`` are always there)
        :param split: ``train`` and ``val`` have no sample in common
        :param frames: number of frames in a sample; by default 2 with ``flow``, otherwise 1
        :param ahead: number of batches computed ahead, at least 1
        :param share: a particle image consists of the pixels above this fraction of its peak and above the noise
        :param heatmap_sigma_px: standard deviation of a particle in ``heatmap``, px
        :param flow_depth_um: depth of ``flow``, um, or the mean over the depth range
        :param flow_components: 3 for the displacement along z (um) as well
        :param particles: minimum number of particle rows in a batch; more if a sample has more
        :raises ValueError: an invalid scenario, path or value; not enough free memory for the batches
        :raises TypeError: an argument of the wrong type
        """
        unknown = [label for label in labels if label not in LABELS]
        if unknown:
            raise ValueError(f"labels = {unknown}: expected some of {', '.join(LABELS)}")
        batch, ahead, particles = whole("batch", batch, 1), whole("ahead", ahead, 1), whole("particles", particles)
        seed, validation = whole("seed", seed, 0, LAST_SEED), one_of("split", split, ("train", "val")) == "val"
        values = _scenario.values_by_path(set)
        window = None
        if crop is not None:
            rows, columns = _sides(crop)
            if one_of("crop_at", crop_at, ("center", "random")) == "random":
                window = (rows, columns)
            else:
                optics = _microsig.resolve(_scenario.text(scenario, None, values))[0]["optics"]
                if rows > optics["pixel_dim_y"] or columns > optics["pixel_dim_x"]:
                    raise ValueError(
                        f"crop = {crop}: expected at most the rows and columns of the scenario's images, "
                        f"({optics['pixel_dim_y']}, {optics['pixel_dim_x']})"
                    )
                values |= {"optics.pixel_dim_y": rows, "optics.pixel_dim_x": columns}
        self._batch, self._ahead_by = batch, ahead
        wanted: _microsig.Labels = {
            "boxes": "boxes" in labels,
            "shapes": "shapes" in labels,
            "instances": "instances" in labels,
            "depth": "depth" in labels,
            "heatmap": "heatmap" in labels,
            "flow": "flow" in labels,
            "flow_depth_um": None if flow_depth_um == "mean" else real("flow_depth_um", flow_depth_um, what="um or 'mean'"),
            "flow_z": one_of("flow_components", flow_components, (2, 3)) == 3,
            "clean": "clean" in labels,
            "share": real("share", share),
            "heatmap_sigma_px": real("heatmap_sigma_px", heatmap_sigma_px),
        }
        if not isinstance(vary, (Mapping, type(None))):
            raise TypeError(f"vary = {vary!r}: expected a dict of distributions by path, such as {{'optics.gain': ms.uniform(1, 2)}}")
        _check_paths(list(vary or {}))
        distributions = [(path, _distribution(path, distribution)._parts()) for path, distribution in (vary or {}).items()]
        number = (2 if "flow" in labels else 1) if frames is None else whole("frames", frames, 1, 2**31 - 1)
        text = _scenario.text(scenario, None, values)
        self._arguments = (text, distributions, seed, validation, number, wanted, particles, window)
        self._position = 0
        self._process = -1
        self._start()
        if warning := self._samples.warning():
            warnings.warn(warning, stacklevel=2)
        # One batch more than are computed ahead: the one in progress counts twice.
        arguments = f"batch = {batch}, ahead = {ahead}, particles = {particles}"
        self._samples.check_memory(arguments, batch, ahead + 1)

    def _start(self) -> None:
        """Creates the compiled part; again in a forked process."""
        if self._process != os.getpid():
            # Objects inherited from the parent of a forked process are not touched: their threads do not run
            # here.
            self._orphans = (self.__dict__.get("_samples"), self.__dict__.get("_ahead"))
            self._samples = _microsig.Samples(*self._arguments)
            self._ahead: _microsig.Ahead | None = None
            self._process = os.getpid()

    @property
    def batch(self) -> int:
        """Number of samples in a batch."""
        return self._batch

    @property
    def position(self) -> int:
        """Number of the first sample of the next batch."""
        return self._position

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the images."""
        return self._samples.size()

    def __getitem__(self, index: int) -> Arrays:
        """Sample ``index`` (from 0): arrays without the batch axis."""
        try:
            number = whole("sample", index)
        except ValueError as error:
            raise IndexError(str(error)) from None
        self._start()
        return {name: values[0] for name, values in self._samples.batch(number, 1).items()}

    def samples(self, first: int, n: int) -> Arrays:
        """``n`` samples from number ``first`` on, as a batch; does not move the stream.

        :raises ValueError: not enough free memory for the samples
        """
        first, n = whole("first", first), whole("n", n, 1)
        self._start()
        self._samples.check_memory(f"n = {n}", n, 2)
        return self._samples.batch(first, n)

    def __iter__(self) -> Iterator[Arrays]:
        return self

    def __next__(self) -> Arrays:
        """The next batch."""
        self._start()
        if self._ahead is None:
            self._ahead = self._samples.ahead(self._position, self._batch, self._batch, self._ahead_by)
        try:
            batch = self._ahead.next()
        except KeyboardInterrupt:
            raise
        except BaseException:
            self._ahead = None
            raise
        self._position += self._batch
        return batch

    def shard(self, worker: int, workers: int) -> Iterator[Arrays]:
        """Every ``workers``-th batch from the current position, starting with number ``worker``: for workers that share a stream."""
        workers = whole("workers", workers, 1, 2**31 - 1)
        worker = whole("worker", worker, 0, workers - 1)
        self._start()
        first, step = self._position + worker * self._batch, workers * self._batch
        ahead = self._samples.ahead(first, self._batch, step, self._ahead_by)
        while True:
            yield ahead.next()

    def seed_of(self, index: int) -> int:
        """The seed of a sample."""
        return self._samples.seed_of(whole("sample", index))

    def values(self, index: int) -> dict[str, Any]:
        """The varied values of a sample, by path; as in :meth:`scenario`, also None, lists, and dicts of one key for variants."""
        return dict(self._samples.values(whole("sample", index)))

    def window(self, index: int) -> tuple[int, int] | None:
        """First row and column of a sample in the images of its scenario, from 0, with ``crop_at="random"``; otherwise None."""
        return self._samples.window(whole("sample", index))

    def scenario(self, index: int) -> dict[str, Any]:
        """The scenario of a sample with all defaults written out; the dataset generated from it starts with the sample."""
        self._start()
        return self._samples.scenario(whole("sample", index))[0]

    @property
    def fingerprint(self) -> str:
        """A hash of everything that samples depend on."""
        text, distributions, seed, split, frames, wanted, rows, window = self._arguments
        inputs = [text["text"], [f"{path}={value}" for path, value in text["values"]], distributions, seed, split, frames, wanted, window]
        return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()[:16]

    def state_dict(self) -> dict[str, Any]:
        """Position of the stream as plain values, for checkpoints."""
        return {"position": self._position, "fingerprint": self.fingerprint}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue at the position of another stream with the same arguments.

        :raises ValueError: the state belongs to a stream of different samples
        """
        if not isinstance(state, Mapping) or not {"fingerprint", "position"} <= set(state):
            raise ValueError(f"{state!r}: expected a result of state_dict(), with fingerprint and position")
        if state["fingerprint"] != self.fingerprint:
            raise ValueError("the state belongs to a stream of different samples (scenario, vary, seed, split or labels differ)")
        self.seek(state["position"])

    def seek(self, position: int) -> None:
        """Continue with a batch that starts with sample number ``position``."""
        position = whole("position", position)
        self.close()
        self._position = position

    def close(self) -> None:
        """End the threads that compute ahead; iterating starts them again at the same position."""
        if self._process == os.getpid():
            self._ahead = None

    def __getstate__(self) -> dict[str, Any]:
        return {
            "arguments": self._arguments,
            "batch": self._batch,
            "ahead": self._ahead_by,
            "position": self._position,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._arguments, self._batch = state["arguments"], state["batch"]
        self._ahead_by, self._position = state["ahead"], state["position"]
        self._process = -1
        self._start()

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"Stream of {columns} x {rows} px, batches of {self._batch}, at sample {self._position}"


#: Columns of ``particles``.
PARTICLE_COLUMNS: tuple[str, ...] = tuple(_microsig.PARTICLE_COLUMNS)

