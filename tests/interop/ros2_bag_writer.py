# SPDX-License-Identifier: BSD-3-Clause
"""Writes the sensors of a dataset folder as a ROS 2 bag, with the package `rosbags`."""
import numpy as np
from rosbags.rosbag2 import CompressionFormat, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

BEAM = "int64 id\nfloat64 velocity\nfloat64 distance\nfloat64 rssi\nfloat64 nsd\nbool valid\n"
DVL = ("std_msgs/Header header\nfloat64 time\ngeometry_msgs/Vector3 velocity\nfloat64 fom\nfloat64 altitude\n"
       "dvl_msgs/DVLBeam[] beams\nbool velocity_valid\nint64 status\nstring form\n")


def rows(dive, sensor):
    """Stamp and cells of each line of a csv file."""
    lines = (dive / "mav0" / sensor / "data.csv").read_text(encoding="utf-8").splitlines()
    return [(int(line.split(",")[0]), line.split(",")[1:]) for line in lines[1:]]


def number(cell):
    return float(cell) if cell else -1.0  # as the driver writes missing values


class Maker:
    """Makes messages of the cells of a csv file."""

    def __init__(self, store):
        self.types = store.types
        self.upright = self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)

    def make(self, kind, **fields):
        return self.types[kind](**fields)

    def header(self, ns):
        stamp = self.make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id="body")

    def vector(self, cells, kind="Vector3"):
        return self.make(f"geometry_msgs/msg/{kind}", **dict(zip("xyz", (float(c or 0) for c in cells))))

    def imu(self, ns, cells):
        none = np.zeros(9)
        return self.make(
            "sensor_msgs/msg/Imu", header=self.header(ns), orientation=self.upright, orientation_covariance=none,
            angular_velocity=self.vector(cells[:3]), angular_velocity_covariance=none,
            linear_acceleration=self.vector(cells[3:6]), linear_acceleration_covariance=none)

    def dvl(self, ns, cells):
        beams = [self.make("dvl_msgs/msg/DVLBeam", id=i, velocity=float(cells[6 + i]), distance=number(cells[10 + i]),
                           rssi=0.0, nsd=0.0, valid=cells[14 + i] == "1") for i in range(4) if cells[6 + i]]
        return self.make(
            "dvl_msgs/msg/DVL", header=self.header(ns), time=0.0, velocity=self.vector(cells[:3]),
            fom=number(cells[3]), altitude=number(cells[4]), beams=beams, velocity_valid=cells[5] == "1", status=0,
            form="")

    def depth(self, ns, cells):
        pose = self.make("geometry_msgs/msg/Pose", position=self.vector([0, 0, -float(cells[0])], "Point"),
                         orientation=self.upright)
        twist = self.make("geometry_msgs/msg/Twist", linear=self.vector([0, 0, 0]), angular=self.vector([0, 0, 0]))
        none = np.zeros(36)
        return self.make(
            "nav_msgs/msg/Odometry", header=self.header(ns), child_frame_id="",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=none),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=none))

    def pressure(self, ns, cells):
        return self.make("sensor_msgs/msg/FluidPressure", header=self.header(ns), fluid_pressure=float(cells[0]),
                         variance=0.0)

    def image(self, ns, path):
        return self.make("sensor_msgs/msg/CompressedImage", header=self.header(ns), format="png",
                         data=np.fromfile(path, np.uint8))


def messages(dive, store):
    """(stamp, topic, message) of all sensors, in order of time."""
    maker = Maker(store)
    found = [(ns, "/imu/data", maker.imu(ns, cells)) for ns, cells in rows(dive, "imu0")]
    found += [(ns, "/dvl/data", maker.dvl(ns, cells)) for ns, cells in rows(dive, "dvl0")]
    for sensor, topic, convert in (("depth0", "/depth/data", maker.depth), ("pressure0", "/pressure", maker.pressure)):
        if (dive / "mav0" / sensor).exists():
            found += [(ns, topic, convert(ns, cells)) for ns, cells in rows(dive, sensor)]
    found += [(ns, "/camera/left/compressed", maker.image(ns, dive / "mav0/cam0/data" / cells[0]))
              for ns, cells in rows(dive, "cam0")]
    return sorted(found, key=lambda item: item[0])


def write(dive, bag, plugin, compression=None):
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register({**get_types_from_msg(BEAM, "dvl_msgs/msg/DVLBeam"), **get_types_from_msg(DVL, "dvl_msgs/msg/DVL")})
    writer = Writer(bag, version=9, storage_plugin=plugin)
    if compression:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for ns, topic, message in messages(dive, store):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], ns, store.serialize_cdr(message, kind))
