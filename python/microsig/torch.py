"""Streams as data sets of PyTorch; the only module that imports torch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from torch.utils.data import IterableDataset, get_worker_info

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


class StreamDataset(IterableDataset):  # type: ignore[misc,type-arg,unused-ignore]
    """A stream as an endless data set whose items are batches of tensors; made by :func:`dataset`."""

    def __init__(self, stream: Stream) -> None:
        """Use :func:`dataset`."""
        super().__init__()
        self.stream = stream

    def __iter__(self) -> Iterator[dict[str, Any]]:
        worker = get_worker_info()
        batches = iter(self.stream) if worker is None else self.stream.shard(worker.id, worker.num_workers)
        for batch in batches:
            yield tensors(batch)


def dataset(stream: Stream) -> StreamDataset:
    """A stream for ``DataLoader(dataset(stream), batch_size=None, num_workers=..., pin_memory=...)``.

    Items are batches already. Workers share the stream: the loader's order is that of the stream, whatever their number. The
    stream draws in threads of its own, so that ``num_workers=0`` is usually the fastest.
    """
    return StreamDataset(stream)
