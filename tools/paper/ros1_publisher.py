"""Publish a plan as joint states, as a motion planner of ROS 1 does: one every 0.1 s.

python ros1_publisher.py PLAN.json TOPIC; prints a line of JSON for each goal, with the moment at
which it was sent (CLOCK_MONOTONIC, s), and for each report of the control node in /diagnostics.
"""

import json
import sys
import time
from pathlib import Path

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState


def main() -> None:
    """Until the plan has been published and the node has told that it was read."""
    plan = json.loads(Path(sys.argv[1]).read_text())
    rospy.init_node("motion_planner", disable_signals=True)
    reports = []

    def look(message: DiagnosticArray) -> None:
        for status in message.status:
            if ": goals, " in status.name:
                reports.append({row.key: row.value for row in status.values})

    rospy.Subscriber("/diagnostics", DiagnosticArray, look)
    publisher = rospy.Publisher(sys.argv[2], JointState, queue_size=10, tcp_nodelay=True)
    while not publisher.get_num_connections() or not reports:
        time.sleep(0.05)
    began = time.monotonic()
    for k, (due, row) in enumerate(zip(plan["time"], plan["position"], strict=True)):
        time.sleep(max(0.0, began + due - time.monotonic()))
        message = JointState(name=plan["names"], position=row)
        message.header.stamp = rospy.Time.now()
        sent = time.monotonic()
        publisher.publish(message)
        print(json.dumps({"goal": k, "sent": sent}), flush=True)
    end = time.monotonic() + 3.0  # a report comes each second
    while int(reports[-1]["goals"]) < len(plan["time"]) and time.monotonic() < end:
        time.sleep(0.05)
    for report in list(reports):
        print(json.dumps(report))
    rospy.signal_shutdown("published")


if __name__ == "__main__":
    main()
