"""Episodes as a Gymnasium environment; needs `pip install benbv[gym]`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ._benbv import Scene
from .simulate import Episode, look_at

Observation = dict[str, Any]


class ScanEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """Scan an object with few views.

    The object has a diagonal of 0.2 m around the origin. Action, 6 numbers from -1 to 1: the direction from target to camera
    (its length does not matter), and the target in units of 0.1 m; the camera stands at the working distance. Observation:
    `points` (max_points, 3), a sample of the cloud in metres, rows beyond `count` zero; `cameras` (num_views + 1, 3), where
    past scans were taken from, zero beyond their number; `views`, that number. Reward: the share of the surface that the view
    added. Terminated once `goal` is covered, truncated after `num_views` views; an overlap is in `info`.

    Each episode is on one of `scenes`, by default built-in objects, drawn with its first view from the seed of `reset`.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        scenes: list[Scene] | None = None,
        *,
        num_views: int = 10,
        max_points: int = 2048,
        goal: float = 0.99,
        config: Mapping[str, Any] | None = None,
    ) -> None:
        if num_views < 1 or max_points < 1:
            raise ValueError(f"num_views {num_views}, max_points {max_points}: expected 1 or more of each")
        self._scenes = scenes
        self._config = dict(config or {})
        self._config["episode"] = {**self._config.get("episode", {}), "num_views": num_views}
        self._num_views, self._max_points, self._goal = num_views, max_points, goal
        self._episode: Episode | None = None
        far = np.float32(10.0)
        self.action_space = spaces.Box(-1.0, 1.0, (6,), np.float32)
        self.observation_space = spaces.Dict(
            {
                "points": spaces.Box(-far, far, (max_points, 3), np.float32),
                "count": spaces.Box(0, max_points, (1,), np.int64),
                "cameras": spaces.Box(-far, far, (num_views + 1, 3), np.float32),
                "views": spaces.Box(0, num_views + 1, (1,), np.int64),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """A new episode. `options["scene"]` is scanned where it is given."""
        super().reset(seed=seed)
        self.close()
        drawn = int(self.np_random.integers(2**31))
        scene = (options or {}).get("scene")
        if scene is None:
            scene = self._scenes[drawn % len(self._scenes)] if self._scenes else Scene.procedural(drawn)
        self._episode = Episode(scene, name="gym", config={**self._config, "seed": drawn})
        return self._observe(self._episode), {"coverage": self._episode.coverage, "overlap": None}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Scans from the view of this action."""
        episode = self._episode
        if episode is None or (state := episode.state) is None:
            raise gymnasium.error.ResetNeeded("the episode has ended: reset first")
        values = np.asarray(action, np.float64)
        length = float(np.linalg.norm(values[:3]))
        direction = values[:3] / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])
        target = 0.1 * values[3:]
        before = episode.coverage
        episode.step(look_at(target + state.working_distance * direction, target))
        terminated = episode.coverage >= self._goal
        info = {"coverage": episode.coverage, "overlap": episode.overlap}
        return self._observe(episode), episode.coverage - before, terminated, episode.done and not terminated, info

    def close(self) -> None:
        """Ends the episode."""
        if self._episode is not None:
            self._episode.close()
            self._episode = None

    def _observe(self, episode: Episode) -> Observation:
        cloud, _ = episode.cloud
        points = np.zeros((self._max_points, 3), np.float32)
        count = min(len(cloud), self._max_points)
        if count:
            # Evenly through the cloud: the same for the same cloud.
            rows = np.linspace(0, len(cloud) - 1, count).astype(np.int64)
            points[:count] = cloud[rows]
        cameras = np.zeros((self._num_views + 1, 3), np.float32)
        views = np.array([view[:3, 3] for view in episode.views], np.float32)
        cameras[: len(views)] = views
        return {
            "points": np.clip(points, -10.0, 10.0),
            "count": np.array([count], np.int64),
            "cameras": np.clip(cameras, -10.0, 10.0),
            "views": np.array([len(views)], np.int64),
        }
