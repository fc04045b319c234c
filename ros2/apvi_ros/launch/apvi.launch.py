# SPDX-License-Identifier: BSD-3-Clause
"""ros2 launch apvi_ros apvi.launch.py parameters:=FILE"""
import pathlib

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

DEFAULTS = pathlib.Path(__file__).resolve().parents[1] / "config" / "apvi.yaml"


def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument("parameters", default_value=str(DEFAULTS), description="YAML file"),
        Node(package="apvi_ros", executable="apvi_node", name="apvi", output="screen",
             parameters=[LaunchConfiguration("parameters")]),
    ])
