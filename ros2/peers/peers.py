"""Peers of the node for its tests: a robot with a depth camera in rclpy, and its transforms, which no wheel has a type for, in cyclonedds."""

import array
import base64
import json
import os
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from dataclasses import dataclass, field

import numpy as np
import rclpy
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from geometry_msgs.msg import PoseArray, PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray


def _struct(name):
    package, kind = name.split("/")
    return {"typename": f"{package}::msg::dds_::{kind}_"}


@dataclass
class Time(IdlStruct, **_struct("builtin_interfaces/Time")):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, **_struct("std_msgs/Header")):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Vector3(IdlStruct, **_struct("geometry_msgs/Vector3")):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, **_struct("geometry_msgs/Quaternion")):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class Transform(IdlStruct, **_struct("geometry_msgs/Transform")):
    translation: Vector3 = field(default_factory=Vector3)
    rotation: Quaternion = field(default_factory=Quaternion)


@dataclass
class TransformStamped(IdlStruct, **_struct("geometry_msgs/TransformStamped")):
    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    transform: Transform = field(default_factory=Transform)


@dataclass
class TFMessage(IdlStruct, **_struct("tf2_msgs/TFMessage")):
    transforms: sequence[TransformStamped] = field(default_factory=list)


@dataclass
class Field(IdlStruct, **_struct("sensor_msgs/PointField")):
    name: str = ""
    offset: uint32 = 0
    datatype: uint8 = 0
    count: uint32 = 0


@dataclass
class Cloud(IdlStruct, **_struct("sensor_msgs/PointCloud2")):
    header: Header
    height: uint32
    width: uint32
    fields: sequence[Field]
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: sequence[uint8]
    is_dense: bool


RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))


class Transforms:
    """What robot_state_publisher and a camera's driver tell: `/tf` at 50 Hz until stopped, `/tf_static` once."""

    def __init__(self):
        self.participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
        many = Qos(RELIABLE, Policy.History.KeepLast(100))
        latched = Qos(RELIABLE, Policy.History.KeepLast(100), Policy.Durability.TransientLocal)
        self.timed = self._writer("rt/tf", many)
        self.fixed = self._writer("rt/tf_static", latched)
        self.pose, self.running = (np.eye(3), np.zeros(3)), True
        self.flange = "flange"
        threading.Thread(target=self._run, daemon=True).start()

    def _writer(self, name, qos):
        return DataWriter(self.participant, Topic(self.participant, name, TFMessage, qos=qos), qos=qos)

    def _run(self):
        while True:
            if self.running:
                self.send("base_link", self.flange, *self.pose)
            time.sleep(0.02)

    def send(self, parent, child, rotation, translation, stamp_ns=None, writer=None):
        stamp_ns = time.time_ns() if stamp_ns is None else stamp_ns
        header = Header(Time(stamp_ns // 10**9, stamp_ns % 10**9), parent)
        x, y, z, w = quaternion(rotation)
        motion = Transform(Vector3(*map(float, translation)), Quaternion(x, y, z, w))
        (writer or self.timed).write(TFMessage([TransformStamped(header, child, motion)]))

    def send_static(self, parent, child, rotation=np.eye(3), translation=(0, 0, 0)):
        self.send(parent, child, rotation, translation, writer=self.fixed)


def quaternion(r):
    """x, y, z, w of a rotation matrix."""
    k = np.array([
        [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
        [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
        [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0],
        [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r.trace()],
    ]) / 3
    values, vectors = np.linalg.eigh(k)
    q = vectors[:, np.argmax(values)]
    return tuple(map(float, -q if q[3] < 0 else q))


def look_at(position, target):
    """Rotation of an optical frame (+X right, +Y down, +Z forward) that looks at the target."""
    z = np.subtract(target, position) / np.linalg.norm(np.subtract(target, position))
    x = np.cross(z, [0, 0, 1.0]) if abs(z[2]) < 0.99 else np.array([1.0, 0, 0])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


# Scores move by a thousandth where points move by a nanometre: a ray passes a voxel on the other side.
ROUNDING = 4e-3


def scene(count, camera, seed=1):
    """Points of a bumpy ball of 0.1 m at (0.5, 0, 0.2), world frame, that a camera there sees."""
    rng = np.random.default_rng(seed)
    centre = np.array([0.5, 0.0, 0.2])
    kept = np.zeros((0, 3))
    while len(kept) < count:
        n = rng.normal(size=(2 * count + 100, 3))
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        p = centre + n * (0.1 + 0.01 * np.sin(8 * n[:, :1]) * np.cos(6 * n[:, 1:2]))
        kept = np.vstack([kept, p[np.einsum("ij,ij->i", n, camera - p) > 0.02]])
    return kept[:count]


def cloud(points, frame="camera", stamp_ns=None, fields="xyz", dtype="f4", step=None, big=False, height=1):
    """A PointCloud2 with these columns."""
    size = np.dtype(dtype).itemsize
    step = step or size * len(fields)
    rows = np.zeros((len(points), step), "u1")
    for i, name in enumerate(fields):
        values = points[:, "xyz".index(name)] if name in "xyz" else np.zeros(len(points))
        rows[:, i * size:(i + 1) * size] = values.astype(dtype).reshape(-1, 1).view("u1")
    message = PointCloud2()
    stamp_ns = time.time_ns() if stamp_ns is None else stamp_ns
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    message.header.frame_id = frame
    message.height, message.width = height, len(points) // height
    message.point_step, message.row_step = step, step * message.width
    kind = {"f4": 7, "f8": 8, "i2": 3}[dtype]
    message.fields = [PointField(name=n, offset=i * size, datatype=kind, count=1) for i, n in enumerate(fields)]
    message.is_bigendian, message.is_dense = big, True
    message.data = array.array("B", rows.tobytes())
    return message


class Robot:
    """A camera on an arm: publishes scans, calls the node's services, hears what it says."""

    def __init__(self, name="robot", reliable=False, topic="/points", nbv="/nbv"):
        self.nbv = nbv
        self.node = rclpy.create_node(name)
        kind = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        self.scans = QoSProfile(depth=1, reliability=kind)
        self.clouds = self.node.create_publisher(PointCloud2, topic, self.scans)
        self.heard, self.times = {}, {}
        latched = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for kind, topic, qos in [(PoseStamped, "next_view", 10), (PoseArray, "candidates", 10), (MarkerArray, "markers", latched),
                                 (String, "status", latched)]:
            self.node.create_subscription(kind, f"{nbv}/{topic}", lambda m, t=topic: self._hear(t, m), qos)
        self.services = {n: self.node.create_client(Trigger, f"{nbv}/{n}") for n in ("plan", "undo", "reset")}
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.closed = False
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()

    def _spin(self):
        while not self.closed:
            self.executor.spin_once(timeout_sec=0.05)

    def _hear(self, topic, message):
        self.heard[topic], self.times[topic] = message, time.time()

    def wait(self, timeout=20):
        for name, client in self.services.items():
            assert client.wait_for_service(timeout_sec=timeout), f"no service {name}"
        self.until(lambda: self.clouds.get_subscription_count() > 0, timeout)

    @staticmethod
    def until(condition, timeout=10):
        end = time.time() + timeout
        while not condition():
            assert time.time() < end, "it did not happen in time"
            time.sleep(0.01)

    def call(self, service, timeout=60):
        future = self.services[service].call_async(Trigger.Request())
        self.until(future.done, timeout)
        return future.result()

    def plan(self):
        """What plan says, which must be yes."""
        answer = self.call("plan")
        assert answer.success, answer.message
        return json.loads(answer.message)

    def refusal(self, service="plan"):
        answer = self.call(service)
        assert not answer.success, answer.message
        return answer.message

    def status(self):
        return json.loads(self.heard["status"].data)

    def parameter(self, name, value):
        from rclpy.parameter import Parameter
        from rcl_interfaces.srv import SetParameters
        client = self.node.create_client(SetParameters, f"{self.nbv}/set_parameters")
        assert client.wait_for_service(timeout_sec=10)
        future = client.call_async(SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()]))
        self.until(future.done, 10)
        return future.result().results[0]

    def close(self):
        self.closed = True
        self.thread.join()
        self.executor.shutdown()
        self.node.destroy_node()


class Node:
    """infer --serve --ros2 base_link, with HTTP beside it."""

    def __init__(self, *arguments, topics=("ros2.cloud_topic=/points",)):
        sets = [word for topic in topics for word in ("--set", topic)]
        command = [os.environ["INFER"], "--serve", "--ros2", "base_link", "--http", "127.0.0.1:0", "--planner", "volumetric",
                   "--distance", "0.6", *sets, *arguments]
        self.log = open(f"{os.environ.get('ROS2_LOGS', '/tmp')}/infer.log", "a")
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self.log, text=True)
        self.http = ""
        for line in self.process.stdout:
            self.http = self.http or line.strip().partition("listening on ")[2]
            if line.startswith("listening as"):
                self.ready = True
            if self.http and getattr(self, "ready", False):
                break
        assert self.http, "the node did not start"

    def ask(self, method, path, body=None):
        data = json.dumps(body or {}).encode() if method == "POST" else None
        request = urllib.request.Request(self.http + path, data=data, method=method)
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.load(answer)

    def plan_over_http(self, points, camera):
        """The poses that HTTP answers for these scans, the best and those as good but for rounding, and the seconds from cloud to pose."""
        session = self.ask("POST", "/sessions")["session"]
        start = time.time()
        body = {"points_base64": base64.b64encode(points.astype("<f4").tobytes()).decode(), "from": [float(x) for x in camera]}
        self.ask("POST", f"/sessions/{session}/scans", body)
        answer = self.ask("POST", f"/sessions/{session}/next")
        took = time.time() - start
        self.ask("DELETE", f"/sessions/{session}")
        best = answer["next"]["score"]
        as_good = [c for c in answer["candidates"] if not c["objections"] and c["score"] > best - ROUNDING]
        return [c["world_from_camera"] for c in as_good], took

    def memory_mib(self):
        with open(f"/proc/{self.process.pid}/status") as status:
            return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmRSS"))

    def kill(self):
        self.process.kill()
        self.process.wait()

    def close(self):
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(15) == 0, "it ends well when it is asked to"


def start():
    rclpy.init()
    return Transforms()
