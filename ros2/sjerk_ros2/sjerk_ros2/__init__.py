"""The nodes of ``sjerk.ports.ros`` as executables of a ROS 2 package."""
