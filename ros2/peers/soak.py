"""Memory of the node over time: clouds of 300,000 points at 2 Hz, a plan every 5 s, a reset every tenth. Run: soak.py SECONDS"""

import sys
import time

import numpy as np

from peers import Node, Robot, cloud, look_at, scene, start

CAMERA, CENTRE = np.array([0.5, -0.5, 0.5]), np.array([0.5, 0.0, 0.2])

transforms = start()
rotation = look_at(CAMERA, CENTRE)
transforms.pose = (rotation, CAMERA)
transforms.send_static("flange", "camera")
node = Node(topics=("ros2.cloud_topic=/points",))
robot = Robot()
robot.wait()
message = cloud((scene(300_000, CAMERA) - CAMERA) @ rotation)
begun, told, plans, sent = time.time(), 0, 0, 0
while time.time() - begun < float(sys.argv[1]):
    now = time.time()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(time.time_ns(), 10**9)
    robot.clouds.publish(message)
    sent += 1
    if sent % 10 == 0:
        robot.plan()
        plans += 1
        if plans % 10 == 0:
            robot.call("reset")
    if now - told >= 30:
        told = now
        arrived = robot.status()["scans_on_topic"]["arrived"]
        print(f"{now - begun:5.0f} s  {node.memory_mib():6.1f} MiB  {sent} sent, {arrived} arrived, {plans} plans", flush=True)
    time.sleep(max(0, now + 0.5 - time.time()))
print(f"{time.time() - begun:5.0f} s  {node.memory_mib():6.1f} MiB  {sent} sent, {robot.status()['scans_on_topic']['arrived']} arrived, {plans} plans")
robot.close()
node.close()
