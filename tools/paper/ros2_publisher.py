"""Publish a plan as joint states, as a motion planner of ROS 2 does: one every 0.1 s.

python ros2_publisher.py PLAN.json TOPIC; a line of JSON per goal: when it was sent, by
CLOCK_MONOTONIC, and its number.
"""

import json
import sys
import time
from pathlib import Path

import rclpy
from sensor_msgs.msg import JointState


def main() -> None:
    """Until the plan has been published, once somebody listens."""
    plan = json.loads(Path(sys.argv[1]).read_text())
    rclpy.init()
    node = rclpy.create_node("motion_planner")
    publisher = node.create_publisher(JointState, sys.argv[2], 10)
    while not publisher.get_subscription_count():
        rclpy.spin_once(node, timeout_sec=0.05)
    began = time.monotonic()
    for k, (due, row) in enumerate(zip(plan["time"], plan["position"], strict=True)):
        time.sleep(max(0.0, began + due - time.monotonic()))
        message = JointState(name=plan["names"], position=row)
        message.header.stamp = node.get_clock().now().to_msg()
        sent = time.monotonic()
        publisher.publish(message)
        print(json.dumps({"goal": k, "sent": sent}), flush=True)
    publisher.wait_for_all_acked()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
