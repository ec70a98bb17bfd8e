"""Training samples that `datagen` made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from os import PathLike
from typing import Any, SupportsIndex, overload

from . import _benbv

Sample = dict[str, Any]
"""One decision. `object`, its name; `scan_index`, scans done minus one; `points`, `normals` (P, 3) float32; `candidates` (C, 6),
target and camera position; `density`, `scores`, `coverage`, `overlap` (C,), NaN where a foreign set does not say;
`current_coverage`; `working_distance`; `cameras` (V, 4, 4), `world_from_camera` of the scans so far. Metres."""


class Shards(Sequence[Sample]):
    """The samples of a folder that `datagen` wrote, or of one of its `.safetensors` files.

    Checksums and counts are checked at once, each sample is read when it is asked for. `split`: `"train"`, `"validation"` or
    `"test"`; by default all. Threads may share it; it can be pickled, for loaders with several processes.
    """

    def __init__(self, path: str | PathLike[str], split: str | None = None) -> None:
        self._native = _benbv.Shards(path, split)
        self._arguments = (path, split)

    def __len__(self) -> int:
        return len(self._native)

    @overload
    def __getitem__(self, index: SupportsIndex) -> Sample: ...
    @overload
    def __getitem__(self, index: slice) -> list[Sample]: ...
    def __getitem__(self, index: SupportsIndex | slice) -> Sample | list[Sample]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        i = index.__index__()
        if not -len(self) <= i < len(self):
            raise IndexError(f"sample {i} of {len(self)}")
        return self._native.sample(i % len(self))

    def __iter__(self) -> Iterator[Sample]:
        return (self[i] for i in range(len(self)))

    def __reduce__(self) -> tuple[type[Shards], tuple[Any, ...]]:
        return Shards, self._arguments
