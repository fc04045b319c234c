# SPDX-License-Identifier: BSD-3-Clause
"""Messages that the node publishes."""
import importlib

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose, PoseStamped, TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image, PointCloud2, PointField
from std_msgs.msg import Header

from .arrays import POINT, pixels_of, points_of, quaternion_of


def type_named(name):
    """The class of a message type such as sensor_msgs/msg/Imu. Raises ImportError if it is not installed."""
    package, _, message = name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), message)


def header(stamp, frame):
    """stamp: nanoseconds."""
    return Header(stamp=Time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=frame)


def set_rotation(q, T):
    q.x, q.y, q.z, q.w = map(float, quaternion_of(T))


def pose(T):
    out = Pose()
    out.position.x, out.position.y, out.position.z = map(float, T[:3, 3])
    set_rotation(out.orientation, T)
    return out


def pose_stamped(stamp, T, frame):
    return PoseStamped(header=header(stamp, frame), pose=pose(T))


def odometry(stamp, T, frame, body):
    """The covariances are unknown, and so is the twist: their first element is -1."""
    out = Odometry(header=header(stamp, frame), child_frame_id=body)
    out.pose.pose = pose(T)
    out.pose.covariance[0] = out.twist.covariance[0] = -1.0
    return out


def transform(stamp, T, frame, child):
    out = TransformStamped(header=header(stamp, frame), child_frame_id=child)
    t = out.transform.translation
    t.x, t.y, t.z = map(float, T[:3, 3])
    set_rotation(out.transform.rotation, T)
    return out


def cloud(stamp, snapshot, frame):
    points = points_of(snapshot)
    types = {"x": PointField.FLOAT32, "y": PointField.FLOAT32, "z": PointField.FLOAT32, "rgb": PointField.UINT32}
    fields = [PointField(name=name, offset=POINT.fields[name][1], datatype=types[name], count=1)
              for name in POINT.names]
    return PointCloud2(header=header(stamp, frame), height=1, width=len(points), fields=fields, is_bigendian=False,
                       point_step=POINT.itemsize, row_step=POINT.itemsize * len(points), is_dense=True,
                       data=points.tobytes())


def image(stamp, images, view, frame):
    encoding, pixels = pixels_of(images, view)
    return Image(header=header(stamp, frame), height=pixels.shape[0], width=pixels.shape[1], encoding=encoding,
                 step=pixels.strides[0], data=pixels.tobytes())


def diagnostics(stamp, status, report, error):
    """OK, WARN without poses or without a map that should be there, ERROR once the estimator has failed."""
    level, message = DiagnosticStatus.OK, "running"
    if status.poses == 0:
        level, message = DiagnosticStatus.WARN, "no pose yet"
    if status.mapping_error:
        level, message = DiagnosticStatus.WARN, f"mapping disabled: {status.mapping_error}"
    if error:
        level, message = DiagnosticStatus.ERROR, error
    values = {"poses": status.poses, "keyframes": status.keyframes, "gaussians": status.gaussians}
    for sensor, counts in report.items():
        values[f"{sensor} delivered"] = counts["delivered"]
        values[f"{sensor} dropped"] = sum(counts["dropped"].values())
    entry = DiagnosticStatus(level=level, name="apvi", message=message, hardware_id="apvi",
                             values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])
    return DiagnosticArray(header=header(stamp, ""), status=[entry])
