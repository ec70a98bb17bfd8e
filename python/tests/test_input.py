"""Wrong and odd arguments: an exception that says what and why, and the process survives."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import benbv

EYE = np.eye(4)
K = np.array([[500.0, 0, 160], [0, 500, 120], [0, 0, 1]])


@pytest.mark.parametrize(
    ("points", "error", "message"),
    [
        (np.zeros((5, 4)), ValueError, r"points: an array of shape \(5, 4\), expected \(N, 3\)"),
        (np.zeros(3), ValueError, r"points: an array of shape \(3,\)"),
        (np.zeros((2, 2, 3)), ValueError, r"\(2, 2, 3\)"),
        (np.zeros((0, 3)), ValueError, "too few points to plan on: 0 points"),
        (np.full((100, 3), np.nan), ValueError, "100 without a position"),
        (np.zeros((5, 3)), ValueError, "too few points"),
        (np.zeros((9, 3), complex), TypeError, "points: an array of complex128, expected real numbers"),
        (np.zeros((9, 3), bool), TypeError, "an array of bool"),
        (np.array([["a"] * 3] * 9), TypeError, "an array of <U1"),
        (None, TypeError, "an array of object"),
        ("scan.ply", TypeError, "expected real numbers"),
        (np.ma.masked_array(np.zeros((9, 3)), mask=True), ValueError, "points: a masked array, its mask would be lost"),
        (np.broadcast_to(np.zeros(3), (10**9, 3)), ValueError, "at most 100663296 numbers are taken: thin or split it"),
    ],
)
def test_clouds_that_are_none(points, error, message):
    session = benbv.Session()
    with pytest.raises(error, match=message):
        session.add_points(points)
    assert len(session) == 0, "the session stays as it was"


def test_clouds_however_they_lie_in_memory(sheet):
    def answer(points):
        session = benbv.Session(0.8)
        session.add_points(points, origin=(0.06, 0.06, 0.8))
        return session.next_view()

    expected = answer(sheet)
    wide = np.zeros((len(sheet), 7))
    wide[:, 1:7:2] = sheet
    locked = sheet.copy()
    locked.flags.writeable = False
    packed = np.zeros(len(sheet), dtype=np.dtype([("tag", "u1"), ("xyz", "f8", 3)], align=False))
    packed["xyz"] = sheet
    assert not packed["xyz"].flags.aligned
    for odd in (
        np.asfortranarray(sheet),
        wide[:, 1:7:2],
        sheet[::-1].copy()[::-1],
        locked,
        packed["xyz"],
        sheet.astype(">f8"),
        sheet.astype(np.longdouble),
        sheet.tolist(),
    ):
        assert answer(odd) == expected
    single = sheet.astype(np.float32)
    assert answer(single) == answer(single.astype(np.float64)) == answer(np.asfortranarray(single))


def test_normals_origin_and_pose_must_fit(sheet):
    session = benbv.Session()
    with pytest.raises(ValueError, match="normals: 5 for 900 points"):
        session.add_points(sheet, normals=np.zeros((5, 3)))
    with pytest.raises(ValueError, match="give origin or world_from_camera"):
        session.add_points(sheet, origin=(0, 0, 1), world_from_camera=EYE)
    with pytest.raises(ValueError, match=r"origin: an array of shape \(2,\)"):
        session.add_points(sheet, origin=(0, 0))
    with pytest.raises(ValueError, match=r"origin: \(NaN, 0, 1\) is not within a million metres"):
        session.add_points(sheet, origin=(np.nan, 0, 1))
    with pytest.raises(ValueError, match="determinant -1"):
        session.add_points(sheet, world_from_camera=np.diag([1.0, 1, -1, 1]))
    with pytest.raises(ValueError, match="row by row"):
        session.add_points(sheet, world_from_camera=np.vstack([np.eye(4)[:3], [0, 0, 1, 1]]))


@pytest.mark.parametrize(
    ("depth", "k", "error", "message"),
    [
        (np.ones((2, 3, 4)), K, ValueError, r"depth: an array of shape \(2, 3, 4\), expected \(height, width\)"),
        (np.ones((0, 7), np.float32), K, ValueError, "at least one pixel"),
        (np.full((240, 320), np.nan, np.float32), K, ValueError, "too few points to plan on: 0 points"),
        (np.ones((240, 320)), np.eye(2), ValueError, r"intrinsics: an array of shape \(2, 2\)"),
        (np.ones((240, 320)), K.T, ValueError, "a camera without skew"),
        (np.ones((240, 320)), -K, ValueError, "a camera without skew"),
        (np.ones((240, 320)), [0, 500, 160, 120], ValueError, "fx and fy positive"),
        (np.ones((240, 320)), [np.nan, 500, 160, 120], ValueError, "fx and fy positive"),
        (np.broadcast_to(np.float32(1), (40_000, 30_000)), K, ValueError, "numbers are taken"),
    ],
)
def test_depth_images_that_are_none(depth, k, error, message):
    with pytest.raises(error, match=message):
        benbv.Session().add_depth(depth, k, EYE)


def test_other_words():
    with pytest.raises(ValueError, match="misses: \"nothing\", expected \"free\" or \"unknown\""):
        benbv.Session().add_depth(np.ones((9, 9)), K, EYE, misses="nothing")
    with pytest.raises(ValueError, match="metres_per_unit: -1"):
        benbv.Session().add_depth(np.ones((9, 9), np.uint16), K, EYE, metres_per_unit=-1)
    with pytest.raises(ValueError, match="unknown field `colour`"):
        benbv.Session(config={"colour": 1})
    with pytest.raises(ValueError, match="config.camera: expected an object of settings"):
        benbv.Session(config={"camera": 3})
    with pytest.raises(ValueError, match="working_distance_m = -1"):
        benbv.Session(-1)
    with pytest.raises(ValueError, match="config: "):
        benbv.Session(float("nan"))
    with pytest.raises(FileNotFoundError, match="nowhere.toml"):
        benbv.Session(config="nowhere.toml")
    with pytest.raises(OSError, match="no-weights"):
        benbv.Session(weights="no-weights")


def test_files_that_are_none(tmp_path):
    for read in (benbv.read_cloud, benbv.read_mesh, benbv.read_depth, benbv.read_poses, benbv.Session().add_file):
        with pytest.raises(OSError, match=r"none\.ply|none\.png"):
            read(tmp_path / ("none.png" if read is benbv.read_depth else "none.ply"))
    empty = tmp_path / "empty.ply"
    empty.write_bytes(b"ply\n")
    with pytest.raises(ValueError, match="empty.ply"):
        benbv.read_cloud(empty)
    with pytest.raises(ValueError, match="cannot be read here"):
        benbv.read_mesh(__file__)


anything = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.binary(max_size=5),
    st.lists(st.floats(), max_size=4),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
    arrays.arrays(
        dtype=st.one_of(arrays.scalar_dtypes(), arrays.array_dtypes(max_size=2)),
        shape=arrays.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=5),
    ),
)
EXPECTED = (ValueError, TypeError, OverflowError, OSError, benbv.PlanError, IndexError, AttributeError, UnicodeError)


@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
@given(anything, anything, anything, anything, st.integers(0, 15))
def test_arguments_of_any_kind_raise_and_never_panic(a, b, c, d, which):
    session, scene = benbv.Session(), benbv.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    calls = [
        lambda: session.add_points(a, origin=b, world_from_camera=c, normals=d),
        lambda: session.add_depth(a, b, c, misses=d),
        lambda: session.add_depth(a, K, EYE, metres_per_unit=b),
        lambda: session.add_file(a, origin=b),
        lambda: session.set_given_views(a),
        lambda: session.next_view(position=a),
        lambda: session.configure(constraints=a, camera=b, region_m=c),
        lambda: benbv.Session(a, b, weights=c),
        lambda: benbv.Scene(a, b),
        lambda: benbv.scan(scene, benbv.Camera(), a, noise=b, render=c),
        lambda: benbv.coverage(a, b, c),
        lambda: benbv.chamfer(a, b),
        lambda: benbv.look_at(a, b, c),
        lambda: benbv.depth_to_points(a, b, c, metres_per_unit=d),
        lambda: benbv.read_cloud(a),
        lambda: benbv.Shards(a, b),
    ]
    try:
        calls[which]()
    except EXPECTED:
        pass


@settings(max_examples=60, deadline=None)
@given(
    arrays.arrays(
        dtype=st.sampled_from([np.float32, np.float64, np.int16, np.uint8, np.float16]),
        shape=st.tuples(st.integers(0, 80), st.just(3)),
    )
)
def test_points_of_any_kind_are_planned_on_or_refused(points):
    session = benbv.Session()
    try:
        session.add_points(points)
        session.next_view()
    except (ValueError, benbv.PlanError) as error:
        assert "internal" not in str(error)
