"""The native half: arrays in, arrays and JSON out. Private; use `benbv`."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Path = str | PathLike[str]

VERSION: str

class PlanError(RuntimeError): ...

class Session:
    def __new__(cls, config_file: _Path | None, config: str, weights: _Path | None) -> Session: ...
    def add_depth(
        self,
        depth: ArrayLike,
        intrinsics: ArrayLike,
        world_from_camera: ArrayLike,
        misses: str | None,
        metres_per_unit: float | None,
        distortion: Sequence[float] | None,
        distortion_model: str,
        size: Sequence[int] | None,
        table_angle_deg: float | None,
    ) -> str: ...
    def add_points(
        self,
        points: ArrayLike,
        origin: ArrayLike | None,
        world_from_camera: ArrayLike | None,
        normals: ArrayLike | None,
        table_angle_deg: float | None,
    ) -> str: ...
    def add_bytes(
        self,
        name: str,
        content: bytes,
        origin: ArrayLike | None,
        millimetres: bool | None,
        table_angle_deg: float | None,
    ) -> str: ...
    def set_given_views(self, poses: Sequence[ArrayLike]) -> None: ...
    def next_view(
        self,
        position: ArrayLike | None,
        reachable: Callable[[NDArray[np.float64]], bool | float | str | tuple[bool, float | str] | None] | None,
        plan_views: int | None,
    ) -> tuple[str, str | None]: ...
    def configure(self, changes: str) -> None: ...
    def config(self) -> str: ...
    def undo(self) -> bool: ...
    def reset(self) -> None: ...
    def rejected_from(self) -> NDArray[np.float64]: ...
    def set_rejected_from(self, places: ArrayLike) -> None: ...
    def num_scans(self) -> int: ...
    def cloud(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def mesh(self) -> tuple[NDArray[np.float64], NDArray[np.uint32]]: ...

def read_cloud(
    path: _Path,
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, float | None, list[str]]: ...
def read_file(path: _Path) -> bytes: ...
def read_depth(path: _Path, metres_per_unit: float | None = None) -> tuple[NDArray[np.float32], list[str]]: ...
def read_mesh(path: _Path) -> tuple[NDArray[np.float64], NDArray[np.uint32]]: ...
def read_arm(path: _Path, tool: str) -> tuple[str, list[str]]: ...
def read_camera(
    path: str,
) -> tuple[tuple[int, int] | None, tuple[float, float, float, float], str, list[float], float | None]: ...
def read_poses(path: _Path) -> list[NDArray[np.float64]]: ...
def look_at(position: ArrayLike, target: ArrayLike, up: ArrayLike | None = None) -> NDArray[np.float64]: ...
def scan(
    scene: Scene,
    size: tuple[int, int],
    intrinsics: tuple[float, float, float, float],
    world_from_camera: ArrayLike,
    render: str,
) -> NDArray[np.float32]: ...
def depth_to_points(
    depth: ArrayLike, intrinsics: ArrayLike, world_from_camera: ArrayLike, metres_per_unit: float | None = None
) -> NDArray[np.float64]: ...
def coverage(cloud: ArrayLike, surface: ArrayLike, tolerance: float) -> float: ...
def overlap(scan: ArrayLike, cloud: ArrayLike, tolerance: float) -> float | None: ...
def distances(a: ArrayLike, b: ArrayLike) -> tuple[float, float]: ...
def evaluate(
    entrants: Sequence[dict[str, Any]], config_file: _Path | None, changes: str, out: _Path, decision_s: float
) -> str: ...
def rust_seconds(points: ArrayLike, origin: ArrayLike) -> tuple[float, float]: ...
def run_program(name: str, words: Sequence[str]) -> int: ...

class State:
    """All that a policy may see: what was measured, and from where. World frame, metres. Every access to an array makes a new one."""

    @property
    def seed(self) -> int:
        """For the policy's own random numbers: drawn from the named stream of the episode."""
    @property
    def points(self) -> NDArray[np.float64]:
        """(N, 3): the accumulated cloud."""
    @property
    def normals(self) -> NDArray[np.float64]:
        """(N, 3): its normals, towards the cameras, not of unit length; (0, 3) where there are none."""
    @property
    def cameras(self) -> list[NDArray[np.float64]]:
        """(4, 4) `world_from_camera` of every past scan whose camera is known or estimated, oldest first."""
    def depth(self, scan: int) -> NDArray[np.float32] | None:
        """The depth image (height, width) of a past scan, 0 where a pixel has no return; None where only points are known."""
    @property
    def num_scans(self) -> int:
        """Number of scans so far."""
    @property
    def working_distance(self) -> float:
        """Distance from target to camera that the next view shall have."""
    @property
    def tolerance(self) -> float:
        """Distance under which two points count as the same surface."""
    @property
    def spacing(self) -> float:
        """Mean distance of neighbouring points."""
    @property
    def image_size(self) -> tuple[int, int]:
        """(width, height) in pixels of the camera that takes the next scan."""
    @property
    def intrinsics(self) -> NDArray[np.float64]:
        """(3, 3): its intrinsics."""
    def candidates(self) -> list[NDArray[np.float64]]:
        """(4, 4) each: the candidates that BENBV makes at the boundary of the cloud; none where it has no boundary."""

class Scene:
    """An object in the simulator: a mesh, in metres. Threads may share it."""

    def __new__(cls, vertices: ArrayLike, faces: ArrayLike) -> Scene:
        """`vertices` (N, 3), metres; `faces` (M, 3), indices of vertices."""
    @staticmethod
    def procedural(seed: int, number: int = 0) -> Scene:
        """One of the built-in objects."""
    def normalized(self, diagonal: float = 0.2) -> Scene:
        """The same object, centred on the mean of its vertices, its bounding box of this diagonal."""
    def surface(self, samples: int = 60_000, seed: int = 0) -> NDArray[np.float64]:
        """(N, 3): points spread evenly over the surface."""
    @property
    def vertices(self) -> NDArray[np.float64]:
        """(N, 3), metres."""
    @property
    def faces(self) -> NDArray[np.uint32]:
        """(M, 3), indices of vertices."""

class Episode:
    def __new__(cls, scene: Scene, name: str, number: int, config: str) -> Episode: ...
    def step(self, view: object) -> None: ...
    def state(self) -> State | None: ...
    def progress(self) -> tuple[float, float | None]: ...
    def views(self) -> list[NDArray[np.float64]]: ...
    def cloud(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def record(self) -> str | None: ...
    def close(self) -> None: ...

class Shards:
    def __new__(cls, path: _Path, split: str | None) -> Shards: ...
    def __len__(self) -> int: ...
    def sample(self, index: int) -> dict[str, Any]: ...
