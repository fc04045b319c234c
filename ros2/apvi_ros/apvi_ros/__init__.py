# SPDX-License-Identifier: BSD-3-Clause
"""The ROS 2 node of APVI-SLAM: docs/ros.md."""
