"""Training samples for PyTorch; needs `pip install benbv[torch]`."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from .shards import Shards


class ShardDataset(Dataset):
    """The samples of `benbv.Shards` as tensors of float32; names and numbers stay as they are.

    `points`: so many points of each cloud, drawn evenly, so that samples of one size can be stacked; by default all.
    """

    def __init__(self, path: str | PathLike[str], split: str | None = None, *, points: int | None = None) -> None:
        self.shards = Shards(path, split)
        self.points = points

    def __len__(self) -> int:
        return len(self.shards)

    def __getitem__(self, index: int) -> dict[str, Any]:
        sample = self.shards[index]
        if self.points is not None:
            rows = np.linspace(0, len(sample["points"]) - 1, self.points).astype(np.int64)
            sample["points"] = sample["points"][rows]
            if len(sample["normals"]):
                sample["normals"] = sample["normals"][rows]
        return {
            name: torch.as_tensor(value, dtype=torch.float32) if isinstance(value, np.ndarray) else value
            for name, value in sample.items()
        }
