"""Planning: the answers of `infer`, number for number."""

import json
import pickle
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict

import numpy as np
import pytest
from conftest import DATA, SAMPLES, infer

import benbv

FROM = [(0.0762, -0.5734, 1.0514), (0.5046, -0.6854, -0.8223)]
SCANS = [SAMPLES / "scan1.ply", SAMPLES / "scan2.ply"]


def words(position):
    return ",".join(map(str, position))


def test_clouds_are_answered_as_by_infer():
    session = benbv.Session()
    for path, origin in zip(SCANS, FROM):
        report = session.add_points(benbv.read_cloud(path).points, origin=origin)
    assert (report.scans, len(session)) == (2, 2)
    expected = infer("--scan", *SCANS, "--from", *map(words, FROM))
    assert session.next_view().raw == expected


def test_files_are_answered_as_by_infer():
    session = benbv.Session(0.8, config={"stop_below": 0.01})
    session.add_file(SCANS[0])
    assert session.next_view().raw == infer("--scan", SCANS[0], "--distance", 0.8, "--stop-below", 0.01)


def test_depth_images_are_answered_as_by_infer():
    pose = json.loads((SAMPLES / "depth3.json").read_text())
    expected = infer("--depth", SAMPLES / "depth3.png", "--pose", SAMPLES / "depth3.json", "--misses", "free")
    metres = benbv.read_depth(SAMPLES / "depth3.png")
    # Python's own JSON differs from the program's in the last bit of some numbers.
    (world_from_camera,) = benbv.read_poses(SAMPLES / "depth3.json")
    fx, fy, cx, cy = pose["intrinsics"]
    k = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
    millimetres = np.round(metres * 1000).astype(np.uint16)
    for depth, intrinsics in [(metres, k), (millimetres, pose["intrinsics"]), (metres.astype(np.float64), k)]:
        session = benbv.Session()
        session.add_depth(depth, intrinsics, world_from_camera, misses="free")
        assert session.next_view().raw == expected
    tenths = benbv.Session()
    tenths.add_depth(millimetres * 2, k, world_from_camera, misses="free", metres_per_unit=0.0005)
    assert tenths.next_view().next is not None


@pytest.mark.skipif(not DATA.exists(), reason="needs ../shared/data/scans beside the repository")
def test_recorded_scans_are_answered_as_by_infer():
    for path in sorted(DATA.iterdir()):
        session = benbv.Session()
        session.add_file(path)
        assert session.next_view().raw == infer("--scan", path), path.name


def test_a_line_scanner_has_a_path(tmp_path):
    path = [[-0.3, -0.5, 1.0], [0.4, -0.5, 1.0]]
    session = benbv.Session()
    session.add_points(benbv.read_cloud(SCANS[0]).points, origin=path)
    text = "..".join(",".join(map(str, end)) for end in path)
    assert session.next_view().raw == infer("--scan", SCANS[0], f"--from={text}")
    for wrong in (np.zeros((2, 3)), [[0, 0, 1], [0, 0, np.nan]], np.ones((3, 2))):
        with pytest.raises(ValueError, match="origin"):
            session.add_points(np.zeros((9, 3)), origin=wrong)


def test_a_view_has_what_the_answer_has(sheet):
    session = benbv.Session(0.8)
    session.add_points(sheet, origin=(0.06, 0.06, 0.8))
    view = session.next_view()
    assert view.next is not None and view.world_from_camera.shape == (4, 4)
    assert view.world_from_camera.dtype == np.float64
    np.testing.assert_array_equal(view.next.position, view.raw["next"]["position_m"])
    # +Z looks from the camera to the target, the working distance ahead.
    ahead = view.world_from_camera @ [0, 0, 0.8, 1]
    np.testing.assert_allclose(ahead[:3], view.next.target, atol=1e-9)
    assert view.expected_gain == view.raw["next"]["expected_gain"]
    assert len(view.candidates) == len(view.raw["candidates"]) >= 20
    assert not view.stop.stop and "predicted" in view.stop.basis
    again = pickle.loads(pickle.dumps(view))
    assert again == view and again.candidates[3].score == view.candidates[3].score
    assert "benbv.View from" in repr(view)


def test_what_is_ruled_out_says_why(sheet):
    session = benbv.Session(0.8, config={"constraints": {"floor_height_m": 2.0}})
    session.add_points(sheet, origin=(0.06, 0.06, 0.8))
    view = session.next_view()
    assert view.next is None and view.stop.stop
    assert view.candidates[0].objections[0].constraint == "floor"
    assert "floor at 2.000 m" in view.candidates[0].objections[0].reason
    with pytest.raises(benbv.PlanError, match="no next view: all .* candidates are excluded"):
        _ = view.world_from_camera
    session.configure(constraints={"floor_height_m": None})
    assert session.next_view().next is not None


def test_undo_reset_and_settings(sheet):
    session = benbv.Session(0.8)
    assert not session.undo()
    session.add_points(sheet, origin=(0.06, 0.06, 0.8))
    before = session.next_view()
    session.add_points(sheet[:, [2, 0, 1]], origin=(0.8, 0.06, 0.06))
    assert session.next_view() != before
    assert session.undo() and session.next_view() == before
    points, normals = session.cloud()
    assert points.shape == normals.shape and points.shape[0] > 800
    vertices, triangles = session.mesh()
    assert vertices.shape[1] == triangles.shape[1] == 3 and triangles.max() == len(vertices) - 1
    assert np.abs(vertices[:, 2] - sheet[0, 2]).max() < 2e-3, "on the sheet"
    assert session.config["working_distance_m"] == 0.8
    with pytest.raises(ValueError, match="tolerance_m = -1.0: expected 1e-6 to 1e6 metres"):
        session.configure(tolerance_m=-1)
    assert session.config["tolerance_m"] == 0.002
    session.reset()
    assert len(session) == 0
    with pytest.raises(benbv.PlanError, match="there is no scan yet"):
        session.next_view()


def test_given_views_and_position(sheet):
    stops = [benbv.look_at((0.06 + x, 0.06, 0.7), (0.06, 0.06, 0.0)) for x in (-0.5, 0.0, 0.5)]
    session = benbv.Session(0.8)
    session.add_points(sheet, origin=(0.06, 0.06, 0.8))
    session.set_given_views(stops)
    view = session.next_view(position=(1.0, 0.0, 0.5))
    assert view.next is not None and view.next.given in (0, 1, 2)
    np.testing.assert_allclose(view.world_from_camera, stops[view.next.given], atol=1e-12)
    session.set_given_views([])
    assert len(session.next_view().candidates) >= 20


def test_a_pose_tells_where_a_cloud_was_taken_from(sheet):
    pose = benbv.look_at((0.06, 0.06, 0.8), (0.06, 0.06, 0.0))
    answers = []
    for camera in ({"origin": (0.06, 0.06, 0.8)}, {"world_from_camera": pose}):
        session = benbv.Session(0.8)
        session.add_points(sheet, **camera)
        answers.append(session.next_view())
    assert answers[0] == answers[1]
    with pytest.raises(ValueError, match="0 % of the points lie ahead of this camera: is it camera_from_world"):
        benbv.Session().add_points(sheet, world_from_camera=np.linalg.inv(pose) @ np.diag([1, -1, -1, 1]))


def test_threads_share_the_interpreter_and_a_session(sheet):
    session = benbv.Session(0.8)
    session.add_points(sheet, origin=(0.06, 0.06, 0.8))
    expected = session.next_view()
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: session.next_view(), range(16)))
    assert all(answer == expected for answer in answers)

    def own(_):
        session = benbv.Session(0.8)
        session.add_points(sheet, origin=(0.06, 0.06, 0.8))
        return session.next_view()

    with ThreadPoolExecutor(4) as pool:
        assert all(answer == expected for answer in pool.map(own, range(4)))


def test_the_interpreter_is_free_while_a_session_works():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(400_000, 3))
    points /= 10 * np.linalg.norm(points, axis=1, keepdims=True)
    session, steps, done = benbv.Session(), [], threading.Event()

    def count():
        while not done.wait(0.001):
            steps.append(1)

    counter = threading.Thread(target=count)
    counter.start()
    session.add_points(points, origin=(0, 0, 1.2))
    done.set()
    counter.join()
    assert len(steps) > 5, "another thread went on meanwhile"


def test_what_the_arm_cannot_reach_is_ruled_out(sheet):
    session = benbv.Session(0.8)
    session.add_points(sheet, origin=(0.06, 0.06, 0.8))
    free, asked = session.next_view(), []

    def reachable(pose):
        asked.append(pose)
        if np.array_equal(pose, free.world_from_camera):
            return "joint 4 at its limit"
        return pose[2, 3] > 0

    view = session.next_view(reachable=reachable)
    assert len(asked) == sum(not c.objections for c in free.candidates)
    assert asked[0].shape == (4, 4) and view.world_from_camera[2, 3] > 0
    reasons = {o.reason for c in view.candidates for o in c.objections if o.constraint == "caller"}
    assert "joint 4 at its limit" in reasons
    assert session.next_view(reachable=lambda pose: None) == free
    for no in (False, np.False_, np.array(False)):
        assert session.next_view(reachable=lambda pose, no=no: no).next is None
    assert session.next_view(reachable=lambda pose: np.array(True)) == free
    with pytest.raises(ZeroDivisionError):
        session.next_view(reachable=lambda pose: 1 / 0)
    for odd in ({}, 1, 0, np.array(0), [0.5], (True, "far"), (False, 0.5)):
        with pytest.raises(TypeError, match="reachable returned .*, expected True, a cost"):
            session.next_view(reachable=lambda pose, odd=odd: odd)
    for cost in (0.5, np.float32(0.5), np.array(0.5), (True, 0.5)):
        dear = session.next_view(reachable=lambda pose, cost=cost: cost)
        assert dear.candidates[0].score == pytest.approx(free.candidates[0].score - 0.5)
    why = session.next_view(reachable=lambda pose: (False, "elbow"))
    assert "elbow" in {o.reason for c in why.candidates for o in c.objections}
    with pytest.raises(benbv.PlanError, match="a cost of -1: expected zero or a positive number"):
        session.next_view(reachable=lambda pose: -1.0)
    with pytest.raises(benbv.PlanError, match="waiting for"):
        session.next_view(reachable=lambda pose: session.next_view())
    assert session.next_view() == free


def test_what_reachable_asks_is_refused_while_another_thread_waits(sheet):
    session, refused = benbv.Session(0.8), []
    session.add_points(sheet, origin=(0.06, 0.06, 0.8))
    other = threading.Thread(target=session.undo, daemon=True)

    def reachable(pose):
        other.start()
        other.join(0.1)
        session.undo()

    def ask():
        with pytest.raises(benbv.PlanError, match="waiting for"):
            session.next_view(reachable=reachable)
        refused.append(True)

    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    asking.join(30)
    assert refused == [True], "neither waits for the other"
    other.join(30)
    assert len(session) == 0


def test_a_scan_on_a_turntable_is_brought_into_the_frame_of_the_object(sheet, tmp_path):
    session = benbv.Session(0.8, config={"turntable": {"stops_deg": [0, 90], "axis_point_m": [0.06, 0.06, 0]}, "max_points": 0})
    for angle in (np.nan, -np.inf, 1e6):
        with pytest.raises(ValueError, match="table_angle_deg: .*, expected an angle in degrees"):
            session.add_points(sheet, origin=(0.06, 0.06, 0.8), table_angle_deg=angle)
    session.add_points(sheet + [0.01, 0, 0], origin=(0.06, 0.06, 0.8), table_angle_deg=90)
    low, high = np.min(session.cloud()[0], 0), np.max(session.cloud()[0], 0)
    assert np.allclose(low, (0, -0.006, 0), atol=1e-6) and np.allclose(high, (0.116, 0.11, 0), atol=1e-6)
    session.save(tmp_path / "kept.npz")
    assert benbv.Session.load(tmp_path / "kept.npz").next_view() == session.next_view()


def test_with_a_turntable_a_view_has_its_stop_and_the_pose_there(sheet):
    session = benbv.Session(0.8, config={"turntable": {"stops_deg": [90], "axis_point_m": [0.06, 0.06, 0]}})
    session.add_points(sheet, origin=(0.06, 0.06, 0.8), table_angle_deg=90)
    view = session.next_view()
    # A quarter turn about the middle of the sheet.
    cell_from_object = [[0, -1, 0, 0.12], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    for candidate in (view.next, *view.candidates):
        assert candidate.table.stop_deg == 90 and candidate.reached is None
        pose = cell_from_object @ candidate.world_from_camera
        np.testing.assert_allclose(candidate.table.cell_from_camera, pose, atol=1e-9)
    free = benbv.Session(0.8)
    free.add_points(sheet, origin=(0.06, 0.06, 0.8))
    assert free.next_view().next.table is None


def test_one_working_distance_replaces_a_range(sheet, tmp_path):
    cell = tmp_path / "cell.toml"
    cell.write_text("working_distance_range_m = [0.6, 0.9]\n")
    assert benbv.Session(config=cell).config["working_distance_range_m"] == [0.6, 0.9]
    for config in (cell, {"working_distance_range_m": [0.6, 0.9]}):
        session = benbv.Session(0.35, config=config)
        assert (session.config["working_distance_m"], session.config["working_distance_range_m"]) == (0.35, None)
    session.configure(working_distance_m=0.4, working_distance_range_m=[0.6, 0.9])
    assert session.config["working_distance_range_m"] == [0.6, 0.9]
    session.configure(working_distance_m=0.5)
    session.add_points(sheet, origin=(0.06, 0.06, 0.8))
    assert {c.working_distance for c in session.next_view().candidates} == {0.5}


def test_a_lens_is_undone_on_reading():
    depth = benbv.read_depth(SAMPLES / "depth3.png")
    (pose,) = benbv.read_poses(SAMPLES / "depth3.json")
    k = [514.1, 514.1, 640, 360]

    def answer(**lens):
        session = benbv.Session()
        session.add_depth(depth, k, pose, misses="free", **lens)
        return session.next_view()

    plain = answer()
    assert answer(distortion=[0, 0, 0, 0]) == plain
    assert answer(distortion=[-0.2, 0.05, 0.001, 0]) != plain
    assert answer(distortion=[0.1], distortion_model="fisheye") != plain
    with pytest.raises(ValueError, match="distortion: found 2 coefficients for brown_conrady"):
        answer(distortion=[0.1, 0.2])
    with pytest.raises(ValueError, match="model barrel, expected"):
        answer(distortion=[0.1], distortion_model="barrel")


def test_a_calibration_is_of_its_size_and_unit(tmp_path):
    (pose,) = benbv.read_poses(SAMPLES / "depth3.json")
    tenths = np.round(benbv.read_depth(SAMPLES / "depth3.png") * 10_000).astype(np.uint16)
    height, width = tenths.shape
    path = tmp_path / "camera.json"

    def calibration(**changes):
        bop = {"cx": 640, "cy": 360, "depth_scale": 0.1, "fx": 514.1, "fy": 514.1, "height": height, "width": width}
        path.write_text(json.dumps(bop | changes))
        return benbv.read_camera(path)

    camera = calibration()
    assert camera.size == (width, height) and camera.metres_per_unit == pytest.approx(1e-4)
    whole, plain = benbv.Session(), benbv.Session()
    whole.add_depth(tenths, world_from_camera=pose, **asdict(camera))
    plain.add_depth(tenths, camera.intrinsics, pose, metres_per_unit=camera.metres_per_unit)
    assert whole.next_view() == plain.next_view()
    whole.save(tmp_path / "kept.npz")
    assert benbv.Session.load(tmp_path / "kept.npz").next_view() == whole.next_view()
    with pytest.raises(ValueError, match=f"{width} x {height} pixels, but the camera was calibrated for 640 x 360"):
        whole.add_depth(tenths, world_from_camera=pose, **asdict(calibration(width=640, height=360)))
    for wrong in ((640,), (640.0, 360.0), (-1, 360), "ab"):
        with pytest.raises((ValueError, TypeError, OverflowError)):
            whole.add_depth(tenths, camera.intrinsics, pose, size=wrong)
    # What is in metres already is seen to be scaled twice.
    twice = whole.add_depth(tenths * 1e-4, world_from_camera=pose, **asdict(camera))
    assert any("already" in note for note in twice.notes)


def test_a_cloud_in_an_unknown_unit_is_asked_for_it(sheet, tmp_path):
    path = tmp_path / "sheet.csv"
    rows = "".join(f"{x},{y},{z}\n" for x, y, z in 1000 * sheet)
    path.write_text(f"x [px],y [px],z [px]\n{rows}")
    cloud = benbv.read_cloud(path)
    assert cloud.metres_per_unit is None and "[px]" in cloud.notes[0]
    session = benbv.Session(0.8)
    with pytest.raises(ValueError, match=r"the unit \[px\] of its columns is not known"):
        session.add_file(path)
    assert session.add_file(path, unit="mm").scans == 1


def test_optional_tables_of_settings_are_taken_away_by_none(sheet):
    session = benbv.Session(0.8, config={"turntable": {"stops_deg": [0, 90], "axis_point_m": [0.06, 0.06, 0]}})
    session.configure(turntable=None)
    assert session.config["turntable"] is None
    session.add_points(sheet, origin=(0.06, 0.06, 0.8))
    assert session.next_view().next.table is None
    with pytest.raises(ValueError, match="null was given for config.camera"):
        session.configure(camera=None)


def test_several_views_are_planned_as_by_infer(tmp_path):
    session = benbv.Session()
    for path, origin in zip(SCANS, FROM):
        session.add_file(path, origin=origin)
    view = session.next_view(plan_views=4)
    infer("--scan", *SCANS, "--from", *map(words, FROM), "--plan", tmp_path / "plan.json", "--plan-views", 4)
    plan = json.loads((tmp_path / "plan.json").read_text())
    assert 1 <= len(view.plan) == len(plan["views"]) <= 4
    assert view.raw["plan"]["adds"] == plan["adds"]
    for planned, expected in zip(view.plan, plan["views"]):
        assert list(planned.position) == [expected["x_m"], expected["y_m"], expected["z_m"]]
    alone = session.next_view()
    assert alone.plan is None
    assert alone.raw == {key: value for key, value in view.raw.items() if key != "plan"}
    with pytest.raises(ValueError, match="plan_views: 0, expected 1 to 100"):
        session.next_view(plan_views=0)


def test_an_arm_and_a_calibration_are_read_as_by_infer(tmp_path):
    urdf = SAMPLES / "robots" / "ur5e.urdf"
    base = [[1, 0, 0, 0.55], [0, 1, 0, 0], [0, 0, 1, -0.2], [0, 0, 0, 1]]
    hand_eye = [[1, 0, 0, 0], [0, 1, 0, 0.05], [0, 0, 1, 0.03], [0, 0, 0, 1]]
    robot = {"arm": benbv.read_arm(urdf, "tool0"), "flange_from_camera": hand_eye, "cell_from_base": base}
    session = benbv.Session(0.5, config={"robot": robot})
    session.add_file(SCANS[0], origin=FROM[0])
    flags = ["--robot", urdf, "--tool", "tool0", "--flange-from-camera", "0,0.05,0.03,0,0,0,1", "--distance", 0.5]
    scan = ["--scan", SCANS[0], "--from", words(FROM[0])]
    view = session.next_view()
    assert view.raw == infer(*scan, *flags, "--set", f"robot.cell_from_base={base}")
    told = view.raw["next"]["reached"]
    assert view.next.reached.joints == {joint["name"]: joint["value"] for joint in told["joints"]}
    assert len(view.next.reached.joints) == 6 and view.next.reached.travel == told["travel"]
    assert all((c.reached is None) == bool(c.objections) for c in view.candidates)
    with pytest.raises(ValueError, match="flange"):
        benbv.read_arm(urdf, "flange_of_another")

    calibration = tmp_path / "camera.yaml"
    calibration.write_text(
        "image_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\n"
        "camera_matrix: {rows: 3, cols: 3, data: [600, 0, 320, 0, 610, 240, 0, 0, 1]}\n"
        "distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -0.2, 0.001, 0.002, 0.05]}\n"
    )
    camera = benbv.read_camera(calibration)
    assert (camera.intrinsics, camera.size) == ((600, 610, 320, 240), (640, 480))
    assert camera.distortion_model == "brown_conrady" and camera.distortion[:5] == (0.1, -0.2, 0.001, 0.002, 0.05)
    with pytest.raises(OSError, match="nowhere"):
        benbv.read_camera("nowhere.yaml")
