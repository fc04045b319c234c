# SPDX-License-Identifier: BSD-3-Clause
"""Writes ROS 2 messages as OMG CDR, little-endian, from the specification: an independent reference for the decoder."""
import struct


class Cdr:
    def __init__(self):
        self.data = b""

    def put(self, kind, *values):
        """kind: of struct; each value is aligned to its size."""
        size = struct.calcsize(kind)
        for value in values:
            self.data += b"\0" * (-len(self.data) % size) + struct.pack("<" + kind, value)
        return self

    def text(self, value):
        data = value.encode() + b"\0"
        self.put("I", len(data)).data += data
        return self

    def octets(self, value):
        self.put("I", len(value)).data += bytes(value)
        return self

    def header(self, stamp):
        return self.put("i", stamp // 10**9).put("I", stamp % 10**9).text("sensor")

    def message(self):
        return b"\0\1\0\0" + self.data


def imu(stamp, gyro, accel):
    return (Cdr().header(stamp).put("d", 0, 0, 0, 1, *[0] * 9, *gyro, *[0] * 9, *accel, *[0] * 9)).message()


def pressure(stamp, pascal):
    return Cdr().header(stamp).put("d", pascal, 0).message()


def twist(stamp, velocity):
    return Cdr().header(stamp).put("d", *velocity, 0, 0, 0, *[0] * 36).message()


def image(stamp, pixels, encoding):
    height, width = pixels.shape[:2]
    step = pixels.size // height
    return (Cdr().header(stamp).put("I", height, width).text(encoding).put("B", 0).put("I", step)
            .octets(pixels.tobytes())).message()
