"""The nodes are in sjerk (``pip install sjerk``); this package makes them known to ROS 2."""

from glob import glob

from setuptools import setup

setup(
    name="sjerk_ros2",
    version="0.1.0",
    packages=["sjerk_ros2"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/sjerk_ros2"]),
        ("share/sjerk_ros2", ["package.xml"]),
        ("share/sjerk_ros2/launch", glob("launch/*")),
        ("share/sjerk_ros2/config", glob("config/*")),
    ],
    entry_points={
        "console_scripts": [
            "controller = sjerk.cli.nodes:ros2_controller",
            "control = sjerk.cli.nodes:ros2_control",
        ]
    },
)
