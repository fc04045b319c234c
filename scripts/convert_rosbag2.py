#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Converts a ROS 2 bag (sqlite3 or mcap) to an apvi dataset folder. Works without ROS: `pip install rosbags`.

    scripts/convert_rosbag2.py BAG OUT [--rig rig.yaml] [--dvl /topic] [--types folder-of-msg-files]

`apvi run` and `apvi doctor` read .mcap and .db3 files directly. This script is for bags whose message types they do
not know, and for GNSS fixes.

BAG is the folder with metadata.yaml. Topics are selected by message type and common names; --list shows them.
Bags of ROS 2 Humble and older do not contain message definitions: for custom types (e.g. of a DVL), give the
folder that contains their package/msg/Name.msg files with --types. docs/formats.md describes the output.
"""
import argparse
import heapq
import math
import pathlib
import shutil
import struct
import sys
import time
import zlib

REORDER = 64  # size of the reordering buffer: messages in a bag may be out of order

IMU_HEADER = ("#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1],"
              "a_x [m s^-2],a_y [m s^-2],a_z [m s^-2]")
DVL_HEADER = ("#timestamp [ns],v_x [m s^-1],v_y [m s^-1],v_z [m s^-1],figure_of_merit [m s^-1],altitude [m],"
              "valid [0|1]," + ",".join(f"beam{i}_v [m s^-1]" for i in range(4)) + ","
              + ",".join(f"beam{i}_range [m]" for i in range(4)) + ","
              + ",".join(f"beam{i}_valid" for i in range(4)))
TRUTH_HEADER = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z"

# For each sensor: message types, required words (any of them), excluded words, preferred words in the topic name.
POSES = ("Odometry", "PoseStamped", "PoseWithCovarianceStamped")
IMAGES = ("Image", "CompressedImage")
RULES = {
    "imu": (("Imu",), (), ("mag",), ("imu/data", "imu")),
    "dvl": (("DVL",), (), ("water_track",), ("dvl/data", "dvl")),
    "pressure": (("FluidPressure",), (), ("atmos",), ()),
    "depth": (POSES, ("depth",), (), ("depth/data",)),
    "cam0": (IMAGES, ("left", "cam0", "camera0"), ("depth", "disparity", "mask"), ("dehazed", "image_raw")),
    "cam1": (IMAGES, ("right", "cam1", "camera1"), ("depth", "disparity", "mask"), ("dehazed", "image_raw")),
    "reference": (POSES, ("/gt", "truth", "vicon", "mocap", "optitrack"), ("gt_full", "slam/pose", "depth"), ("/gt",)),
    "gnss": (("NavSatFix",), (), (), ()),
}
DVL_TWISTS = (("TwistWithCovarianceStamped", "TwistStamped"), ("dvl",), ("water_track",), ("dvl",))


class UsageError(Exception):
    """Invalid user input; reported in one line, exit status 2."""


def at(message, path, default=None):
    """Member of a message by path, or the default if this variant of the message does not have it."""
    for name in path.split("."):
        if not hasattr(message, name):
            return default
        message = getattr(message, name)
    return message


def first_of(message, *paths):
    return next((found for path in paths if (found := at(message, path)) is not None), None)


def stamp_of(message, recorded):
    stamp = at(message, "header.stamp")
    ns = stamp.sec * 10**9 + stamp.nanosec if stamp is not None else 0
    return ns if ns > 0 else recorded


def number(value):
    return "" if value is None else f"{float(value):.9g}"


def xyz(vector):
    return [number(vector.x), number(vector.y), number(vector.z)]


# One function per sensor that converts a message to the CSV cells after the stamp.

def imu_cells(message):
    return xyz(message.angular_velocity) + xyz(message.linear_acceleration)


def not_negative(value):
    return None if value is None or not value >= 0 else value


def dvl_cells(message):
    velocity = first_of(message, "velocity", "twist.twist.linear", "twist.linear")
    covariance = first_of(message, "velocity_covariance", "twist.covariance")
    variance = None if covariance is None else float(covariance[0])
    fom = at(message, "fom", math.sqrt(variance) if variance is not None and variance > 0 else None)
    beams = [None] * 4
    for index, beam in enumerate(at(message, "beams", [])[:4]):
        number_of = int(at(beam, "id", index))
        beams[number_of if 0 <= number_of < 4 and beams[number_of] is None else index] = beam
    moving = any((velocity.x, velocity.y, velocity.z)) or any(at(b, "velocity") for b in beams if b is not None)
    valid = bool(at(message, "velocity_valid", moving)) and not (variance is not None and variance < 0)
    valid = valid and "water" not in str(at(message, "type", ""))
    return (xyz(velocity) + [number(not_negative(fom)), number(not_negative(at(message, "altitude"))), str(int(valid))]
            + ["" if b is None else number(at(b, "velocity")) for b in beams]
            + ["" if b is None else number(not_negative(first_of(b, "distance", "range"))) for b in beams]
            + ["" if b is None else str(int(at(b, "valid", True))) for b in beams])


def pressure_cells(message):
    return [number(message.fluid_pressure)]


def depth_cells(message):
    return [number(-first_of(message, "pose.pose.position", "pose.position").z)]


def truth_cells(message):
    pose = first_of(message, "pose.pose", "pose")
    q = pose.orientation
    return xyz(pose.position) + [number(q.w), number(q.x), number(q.y), number(q.z)]


class Gnss:
    """Converts fixes to meters east, north and up of the first one, on the WGS 84 ellipsoid."""

    def __init__(self):
        self.origin = None

    def __call__(self, message):
        latitude, longitude, height = message.latitude, message.longitude, message.altitude
        if self.origin is None:
            self.origin = latitude, longitude, height
        lat0 = math.radians(self.origin[0])
        e2 = 6.69437999014e-3
        s = 1 - e2 * math.sin(lat0) ** 2
        meridian, normal = 6378137 * (1 - e2) / s**1.5, 6378137 / math.sqrt(s)
        east = math.radians(longitude - self.origin[1]) * normal * math.cos(lat0)
        north = math.radians(latitude - self.origin[0]) * meridian
        return [number(east), number(north), number(height - self.origin[2])]


class Csv:
    """A CSV file whose rows are sorted by time within a short window; duplicates are dropped."""

    def __init__(self, path, header):
        path.parent.mkdir(parents=True, exist_ok=True)
        self.file = open(path, "w", encoding="ascii")
        self.file.write(header + "\n")
        self.waiting, self.last, self.rows, self.dropped = [], -1, 0, 0

    def add(self, stamp, cells):
        heapq.heappush(self.waiting, (stamp, cells))
        if len(self.waiting) > REORDER:
            self.write_one()

    def write_one(self):
        stamp, cells = heapq.heappop(self.waiting)
        if stamp <= self.last:
            self.dropped += 1
            return
        self.last = stamp
        self.rows += 1
        self.file.write(",".join([str(stamp), *cells]) + "\n")

    def close(self):
        while self.waiting:
            self.write_one()
        self.file.close()


def png(rows, width, height, channels):
    """A PNG file of 8-bit gray or RGB rows."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    header = struct.pack(">IIBBBBB", width, height, 8, 0 if channels == 1 else 2, 0, 0, 0)
    filtered = b"".join(b"\0" + row for row in rows)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(filtered, 1))
            + chunk(b"IEND", b""))


def pixels(message):
    """The pixels of a sensor_msgs/Image as an array of 8-bit gray [H,W] or RGB [H,W,3]."""
    import numpy as np
    kinds = {"mono8": (1, 1), "8UC1": (1, 1), "mono16": (1, 2), "16UC1": (1, 2), "rgb8": (3, 1), "bgr8": (3, 1),
             "8UC3": (3, 1), "rgba8": (4, 1), "bgra8": (4, 1)}
    if message.encoding not in kinds:
        raise UsageError(f"unsupported image encoding {message.encoding}; supported are {', '.join(kinds)}")
    channels, size = kinds[message.encoding]
    row = message.width * channels * size
    data = np.frombuffer(bytes(message.data), np.uint8)[:message.height * message.step]
    data = data.reshape(message.height, message.step)[:, :row]
    if size == 2:
        data = data[:, 0::2] if message.is_bigendian else data[:, 1::2]  # the upper byte
    if channels == 1:
        return data
    data = data.reshape(message.height, message.width, channels)[:, :, :3]
    return data if message.encoding.startswith("rgb") else data[:, :, ::-1]


class Camera:
    """The folder of one camera: a CSV file of names, and the image files."""

    def __init__(self, folder):
        self.csv = Csv(folder / "data.csv", "#timestamp [ns],filename")
        self.images = folder / "data"
        self.images.mkdir(exist_ok=True)

    def add(self, stamp, message):
        if hasattr(message, "format"):
            content = bytes(message.data)
            suffix = "png" if content.startswith(b"\x89PNG") else "jpg"
        else:
            array = pixels(message)
            content = png([row.tobytes() for row in array], message.width, message.height, 1 if array.ndim == 2 else 3)
            suffix = "png"
        name = f"{stamp}.{suffix}"
        (self.images / name).write_bytes(content)
        self.csv.add(stamp, [name])

    def close(self):
        self.csv.close()


class Rows:
    """A sensor stored as rows of numbers."""

    def __init__(self, folder, header, cells):
        self.csv = Csv(folder / "data.csv", header)
        self.cells = cells

    def add(self, stamp, message):
        self.csv.add(stamp, self.cells(message))

    def close(self):
        self.csv.close()


def open_sensor(sensor, mav, pressure_unit):
    # Without a unit in the header, the reader infers it from the magnitude of the values.
    pressure = "#timestamp [ns],pressure" + (f" [{pressure_unit}]" if pressure_unit else "")
    if sensor.startswith("cam"):
        return Camera(mav / sensor)
    folder, header, cells = {
        "imu": ("imu0", IMU_HEADER, imu_cells),
        "dvl": ("dvl0", DVL_HEADER, dvl_cells),
        "pressure": ("pressure0", pressure, pressure_cells),
        "depth": ("depth0", "#timestamp [ns],depth [m]", depth_cells),
        "reference": ("state_groundtruth_estimate0", TRUTH_HEADER, truth_cells),
        "gnss": ("gnss0", "#timestamp [ns],east [m],north [m],up [m]", Gnss()),
    }[sensor]
    return Rows(mav / folder, header, cells)


def best_topic(topics, rule):
    types, required, excluded, preferred = rule
    fitting = [name for name, kind in topics.items()
               if kind.split("/")[-1] in types and not any(w in name.lower() for w in excluded)
               and (not required or any(w in name.lower() for w in required))]

    def rank(name):
        return next((i for i, w in enumerate(preferred) if w in name.lower()), len(preferred)), len(name), name
    return min(fitting, key=rank, default=None)


def choose_topics(topics, chosen):
    """Sensor -> topic, as given by the user (`chosen`) or else by type and name."""
    result = {}
    for sensor, rule in RULES.items():
        topic = chosen.get(sensor)
        if topic and topic not in topics:
            raise UsageError(f"--{sensor} {topic}: no such topic; the bag has {', '.join(sorted(topics))}")
        topic = topic or best_topic(topics, rule)
        if not topic and sensor == "dvl":
            topic = best_topic(topics, DVL_TWISTS)
        if topic:
            result[sensor] = topic
    if "cam0" not in result:
        used = set(result.values())
        any_camera = best_topic({n: t for n, t in topics.items() if n not in used}, (IMAGES, (), ("depth",), ()))
        if any_camera:
            result["cam0"] = any_camera
    return result


def type_store(folder):
    """Standard ROS message types and those found below a folder (package/msg/Name.msg)."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    store = get_typestore(Stores.ROS2_HUMBLE)
    if folder is None:
        return store
    files = sorted(folder.rglob("*.msg"))
    if not files:
        raise UsageError(f"{folder}: no .msg files below this folder")
    types = {}
    for file in files:
        package = file.parent.parent.name if file.parent.name == "msg" else file.parent.name
        types.update(get_types_from_msg(file.read_text(encoding="utf-8"), f"{package}/msg/{file.stem}"))
    store.register(types)
    return store


def bag_folder(path):
    if not path.exists():
        raise UsageError(f"{path}: no such file or folder")
    if path.suffix in (".db3", ".mcap"):
        path = path.parent
    if path.is_dir() and not (path / "metadata.yaml").exists():
        raise UsageError(f"{path}: no metadata.yaml in this folder; expected the folder of a ROS 2 bag")
    return path


class Progress:
    """Prints progress to standard error every few seconds."""

    def __init__(self, start, end):
        self.start, self.span = start, max(end - start, 1)
        self.printed = time.monotonic()

    def update(self, recorded):
        if time.monotonic() - self.printed < 3:
            return
        self.printed = time.monotonic()
        print(f"{100 * (recorded - self.start) / self.span:.0f} %", file=sys.stderr, flush=True)


def convert(reader, topics, mav, pressure_unit):
    """Writes the selected topics below `mav`; returns the number of rows of each sensor."""
    sensors = {sensor: open_sensor(sensor, mav, pressure_unit) for sensor in topics}
    sensors_by_topic = {}
    for sensor, topic in topics.items():
        sensors_by_topic.setdefault(topic, []).append(sensors[sensor])
    progress = Progress(reader.start_time, reader.end_time)
    try:
        for connection, recorded, raw in reader.messages([c for c in reader.connections if c.topic in sensors_by_topic]):
            message = reader.deserialize(raw, connection.msgtype)
            for sensor in sensors_by_topic[connection.topic]:
                sensor.add(stamp_of(message, recorded), message)
            progress.update(recorded)
    finally:
        for sensor in sensors.values():
            sensor.close()
    for name, sensor in sensors.items():
        if sensor.csv.dropped:
            print(f"{name}: {sensor.csv.dropped} messages with non-increasing stamps were dropped",
                  file=sys.stderr)
    return {name: sensor.csv.rows for name, sensor in sensors.items()}


def known_topics(reader):
    """Name -> type of the topics with known message types."""
    unknown = {c.msgtype for c in reader.connections if c.msgtype not in reader.typestore.types}
    for msgtype in sorted(unknown):
        print(f"no definition of {msgtype} in the bag: its topics are skipped; see --types", file=sys.stderr)
    return {c.topic: c.msgtype for c in reader.connections if c.msgtype not in unknown}


def run(arguments):
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
    except ImportError as error:
        raise UsageError(f"requires the Python package rosbags (pip install rosbags): {error}") from None
    out = arguments.out
    if out is None and not arguments.list:
        raise UsageError("give an output folder, or --list")
    if out is not None and out.exists():
        raise UsageError(f"{out}: exists already; delete it or choose another folder")
    if arguments.rig and not arguments.rig.is_file():
        raise UsageError(f"{arguments.rig}: no such file")
    store = type_store(arguments.types)
    try:
        with AnyReader([bag_folder(arguments.bag)], default_typestore=store) as reader:
            if arguments.list:
                print("\n".join(f"{c.topic} {c.msgtype} {c.msgcount}" for c in reader.connections))
                return
            write_folder(reader, arguments)
    except AnyReaderError as error:
        raise UsageError(f"{arguments.bag}: cannot read this bag: {error}") from None


def write_folder(reader, arguments):
    chosen = {sensor: getattr(arguments, sensor) for sensor in RULES}
    topics = choose_topics(known_topics(reader), chosen)
    if not topics:
        raise UsageError(f"{arguments.bag}: no supported sensor topics found; see --list")
    # Written under another name until complete, so that an interrupted conversion is never taken for a dataset.
    partial = arguments.out.with_name(arguments.out.name + ".partial")
    if partial.exists():
        print(f"{partial}: left by an interrupted conversion; starting over", file=sys.stderr)
        shutil.rmtree(partial)
    rows = convert(reader, topics, partial / "mav0", arguments.pressure_unit)
    if arguments.rig:
        shutil.copy(arguments.rig, partial / "rig.yaml")
    partial.rename(arguments.out)
    for sensor, topic in topics.items():
        print(f"{sensor}: {rows[sensor]} from {topic}")
    if not arguments.rig:
        print(f"{arguments.out}: add a calibration file rig.yaml (docs/formats.md)", file=sys.stderr)


def parse(argv):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bag", type=pathlib.Path, help="bag folder")
    parser.add_argument("out", type=pathlib.Path, nargs="?", help="dataset folder to create; must not exist")
    parser.add_argument("--list", action="store_true", help="only list the topics")
    parser.add_argument("--rig", type=pathlib.Path, help="calibration file to copy into the folder")
    parser.add_argument("--types", type=pathlib.Path, help="folder with .msg files of types not defined in the bag")
    parser.add_argument("--pressure-unit", choices=("Pa", "hPa", "kPa"), help="default: inferred by the reader")
    for sensor in RULES:
        parser.add_argument(f"--{sensor}", metavar="TOPIC", help=f"topic for {sensor}")
    return parser.parse_args(argv)


def main(argv=None):
    try:
        run(parse(argv))
    except UsageError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted; partial output is in the .partial folder", file=sys.stderr)
        return 1
    except Exception as error:  # damaged bags raise many kinds of exceptions in the reader
        print(f"{type(error).__name__}: {error}; partial output is in the .partial folder", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
