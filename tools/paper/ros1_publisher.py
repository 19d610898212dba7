"""Publish a plan as joint states, as a motion planner of ROS 1 does: one every 0.1 s.

python ros1_publisher.py PLAN.json TOPIC; a line of JSON per goal: when it was sent, by
CLOCK_MONOTONIC, and its number.
"""

import json
import sys
import time
from pathlib import Path

import rospy
from sensor_msgs.msg import JointState


def main() -> None:
    """Until the plan has been published, once somebody listens."""
    plan = json.loads(Path(sys.argv[1]).read_text())
    rospy.init_node("motion_planner", disable_signals=True)
    publisher = rospy.Publisher(sys.argv[2], JointState, queue_size=10, tcp_nodelay=True)
    while not publisher.get_num_connections():
        time.sleep(0.05)
    began = time.monotonic()
    for k, (due, row) in enumerate(zip(plan["time"], plan["position"], strict=True)):
        time.sleep(max(0.0, began + due - time.monotonic()))
        message = JointState(name=plan["names"], position=row)
        message.header.stamp = rospy.Time.now()
        sent = time.monotonic()
        publisher.publish(message)
        print(json.dumps({"goal": k, "sent": sent}), flush=True)
    time.sleep(0.5)  # the last one is on its way when this program ends
    rospy.signal_shutdown("published")


if __name__ == "__main__":
    main()
