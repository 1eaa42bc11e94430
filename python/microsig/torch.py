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


#: Most workers of a loader.
WORKERS = 1024


class StreamDataset(IterableDataset):  # type: ignore[misc,type-arg,unused-ignore]
    """A stream as a data set whose items are batches of tensors; made by :func:`dataset`."""

    def __init__(self, stream: Stream, batches: int | None = None) -> None:
        """Use :func:`dataset`."""
        super().__init__()
        self.stream = stream
        self.batches = None if batches is None else whole("batches", batches, 1)
        self._first = stream.position
        # Epochs begun, by worker: in shared memory, as workers have copies and may be new in every epoch.
        self._epochs = torch.zeros(WORKERS, dtype=torch.int64).share_memory_()

    def __len__(self) -> int:
        """Batches of an epoch."""
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
        # The stream of a worker is a copy of its own.
        self.stream.seek(self._position(epoch))
        own = range(worker, self.batches, workers)
        for _, batch in zip(own, self.stream.shard(worker, workers)):
            yield tensors(batch)

    def _position(self, epochs: int) -> int:
        return self._first + epochs * (self.batches or 0) * self.stream.batch

    def state_dict(self) -> dict[str, Any]:
        """Where the data set is after the epochs begun so far: plain values, for checkpoints at the end of an epoch."""
        state = self.stream.state_dict()
        return state if self.batches is None else {**state, "position": self._position(int(self._epochs.max()))}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on with the epoch that follows those of a data set of the same stream.

        :raises ValueError: the state of a stream of other samples
        """
        self.stream.load_state_dict(state)
        self._first = self.stream.position
        self._epochs.zero_()


def dataset(stream: Stream, batches: int | None = None) -> StreamDataset:
    """A stream for ``DataLoader(dataset(stream), batch_size=None, num_workers=..., pin_memory=...)``.

    Items are batches already. Workers share the stream: the loader's order is that of the stream, whatever their number. The
    stream draws in threads of its own, so that ``num_workers=0`` is usually the fastest.

    :param batches: batches of an epoch, of all workers together; each iteration goes on where the one before ended, or would
        have ended. Without it the data set is endless; every iteration with workers, which are copies, then begins at the
        stream's position again.
    """
    return StreamDataset(stream, batches)
