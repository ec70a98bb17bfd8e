"""Sessions in files: a `.npz` of the scans as they came, the settings that each came under, and where rejected ones were taken."""

from __future__ import annotations

import json
import os
import uuid
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

VERSION = 1


@dataclass(frozen=True)
class KeptScan:
    """A scan as it was asked for."""

    kind: str
    arrays: dict[str, ArrayLike]
    words: dict[str, Any]
    config: dict[str, Any]

    @classmethod
    def of(cls, kind: str, arrays: Mapping[str, ArrayLike | None], words: dict[str, Any], config: dict[str, Any]) -> KeptScan:
        """With the caller's arrays, those that were given."""
        return cls(kind, {name: value for name, value in arrays.items() if value is not None}, words, config)

    def copied(self) -> KeptScan:
        """With arrays of its own: the caller's may change."""
        return replace(self, arrays={name: np.array(value) for name, value in self.arrays.items()})


def save(
    path: str | PathLike[str],
    config: dict[str, Any],
    given: list[NDArray[Any]],
    rejected_from: NDArray[np.float64],
    scans: list[KeptScan],
) -> None:
    """Writes the file whole or not at all."""
    told = [{"kind": s.kind, "words": s.words, "config": s.config, "arrays": list(s.arrays)} for s in scans]
    # Numbers may be of numpy.
    text = json.dumps({"version": VERSION, "config": config, "scans": told}, default=float)
    members: dict[str, Any] = {
        "session": np.frombuffer(text.encode(), np.uint8),
        "given": np.array(given).reshape(-1, 4, 4),
        "rejected_from": rejected_from,
    }
    for i, scan in enumerate(scans):
        members.update({f"{i}.{name}": array for name, array in scan.arrays.items()})
    path = Path(path)
    temporary = path.with_name(f".{path.name[:100]}.{uuid.uuid4().hex}.tmp")
    # Readable by whom the system's mask says, as `tempfile` would not have it.
    file = open(temporary, "xb")
    try:
        with file:
            np.savez(file, **members)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def load(path: str | PathLike[str]) -> tuple[dict[str, Any], list[NDArray[Any]], NDArray[np.float64], list[KeptScan]]:
    """Settings, given views, where rejected scans were taken, and scans."""
    try:
        with np.load(path, allow_pickle=False) as members:
            told = json.loads(members["session"].tobytes())
            if told["version"] != VERSION:
                raise ValueError(f"version {told['version']}, expected {VERSION}")
            # Absent in older files.
            rejected_from = members["rejected_from"] if "rejected_from" in members else np.zeros((0, 3))
            return told["config"], list(members["given"]), rejected_from, list(_scans(told["scans"], members))
    except OSError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{os.fspath(path)}: no session that was saved here, or damaged: {error}") from None


def _scans(told: list[dict[str, Any]], members: Any) -> Iterator[KeptScan]:
    for i, scan in enumerate(told):
        arrays = {name: members[f"{i}.{name}"] for name in scan["arrays"]}
        yield KeptScan(scan["kind"], arrays, scan["words"], scan["config"])
