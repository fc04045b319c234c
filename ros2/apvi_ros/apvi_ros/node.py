# SPDX-License-Identifier: BSD-3-Clause
"""The node: subscribes to the sensors, runs the estimator, publishes poses, map and images."""
import pathlib
import threading

import rclpy
from nav_msgs.msg import Odometry, Path
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, PointCloud2
from std_srvs.srv import Trigger

import apvi

from . import messages
from .estimator import Estimator
from .parameters import DEFAULTS, SENSORS, options_of, unknown

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # the message packages on PyPI lack it
    TFMessage = None

SENSOR_QOS = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DISCOVERY_PERIOD_S = 0.5


class ApviNode(Node):
    def __init__(self, **arguments):
        super().__init__("apvi", automatically_declare_parameters_from_overrides=True, **arguments)
        for name, default in DEFAULTS.items():
            if not self.has_parameter(name):
                self.declare_parameter(name, default)
        given = {name: p.value for name, p in self.get_parameters_by_prefix("").items()}
        if unknown(given):
            raise apvi.InputError(f"parameters {', '.join(unknown(given))}: neither the node's nor configuration keys")
        self.rig = apvi.Rig(given["rig_file"])
        self.frames = {name: given[f"frames.{name}"] for name in ("map", "odom", "body")}
        self.topics = {name: given[f"topics.{name}"] for name in SENSORS if given[f"topics.{name}"]}
        self.path, self.path_lock = [], threading.Lock()
        self.make_publishers()
        self.estimator = Estimator(options_of(given), self.rig, self.publish_pose)
        self.make_services()
        self.make_timers(given)

    def value(self, name):
        return self.get_parameter(name).value

    # Interfaces

    def make_publishers(self):
        self.odometry = self.create_publisher(Odometry, "~/odometry", 50)
        self.trajectory = self.create_publisher(Path, "~/path", LATCHED)
        self.cloud = self.create_publisher(PointCloud2, "~/map", LATCHED)
        self.image = self.create_publisher(Image, "~/image", LATCHED)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.tf = self.create_publisher(TFMessage, "/tf", 50) if TFMessage else None

    def make_services(self):
        self.create_service(Trigger, "~/reset", self.reset)
        self.create_service(Trigger, "~/save_map", self.save_map)

    def make_timers(self, given):
        self.subscribers = {}
        self.create_timer(DISCOVERY_PERIOD_S, self.subscribe)
        self.create_timer(1.0, self.publish_status)
        for period, publish in (("image_period_s", self.publish_image), ("map_period_s", self.publish_map)):
            if given[period] > 0.0:
                self.create_timer(float(given[period]), publish)

    # Input

    def subscribe(self):
        """Subscribes to the topics that have appeared, with the type that their publishers use."""
        present = dict(self.get_topic_names_and_types())
        for sensor, topic in self.topics.items():
            types = present.get(self.resolve_topic_name(topic))
            if sensor not in self.subscribers and types:
                self.subscribers[sensor] = self.subscription(sensor, topic, types[0])

    def subscription(self, sensor, topic, type_name):
        """None, with an error in the log, for a type that is not installed or not of this sensor."""
        try:
            decoder = apvi.RosDecoder(sensor, type_name)
            message_type = messages.type_named(type_name)
        except (apvi.Error, ImportError, AttributeError) as error:
            self.get_logger().error(f"{topic}: {error}")
            return None
        self.get_logger().info(f"{sensor}: {topic}, {type_name}")
        return self.create_subscription(message_type, topic, lambda data: self.receive(decoder, data), SENSOR_QOS,
                                        raw=True)

    def receive(self, decoder, data):
        sample = decoder.decode(data, self.get_clock().now().nanoseconds)
        if sample is not None:
            self.estimator.push(sample)

    # Output

    def publish_pose(self, stamp, T):
        """From a thread of the estimator; rclpy's publishers may be used by any thread."""
        if not self.context.ok():
            return
        odom, body = self.frames["odom"], self.frames["body"]
        self.odometry.publish(messages.odometry(stamp, T, odom, body))
        with self.path_lock:
            self.path.append(messages.pose_stamped(stamp, T, odom))
        if self.tf:
            T_map_odom = self.estimator.system.T_map_odom()
            self.tf.publish(TFMessage(transforms=[
                messages.transform(stamp, T_map_odom, self.frames["map"], odom),
                messages.transform(stamp, T, odom, body)]))

    def publish_status(self):
        now = self.get_clock().now().nanoseconds
        estimator = self.estimator
        status = estimator.system.status()
        self.diagnostics.publish(messages.diagnostics(now, status, estimator.report, estimator.error))
        with self.path_lock:
            poses = list(self.path)
        if poses and self.trajectory.get_subscription_count() > 0:
            self.trajectory.publish(Path(header=poses[-1].header, poses=poses))

    def publish_map(self):
        snapshot = self.estimator.system.map() if self.cloud.get_subscription_count() > 0 else None
        if snapshot is not None:
            stamp = int(snapshot.keyframes.stamps[-1])
            self.cloud.publish(messages.cloud(stamp, snapshot, self.frames["map"]))

    def publish_image(self):
        newest = self.estimator.system.pose() if self.image.get_subscription_count() > 0 else None
        if newest is None or not self.rig.cameras:
            return
        stamp, T = newest
        system, calibration = self.estimator.system, self.rig.cameras[0]
        T_map_camera = system.T_map_odom() @ T @ calibration.T_body_camera  # loops are closed in the map
        images = system.render(calibration.camera.pinhole(), T_map_camera)
        if images is not None:
            self.image.publish(messages.image(stamp, images, self.value("view"), self.frames["body"]))

    # Services

    def reset(self, request, response):
        self.estimator.reset()
        with self.path_lock:
            self.path.clear()
        response.success, response.message = True, "every sample and estimate was discarded"
        return response

    def save_map(self, request, response):
        folder = pathlib.Path(self.value("output"))
        system = self.estimator.system
        try:
            folder.mkdir(parents=True, exist_ok=True)
            system.trajectory().write_tum(folder / "trajectory.tum")
            snapshot = system.map()
            if snapshot is not None:
                snapshot.save(folder / "map.ply")
        except (OSError, apvi.Error) as error:
            response.success, response.message = False, str(error)
            return response
        made = "trajectory.tum" if snapshot is None else f"trajectory.tum and map.ply of {len(snapshot)} Gaussians"
        response.success, response.message = True, f"{folder}: {made}"
        return response


def main(arguments=None):
    rclpy.init(args=arguments)
    node = None
    try:
        node = ApviNode()
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except apvi.Error as error:
        raise SystemExit(f"error: {error}") from error
    finally:
        if node is not None:
            node.estimator.stop()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
