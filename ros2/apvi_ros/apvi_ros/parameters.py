# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the node, without ROS."""
import json

import apvi

DEFAULTS = {
    "rig_file": "rig.yaml",
    "config": "",
    "output": ".",
    "topics.imu": "imu/data",
    "topics.dvl": "dvl",
    "topics.pressure": "pressure",
    "topics.depth": "",
    "topics.cam0": "camera/image_raw",
    "topics.cam1": "",
    "frames.map": "map",
    "frames.odom": "odom",
    "frames.body": "base_link",
    "view": "color",
    "image_period_s": 1.0,
    "map_period_s": 5.0,
}
SENSORS = [key.removeprefix("topics.") for key in DEFAULTS if key.startswith("topics.")]


def overrides_of(given):
    """The configuration keys among the parameters, as "key=value"."""
    sections = apvi.Options().to_dict()
    keys = [key for key in given if key.split(".")[0] in sections]
    plain = {key: given[key].tolist() if hasattr(given[key], "tolist") else given[key] for key in keys}
    return [f"{key}={json.dumps(value)}" for key, value in plain.items()]


def options_of(given):
    """The configuration of the estimator: in real time, with the configuration keys among the parameters."""
    return apvi.Options(given.get("config") or None, set=["run.mode=realtime", *overrides_of(given)])


def unknown(given):
    """Parameters that are neither the node's nor of a section of the configuration."""
    sections = apvi.Options().to_dict()
    ros = ("use_sim_time", "qos_overrides", "start_type_description_service")
    return sorted(key for key in given
                  if key not in DEFAULTS and key.split(".")[0] not in sections and not key.startswith(ros))
