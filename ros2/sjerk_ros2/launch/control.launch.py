"""A kernel and its control node.

ros2 launch sjerk_ros2 control.launch.py kernel:=robot.toml params:=arm.yaml
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    """The node runs the kernel of the file as its child, and ends it."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("name", default_value="sjerk_control_node"),
            DeclareLaunchArgument("kernel"),
            DeclareLaunchArgument("params"),
            DeclareLaunchArgument(
                "hardware",
                default_value="simulated",
                choices=["simulated", "ethercat"],
                description="drives of the kernel's file: simulated, whatever it says, or its bus",
            ),
            Node(
                package="sjerk_ros2",
                executable="control",
                name=LaunchConfiguration("name"),
                output="screen",
                parameters=[
                    LaunchConfiguration("params"),
                    {
                        "kernel.file": LaunchConfiguration("kernel"),
                        "kernel.hardware": LaunchConfiguration("hardware"),
                    },
                ],
                sigterm_timeout="5",
                on_exit=Shutdown(),
            ),
        ]
    )
