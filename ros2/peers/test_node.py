"""The node against rclpy (Fast DDS) and cyclonedds, which have met real robots. Run by .ci/ros2, in a separate network."""

import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest
import rclpy
from sensor_msgs.msg import CameraInfo, Image

import client
import peers
from peers import Node, Robot, cloud, look_at, scene

CAMERA = np.array([0.5, -0.5, 0.5])
CENTRE = np.array([0.5, 0.0, 0.2])


@pytest.fixture(scope="session")
def transforms():
    made = peers.start()
    yield made
    rclpy.shutdown()


@pytest.fixture(autouse=True)
def place(request):
    """The camera 4 cm beside the flange, which stands so that the camera is at CAMERA and looks at the object."""
    if "transforms" not in request.fixturenames:
        return
    tf = request.getfixturevalue("transforms")
    put_camera(tf, CAMERA, look_at(CAMERA, CENTRE))
    tf.running = True
    tf.send_static("flange", "camera", translation=(0.04, 0, 0))


def put_camera(tf, position, rotation):
    tf.pose = (rotation, position - rotation @ [0.04, 0, 0])


def in_camera(points, position=CAMERA):
    return (points - position) @ look_at(position, CENTRE)


@pytest.fixture(scope="session")
def node():
    made = Node()
    yield made
    made.close()


@pytest.fixture
def robot(request, transforms, node):
    made = Robot(reliable=getattr(request, "param", False))
    made.wait()
    # Once one scan has come and been used, the node hears this publisher, and what is sent once arrives.
    send(made, cloud(scene(100, CAMERA), frame="base_link"))
    made.plan()
    made.call("reset")
    time.sleep(0.3)
    yield made
    made.close()


def as_sent(points, position=CAMERA):
    """World points as the float32 of the camera's frame hold them."""
    local = in_camera(points, position).astype("f4").astype("f8")
    return local @ look_at(position, CENTRE).T + position


def send(robot, message):
    """Publishes every two seconds until the node has got it: what is sent before it knows this publisher is lost."""
    before = arrived(robot)
    for _ in range(10):
        robot.clouds.publish(message)
        end = time.time() + 2
        while time.time() < end:
            if arrived(robot) > before:
                return
            time.sleep(0.02)
    raise AssertionError("the node got nothing in 20 s")


def arrived(robot):
    """How many scans have arrived at the node."""
    robot.until(lambda: "status" in robot.heard, 20)
    return robot.status()["scans_on_topic"]["arrived"]


def same(pose, others, tolerance=2e-6):
    """One of these, to what four bytes of a coordinate hold: the same point may be rounded up on one way and down on the other."""
    off = lambda other: np.abs(np.subtract(pose["position_m"], other["translation_m"])).max()
    nearest = min(others, key=off)
    np.testing.assert_allclose(pose["position_m"], nearest["translation_m"], atol=tolerance)
    np.testing.assert_allclose(pose["quaternion_xyzw"], nearest["quaternion_xyzw"], atol=tolerance)


@pytest.mark.parametrize("robot", [False, True], indirect=True, ids=["best_effort", "reliable"])
@pytest.mark.parametrize("count", [1000, 100_000, 300_000])
def test_the_pose_is_that_of_http(robot, node, count):
    points = scene(count, CAMERA)
    start = time.time()
    robot.clouds.publish(cloud(in_camera(points)))
    said = robot.plan()
    took = time.time() - start
    robot.until(lambda: robot.times.get("next_view", 0) > start)
    took_to_topic = robot.times["next_view"] - start
    assert said["scan"]["returns"] == count and said["scan"]["frame"] == "camera"
    expected, over_http = node.plan_over_http(as_sent(points), CAMERA)
    same(said["next"], expected)
    pose = robot.heard["next_view"]
    assert pose.header.frame_id == "base_link"
    p, q = pose.pose.position, pose.pose.orientation
    assert [p.x, p.y, p.z] == said["next"]["position_m"] and [q.x, q.y, q.z, q.w] == said["next"]["quaternion_xyzw"]
    size = len(cloud(in_camera(points)).data) / 1e6
    print(f"\n{count} points ({size:.1f} MB): cloud to pose {1000 * took:.0f} ms over ROS 2 (topic {1000 * took_to_topic:.0f}), "
          f"{1000 * over_http:.0f} ms over HTTP")


def test_what_needs_no_transform_gives_the_very_same_pose(robot, node):
    """Points in the base frame already, with the camera named: nothing is rounded on the way."""
    assert robot.parameter("sensor_frame", "camera").successful
    points = scene(10_000, CAMERA).astype("f4").astype("f8")
    send(robot, cloud(points, frame="base_link"))
    same(robot.plan()["next"], node.plan_over_http(points, CAMERA)[0][:1], 1e-12)
    assert robot.parameter("sensor_frame", "").successful
    robot.call("reset")
    send(robot, cloud(points, frame="base_link"))
    assert any("its camera's position is unknown" in note for note in robot.plan()["notes"])


def test_fields_of_any_order_padding_and_width(robot, node):
    points = scene(2000, CAMERA)
    expected, _ = node.plan_over_http(as_sent(points), CAMERA)
    local = in_camera(points)
    for message in (cloud(local, fields="zyx"), cloud(local, step=48), cloud(local, dtype="f8"), cloud(local, fields="rxyz")):
        robot.call("reset")
        send(robot, message)
        # Eight bytes hold what four round.
        same(robot.plan()["next"], expected, 2e-6 if message.fields[0].datatype == 7 else 1e-4)
    holes = np.vstack([local, np.full((50, 3), np.nan)])
    robot.call("reset")
    send(robot, cloud(holes))
    said = robot.plan()
    assert said["scan"]["without"] == 50
    same(said["next"], expected)


def test_what_is_wrong_with_a_cloud_is_said_by_name(robot):
    local = in_camera(scene(1000, CAMERA))
    for message, expected in [
        (cloud(local, big=True), "bad_message: PointCloud2: is_bigendian: found true"),
        (cloud(local, fields="xyr"), "fields: found [\"x\", \"y\", \"r\"], expected x, y and z"),
        (cloud(local, dtype="i2"), "field x: found int16, expected float32 or float64"),
        (cloud(np.full((20, 3), np.nan)), "none with finite coordinates"),
    ]:
        send(robot, message)
        assert expected in robot.refusal()
    short = cloud(local)
    short.width += 1
    send(robot, short)
    assert "data: found 12000 bytes for 1001 x 1 points of 12" in robot.refusal()


def test_a_scan_is_taken_once_and_what_is_missing_is_said(robot):
    robot.parameter("wait_s", 0.3)
    send(robot, cloud(in_camera(scene(1000, CAMERA))))
    assert robot.plan()["session"]["scans"] == 1
    assert "no_new_scan" in robot.refusal() and "already been used" in robot.refusal()
    assert json.loads(robot.call("undo").message) == {"scans": 0}
    assert "no_scan" in robot.refusal("undo")
    send(robot, cloud(in_camera(scene(1000, CAMERA))))
    robot.parameter("max_age_s", 0.5)
    time.sleep(0.7)
    assert "stale_scan" in robot.refusal()
    robot.parameter("max_age_s", 30.0)
    robot.parameter("wait_s", 2.0)


def test_transforms_that_are_missing_or_stale(robot, transforms):
    local = in_camera(scene(1000, CAMERA))
    robot.parameter("wait_s", 0.5)
    send(robot, cloud(local, frame="nowhere"))
    assert '"nowhere" is not in the tree of transforms (base_link, camera, flange' in robot.refusal()
    transforms.send("island", "boat", np.eye(3), np.zeros(3))
    time.sleep(0.1)
    send(robot, cloud(local, frame="boat"))
    assert 'no transforms connect "boat" (in the tree of "island") with "base_link"' in robot.refusal()
    transforms.running = False
    time.sleep(0.5)
    send(robot, cloud(local))
    said = robot.refusal()
    assert "the newest transform of \"flange\" in \"base_link\" is" in said and "s older than the message" in said
    send(robot, cloud(local, stamp_ns=time.time_ns() - 3600 * 10**9))
    assert "older than the oldest transform kept" in robot.refusal()
    transforms.running = True
    # What is on its way is waited for.
    robot.parameter("wait_s", 5.0)
    stamp_ns = time.time_ns() + 10**9
    send(robot, cloud(local, stamp_ns=stamp_ns))
    robot.plan()
    assert time.time_ns() >= stamp_ns, "answered only when the camera's place at that time was known"
    robot.parameter("wait_s", 2.0)


def test_a_moving_camera_is_where_it_was_at_the_time_of_the_scan(robot, transforms, node):
    """Half way, in time, between two transforms a second apart."""
    transforms.running = False
    time.sleep(0.1)
    now = time.time_ns() + 10**9
    rotation = look_at(CAMERA, CENTRE)
    flange = CAMERA - rotation @ [0.04, 0, 0]
    transforms.send("base_link", "flange", rotation, flange - [0.1, 0, 0], stamp_ns=now)
    transforms.send("base_link", "flange", rotation, flange + [0.1, 0, 0], stamp_ns=now + 10**9)
    points = scene(1000, CAMERA)
    send(robot, cloud(in_camera(points), stamp_ns=now + 5 * 10**8))
    said = robot.plan()
    assert "interpolated between transforms 1.0 s apart" in said["notes"][0]
    same(said["next"], node.plan_over_http(as_sent(points), CAMERA)[0])
    time.sleep(2)
    transforms.running = True


def test_two_publishers(robot):
    other = Robot("other")
    other.wait()
    robot.clouds.publish(cloud(in_camera(scene(1000, CAMERA)), frame="flange"))
    time.sleep(0.2)
    send(other, cloud(in_camera(scene(1000, CAMERA))))
    said = robot.plan()
    assert said["scan"]["frame"] == "camera"
    assert any("publishers send on /points" in note for note in said["notes"]), said["notes"]
    other.close()


def test_depth_images_are_taken_with_their_distortion(transforms):
    """A ball seen through a lens: undistorted, its points are where they are."""
    node = Node(topics=("ros2.depth_topic=/depth/image", "ros2.node=/cell/eye"))
    robot = Robot("eye", nbv="/cell/eye")
    images = robot.node.create_publisher(Image, "/depth/image", robot.scans)
    infos = robot.node.create_publisher(CameraInfo, "/depth/camera_info", robot.scans)
    for service in robot.services.values():
        assert service.wait_for_service(timeout_sec=20)
    robot.until(lambda: images.get_subscription_count() and infos.get_subscription_count())
    time.sleep(0.3)
    width, height, f = 320, 240, 300.0
    k = np.array([0.1, -0.05, 0.001, -0.001, 0.01])
    # Where each pixel looks, by fixed point; then where that ray meets the ball.
    u, v = np.meshgrid((np.arange(width) - 160) / f, (np.arange(height) - 120) / f)
    x, y = u.copy(), v.copy()
    for _ in range(50):
        r2 = x * x + y * y
        radial = 1 + k[0] * r2 + k[1] * r2**2 + k[4] * r2**3
        x = (u - 2 * k[2] * x * y - k[3] * (r2 + 2 * x * x)) / radial
        y = (v - k[2] * (r2 + 2 * y * y) - 2 * k[3] * x * y) / radial
    ray = np.stack([x, y, np.ones_like(x)], -1)
    centre = in_camera(CENTRE[None])[0]
    a, b, c = (ray**2).sum(-1), ray @ centre, centre @ centre - 0.1**2
    root = b * b - a * c
    z = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, 0)
    for encoding, kind, unit in (("32FC1", "f4", 1.0), ("16UC1", "u2", 1000.0)):
        image, info = Image(), CameraInfo()
        now = time.time_ns()
        image.header.stamp.sec, image.header.stamp.nanosec = divmod(now, 10**9)
        image.header.frame_id = info.header.frame_id = "camera"
        image.width = info.width = width
        image.height = info.height = height
        image.encoding, image.step = encoding, width * np.dtype(kind).itemsize
        image.data = np.round(z * unit, 0 if kind == "u2" else 6).astype(kind).tobytes()
        info.distortion_model, info.d = "plumb_bob", [float(x) for x in k]
        info.k = [f, 0.0, 160.0, 0.0, f, 120.0, 0.0, 0.0, 1.0]
        robot.call("reset")
        info.height += 1
        infos.publish(info)
        images.publish(image)
        time.sleep(0.3)
        assert "CameraInfo: width, height, roi and binning" in robot.refusal()
        info.height -= 1
        infos.publish(info)
        time.sleep(0.3)
        said = robot.plan()
        assert said["scan"]["kind"] == "depth image" and said["scan"]["returns"] == int((z > 0).sum())
        known = np.array(node.ask("GET", "/sessions/1/export")["points_m"])
        off = np.abs(np.linalg.norm(known - CENTRE, axis=1) - 0.1)
        print(f"\n{encoding}: {len(known)} points, off the ball by {1000 * np.median(off):.3f} mm at the median")
        assert np.median(off) < (2e-4 if kind == "f4" else 6e-4)
    robot.close()
    node.close()


def test_an_organised_cloud_is_evidence_like_a_depth_image(robot, node):
    u, v = np.meshgrid((np.arange(160) - 80) / 150.0, (np.arange(120) - 60) / 150.0)
    ray = np.stack([u, v, np.ones_like(u)], -1)
    centre = in_camera(CENTRE[None])[0]
    a, b, c = (ray**2).sum(-1), ray @ centre, centre @ centre - 0.1**2
    root = b * b - a * c
    z = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.nan)
    points = (ray * z[..., None]).reshape(-1, 3)
    send(robot, cloud(points, height=120))
    said = robot.plan()
    assert said["scan"]["kind"] == "organised cloud"
    assert said["scan"]["without"] == int(np.isnan(z).sum())


def test_parameters(robot):
    assert not robot.parameter("base_frame", "elsewhere").successful
    assert "not JSON" in robot.parameter("config", "{").reason
    assert "unknown field `working_distance`" in robot.parameter("config", '{"working_distance": 0.45}').reason
    assert robot.parameter("config", '{"stop_below": 7}').successful
    send(robot, cloud(in_camera(scene(1000, CAMERA))))
    assert "bad_config: stop_below = 7: expected a share from 0 to 1" in robot.refusal()
    # Settings hold for the scan of the same plan.
    assert robot.parameter("config", '{"min_points": 2000}').successful
    assert "too_few_points" in robot.refusal()
    assert robot.parameter("config", '{"working_distance_m": 0.45, "min_points": 30}').successful
    view = robot.plan()["next"]
    assert abs(np.linalg.norm(np.subtract(view["position_m"], view["target_m"])) - 0.45) < 1e-9
    assert robot.parameter("config", '{"working_distance_m": 0.6}').successful
    send(robot, cloud(in_camera(scene(1000, CAMERA))))
    robot.plan()


def test_markers_show_the_cloud_the_candidates_and_the_view(robot):
    send(robot, cloud(in_camera(scene(5000, CAMERA))))
    start = time.time()
    said = robot.plan()
    robot.until(lambda: robot.times.get("markers", 0) > start and robot.times.get("candidates", 0) > start)
    shown = {m.ns: m for m in robot.heard["markers"].markers if m.action == 0}
    assert set(shown) == {"cloud", "boundary", "candidates", "next_view"}
    assert robot.heard["markers"].markers[0].action == 3
    assert all(m.header.frame_id == "base_link" for m in shown.values())
    assert len(shown["candidates"].points) == len(shown["candidates"].colors)
    apex = shown["next_view"].points[0]
    np.testing.assert_allclose([apex.x, apex.y, apex.z], said["next"]["position_m"])
    best = robot.heard["candidates"].poses[0].position
    assert [best.x, best.y, best.z] == said["next"]["position_m"]
    if folder := os.environ.get("ROS2_PICTURE"):
        import picture
        picture.draw(shown.values(), f"{folder}/ros2_markers.png")


def test_cyclonedds_sends_clouds_too(robot, transforms, node):
    from cyclonedds.core import Policy, Qos
    from cyclonedds.pub import DataWriter
    from cyclonedds.topic import Topic
    points = scene(100_000, CAMERA)
    sent = cloud(in_camera(points))
    qos = Qos(peers.RELIABLE, Policy.History.KeepLast(1))
    writer = DataWriter(transforms.participant, Topic(transforms.participant, "rt/points", peers.Cloud, qos=qos), qos=qos)
    time.sleep(1.5)
    header = peers.Header(peers.Time(sent.header.stamp.sec, sent.header.stamp.nanosec), "camera")
    fields = [peers.Field(f.name, f.offset, f.datatype, f.count) for f in sent.fields]
    writer.write(peers.Cloud(header, sent.height, sent.width, fields, False, sent.point_step, sent.row_step, list(sent.data), True))
    time.sleep(1)
    same(robot.plan()["next"], node.plan_over_http(as_sent(points), CAMERA)[0])


def test_a_peer_that_is_killed_and_comes_again(robot):
    program = (
        "import time, numpy as np, rclpy, peers\n"
        "rclpy.init(); r = peers.Robot('short_lived'); r.wait()\n"
        "c = np.array([0.5, -0.5, 0.5]); p = (peers.scene(1000, c) - c) @ peers.look_at(c, [0.5, 0, 0.2])\n"
        "while True: r.clouds.publish(peers.cloud(p)); time.sleep(0.2)\n"
    )
    for run in (1, 2):
        robot.call("reset")
        before = arrived(robot)
        peer = subprocess.Popen([sys.executable, "-c", program], cwd=os.path.dirname(__file__))
        robot.until(lambda: arrived(robot) > before, 30)
        peer.kill()
        peer.wait()
        assert robot.plan()["scan"]["returns"] == 1000, run


def test_the_node_killed_and_started_again_says_what_it_lost(transforms, tmp_path):
    for arguments, note, scans in [
        ([], "is new: scans of an earlier run are lost (--state DIR keeps them)", 1),
        (["--state", str(tmp_path / "kept")], "resumes with 1 scans", 2),
    ]:
        topics = ("ros2.cloud_topic=/again", "ros2.node=/again")
        first = Node(*arguments, topics=topics)
        robot = Robot("witness", topic="/again", nbv="/again")
        robot.wait()
        time.sleep(0.5)
        send(robot, cloud(in_camera(scene(1000, CAMERA))))
        robot.plan()
        first.kill()
        robot.heard.pop("status")
        robot.close()
        second = Node(*arguments, topics=topics)
        robot = Robot("witness", topic="/again", nbv="/again")
        robot.wait()
        robot.until(lambda: "status" in robot.heard)
        assert note in robot.status()["note"]
        time.sleep(0.5)
        send(robot, cloud(in_camera(scene(1000, CAMERA, seed=2))))
        assert robot.plan()["session"]["scans"] == scans
        robot.close()
        second.close()


def test_the_example_scans_all_around(robot, transforms):
    """A simulated arm: it stands where it is told to, and its camera sees the ball from there."""
    loop = rclpy.create_node("loop")
    robot.parameter("config", '{"stop_below": 0.02, "constraints": {"floor_height_m": 0.0}}')
    seen = [scene(20_000, CAMERA)]

    def move(goal):
        p, q = goal.pose.position, goal.pose.orientation
        position = np.array([p.x, p.y, p.z])
        x, y, z, w = q.x, q.y, q.z, q.w
        rotation = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ])
        put_camera(transforms, position, rotation)
        time.sleep(0.1)
        seen.append(scene(20_000, position))
        send(robot, cloud((seen[-1] - position) @ rotation))

    send(robot, cloud(in_camera(seen[0])))
    said = client.scan_all_around(loop, move)
    print("\n" + "\n".join(f"{s['session']['scans']} scans: {s['reason']}" for s in said))
    assert said[-1]["stop"] and 3 <= len(said) <= 9
    told = said[-1]["missing"]
    # Of even points on the whole ball, those that no scan has a point near.
    points = np.vstack(seen)[::20]
    whole = np.vstack([scene(1000, np.array([0.5, 0.0, 0.2 + z])) for z in (1e6, -1e6)])
    unseen = np.mean([np.linalg.norm(points - p, axis=1).min() > 0.008 for p in whole])
    assert unseen < 0.02
    assert told is not None and told < 0.1
    robot.parameter("config", '{"stop_below": 0.0}')
    loop.destroy_node()
