# SPDX-License-Identifier: BSD-3-Clause
"""Bags written by `rosbags` itself, converted and read back. Skips where the package is not installed."""
import contextlib
import importlib.util
import io
import math
import pathlib
import sys
import tempfile
import unittest

SCRIPT = pathlib.Path(__file__).parents[2] / "scripts" / "convert_rosbag2.py"
if importlib.util.find_spec("rosbags") is None:
    print("skipped: the Python package rosbags is not installed")
    sys.exit(77)

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

spec = importlib.util.spec_from_file_location("convert_rosbag2", SCRIPT)
converter = importlib.util.module_from_spec(spec)
spec.loader.exec_module(converter)

DVL_MSG = ("std_msgs/Header header\nfloat64 time\ngeometry_msgs/Vector3 velocity\nfloat64 fom\nfloat64 altitude\n"
           "dvl_msgs/DVLBeam[] beams\nbool velocity_valid\nint64 status\nstring form\n")
BEAM_MSG = "int64 id\nfloat64 velocity\nfloat64 distance\nfloat64 rssi\nfloat64 nsd\nbool valid\n"


class Bag:
    """Writes a bag with the sensors of an underwater vehicle."""

    def __init__(self, path, plugin=StoragePlugin.SQLITE3):
        self.store = get_typestore(Stores.ROS2_HUMBLE)
        self.store.register({**get_types_from_msg(BEAM_MSG, "dvl_msgs/msg/DVLBeam"),
                             **get_types_from_msg(DVL_MSG, "dvl_msgs/msg/DVL")})
        self.types = self.store.types
        self.writer = Writer(path, version=9, storage_plugin=plugin)
        self.connections = {}

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *_):
        self.writer.close()

    def make(self, kind, **fields):
        return self.types[kind](**fields)

    def header(self, ns):
        stamp = self.make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id="")

    def vector(self, x, y, z):
        return self.make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))

    def write(self, topic, message, recorded):
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        self.writer.write(self.connections[topic], recorded, self.store.serialize_cdr(message, kind))

    def imu(self, ns, recorded=None, topic="/imu/data"):
        quaternion = self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        zeros = np.zeros(9)
        message = self.make(
            "sensor_msgs/msg/Imu", header=self.header(ns), orientation=quaternion, orientation_covariance=zeros,
            angular_velocity=self.vector(0.1, 0.2, 0.3), angular_velocity_covariance=zeros,
            linear_acceleration=self.vector(1, 2, 9.8), linear_acceleration_covariance=zeros)
        self.write(topic, message, recorded or ns)

    def dvl(self, ns, valid=True):
        beams = [self.make("dvl_msgs/msg/DVLBeam", id=i, velocity=0.5 * i, distance=-1.0 if i == 2 else 3.0,
                           rssi=0.0, nsd=0.0, valid=i != 2) for i in range(4)]
        message = self.make("dvl_msgs/msg/DVL", header=self.header(ns), time=0.0, velocity=self.vector(1, 2, 3),
                            fom=0.004, altitude=-1.0, beams=beams, velocity_valid=valid, status=0, form="")
        self.write("/dvl/data", message, ns)

    def depth(self, ns, z, topic="/depth/data"):
        point = self.make("geometry_msgs/msg/Point", x=0.0, y=0.0, z=z)
        quaternion = self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.6, z=0.0, w=0.8)
        pose = self.make("geometry_msgs/msg/Pose", position=point, orientation=quaternion)
        twist = self.make("geometry_msgs/msg/Twist", linear=self.vector(0, 0, 0), angular=self.vector(0, 0, 0))
        message = self.make(
            "nav_msgs/msg/Odometry", header=self.header(ns), child_frame_id="",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)))
        self.write(topic, message, ns)

    def pressure(self, ns, value):
        message = self.make("sensor_msgs/msg/FluidPressure", header=self.header(ns), fluid_pressure=value, variance=0.0)
        self.write("/pressure", message, ns)

    def image(self, ns, encoding="rgb8", pixel=(10, 20, 30)):
        data = np.tile(np.array(pixel, np.uint8), 6)
        message = self.make("sensor_msgs/msg/Image", header=self.header(ns), height=2, width=3, encoding=encoding,
                            is_bigendian=0, step=3 * len(pixel), data=data)
        self.write("/camera/image_raw", message, ns)

    def compressed(self, ns, content):
        message = self.make("sensor_msgs/msg/CompressedImage", header=self.header(ns), format="jpeg",
                            data=np.frombuffer(content, np.uint8))
        self.write("/camera/left/compressed", message, ns)

    def fix(self, ns, latitude, longitude):
        status = self.make("sensor_msgs/msg/NavSatStatus", status=0, service=1)
        message = self.make("sensor_msgs/msg/NavSatFix", header=self.header(ns), status=status, latitude=latitude,
                            longitude=longitude, altitude=0.0, position_covariance=np.zeros(9),
                            position_covariance_type=0)
        self.write("/gps/fix", message, ns)


def write_all(bag):
    for i in range(100):
        bag.imu(10**9 + i * 10**7)
    for i in range(5):
        bag.dvl(10**9 + i * 2 * 10**8, valid=i != 3)
        bag.depth(10**9 + i * 10**8, -1.5)
        bag.depth(10**9 + i * 10**8, 7.0, topic="/mocap/pose")
    bag.pressure(10**9, 103000.0)
    bag.compressed(10**9, b"\xff\xd8 fake jpeg")
    bag.fix(10**9, 59.0, 10.0)
    bag.fix(2 * 10**9, 59.001, 10.001)


class ConvertTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.root = pathlib.Path(self.folder.name)
        self.addCleanup(self.folder.cleanup)

    def convert(self, *arguments):
        """Returns exit status and output."""
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
            status = converter.main([str(a) for a in arguments])
        return status, text.getvalue()

    def rows(self, sensor, out="out"):
        lines = (self.root / out / "mav0" / sensor / "data.csv").read_text().splitlines()
        return lines[0], [line.split(",") for line in lines[1:]]

    def check_all(self, plugin):
        with Bag(self.root / "bag", plugin) as bag:
            write_all(bag)
        status, text = self.convert(self.root / "bag", self.root / "out")
        self.assertEqual(status, 0, text)
        header, imu = self.rows("imu0")
        self.assertEqual(len(imu), 100)
        self.assertEqual(imu[1], ["1010000000", "0.1", "0.2", "0.3", "1", "2", "9.8"])
        header, dvl = self.rows("dvl0")
        self.assertEqual(len(header.split(",")), 19)
        self.assertEqual(dvl[0], "1000000000,1,2,3,0.004,,1,0,0.5,1,1.5,3,3,,3,1,1,0,1".split(","))
        self.assertEqual([row[6] for row in dvl], ["1", "1", "1", "0", "1"])
        self.assertEqual(self.rows("depth0")[1][0], ["1000000000", "1.5"])
        self.assertEqual(self.rows("pressure0"), ("#timestamp [ns],pressure", [["1000000000", "103000"]]))
        self.assertEqual(self.rows("state_groundtruth_estimate0")[1][0][3:], ["7", "0.8", "0", "0.6", "0"])
        self.assertEqual(self.rows("cam0")[1], [["1000000000", "1000000000.jpg"]])
        fix = [float(v) for v in self.rows("gnss0")[1][1][1:]]
        # One thousandth of a degree at 59 degrees north.
        self.assertAlmostEqual(fix[0], math.radians(1e-3) * 6378137 * math.cos(math.radians(59)), delta=0.3)
        self.assertAlmostEqual(fix[1], math.radians(1e-3) * 6367000, delta=0.5)

    def test_converts_all_sensors_of_sqlite_bag(self):
        self.check_all(StoragePlugin.SQLITE3)

    def test_converts_all_sensors_of_mcap_bag(self):
        self.check_all(StoragePlugin.MCAP)

    def test_sorts_messages_and_drops_duplicates(self):
        with Bag(self.root / "bag") as bag:
            for recorded, ns in enumerate((100, 300, 200, 200, 400)):
                bag.imu(10**9 + ns, 10**9 + recorded)
        status, text = self.convert(self.root / "bag", self.root / "out")
        self.assertEqual(status, 0, text)
        self.assertEqual([int(row[0]) - 10**9 for row in self.rows("imu0")[1]], [100, 200, 300, 400])
        self.assertIn("1 messages", text)

    def test_message_without_stamp_uses_recording_time(self):
        with Bag(self.root / "bag") as bag:
            bag.imu(0, 5 * 10**9)
        self.convert(self.root / "bag", self.root / "out")
        self.assertEqual(self.rows("imu0")[1][0][0], "5000000000")

    def test_converts_raw_images_to_png(self):
        for encoding, pixel, expected in (("rgb8", (10, 20, 30), b"\x0a\x14\x1e"), ("bgr8", (30, 20, 10), b"\x0a\x14\x1e"),
                                          ("mono8", (77,), b"\x4d"), ("mono16", (1, 77), b"\x4d")):
            bag_path, out = self.root / f"bag_{encoding}", f"out_{encoding}"
            with Bag(bag_path) as bag:
                bag.image(10**9, encoding, pixel)
            status, text = self.convert(bag_path, self.root / out)
            self.assertEqual(status, 0, text)
            content = (self.root / out / "mav0/cam0/data/1000000000.png").read_bytes()
            self.assertTrue(content.startswith(b"\x89PNG\r\n\x1a\n"))
            data = content[content.index(b"IDAT") + 4:]
            import zlib
            self.assertEqual(zlib.decompressobj().decompress(data), (b"\0" + expected * 3) * 2, encoding)

    def test_unknown_image_encoding_error_names_encoding(self):
        with Bag(self.root / "bag") as bag:
            bag.image(10**9, "32FC1", (1, 2, 3, 4))
        status, text = self.convert(self.root / "bag", self.root / "out")
        self.assertEqual(status, 2)
        self.assertIn("32FC1", text)
        self.assertFalse((self.root / "out").exists())

    def test_selects_topics(self):
        with Bag(self.root / "bag") as bag:
            bag.imu(10**9)
            bag.imu(2 * 10**9, topic="/second/imu")
        status, text = self.convert(self.root / "bag", self.root / "out", "--imu", "/second/imu")
        self.assertEqual(status, 0, text)
        self.assertEqual(self.rows("imu0")[1][0][0], "2000000000")
        status, text = self.convert(self.root / "bag", self.root / "out2", "--imu", "/third/imu")
        self.assertEqual(status, 2)
        self.assertIn("/second/imu", text)

    def test_refuses_existing_output_and_restarts_partial_output(self):
        with Bag(self.root / "bag") as bag:
            bag.imu(10**9)
        (self.root / "out.partial" / "mav0").mkdir(parents=True)
        (self.root / "out.partial" / "old").write_text("old")
        status, text = self.convert(self.root / "bag", self.root / "out", "--rig", __file__)
        self.assertEqual(status, 0, text)
        self.assertFalse((self.root / "out" / "old").exists())
        self.assertTrue((self.root / "out" / "rig.yaml").exists())
        status, text = self.convert(self.root / "bag", self.root / "out")
        self.assertEqual(status, 2)
        self.assertIn("exists already", text)

    def test_errors_are_one_line(self):
        for arguments, word in ((["nowhere", "out"], "no such file"), ([self.root, self.root / "out"], "metadata.yaml"),
                                ([self.root], "--list"), ([self.root, self.root / "o", "--rig", "no.yaml"], "no.yaml"),
                                ([self.root, self.root / "o", "--types", self.root], ".msg")):
            status, text = self.convert(*arguments)
            self.assertEqual(status, 2)
            self.assertIn(word, text)
            self.assertEqual(text.count("\n"), 1, text)

    def test_damaged_bag_leaves_no_dataset(self):
        with Bag(self.root / "bag", StoragePlugin.MCAP) as bag:
            write_all(bag)
        mcap = next((self.root / "bag").glob("*.mcap"))
        mcap.write_bytes(mcap.read_bytes()[:2000])
        status, text = self.convert(self.root / "bag", self.root / "out")
        self.assertNotEqual(status, 0)
        self.assertTrue(text)
        self.assertFalse((self.root / "out").exists())

    def test_reads_custom_message_definitions_from_folder(self):
        types = self.root / "types" / "dvl_msgs" / "msg"
        types.mkdir(parents=True)
        (types / "DVL.msg").write_text(DVL_MSG)
        (types / "DVLBeam.msg").write_text(BEAM_MSG)
        store = converter.type_store(self.root / "types")
        self.assertIn("dvl_msgs/msg/DVL", store.types)
        self.assertEqual(store.hash_rihs01("dvl_msgs/msg/DVL"), Bag(self.root / "x").store.hash_rihs01("dvl_msgs/msg/DVL"))

    def test_lists_topics(self):
        with Bag(self.root / "bag") as bag:
            bag.imu(10**9)
        self.assertEqual(self.convert(self.root / "bag", "--list"), (0, "/imu/data sensor_msgs/msg/Imu 1\n"))


if __name__ == "__main__":
    unittest.main()
