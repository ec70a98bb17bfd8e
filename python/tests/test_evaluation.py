"""Own policies in our tables."""

import json
import os
import re
import runpy
import signal
import time

import numpy as np
import pytest
from conftest import ROOT, program

import benbv

FAST = {
    "surface_samples": 6000,
    "resamples": 50,
    "episode": {"num_views": 3, "image": {"width": 320, "height": 180, "fov_y_deg": 20.0}},
}
EXAMPLE = runpy.run_path(str(ROOT / "python/examples/largest_unseen.py"))
LargestUnseen = EXAMPLE["LargestUnseen"]


def evaluate(policies, **changes):
    return benbv.evaluate(policies, **{"objects": 2, "episodes": 2, "config": FAST, **changes})


def row(report, policy):
    (found,) = [r for r in report.policies if r["policy"] == policy]
    return found


def test_ours_are_those_of_the_program(tmp_path):
    report = evaluate(["benbv", "farthest"], out=tmp_path / "python")
    settings = ["--set", "surface_samples=6000", "--set", "resamples=50", "--set", "episode.num_views=3"]
    for key, value in FAST["episode"]["image"].items():
        settings += ["--set", f"episode.image.{key}={value}"]
    words = ["--dataset", "procedural", "--objects", 2, "--episodes", 2, "--policies", "benbv,farthest"]
    rows = json.loads(program("evaluate", *words, *settings, "--out", tmp_path / "program", "--json"))
    assert report.policies == rows["policies"] and report.paired == rows["paired"]
    for name in ("report.md", "episodes.jsonl", "policies.csv", "report.html"):
        ours, theirs = [(tmp_path / folder / name).read_text() for folder in ("python", "program")]
        assert ours == theirs, name
    # What the program ran is not run again, and stands beside what is added.
    both = evaluate({"benbv": "benbv", "mine": LargestUnseen()}, out=tmp_path / "program")
    assert row(both, "benbv") == row(report, "benbv")
    assert row(both, "mine")["episodes"] == 4 and both.paired[0]["policy"] == "mine"
    assert both.directory is not None and "| mine |" in both.markdown


def test_the_example_stands_beside_ours():
    report = evaluate({"mine": LargestUnseen(), "benbv": "benbv"})
    mine = row(report, "mine")
    assert mine["episodes"] == 4 and mine["coverage_percent"] > 60
    assert mine["efficiency_ci_objects_low"] <= mine["efficiency"] <= mine["efficiency_ci_objects_high"]
    assert report.skipped == [] and report.directory is None
    first = {(e["object"], e["episode"], e["policy"]): e["views"][0] for e in report.episodes}
    for (name, number, policy), view in first.items():
        assert view == first[name, number, "benbv"], f"{policy}: paired first views"
    assert evaluate({"mine": LargestUnseen(), "benbv": "benbv"}).policies == report.policies, "and again"


class Raises:
    def rank_views(self, state):
        return [1 / 0]


class Nan:
    def rank_views(self, state):
        return [(state.cameras[0], float("nan"))]


class NanPose:
    def rank_views(self, state):
        return [(np.full((4, 4), np.nan), 1.0)]


class Nothing:
    def rank_views(self, state):
        return None


class Empty:
    def rank_views(self, state):
        return []


class NoPairs:
    def rank_views(self, state):
        return [state.cameras[0]]


class Slow:
    calls = 0

    def rank_views(self, state):
        Slow.calls += 1
        time.sleep(1.0)
        return [(state.cameras[0], 1.0)]


class CannotBeMade:
    def __init__(self):
        raise RuntimeError("no weights here")

    def rank_views(self, state): ...


def test_wrong_policies_are_reported_by_name_and_harm_no_other():
    wrong = {
        "raises": (Raises(), r"ZeroDivisionError: division by zero \(test_evaluation.py, line \d+\)"),
        "nan": (Nan(), "the score of view 0 is NaN, expected a finite number"),
        "nan-pose": (NanPose(), "numbers that are not finite"),
        "nothing": (Nothing(), r"rank_views returned None, expected a list of \(view, score\)"),
        "no-pairs": (NoPairs(), "rank_views returned a ndarray as number 0"),
        "slow": (Slow(), r"rank_views took 1\.\d s, allowed 0.5 s \(decision_s\)"),
        "cannot-be-made": (CannotBeMade, "RuntimeError: no weights here"),
    }
    policies = {name: policy for name, (policy, _) in wrong.items()} | {"empty": Empty(), "farthest": "farthest"}
    report = evaluate(policies, decision_s=0.5)
    for name, (_, reason) in wrong.items():
        skipped = [s for s in report.skipped if s["policy"] == name]
        assert len(skipped) == 4, name
        assert all(f"planner {name} failed" in s["reason"] for s in skipped)
        assert any(re.search(reason, s["reason"]) for s in skipped), skipped[0]["reason"]
        assert f"| {name} |" in report.markdown, "in the table of what was not run"
    assert Slow.calls == 1, "not asked again"
    assert row(report, "empty")["episodes_ended_early"] == 4, "none to offer ends an episode as it ends ours"
    assert row(report, "farthest") == row(evaluate(["farthest"]), "farthest")


def test_a_policy_that_remembers_is_made_for_every_episode():
    made = []

    class Remembers:
        def __init__(self):
            made.append(self)
            self.seen = 0

        def rank_views(self, state):
            self.seen += 1
            assert state.num_scans == self.seen
            return LargestUnseen().rank_views(state)

    report = evaluate({"remembers": Remembers})
    assert report.skipped == [] and len(made) == 4
    assert evaluate({"function": lambda: Remembers()}).skipped == []


def test_versions_say_what_need_not_run_again(tmp_path):
    class Counts(LargestUnseen):
        version = None
        calls = 0

        def rank_views(self, state):
            Counts.calls += 1
            return super().rank_views(state)

    evaluate({"mine": Counts()}, out=tmp_path)
    evaluate({"mine": Counts()}, out=tmp_path)
    assert Counts.calls == 2 * 12, "nobody knows whether it is the same"
    Counts.version = "1"
    evaluate({"mine": Counts()}, out=tmp_path)
    assert Counts.calls == 3 * 12
    evaluate({"mine": Counts()}, out=tmp_path)
    assert Counts.calls == 3 * 12, "the same version"
    with pytest.raises(benbv.PlanError, match="none of 4 episodes could be run: .* planner mine failed"):
        evaluate({"mine": Raises()}, out=tmp_path)
    report = evaluate({"mine": LargestUnseen()}, out=tmp_path)
    assert report.skipped == [] and row(report, "mine")["episodes"] == 4, "what failed is tried again"


def test_ctrl_c_keeps_what_is_done_and_the_same_call_goes_on(tmp_path):
    class Slow(LargestUnseen):
        version = "1"
        calls = 0

        def rank_views(self, state):
            Slow.calls += 1
            if Slow.calls == 7:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.3)
            return super().rank_views(state)

    # Of processes in the background, shells have it ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            evaluate({"slow": Slow()}, out=tmp_path, episodes=20)
    finally:
        signal.signal(signal.SIGINT, before)
    stopped = Slow.calls
    assert 7 <= stopped < 60, "not all 120"
    report = evaluate({"slow": Slow()}, out=tmp_path, episodes=20)
    assert row(report, "slow")["episodes"] == 40
    assert Slow.calls == 120, "no episode was run twice"


def test_settings_hold_where_no_argument_says_otherwise(tmp_path):
    settings = {**FAST, "episodes": 1, "seed": 7, "baseline": "random-sphere", "dataset": {"name": "procedural", "objects": 2}}
    file = tmp_path / "evaluate.toml"
    file.write_text(
        "surface_samples = 6000\nresamples = 50\nepisodes = 1\nseed = 7\nbaseline = 'random-sphere'\n"
        "dataset = { name = 'procedural', objects = 2 }\n"
        "[episode]\nnum_views = 3\nimage = { width = 320, height = 180, fov_y_deg = 20.0 }\n"
    )
    asked = evaluate(["farthest", "random-sphere"], episodes=1, seed=7, baseline="random-sphere")
    for config in (settings, file):
        report = benbv.evaluate(["farthest", "random-sphere"], config=config)
        assert report.episodes == asked.episodes and len(report.episodes) == 4
        assert [(r["policy"], r["baseline"]) for r in report.paired] == [("farthest", "random-sphere")]
    other = benbv.evaluate(["farthest", "random-sphere"], 1, 2, seed=8, baseline="farthest", config=settings)
    assert len(other.episodes) == 4 and other.episodes[0]["views"] != asked.episodes[0]["views"]
    assert {r["baseline"] for r in other.paired} == {"farthest"}


def test_without_settings_there_are_five_objects_and_five_episodes():
    report = benbv.evaluate(["farthest"], config=FAST)
    assert report.episodes == benbv.evaluate(["farthest"], objects=np.int64(5), config=FAST).episodes
    runs = report.episodes + report.skipped
    assert len(runs) == 25 and len({run["object"] for run in runs}) == 5


def test_without_the_usual_baseline_the_first_policy_is_compared_with():
    report = evaluate({"mine": LargestUnseen(), "farthest": "farthest"})
    assert [(r["policy"], r["baseline"]) for r in report.paired] == [("farthest", "mine")]


def test_what_is_asked_must_make_sense(tmp_path):
    with pytest.raises(ValueError, match='"benbv" is already the name of a policy'):
        evaluate({"benbv": LargestUnseen()})
    with pytest.raises(ValueError, match="no policy is named \"farthst\", did you mean \"farthest\""):
        evaluate(["farthst"])
    with pytest.raises(ValueError, match="ours keep their names"):
        evaluate({"mine": "benbv"})
    with pytest.raises(ValueError, match="1 to 60 letters"):
        evaluate({"a | b": LargestUnseen()})
    with pytest.raises(TypeError, match="'mine' is a int without rank_views"):
        evaluate({"mine": 3})
    with pytest.raises(ValueError, match="policies: none"):
        evaluate({})
    with pytest.raises(ValueError, match="baseline: 'benbv' is not among the policies, expected one of farthest"):
        evaluate(["farthest"], baseline="benbv")
    with pytest.raises(ValueError, match="episodes = 0: expected"):
        evaluate(["farthest"], episodes=0)
    with pytest.raises(ValueError, match="unknown field `epsiode`"):
        evaluate(["farthest"], config={"epsiode": {}})
    with pytest.raises((ValueError, OSError), match="nowhere"):
        evaluate(["farthest"], objects=tmp_path / "nowhere")
    with pytest.raises(ValueError, match="decision_s"):
        evaluate(["farthest"], decision_s=-1)


def test_the_state_is_all_that_was_measured():
    states = []

    class Looks:
        def rank_views(self, state):
            states.append(state)
            views = state.candidates()
            return [(view, -i) for i, view in enumerate(views)]

    evaluate({"looks": Looks()}, objects=1, episodes=1)
    first, last = states[0], states[-1]
    assert (first.num_scans, last.num_scans) == (1, 3)
    assert first.points.shape == first.normals.shape and len(first.points) > 50
    assert [c.shape for c in last.cameras] == [(4, 4)] * 3
    depth = first.depth(0)
    assert depth.shape == (180, 320) == first.image_size[::-1] and (depth > 0).sum() > 50
    seen = benbv.depth_to_points(depth, first.intrinsics, first.cameras[0])
    assert benbv.overlap(first.points, seen, 0.003) > 0.99, "the image is what the cloud was made of"
    assert (first.working_distance, first.tolerance) == (1.2, 0.002) and first.spacing > 0
    assert len(first.candidates()) == 20 and first.seed != last.seed
    np.testing.assert_array_equal(first.candidates()[0], first.candidates()[0])
    with pytest.raises(ValueError, match="scan 7: there are 1"):
        first.depth(7)


def test_the_documentation_shows_the_example():
    text = (ROOT / "docs/python.md").read_text()
    assert (ROOT / "python/examples/largest_unseen.py").read_text() in text
