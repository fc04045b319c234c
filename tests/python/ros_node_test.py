# SPDX-License-Identifier: BSD-3-Clause
"""The node in a process of its own, a vehicle in another one, both on the loopback.

    pip install -r tests/python/requirements.txt
"""
import importlib.util
import os
import signal
import subprocess
import sys
import time
import unittest

import support

if importlib.util.find_spec("numpy"):
    import numpy as np

    import apvi

PACKAGE = support.ROOT / "ros2" / "apvi_ros"
PACKAGES = ("rclpy", "sensor_msgs", "nav_msgs", "std_srvs", "diagnostic_msgs", "rmw_fastrtps_cpp")
MISSING = [name for name in PACKAGES if not importlib.util.find_spec(name)]


def environment():
    path = os.pathsep.join([str(PACKAGE), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": path, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": str(os.getpid() % 100)}


def start_node(folder):
    settings = {"rig_file": support.dive() / "rig.yaml", "output": folder, "run.mode": "replay", "run.threads": 1,
                "image_period_s": 0.5, "map_period_s": 1.0}
    arguments = [word for key, value in settings.items() for word in ("-p", f"{key}:={value}")]
    return subprocess.Popen([sys.executable, "-m", "apvi_ros.node", "--ros-args", *arguments], env=environment(),
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


class Watcher:
    """A node of the test: keeps what the node publishes, and calls its services."""

    def __init__(self):
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from nav_msgs.msg import Odometry, Path
        from rclpy.qos import QoSProfile
        from sensor_msgs.msg import Image, PointCloud2
        self.rclpy = rclpy
        rclpy.init()
        self.node = rclpy.create_node("watcher")
        self.received = {}
        for topic, kind in (("/apvi/odometry", Odometry), ("/apvi/path", Path), ("/apvi/map", PointCloud2),
                            ("/apvi/image", Image), ("/diagnostics", DiagnosticArray)):
            self.received[topic] = []
            self.node.create_subscription(kind, topic, self.received[topic].append, QoSProfile(depth=200))

    def spin_while(self, condition, limit_s):
        end = time.monotonic() + limit_s
        while condition() and time.monotonic() < end:
            self.rclpy.spin_once(self.node, timeout_sec=0.1)

    def call(self, name):
        from std_srvs.srv import Trigger
        client = self.node.create_client(Trigger, f"/apvi/{name}")
        future = client.call_async(Trigger.Request())
        self.rclpy.spin_until_future_complete(self.node, future, timeout_sec=120)
        return future.result()

    def close(self):
        self.node.destroy_node()
        self.rclpy.shutdown()


@unittest.skipIf(MISSING, f"not installed: {', '.join(MISSING)}")
class Dive(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        os.environ.update(environment())
        cls.folder = support.scratch() / "ros"
        cls.process = start_node(cls.folder)
        cls.watcher = Watcher()
        cls.addClassCleanup(cls.close)
        vehicle = [sys.executable, support.ROOT / "tests/python/ros_publisher.py", str(support.dive()), "0.5"]
        with subprocess.Popen(vehicle, env=environment(), stderr=subprocess.PIPE, text=True) as publisher:
            cls.watcher.spin_while(lambda: publisher.poll() is None, 180)
            cls.vehicle = publisher.poll(), publisher.stderr.read()
        maps = cls.watcher.received["/apvi/map"]
        cls.watcher.spin_while(lambda: not maps, 60)
        cls.saved = cls.watcher.call("save_map")

    @classmethod
    def close(cls):
        cls.watcher.close()
        cls.process.send_signal(signal.SIGINT)
        cls.output, _ = cls.process.communicate(timeout=60)

    def of(self, topic):
        self.assertEqual(self.vehicle, (0, ""))
        self.assertTrue(self.watcher.received[topic], f"nothing on {topic}")
        return self.watcher.received[topic]

    def test_odometry_is_that_of_the_vehicle(self):
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in self.of("/apvi/odometry")]
        poses = [m.pose.pose for m in self.of("/apvi/odometry")]
        positions = [[p.position.x, p.position.y, p.position.z] for p in poses]
        rotations = [[p.orientation.x, p.orientation.y, p.orientation.z, p.orientation.w] for p in poses]
        estimate = apvi.Trajectory(stamps, positions, rotations)
        metrics = apvi.evaluate(apvi.Recording(support.dive()).reference(), estimate, align="first")
        self.assertGreater(metrics["matched"], 60)
        self.assertLess(metrics["ate_rmse_m"], 0.05)
        self.assertLess(metrics["rot_rmse_deg"], 2.0)
        message = self.of("/apvi/odometry")[0]
        self.assertEqual((message.header.frame_id, message.child_frame_id), ("odom", "base_link"))

    def test_path_has_the_poses_so_far(self):
        self.assertGreater(len(self.of("/apvi/path")[-1].poses), 60)

    def test_map_is_a_cloud_of_colored_points(self):
        cloud = self.of("/apvi/map")[-1]
        self.assertEqual(cloud.header.frame_id, "map")
        self.assertEqual([field.name for field in cloud.fields], ["x", "y", "z", "rgb"])
        points = np.frombuffer(bytes(cloud.data), "<f4").reshape(-1, 4)[:, :3]
        self.assertEqual(len(points), cloud.width)
        self.assertGreater(len(points), 100)
        self.assertTrue(np.isfinite(points).all())

    def test_images_are_renders(self):
        image = self.of("/apvi/image")[-1]
        self.assertEqual((image.height, image.width, image.encoding), (240, 320, "rgb8"))
        self.assertGreater(np.frombuffer(bytes(image.data), np.uint8).std(), 5.0)

    def test_diagnostics_count_samples_and_poses(self):
        status = self.of("/diagnostics")[-1].status[0]
        values = {entry.key: int(entry.value) for entry in status.values}
        self.assertEqual(status.level, b"\0")
        self.assertGreater(values["poses"], 60)
        self.assertGreater(values["imu delivered"], 1000)
        self.assertEqual(values["imu dropped"], 0)

    def test_saved_files_are_read_by_the_package(self):
        self.assertTrue(self.saved.success, self.saved.message)
        self.assertGreater(len(apvi.Trajectory.read(self.folder / "trajectory.tum")), 60)
        self.assertGreater(len(apvi.MapSnapshot.read(self.folder / "map.ply")), 100)


@unittest.skipIf(MISSING, f"not installed: {', '.join(MISSING)}")
class Start(unittest.TestCase):
    def start(self, *arguments):
        done = subprocess.run([sys.executable, "-m", "apvi_ros.node", "--ros-args", *arguments], env=environment(),
                              capture_output=True, text=True, timeout=120, check=False)
        return done.returncode, done.stderr

    def test_missing_calibration_is_named(self):
        code, errors = self.start("-p", "rig_file:=/no/such/rig.yaml")
        self.assertEqual(code, 1)
        self.assertIn("error: /no/such/rig.yaml", errors)

    def test_misspelled_parameter_is_named(self):
        code, errors = self.start("-p", "run.thread:=2", "-p", f"rig_file:={support.dive() / 'rig.yaml'}")
        self.assertEqual(code, 1)
        self.assertIn("did you mean run.threads", errors)


if __name__ == "__main__":
    support.main()
