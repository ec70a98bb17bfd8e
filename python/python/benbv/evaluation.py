"""Own policies in our tables: the objects, streams, intervals and report of the program `evaluate`."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from . import _benbv
from ._benbv import State
from .session import Config, plain, split
from .view import Candidate


class Policy(Protocol):
    """Where to look next.

    One object serves all episodes, its calls never overlap, and it must keep nothing between them. A policy that remembers is
    given as a class, or as any function that makes one: every episode gets its own object.
    """

    def rank_views(self, state: State) -> Iterable[tuple[ArrayLike | Candidate, float]]:
        """Views, poses (4, 4) or what has one as `world_from_camera`, each with a score; larger is better.

        The best is taken. None left to offer ends the episode. An object with an attribute `version`, a string, is not asked
        again for episodes that it ran already under this version in the same `out`.
        """
        ...


@dataclass(frozen=True)
class Report:
    """The tables, as the program's `--json` prints them."""

    policies: list[dict[str, Any]]
    """A row per policy, over all objects."""
    paired: list[dict[str, Any]]
    """Policies against the baseline, over episodes that start from the same view."""
    objects: list[dict[str, Any]]
    """A row per policy and object."""
    skipped: list[dict[str, Any]]
    """Objects that could not be used (policy and episode are None), then episodes that were not run: object, policy, episode,
    and the reason."""
    episodes: list[dict[str, Any]]
    """Every episode: views, coverages, overlaps, distances in metres."""
    notes: list[str]
    """What there is to say of objects."""
    markdown: str
    """The report as text."""
    directory: Path | None
    """Where report.html and all else is, if `out` was given."""

    def __str__(self) -> str:
        return self.markdown


def evaluate(
    policies: Mapping[str, str | Policy | Any] | Iterable[str],
    objects: int | str | PathLike[str] | Mapping[str, Any] | None = None,
    episodes: int | None = None,
    *,
    out: str | PathLike[str] | None = None,
    baseline: str | None = None,
    only: Iterable[str] = (),
    seed: int | None = None,
    config: Config = None,
    decision_s: float = 60.0,
) -> Report:
    """Runs policies on objects and reports on them with confidence intervals, as the program `evaluate` does.

    `policies`: by the name in the tables, each a name of ours (`evaluate --list-policies`) or an own `Policy`. `objects`: so
    many built-in ones, a folder of meshes, or settings as `[dataset]` in `configs/evaluate.toml`; `only` these of them by name.
    `out`: a folder in which all is kept; what was run there already, by the program as well, is not run again. `baseline`: one
    of the policies, with which the others are compared; where neither it nor that of the settings is one, the first.
    `decision_s`: an own policy that takes longer for a view is reported, and not asked again.

    `config`: any settings of `configs/evaluate.toml`, as a mapping or as the path of such a file; arguments come before them.
    Where neither says it, there are 5 built-in objects and 5 episodes of each, from seed 0; a file is taken as the program
    takes it, and what it leaves out is as in `configs/evaluate.toml`.

    A policy that fails is reported by name in `Report.skipped`; the other rows are as without it. Ctrl-C stops after the
    episodes in hand.
    """
    if not isinstance(policies, Mapping):
        policies = {name: name for name in policies}
    if baseline is not None and baseline not in policies:
        raise ValueError(f"baseline: {baseline!r} is not among the policies, expected one of {', '.join(policies)}")
    file, settings = split(config)
    if file is None:
        # Fewer than the program's, which take hours.
        settings.setdefault("episodes", 5)
        objects = 5 if objects is None and "dataset" not in settings else objects
    if objects is not None:
        settings["dataset"] = {**settings.get("dataset", {}), **_dataset(objects)}
    given = {"episodes": episodes, "seed": seed, "baseline": baseline, "only": list(only) or None}
    settings.update({key: value for key, value in given.items() if value is not None})
    entrants = [_entrant(name, policy) for name, policy in policies.items()]
    if not entrants:
        raise ValueError("policies: none, expected at least one")
    with tempfile.TemporaryDirectory(prefix="benbv-") as temporary:
        directory = Path(temporary if out is None else out)
        text = _benbv.evaluate(entrants, file, json.dumps(settings, default=plain), directory, decision_s)
        markdown = (directory / "report.md").read_text(encoding="utf-8")
    raw = json.loads(text)
    rows = raw["rows"]
    return Report(
        policies=rows["policies"],
        paired=rows["paired"],
        objects=rows["objects"],
        skipped=rows["skipped"],
        episodes=raw["episodes"],
        notes=raw["notes"],
        markdown=markdown,
        directory=None if out is None else directory,
    )


def _dataset(objects: int | str | PathLike[str] | Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(objects, Mapping):
        return dict(objects)
    if isinstance(objects, int | np.integer):
        return {"name": "procedural", "objects": objects}
    return {"name": "folder", "root": str(objects)}


def _entrant(name: str, policy: str | Policy | Any) -> dict[str, Any]:
    if isinstance(policy, str):
        if policy != name:
            raise ValueError(f"policies: {name!r} stands for {policy!r}: ours keep their names, write {policy!r} for both")
        return {"name": name, "object": None, "makes": False, "version": None}
    makes = isinstance(policy, type) or not hasattr(policy, "rank_views")
    if makes and not callable(policy):
        raise TypeError(f"policies: {name!r} is a {type(policy).__name__} without rank_views, expected a policy")
    version = getattr(policy, "version", None)
    if version is not None and not isinstance(version, str):
        raise TypeError(f"policies: the version of {name!r} is a {type(version).__name__}, expected a string")
    return {"name": name, "object": policy, "makes": makes, "version": version}
