# SPDX-License-Identifier: BSD-3-Clause
from setuptools import setup

setup(
    name="apvi_ros",
    version="0.2.0",
    description="Localization and mapping under water from the topics of a vehicle",
    license="BSD-3-Clause",
    packages=["apvi_ros"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/apvi_ros"]),
        ("share/apvi_ros", ["package.xml"]),
        ("share/apvi_ros/launch", ["launch/apvi.launch.py"]),
        ("share/apvi_ros/config", ["config/apvi.yaml"]),
    ],
    install_requires=["setuptools", "apvi"],
    entry_points={"console_scripts": ["apvi_node = apvi_ros.node:main"]},
)
