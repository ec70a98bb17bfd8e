"""Time from cloud to pose over ROS 2 and over HTTP, the same scan into an empty session each time. Run: latency.py RUNS"""

import sys
import time

import numpy as np

from peers import Node, Robot, cloud, look_at, scene, start

CAMERA, CENTRE = np.array([0.5, -0.5, 0.5]), np.array([0.5, 0.0, 0.2])

transforms = start()
rotation = look_at(CAMERA, CENTRE)
transforms.pose = (rotation, CAMERA)
transforms.send_static("flange", "camera")
node = Node()
robots = {kind: Robot(kind, reliable=kind == "reliable") for kind in ("best_effort", "reliable")}
for robot in robots.values():
    robot.wait()
for count in (1000, 100_000, 300_000):
    points = scene(count, CAMERA)
    message = cloud((points - CAMERA) @ rotation)
    took = {"best_effort": [], "reliable": [], "http": []}
    for _ in range(int(sys.argv[1])):
        for kind, robot in robots.items():
            robot.call("reset")
            time.sleep(0.2)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(time.time_ns(), 10**9)
            begun = time.time()
            robot.clouds.publish(message)
            robot.plan()
            robot.until(lambda: robot.times.get("next_view", 0) > begun)
            took[kind].append(robot.times["next_view"] - begun)
        took["http"].append(node.plan_over_http(points, CAMERA)[1])
    print(f"{count:7} points: " + ", ".join(f"{kind} {1000 * np.median(t):.0f} ms" for kind, t in took.items()), flush=True)
for robot in robots.values():
    robot.close()
node.close()
