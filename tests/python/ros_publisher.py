# SPDX-License-Identifier: BSD-3-Clause
"""A vehicle: publishes a recording as ROS 2 messages at its own pace, once all topics have a subscriber.

    ros_publisher.py DIVE [RATE]
"""
import sys
import time

import apvi
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TwistWithCovarianceStamped
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import FluidPressure, Image, Imu
from std_msgs.msg import Header

TOPICS = {apvi.ImuSample: ("imu/data", Imu), apvi.DvlSample: ("dvl", TwistWithCovarianceStamped),
          apvi.PressureSample: ("pressure", FluidPressure), apvi.ImageFrame: ("camera/image_raw", Image)}
PATIENCE_S = 60.0


def header(sample):
    return Header(stamp=Time(sec=sample.stamp // 10**9, nanosec=sample.stamp % 10**9), frame_id="sensor")


def set_vector(out, values):
    out.x, out.y, out.z = map(float, values)


def message_of(sample):
    """None for pings without bottom lock, which a twist cannot say."""
    if isinstance(sample, apvi.ImageFrame):
        pixels = sample.image
        return Image(header=header(sample), height=pixels.shape[0], width=pixels.shape[1], encoding="rgb8",
                     step=pixels.strides[0], data=pixels.tobytes())
    if isinstance(sample, apvi.PressureSample):
        return FluidPressure(header=header(sample), fluid_pressure=sample.pressure_pa)
    if isinstance(sample, apvi.DvlSample):
        out = TwistWithCovarianceStamped(header=header(sample))
        set_vector(out.twist.twist.linear, sample.velocity)
        return out if sample.valid else None
    out = Imu(header=header(sample))
    set_vector(out.angular_velocity, sample.gyro)
    set_vector(out.linear_acceleration, sample.accel)
    return out


def wait_for(condition):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > end:
            sys.exit("nobody subscribes")
        time.sleep(0.1)


def main():
    rate = float(sys.argv[2]) if len(sys.argv) > 2 else 1.0
    samples = [(sample, message_of(sample)) for sample in apvi.Recording(sys.argv[1]) if type(sample) in TOPICS]
    rclpy.init()
    node = rclpy.create_node("vehicle")
    publishers = {kind: node.create_publisher(message, topic, qos_profile_sensor_data)
                  for kind, (topic, message) in TOPICS.items()}
    wait_for(lambda: all(p.get_subscription_count() > 0 for p in publishers.values()))
    begin, first = time.monotonic(), samples[0][0].stamp
    for sample, message in samples:
        time.sleep(max(0.0, begin + 1e-9 * (sample.stamp - first) / rate - time.monotonic()))
        if message is not None:
            publishers[type(sample)].publish(message)
    time.sleep(1.0)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
