"""A custom policy in the tables: look from the direction that is farthest from all past cameras."""

import numpy as np

import benbv


class LargestUnseen:
    """Of 200 directions around the object the one with the largest angle to the nearest past camera."""

    version = "1"

    def rank_views(self, state: benbv.State) -> list[tuple[np.ndarray, float]]:
        i = np.arange(200) + 0.5
        polar, azimuth = np.arccos(1 - 2 * i / 200), np.pi * (1 + 5**0.5) * i
        directions = np.c_[np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
        center = state.points.mean(axis=0)
        seen = np.array([camera[:3, 3] - center for camera in state.cameras])
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        angles = np.arccos(np.clip(directions @ seen.T, -1, 1)).min(axis=1)
        return [
            (benbv.look_at(center + state.working_distance * d, center), angle) for d, angle in zip(directions, angles)
        ]


if __name__ == "__main__":
    policies = {"mine": LargestUnseen(), "benbv": "benbv", "auto": "auto"}
    report = benbv.evaluate(policies, objects=3, episodes=2)
    for row in report.policies:
        print(f"{row['policy']:8} efficiency {row['efficiency']:.2f}, coverage {row['coverage_percent']:.1f} %")
