"""ROS: a kernel behind an action server, or behind topics of joint states.

``joints``, ``parameters``, ``tracking`` and ``desk`` need no ROS; ``ros2_*`` are the nodes.
"""
