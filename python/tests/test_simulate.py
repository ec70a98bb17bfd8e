"""The simulator, its metrics, episodes and the Gymnasium environment."""

import time
from pathlib import Path

import numpy as np
import pytest
from test_evaluation import FAST

import benbv

CAMERA = benbv.Camera.from_fov(320, 180, 20.0)


def test_a_scan_is_what_a_camera_sees():
    square = benbv.Scene([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    pose = benbv.look_at((0.0, 0.0, 1.2), (0.0, 0.0, 0.0))
    depth = benbv.scan(square, CAMERA, pose)
    assert depth.shape == (180, 320) and depth.dtype == np.float32
    np.testing.assert_allclose(depth, 1.2, atol=1e-6)
    points = benbv.depth_to_points(depth, CAMERA.intrinsics, pose)
    assert points.shape == (180 * 320, 3)
    np.testing.assert_allclose(points[:, 2], 0, atol=1e-6)
    assert not benbv.scan(square, CAMERA, benbv.look_at((0, 0, 1.2), (0, 0, 3))).any(), "looks away"
    noisy = benbv.scan(square, CAMERA, pose, noise=0.002, render={"depth_quantum_m": 0.0})
    assert 0.001 < noisy.std() < 0.004
    np.testing.assert_array_equal(noisy, benbv.scan(square, CAMERA, pose, noise=0.002, render={"depth_quantum_m": 0.0}))
    sensor = benbv.scan(square, CAMERA, pose, noise=True)
    assert sensor.std() > 1e-4
    np.testing.assert_array_equal(sensor, benbv.scan(square, CAMERA, pose, noise=np.True_))
    with pytest.raises(ValueError, match="unknown field `sigma`"):
        benbv.scan(square, CAMERA, pose, noise={"sigma": 1})
    with pytest.raises(ValueError, match="noise: expected numbers of 0 and above"):
        benbv.scan(square, CAMERA, pose, noise=-1.0)
    with pytest.raises(ValueError, match="1 to 16,384 pixels"):
        benbv.scan(square, benbv.Camera(10**9, 1), pose)
    with pytest.raises(ValueError, match="at most 33,554,432 pixels"):
        benbv.scan(square, benbv.Camera(16_000, 16_000), pose)
    assert benbv.Camera().intrinsics[0, 0] == pytest.approx(benbv.Camera.from_fov(1280, 720, 70).fx)


def test_meshes_that_are_none():
    good = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    for vertices, faces, message in [
        (good, [[0, 1, 3]], "faces: an index 3, expected 0 to 2"),
        (good, [[0, 1, -1]], "faces: an index -1"),
        (good, np.zeros((0, 3), int), "faces: none"),
        ([[0, 0, np.nan]] * 3, [[0, 1, 2]], "vertices: number 0 is not within"),
        (good, [[0, 1]], r"faces: an array of shape \(1, 2\)"),
    ]:
        with pytest.raises(ValueError, match=message):
            benbv.Scene(vertices, faces)
    with pytest.raises(TypeError, match="faces: an array of floats"):
        benbv.Scene(good, [[0.0, 1.0, 2.0]])
    scene = benbv.Scene(good, np.array([[0, 1, 2]], np.uint8))
    np.testing.assert_array_equal(scene.faces, [[0, 1, 2]])
    np.testing.assert_array_equal(scene.vertices, good)
    assert benbv.Scene(scene.vertices, scene.faces).faces.dtype == np.uint32
    with pytest.raises(ValueError, match="samples: 0"):
        scene.surface(0)


def test_metrics():
    a, b = np.zeros((1, 3)), np.array([[3.0, 4, 0], [0, 0, 1]])
    assert benbv.chamfer(a, b) == pytest.approx(0.5 * (1 + 3))
    assert benbv.hausdorff(a, b) == pytest.approx(5)
    assert benbv.coverage(a, b, 1.5) == 0.5
    assert benbv.overlap(b, a, 1.5) == 0.5
    assert benbv.overlap(np.zeros((0, 3)), a) is None
    assert benbv.coverage(a, [[0, 0, 0], [np.nan, 0, 0]]) == 1.0, "no return is no surface"
    with pytest.raises(ValueError, match="tolerance: 0, expected a length above 0"):
        benbv.coverage(a, b, 0.0)


def test_an_episode_is_one_of_evaluate(tmp_path):
    policy = [benbv.look_at(p, (0, 0, 0)) for p in [(1.2, 0, 0), (0, 1.2, 0), (0, 0, -1.2)]]

    class Fixed:
        def rank_views(self, state):
            return [(policy[state.num_scans - 1], 1.0)]

    report = benbv.evaluate({"fixed": Fixed()}, objects=1, episodes=2, config=FAST)
    expected = report.episodes[1]
    scene = benbv.Scene.procedural(0x7E57)
    episode = benbv.Episode(scene, name=expected["object"], number=1, config=FAST)
    coverages = [episode.coverage]
    for i, view in enumerate(policy):
        assert not episode.done and episode.state.num_scans == i + 1 and episode.record is None
        state = episode.step(view)
        assert (state is None) == (i == 2)
        coverages.append(episode.coverage)
    assert episode.done and len(episode.views) == 4
    assert coverages == expected["coverages"]
    record = dict(episode.record)
    for own in (record, expected):
        own.pop("policy")
    assert record == expected
    assert episode.overlap == expected["overlaps"][-1]
    points, normals = episode.cloud
    assert points.shape == normals.shape
    with pytest.raises(benbv.PlanError, match="the episode has ended"):
        episode.step(policy[0])


def test_episodes_end_when_they_are_dropped(ball):
    tasks = Path("/proc/self/task")

    def threads():
        return sum((t / "comm").read_text().startswith("episode") for t in tasks.iterdir()) if tasks.exists() else 0

    for _ in range(20):
        benbv.Episode(ball, config=FAST)
    episode = benbv.Episode(ball, config=FAST)
    episode.close()
    assert episode.done
    for _ in range(200):
        if threads() == 0:
            break
        time.sleep(0.01)
    assert threads() == 0, "every loop went home"
    with pytest.raises(benbv.PlanError, match="none of 100 first views"):
        benbv.Episode(ball, config={**FAST, "diagonal_m": 1e-4})
    with pytest.raises(ValueError, match="episode.working_distance_m = -1"):
        benbv.Episode(ball, config={"episode": {"working_distance_m": -1}})


def test_the_environment_keeps_the_rules(ball):
    gymnasium = pytest.importorskip("gymnasium")
    from gymnasium.utils.env_checker import check_env

    from benbv.gym import ScanEnv

    env = ScanEnv([ball], num_views=3, max_points=500, config=FAST)
    check_env(env, skip_render_check=True)
    first, info = env.reset(seed=5)
    again, _ = env.reset(seed=5)
    np.testing.assert_array_equal(first["points"], again["points"])
    assert 0 < info["coverage"] < 1 and first["views"] == [1]
    total, done, steps = info["coverage"], False, 0
    while not done:
        _, reward, terminated, truncated, info = env.step(env.action_space.sample())
        total, done, steps = total + reward, terminated or truncated, steps + 1
    assert steps == 3 and truncated and total == pytest.approx(info["coverage"])
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(env.action_space.sample())
    env.close()
