"""Streams as data sets of PyTorch; the only module that imports torch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import torch
from torch.utils.data import IterableDataset, get_worker_info

from ._arguments import whole
from ._stream import Arrays, Stream


def tensors(batch: Arrays) -> dict[str, Any]:
    """The arrays of a batch as tensors: images as float32 (torch has little arithmetic for uint16), indices as int64."""
    made = {}
    for name, values in batch.items():
        if values.dtype == np.uint16:
            values = values.astype(np.float32)
        elif values.dtype == np.uint64:
            values = values.astype(np.int64)
        made[name] = torch.from_numpy(values)
    return made


#: Maximum number of workers of a loader.
WORKERS = 1024


class StreamDataset(IterableDataset):  # type: ignore[misc,type-arg,unused-ignore]
    """A stream as a data set whose items are batches of tensors; created by :func:`dataset`."""

    def __init__(self, stream: Stream, batches: int | None = None) -> None:
        """Use :func:`dataset`."""
        super().__init__()
        self.stream = stream
        self.batches = None if batches is None else whole("batches", batches, 1)
        self._first = stream.position
        # Number of epochs started by each worker; in shared memory, because workers have copies and may be
        # new in every epoch.
        self._epochs = torch.zeros(WORKERS, dtype=torch.int64).share_memory_()  # type: ignore[no-untyped-call,unused-ignore]

    def __len__(self) -> int:
        """Number of batches in an epoch."""
        if self.batches is None:
            raise TypeError("the data set is endless; batches = N makes epochs of N batches")
        return self.batches

    def __iter__(self) -> Iterator[dict[str, Any]]:
        info = get_worker_info()
        worker, workers = (0, 1) if info is None else (info.id, info.num_workers)
        if self.batches is None:
            batches = iter(self.stream) if info is None else self.stream.shard(worker, workers)
            yield from map(tensors, batches)
            return
        epoch = int(self._epochs[worker])
        self._epochs[worker] += 1
        # Each worker has its own copy of the stream.
        self.stream.seek(self._position(epoch))
        own = range(worker, self.batches, workers)
        for _, batch in zip(own, self.stream.shard(worker, workers)):
            yield tensors(batch)

    def _position(self, epochs: int) -> int:
        return self._first + epochs * (self.batches or 0) * self.stream.batch

    def state_dict(self) -> dict[str, Any]:
        """Position after the epochs started so far, as plain values, for checkpoints at the end of an epoch."""
        state = self.stream.state_dict()
        return state if self.batches is None else {**state, "position": self._position(int(self._epochs.max()))}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue with the next epoch of another data set of the same stream.

        :raises ValueError: the state belongs to a stream of different samples
        """
        self.stream.load_state_dict(state)
        self._first = self.stream.position
        self._epochs.zero_()


def dataset(stream: Stream, batches: int | None = None) -> StreamDataset:
    """A stream for ``DataLoader(dataset(stream), batch_size=None, num_workers=..., pin_memory=...)``.

    Items are already batches. Workers share the stream: the order is that of the stream for any number of workers. The
    stream draws in threads of its own, so that ``num_workers=0`` is usually the fastest.

    :param batches: number of batches in an epoch, over all workers; each iteration continues where the previous one ended, or
    would have ended. Without it the data set is endless; with workers, which are copies, every iteration then starts at
    the position of the stream again.
    """
    return StreamDataset(stream, batches)
