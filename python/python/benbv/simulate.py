"""The simulator: objects, scans, metrics, and episodes step by step."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _benbv
from ._benbv import Scene, State
from .session import plain
from .view import Candidate, View


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; pixel (column, row) is sampled at its integer coordinate."""

    width: int = 1280
    height: int = 720
    fx: float = 360.0 / math.tan(math.radians(35.0))
    fy: float = 360.0 / math.tan(math.radians(35.0))
    cx: float = 640.0
    cy: float = 360.0

    @classmethod
    def from_fov(cls, width: int, height: int, fov_y_deg: float) -> Camera:
        """Square pixels, the principal point in the middle."""
        f = 0.5 * height / math.tan(math.radians(0.5 * fov_y_deg))
        return cls(width, height, f, f, 0.5 * width, 0.5 * height)

    @property
    def intrinsics(self) -> NDArray[np.float64]:
        """(3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


def scan(
    scene: Scene,
    camera: Camera,
    world_from_camera: ArrayLike,
    *,
    noise: bool | float | Mapping[str, Any] = False,
    render: Mapping[str, Any] | None = None,
) -> NDArray[np.float32]:
    """The depth image (height, width) that a camera at this pose measures, in metres; 0 where a ray returns nothing.

    `noise`: True for that of a consumer sensor, a number for axial noise of that standard deviation in metres at 1.2 m, or
    settings as `[episode.render.noise]` in `configs/evaluate.toml`. `render`: settings as `[episode.render]`.
    """
    settings = dict(render or {})
    if isinstance(noise, Mapping):
        settings["noise"] = dict(noise)
    elif isinstance(noise, bool | np.bool_):
        settings.update({"noise": {}} if noise else {})
    else:
        off = {"lateral_sigma_px": 0.0, "grazing_from_deg": 90.0, "edge_dropout": 0.0}
        settings["noise"] = {"axial_sigma_m": float(noise), **off}
    intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
    size = (camera.width, camera.height)
    return _benbv.scan(scene, size, intrinsics, world_from_camera, json.dumps(settings, default=plain))


def depth_to_points(
    depth: ArrayLike, intrinsics: ArrayLike, world_from_camera: ArrayLike, *, metres_per_unit: float | None = None
) -> NDArray[np.float64]:
    """(N, 3): the world points of the pixels with a return, row by row."""
    return _benbv.depth_to_points(depth, intrinsics, world_from_camera, metres_per_unit)


def look_at(
    position: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)
) -> NDArray[np.float64]:
    """(4, 4): the pose of a camera at `position` that looks at `target`, with image-up as near to `up` as can be."""
    return _benbv.look_at(position, target, up)


def coverage(cloud: ArrayLike, surface: ArrayLike, tolerance: float = 0.002) -> float:
    """Share of the points of the surface (N, 3) that have a point of the cloud (M, 3) nearer than `tolerance`."""
    return _benbv.coverage(cloud, surface, tolerance)


def overlap(scan: ArrayLike, cloud: ArrayLike, tolerance: float = 0.002) -> float | None:
    """Share of the points of the scan (N, 3) that have a point of the cloud (M, 3) nearer than `tolerance`; None for none."""
    return _benbv.overlap(scan, cloud, tolerance)


def chamfer(a: ArrayLike, b: ArrayLike) -> float:
    """Half the sum of the two mean distances to the nearest point of the other cloud; infinite if one is empty, 0 if both are."""
    return _benbv.distances(a, b)[0]


def hausdorff(a: ArrayLike, b: ArrayLike) -> float:
    """The larger of the two largest distances to the nearest point of the other cloud; infinite if one is empty, 0 if both are."""
    return _benbv.distances(a, b)[1]


class Episode:
    """An episode on an object, decided step by step: the loop, the first view and the metrics of `evaluate`.

    The object is centred and scaled to `diagonal_m` (0.2), as everything there is. Episodes of one `name`, `number` and seed
    start from the same view. `config` holds settings of `configs/evaluate.toml`.

    >>> episode = Episode(Scene.procedural(3), config={"episode": {"num_views": 5}})
    >>> while (state := episode.state) is not None:
    ...     episode.step(state.candidates()[0])
    >>> episode.coverage
    """

    def __init__(
        self, scene: Scene, *, name: str = "object", number: int = 0, config: Mapping[str, Any] | None = None
    ) -> None:
        self._native = _benbv.Episode(scene, name, number, json.dumps(dict(config or {}), default=plain))

    @property
    def state(self) -> State | None:
        """What a policy may see now; None at the end."""
        return self._native.state()

    def step(self, view: ArrayLike | Candidate | View) -> State | None:
        """Scans from this view, a pose (4, 4) or what has one as `world_from_camera`, and answers with the state after it.

        The simulated camera stands upright there, looking along the pose's +Z.
        """
        self._native.step(view)
        return self.state

    @property
    def cloud(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The accumulated cloud (N, 3) with its normals (N, 3), at the end too."""
        return self._native.cloud()

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self.state is None

    @property
    def coverage(self) -> float:
        """Share of the surface that is covered."""
        return self._native.progress()[0]

    @property
    def overlap(self) -> float | None:
        """Share of the last scan that was seen before it."""
        return self._native.progress()[1]

    @property
    def views(self) -> Sequence[NDArray[np.float64]]:
        """Poses (4, 4) scanned from, the first one included."""
        return self._native.views()

    @property
    def record(self) -> dict[str, Any] | None:
        """At the end what `evaluate` keeps of an episode: coverages, overlaps, distances in metres, why it ended."""
        record = self._native.record()
        return None if record is None else json.loads(record)

    def close(self) -> None:
        """Ends it now."""
        self._native.close()
