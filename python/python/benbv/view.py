"""What a session answers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._benbv import PlanError


@dataclass(frozen=True)
class Objection:
    """Why a view must not be taken."""

    constraint: str
    """Which limit: `workspace`, `floor`, `travel` and so on."""
    reason: str
    """What was found, and what is allowed."""


@dataclass(frozen=True, eq=False)
class TableStop:
    """Where a turntable stops for a view, and where the camera stands then."""

    stop_deg: float
    """The table's angle, degrees."""
    cell_from_camera: NDArray[np.float64]
    """(4, 4): the camera's pose in the frame of the cell, which does not turn; metres."""

    @classmethod
    def _of(cls, raw: dict[str, Any]) -> TableStop:
        return cls(raw["stop_deg"], np.array(raw["cell_from_camera"]["matrix"]))


@dataclass(frozen=True)
class Reached:
    """An arm at a view."""

    joints: dict[str, float]
    """Values by the names of the joints, radians or metres, in the order of the arm."""
    travel: float
    """Sum of the joints' travel from where the arm is, radians and metres."""

    @classmethod
    def _of(cls, raw: dict[str, Any]) -> Reached:
        return cls({joint["name"]: joint["value"] for joint in raw["joints"]}, raw["travel"])


@dataclass(frozen=True, eq=False)
class Candidate:
    """A view that was considered. World frame, metres; with a turntable that is the object's frame, which turns with it."""

    rank: int
    """0 is the best of those allowed; the excluded ones follow."""
    score: float
    """Larger is better; the cost of travel is taken off."""
    world_from_camera: NDArray[np.float64]
    """(4, 4)."""
    target: NDArray[np.float64]
    """(3,): what the camera looks at."""
    working_distance: float
    """From target to camera."""
    expected_gain: float | None
    """New surface as a share of the whole, where it can be predicted."""
    expected_overlap: float | None
    """Share of the scan that is seen already, where it can be predicted."""
    objections: tuple[Objection, ...]
    """Why it must not be taken; empty if it may."""
    given: int | None
    """Which of the given views it is."""
    table: TableStop | None = None
    """With a turntable, the stop and the pose to take there; None without one."""
    reached: Reached | None = None
    """The arm at this view; None without an arm, and where it cannot get there."""

    @property
    def position(self) -> NDArray[np.float64]:
        """(3,): where the camera stands."""
        position: NDArray[np.float64] = self.world_from_camera[:3, 3]
        return position

    @classmethod
    def _of(cls, raw: dict[str, Any]) -> Candidate:
        return cls(
            rank=raw["rank"],
            score=raw["score"],
            world_from_camera=np.array(raw["world_from_camera"]["matrix"]),
            target=np.array(raw["target_m"]),
            working_distance=raw["working_distance_m"],
            expected_gain=raw["expected_gain"],
            expected_overlap=raw["expected_overlap"],
            objections=tuple(Objection(o["constraint"], o["reason"]) for o in raw["objections"]),
            given=raw.get("given"),
            table=TableStop._of(raw["table"]) if "table" in raw else None,
            reached=Reached._of(raw["reached"]) if "reached" in raw else None,
        )


@dataclass(frozen=True)
class Stop:
    """Whether another view is worth it."""

    stop: bool
    """The expected gain, what the last scan added and the mean of the last two are under `stop_below`, or no view is left."""
    expected_gain: float | None
    """The most that one view is expected to add, as a share of the whole surface."""
    basis: str
    """Where that number comes from."""
    last_added: float | None = None
    """What the last scan added, as a share of the whole surface; None of a single scan."""
    last_two_added: float | None = None
    """What the last two scans added together; None of two scans or fewer."""


@dataclass(frozen=True)
class View:
    """The next view, and what there is to say of it. Can be compared and pickled."""

    raw: dict[str, Any]
    """All of the answer, as `infer --json` prints it."""
    none: str | None = None
    """Why there is no view, where there is none."""

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """All views considered, best first, excluded ones last."""
        return tuple(Candidate._of(c) for c in self.raw["candidates"])

    @cached_property
    def next(self) -> Candidate | None:
        """The view to take; None where none is left."""
        return None if self.raw["next"] is None else Candidate._of(self.raw["next"])

    @cached_property
    def plan(self) -> tuple[Candidate, ...] | None:
        """The views of `plan_views` in order of travel; more in `raw["plan"]`. None where none were asked for, or the planner does not
        predict what several views see together."""
        plan = self.raw.get("plan")
        return None if plan is None else tuple(Candidate._of(c) for c in plan["views"])

    @property
    def _some(self) -> Candidate:
        if self.next is None:
            raise PlanError(f"no next view: {self.none}")
        return self.next

    @property
    def world_from_camera(self) -> NDArray[np.float64]:
        """(4, 4): the pose to take. Raises `PlanError` where no view is left.

        With a turntable it is in the object's frame, which turns with the table: the pose to take is
        `next.table.cell_from_camera`, with the table at `next.table.stop_deg`.
        """
        return self._some.world_from_camera

    @property
    def expected_gain(self) -> float | None:
        """New surface that the view is expected to show, as a share of the whole."""
        return self._some.expected_gain

    @property
    def expected_overlap(self) -> float | None:
        """Share of the scan that is seen already."""
        return self._some.expected_overlap

    @property
    def stop(self) -> Stop:
        """Whether another view is worth it."""
        stop = self.raw["stop"]
        added = (stop.get("last_added"), stop.get("last_two_added"))
        return Stop(stop["stop"], stop["expected_gain"], stop["basis"], *added)

    @property
    def planner(self) -> str:
        """Which planner decided."""
        planner: str = self.raw["planner"]
        return planner

    @property
    def missing(self) -> dict[str, Any] | None:
        """What is missing of the surface, where the planner makes it out: its share, its holes."""
        missing: dict[str, Any] | None = self.raw["missing"]
        return missing

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know."""
        return tuple(self.raw["warnings"])

    def __repr__(self) -> str:
        if self.next is None:
            return f"<benbv.View: none, {self.none}>"
        x, y, z = self.next.position
        return f"<benbv.View from ({x:.3f}, {y:.3f}, {z:.3f}), {self.planner}, {len(self.candidates)} candidates>"
