"""Planning: scans in, the next view out."""

from __future__ import annotations

import json
import operator
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _benbv, kept
from .view import View

Config = Mapping[str, Any] | str | PathLike[str] | None
"""Settings: a mapping as in `configs/infer.toml`, or the path of such a file."""

Verdict = bool | float | str | tuple[bool, float | str] | None
"""Of a pose: True or None, a cost or (True, cost); False, the reason or (False, reason)."""


def plain(value: Any) -> Any:
    """What `json` does not know of numpy."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, PathLike):
        return str(value)
    raise TypeError(f"config: {value!r} is no setting")


def split(config: Config) -> tuple[str | PathLike[str] | None, dict[str, Any]]:
    """The file and the changes."""
    if config is None or isinstance(config, Mapping):
        return None, dict(config or {})
    return config, {}


@dataclass(frozen=True)
class ScanReport:
    """What was done with a scan."""

    scans: int
    """Scans of the session now."""
    points: dict[str, Any]
    """Points read, used, and left out for each reason."""
    notes: tuple[str, ...]
    """What was guessed in reading, and what was left out."""


class Session:
    """The scans of one object so far. Threads may share it; one works on it at a time, and the interpreter is free meanwhile.

    `working_distance_m` is the distance from target to camera, whatever `config` says of it; `config` holds any settings of
    `configs/infer.toml`, as a mapping (`{"constraints": {"floor_height_m": 0.0}}`) or as the path of such a file; `weights` is
    the directory of a checkpoint for `benbv-net` in place of the weights that come along.
    """

    def __init__(
        self,
        working_distance_m: float | None = None,
        config: Config = None,
        *,
        weights: str | PathLike[str] | None = None,
    ) -> None:
        file, changes = split(config)
        if working_distance_m is not None:
            changes.update(working_distance_m=working_distance_m, working_distance_range_m=None)
        self._native = _benbv.Session(file, json.dumps(changes, default=plain), weights)
        self._kept: list[kept.KeptScan] = []
        self._given: list[NDArray[Any]] = []
        # Taken before the native session's own lock, by `next_view` too: what `reachable` asks is refused, not waited for.
        self._lock = threading.RLock()

    def _add(self, kind: str, arrays: Mapping[str, Any], words: dict[str, Any]) -> ScanReport:
        """Adds a scan and keeps it as it came."""
        with self._lock:
            scans = self._native.num_scans()
            # In its place before it is added: Ctrl-C is raised when the call returns, and the scan is in the session by then.
            self._kept[scans:] = [kept.KeptScan.of(kind, arrays, words, self.config)]
            try:
                raw = json.loads(self._add_native(kind, arrays, words))
            finally:
                # Nothing where it was refused. Copied not before it is known to be one, of a size that can be kept.
                self._kept[scans:] = [scan.copied() for scan in self._kept[scans : self._native.num_scans()]]
        return ScanReport(raw["scans"], raw["report"], tuple(raw["notes"]))

    def _add_native(self, kind: str, arrays: Mapping[str, Any], words: dict[str, Any]) -> str:
        a, native, angle = arrays, self._native, words.get("table_angle_deg")
        if kind == "depth":
            return native.add_depth(
                a["depth"],
                a["intrinsics"],
                a["world_from_camera"],
                words["misses"],
                words["metres_per_unit"],
                words["distortion"],
                words["distortion_model"],
                # Absent in older files.
                words.get("size"),
                angle,
            )
        if kind == "points":
            return native.add_points(a["points"], a.get("origin"), a.get("world_from_camera"), a.get("normals"), angle)
        return native.add_bytes(words["name"], a["raw"].tobytes(), a.get("origin"), words["millimetres"], angle)

    def save(self, path: str | PathLike[str]) -> None:
        """Writes the session to a file (`.npz`), whole or not at all: scans as they came, settings, given views, and where rejected
        scans were taken."""
        with self._lock:
            scans = self._kept[: self._native.num_scans()]
            kept.save(path, self.config, self._given, self._native.rejected_from(), scans)

    @classmethod
    def load(cls, path: str | PathLike[str], *, weights: str | PathLike[str] | None = None) -> Session:
        """A session as it was saved; it answers as the one that was."""
        config, given, rejected_from, scans = kept.load(path)
        session = cls(weights=weights)
        for scan in scans:
            session.configure(**scan.config)
            session._add(scan.kind, scan.arrays, scan.words)
        session.configure(**config)
        session.set_given_views(given)
        session._native.set_rejected_from(rejected_from)
        return session

    def add_depth(
        self,
        depth: ArrayLike,
        intrinsics: ArrayLike,
        world_from_camera: ArrayLike,
        *,
        misses: str | None = None,
        metres_per_unit: float | None = None,
        distortion: Sequence[float] | None = None,
        distortion_model: str = "brown_conrady",
        size: Sequence[int] | None = None,
        table_angle_deg: float | None = None,
    ) -> ScanReport:
        """Adds a depth image.

        `depth` is (height, width); floats are metres and integers millimetres unless `metres_per_unit` says otherwise. 0, NaN
        and the largest integer of the type stand for no return. `intrinsics` is (3, 3), or fx, fy, cx, cy, in pixels; pixel
        (column, row) is sampled at its integer coordinate. `misses`: whether a pixel without a return is `"free"` space or
        `"unknown"`; by default as the settings say. `distortion` has the lens's coefficients in OpenCV's order: k1, k2, p1, p2,
        k3, k4, k5, k6, of which the later ones may be left out, or k1 to k4 with `distortion_model="fisheye"`; the image is
        undistorted on reading. `size` has the columns and rows that the camera was calibrated for; an image of another size raises
        `ValueError`. `add_depth(depth, world_from_camera=pose, **dataclasses.asdict(read_camera(path)))` takes a whole calibration.
        `table_angle_deg` is the turntable's angle (`turntable` of the settings): the scan is given in the
        frame that does not turn.

        With `registration.register = "refine"` a scan that cannot be registered raises `PlanError` and is not in the session; views
        from near its camera are ruled out until another scan is added.
        """
        return self._add(
            "depth",
            {"depth": depth, "intrinsics": intrinsics, "world_from_camera": world_from_camera},
            {
                "misses": misses,
                "metres_per_unit": metres_per_unit,
                "distortion": None if distortion is None else [float(k) for k in distortion],
                "distortion_model": distortion_model,
                "size": None if size is None else [operator.index(side) for side in size],
                "table_angle_deg": table_angle_deg,
            },
        )

    def add_points(
        self,
        points: ArrayLike,
        *,
        origin: ArrayLike | None = None,
        world_from_camera: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        table_angle_deg: float | None = None,
    ) -> ScanReport:
        """Adds a cloud: `points` (N, 3) in the world frame, metres; NaN for no return.

        The camera is given by `origin`, its position (3,), or by `world_from_camera`, its pose; without either it is
        estimated. For a line scanner `origin` is two points of its straight path, (2, 3). `normals` (N, 3) of any length; zero where one is not known. `table_angle_deg` as in `add_depth`.
        """
        camera = {"origin": origin, "world_from_camera": world_from_camera}
        return self._add("points", {"points": points, **camera, "normals": normals}, {"table_angle_deg": table_angle_deg})

    def add_file(
        self,
        path: str | PathLike[str],
        *,
        origin: ArrayLike | None = None,
        unit: str | None = None,
        table_angle_deg: float | None = None,
    ) -> ScanReport:
        """Adds the cloud in a file, as `infer --scan` does: an organised one becomes the depth image that its pixels prove.

        `unit` (`"m"` or `"mm"`) is that of the cloud and of `origin`; by default the one that the file names, or metres.
        `table_angle_deg` as in `add_depth`.
        """
        if unit not in (None, "m", "mm"):
            raise ValueError(f"unit: {unit!r}, expected 'm' or 'mm'")
        raw = np.frombuffer(_benbv.read_file(path), np.uint8)
        millimetres = None if unit is None else unit == "mm"
        words = {"name": os.fspath(path), "millimetres": millimetres, "table_angle_deg": table_angle_deg}
        return self._add("file", {"raw": raw, "origin": origin}, words)

    def set_given_views(self, poses: Sequence[ArrayLike]) -> None:
        """Chooses from these poses, (4, 4) `world_from_camera` each, alone from now on: taught poses, or, with a turntable, poses
        in the frame that does not turn, each at every stop.

        None given: views at the boundary of the cloud again.
        """
        given = [np.array(pose) for pose in poses]
        with self._lock:
            self._native.set_given_views(given)
            self._given = given

    def next_view(
        self,
        *,
        position: ArrayLike | None = None,
        reachable: Callable[[NDArray[np.float64]], Verdict] | None = None,
        plan_views: int | None = None,
    ) -> View:
        """The next view. `position` (3,) is where the camera is now, for limits and cost of travel.

        `reachable` is asked of the pose (4, 4) of each candidate that nothing else rules out, with a turntable in the frame that
        does not turn: True (or None) where the arm gets there, a cost (float) or (True, cost) to take off the score, False, the
        reason or (False, reason) where not. What it raises is raised here. It must not ask this session for anything, which
        raises `PlanError`, nor wait for a thread that does, which never ends.

        `plan_views`: plan so many views at once beside the next one (`View.plan`), for cells that cannot plan after each scan.

        Raises `PlanError` where there is no scan, or the planner cannot work on what is known.
        """
        with self._lock:
            answer, none = self._native.next_view(position, reachable, plan_views)
        return View(json.loads(answer), none)

    def configure(self, **changes: Any) -> None:
        """Changes settings; the scans stay. One out of range raises `ValueError`, and the old ones stay."""
        # Not while a scan is added: it is kept with the settings that it came under.
        with self._lock:
            self._native.configure(json.dumps(changes, default=plain))

    @property
    def config(self) -> dict[str, Any]:
        """The settings, as in `configs/infer.toml`."""
        config: dict[str, Any] = json.loads(self._native.config())
        return config

    def undo(self) -> bool:
        """Takes the last scan back; False if there is none."""
        with self._lock:
            had_one = self._native.undo()
            del self._kept[self._native.num_scans() :]
        return had_one

    def reset(self) -> None:
        """Forgets all scans."""
        with self._lock:
            self._native.reset()
            self._kept.clear()

    def __len__(self) -> int:
        """Number of scans."""
        return self._native.num_scans()

    def cloud(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The cloud that is planned on: points (N, 3) and their normals towards the cameras (N, 3)."""
        return self._native.cloud()

    def mesh(self) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
        """The measured surface as triangles: vertices (N, 3) and their indices (M, 3), counter-clockwise seen from outside.

        Closed where the object was measured all around; elsewhere it ends where the measured surface does.
        """
        return self._native.mesh()

