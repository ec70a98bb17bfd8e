"""Sessions in files: what is loaded answers as what was saved."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from conftest import SAMPLES

import benbv


class Interrupts:
    """A native session, while which adds a scan Ctrl-C is pressed: Python raises it when the call returns."""

    def __init__(self, native):
        self.native = native

    def __getattr__(self, name):
        return getattr(self.native, name)

    def add_points(self, *given):
        self.native.add_points(*given)
        raise KeyboardInterrupt


def test_ctrl_c_while_a_scan_is_added_loses_no_scan(sheet, tmp_path):
    session, interrupted = benbv.Session(0.8), sheet.copy()
    native = session._native
    session._native = Interrupts(native)
    with pytest.raises(KeyboardInterrupt):
        session.add_points(interrupted, origin=(0.06, 0.06, 0.8))
    session._native = native
    interrupted += 1.0
    session.add_points(sheet[:, [2, 0, 1]], origin=(0.8, 0.06, 0.06))
    assert len(session) == 2 and session.undo()
    with pytest.raises(ValueError, match="too few points"):
        session.add_points(sheet[:5], origin=(0.06, 0.06, 0.8))
    session.save(tmp_path / "part.npz")
    again = benbv.Session.load(tmp_path / "part.npz")
    assert len(again) == 1 and again.next_view() == session.next_view()


def test_places_of_rejected_scans_are_saved(sheet, tmp_path):
    session = benbv.Session(0.8, config={"registration": {"register": "refine", "registrability": "off"}})
    session.add_points(sheet, origin=(0.06, 0.06, 0.8))
    before = session.next_view()
    # A wall half a metre behind what is aimed at.
    with pytest.raises(benbv.PlanError, match="cannot be registered"):
        session.add_depth(np.full((30, 40), 1.3), (300, 300, 20, 15), before.world_from_camera)
    view = session.next_view()
    again = next(c for c in view.candidates if np.array_equal(c.position, before.next.position))
    assert [o.constraint for o in again.objections] == ["registrability"]
    path = tmp_path / "part.npz"
    session.save(path)
    assert benbv.Session.load(path).next_view() == view
    with np.load(path) as members:
        older = {name: members[name] for name in members if name != "rejected_from"}
    np.savez(path, **older)
    assert benbv.Session.load(path).next_view() == before, "of files that do not tell"


class Watched:
    """A native session that tells whether it is configured while nobody else adds or takes away scans."""

    def __init__(self, session):
        self.session, self.native, self.alone = session, session._native, []

    def __getattr__(self, name):
        return getattr(self.native, name)

    def configure(self, changes):
        with ThreadPoolExecutor(1) as other:
            self.alone.append(not other.submit(self.session._lock.acquire, blocking=False).result())
        self.native.configure(changes)


def test_settings_do_not_change_between_keeping_a_scan_and_adding_it():
    session = benbv.Session(0.8)
    session._native = watched = Watched(session)
    session.configure(stop_below=0.02)
    assert watched.alone == [True] and session.config["stop_below"] == 0.02


def test_numbers_of_numpy_are_saved(sheet, tmp_path):
    turning = benbv.Session(0.8, config={"turntable": {"stops_deg": [0, 90], "axis_point_m": [0.06, 0.06, 0]}})
    for angle in np.arange(0, 180, 90):
        turning.add_points(sheet, origin=(0.06, 0.06, 0.8), table_angle_deg=angle)
    imaged = benbv.Session()
    millimetres = np.round(benbv.read_depth(SAMPLES / "depth3.png") * 1000).astype(np.uint16)
    (pose,) = benbv.read_poses(SAMPLES / "depth3.json")
    imaged.add_depth(millimetres, [514.1, 514.1, 640, 360], pose, metres_per_unit=np.float32(0.001))
    for session in (turning, imaged):
        session.save(tmp_path / "part.npz")
        assert benbv.Session.load(tmp_path / "part.npz").next_view() == session.next_view()


def test_sessions_are_saved_and_loaded(sheet, tmp_path):
    session = benbv.Session(0.8, config={"stop_below": 0.02})
    session.add_points(sheet.astype(np.float32), origin=(0.06, 0.06, 0.8), normals=np.tile([0.1, 0.2, 0.97], (900, 1)))
    session.add_file(SAMPLES / "scan1.ply", origin=(0.0762, -0.5734, 1.0514), unit="m")
    session.configure(working_distance_m=0.9)
    depth = benbv.read_depth(SAMPLES / "depth3.png")
    (pose,) = benbv.read_poses(SAMPLES / "depth3.json")
    session.add_depth(depth, [514.1, 514.1, 640, 360], pose, misses="free")
    path = tmp_path / "part.npz"
    session.save(path)
    again = benbv.Session.load(path)
    assert len(again) == 3 and again.config == session.config
    assert again.next_view() == session.next_view()
    assert again.undo() and session.undo() and again.next_view() == session.next_view()
    stops = [benbv.look_at((0, 0, 1), (0, 0, 0)), benbv.look_at((1, 0, 0), (0, 0, 0))]
    given = benbv.Session.load(path)
    given.set_given_views(stops)
    given.save(path)
    assert benbv.Session.load(path).next_view() == given.next_view()
    assert len(given.next_view().candidates) == 2
    assert sorted(p.name for p in tmp_path.iterdir()) == ["part.npz"], "nothing is left behind"
    (tmp_path / "other").touch()
    assert path.stat().st_mode == (tmp_path / "other").stat().st_mode, "who may read other files may read it"
    with pytest.raises(FileNotFoundError):
        benbv.Session.load(tmp_path / "none.npz")
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    broken = tmp_path / "broken.npz"
    broken.write_bytes(content)
    with pytest.raises(ValueError, match="broken.npz: no session that was saved here, or damaged"):
        benbv.Session.load(broken)
    broken.write_bytes(b"nothing")
    with pytest.raises(ValueError, match="broken.npz"):
        benbv.Session.load(broken)
