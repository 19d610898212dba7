"""Publish a plan as joint states, as a motion planner of ROS 2 does: one every 0.1 s.

python ros2_publisher.py PLAN.json TOPIC; prints a line of JSON for each goal, with the moment at
which it was sent (CLOCK_MONOTONIC, s), and for each report of the control node in /diagnostics.
"""

import json
import sys
import time
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState


def main() -> None:
    """Until the plan has been published and the node has told that it was read."""
    plan = json.loads(Path(sys.argv[1]).read_text())
    rclpy.init()
    node = rclpy.create_node("motion_planner")
    reports = []

    def look(message: DiagnosticArray) -> None:
        for status in message.status:
            if ": goals, " in status.name:
                reports.append({row.key: row.value for row in status.values})

    node.create_subscription(DiagnosticArray, "/diagnostics", look, 10)
    publisher = node.create_publisher(JointState, sys.argv[2], 10)
    while not publisher.get_subscription_count() or not reports:
        rclpy.spin_once(node, timeout_sec=0.05)
    began = time.monotonic()
    for k, (due, row) in enumerate(zip(plan["time"], plan["position"], strict=True)):
        while (left := began + due - time.monotonic()) > 0.0:
            rclpy.spin_once(node, timeout_sec=left)
        message = JointState(name=plan["names"], position=row)
        message.header.stamp = node.get_clock().now().to_msg()
        sent = time.monotonic()
        publisher.publish(message)
        print(json.dumps({"goal": k, "sent": sent}), flush=True)
    end = time.monotonic() + 3.0  # a report comes each second
    while int(reports[-1]["goals"]) < len(plan["time"]) and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    for report in reports:
        print(json.dumps(report))
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
