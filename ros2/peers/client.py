"""A robot's loop over ROS 2: plan, move, scan, until the node says stop. Needs rclpy, std_srvs and geometry_msgs."""

import json

import rclpy
from geometry_msgs.msg import PoseStamped
from std_srvs.srv import Trigger


def scan_all_around(node, move, most=10):
    """move(pose: PoseStamped) brings the camera there, and returns once a new scan has been taken; returns what was said."""
    client = node.create_client(Trigger, "/nbv/plan")
    client.wait_for_service()
    said = []
    while len(said) < most:
        future = client.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(node, future)
        answer = future.result()
        if not answer.success:
            raise RuntimeError(answer.message)
        said.append(json.loads(answer.message))
        if said[-1]["stop"]:
            break
        view = said[-1]["next"]
        goal = PoseStamped()
        goal.header.frame_id = view["frame"]
        p, q = goal.pose.position, goal.pose.orientation
        p.x, p.y, p.z = view["position_m"]
        q.x, q.y, q.z, q.w = view["quaternion_xyzw"]
        move(goal)
    return said
