#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Opens apvi's output with the programs it is made for: interop_test.py APVI.

    python3 -m venv build/venv && build/venv/bin/pip install -r tests/interop/requirements.txt

Tests are skipped if their package is not installed or apvi was built without a required feature."""
import importlib.util
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

SKIPPED = 77
ROOT = pathlib.Path(__file__).resolve().parents[2]
APVI = sys.argv.pop(1) if len(sys.argv) > 1 else str(ROOT / "build/cpu/bin/apvi")
SCENE = ROOT / "configs/scenes/seabed_easy.yaml"
# No lens distortion, so that exported images equal the simulated ones.
SMALL = ["rig.cam0.resolution=[160, 120]", "rig.cam0.intrinsics=[105, 105, 79.5, 59.5]",
         "rig.cam0.coefficients=[0, 0, 0, 0]", "rig.cam0.rate_hz=4",
         "truth.image_every=1"]

if importlib.util.find_spec("numpy"):
    import numpy as np


def needs(*packages):
    missing = [name for name in ("numpy", *packages) if not importlib.util.find_spec(name)]
    return unittest.skipIf(missing, f"not installed: {', '.join(missing)}")


def apvi(*arguments):
    result = subprocess.run([APVI, *map(str, arguments)], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise AssertionError(f"apvi {arguments[0]}: {result.stderr.strip()}")
    return result.stdout


def settings(pairs):
    return [word for pair in pairs for word in ("--set", pair)]


def can(command):
    text = subprocess.run([APVI, command, "--help"], capture_output=True, text=True, check=False)
    return text.returncode == 0


def read_pfm(path):
    """Image [H, W] or [H, W, 3], top row first."""
    with open(path, "rb") as file:
        kind = file.readline().strip()
        width, height = map(int, file.readline().split())
        scale = float(file.readline())
        data = np.frombuffer(file.read(), "<f4" if scale < 0 else ">f4")
    shape = (height, width, 3) if kind == b"PF" else (height, width)
    return data.reshape(shape)[::-1]


class Folder(unittest.TestCase):
    """A temporary folder shared by all tests of a class."""

    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.temporary.cleanup)
        cls.folder = pathlib.Path(cls.temporary.name)


@needs("evo")
class Evo(Folder):
    """The metrics of `apvi eval` equal those of evo for the files of a run."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        dive, run = cls.folder / "dive", cls.folder / "run"
        apvi("sim", SCENE, "-o", dive, "--no-images", "--set", "duration_s=100")
        apvi("run", ROOT / "configs/default.yaml", "--set", f"dataset.path={dive}", "-o", run)
        cls.files = dive / "truth" / "trajectory.tum", run / "trajectory.tum"

    def ours(self, *more):
        reference, estimate = self.files
        return json.loads(apvi("eval", "trajectory", "--reference", reference, "--estimate", estimate,
                               "--associate", "nearest", "--json", *more))

    def pair(self):
        from evo.core import sync
        from evo.tools import file_interface
        read = [file_interface.read_tum_trajectory_file(str(path)) for path in self.files]
        return sync.associate_trajectories(*read, max_diff=0.01)

    def statistics(self, metric, pair):
        from evo.core import metrics
        metric.process_data(pair)
        return metric.get_statistic(metrics.StatisticsType.rmse)

    def test_absolute_errors_match(self):
        from evo.core import metrics
        ours = self.ours()["trajectory"]
        reference, estimate = self.pair()
        self.assertEqual(ours["matched"], len(reference.timestamps))
        estimate.align(reference)
        ate = self.statistics(metrics.APE(metrics.PoseRelation.translation_part), (reference, estimate))
        self.assertAlmostEqual(ours["ate_rmse_m"], ate, delta=1e-6)
        angle = self.statistics(metrics.APE(metrics.PoseRelation.rotation_angle_deg), (reference, estimate))
        self.assertAlmostEqual(ours["rot_rmse_deg"], angle, delta=1e-5)

    def test_first_pose_aligned_error_matches(self):
        from evo.core import metrics
        reference, estimate = self.pair()
        estimate.align_origin(reference)
        ate = self.statistics(metrics.APE(metrics.PoseRelation.translation_part), (reference, estimate))
        self.assertAlmostEqual(self.ours()["trajectory"]["ate_first_pose_rmse_m"], ate, delta=1e-6)

    def relative(self, all_pairs):
        from evo.core import metrics
        metric = metrics.RPE(metrics.PoseRelation.translation_part, 10.0, metrics.Unit.meters, all_pairs=all_pairs)
        metric.process_data(self.pair())
        return np.asarray(metric.error)

    def test_relative_errors_of_all_pairs_match(self):
        rmse = np.sqrt(np.mean(self.relative(True)**2))
        self.assertAlmostEqual(self.ours()["trajectory"]["rpe_10m_all_pairs_rmse_m"], rmse, delta=1e-6)

    def test_relative_errors_of_consecutive_pairs_match(self):
        """Pairs start after the first 10 m, like evo up to 1.37; later versions start at the first pose."""
        from importlib.metadata import version
        errors = self.relative(False)
        if tuple(map(int, version("evo").split(".")[:2])) >= (1, 38):
            errors = errors[1:]
        self.assertAlmostEqual(self.ours()["trajectory"]["rpe_10m_rmse_m"], np.sqrt(np.mean(errors**2)), delta=1e-6)


@needs("rosbags", "PIL")
class Rosbags(Folder):
    """The bag and the folder written by the simulator have the same data."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        more = settings([*SMALL, "duration_s=2"])
        simulate_bag(cls.folder / "bag", [*SMALL, "duration_s=2"])
        apvi("sim", SCENE, "-o", cls.folder / "dive", *more)
        cls.messages = cls.read(cls.folder / "bag" / "recording.bag")

    @staticmethod
    def read(path):
        """Topic -> (type, [message])."""
        from rosbags.highlevel import AnyReader
        found = {}
        with AnyReader([path]) as reader:
            for connection, _, raw in reader.messages():
                message = reader.deserialize(raw, connection.msgtype)
                found.setdefault(connection.topic, (connection.msgtype, []))[1].append(message)
        return found

    def of_type(self, *words):
        found = [messages for topic, (kind, messages) in self.messages.items()
                 if all(word in f"{topic} {kind}".lower() for word in words)]
        self.assertEqual(len(found), 1, f"{words}: {list(self.messages)}")
        return found[0]

    def csv(self, sensor):
        return np.loadtxt(self.folder / "dive/mav0" / sensor / "data.csv", delimiter=",", comments="#", ndmin=2)

    @staticmethod
    def stamps(messages):
        return [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages]

    def test_imu_data_match(self):
        messages, table = self.of_type("msg/imu"), self.csv("imu0")
        self.assertEqual(len(messages), len(table))
        read = [[v for part in (m.angular_velocity, m.linear_acceleration) for v in (part.x, part.y, part.z)]
                for m in messages]
        np.testing.assert_allclose(read, table[:, 1:7], atol=1e-8)
        np.testing.assert_allclose(self.stamps(messages), table[:, 0], atol=256)  # double precision

    def test_dvl_velocities_match(self):
        messages = self.of_type("msg/dvl")
        lines = (self.folder / "dive/mav0/dvl0/data.csv").read_text(encoding="utf-8").splitlines()
        rows = [line.split(",")[1:4] for line in lines[1:]]
        self.assertEqual(len(messages), len(rows))
        for message, row in zip(messages, rows):
            if row[0] and message.velocity_valid:
                np.testing.assert_allclose(
                    [message.velocity.x, message.velocity.y, message.velocity.z], list(map(float, row)), atol=1e-6)

    def test_images_match(self):
        import io
        from PIL import Image
        messages = self.of_type("compressedimage")
        files = sorted((self.folder / "dive/mav0/cam0/data").glob("*.png"))
        self.assertEqual(self.stamps(messages), [int(path.stem) for path in files])
        for message, path in zip(messages, files):
            seen = np.asarray(Image.open(io.BytesIO(bytes(message.data))).convert("RGB"))
            np.testing.assert_array_equal(seen, np.asarray(Image.open(path).convert("RGB")))


@needs("rosbags")
class Ros2Bags(Folder):
    """A run on a ROS 2 bag written by `rosbags` equals that on the folder with the same data."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.dive = cls.folder / "dive"
        apvi("sim", SCENE, "-o", cls.dive, *settings([*SMALL, "rig.cam0.rate_hz=10", "duration_s=12"]))
        cls.expected = cls.trajectory_of(cls.dive, "folder")

    @classmethod
    def trajectory_of(cls, recording, name):
        out = cls.folder / f"run_{name}"
        apvi("run", ROOT / "configs/localization.yaml", "-o", out, "--no-report", *settings([
            f"dataset.path={recording}", f"dataset.rig={cls.dive / 'rig.yaml'}", "run.mode=sequential"]))
        return (out / "trajectory.tum").read_text(encoding="utf-8")

    def write_bag(self, name, *options):
        import ros2_bag_writer
        ros2_bag_writer.write(self.dive, self.folder / name, *options)
        return self.folder / name

    def assert_same_run(self, bag):
        self.assertGreater(self.expected.count("\n"), 50)
        self.assertEqual(self.trajectory_of(bag, f"{bag.stem}_{bag.suffix}"), self.expected)

    def test_run_on_mcap_equals_run_on_folder(self):
        from rosbags.rosbag2 import StoragePlugin
        bag = self.write_bag("mcap", StoragePlugin.MCAP)
        self.assert_same_run(bag)
        self.assert_same_run(next(bag.glob("*.mcap")))

    def test_run_on_sqlite3_equals_run_on_folder(self):
        from rosbags.rosbag2 import StoragePlugin
        bag = self.write_bag("sqlite3", StoragePlugin.SQLITE3)
        self.assert_same_run(bag)
        self.assert_same_run(next(bag.glob("*.db3")))

    def test_run_on_compressed_bags_equals_run_on_folder(self):
        from rosbags.rosbag2 import CompressionMode, StoragePlugin
        self.assert_same_run(self.write_bag("message", StoragePlugin.SQLITE3, CompressionMode.MESSAGE))
        self.assert_same_run(self.write_bag("storage", StoragePlugin.MCAP, CompressionMode.STORAGE))


def simulate_bag(folder, pairs):
    result = subprocess.run([APVI, "sim", SCENE, "-o", folder, "--format", "rosbag", *settings(pairs)],
                            capture_output=True, text=True, check=False)
    if "without rosbag support" in result.stderr:
        raise unittest.SkipTest("apvi was built without rosbag support")
    if result.returncode != 0:
        raise AssertionError(result.stderr)


class TankAndCoral(Folder):
    """The configurations of both datasets work with simulated recordings of their layouts."""
    PAIRS = ["duration_s=14", "rig.cam0.resolution=[306, 256]", "rig.cam0.intrinsics=[201, 201, 152.5, 127.5]",
             "rig.cam0.coefficients=[0, 0, 0, 0]", "truth.image_every=0"]

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        simulate_bag(cls.folder / "tank", cls.PAIRS)

    def run_with(self, config, path, *pairs):
        out = self.folder / f"run_{self.id().rpartition('.')[2]}"
        apvi("run", ROOT / "configs/datasets" / config, "-o", out, *settings([
            f"dataset.path={path}", f"dataset.rig={self.folder / 'tank/rig.yaml'}", "run.mode=sequential", *pairs]))
        return json.loads((out / "metrics.json").read_text())

    def assert_localized(self, metrics, depths):
        self.assertLess(metrics["trajectory"]["ate_rmse_m"], 0.05)
        self.assertGreater(metrics["trajectory"]["coverage"], 0.7)
        self.assertLess(metrics["trajectory"]["vio"]["ate_rmse_m"], 0.1)
        self.assertGreater(metrics["counts"]["dvl"]["accepted"], 50)
        self.assertGreater(metrics["counts"]["depth"]["accepted"], depths)

    def test_tank_bag_is_localized(self):
        self.assert_localized(self.run_with("tank.yaml", self.folder / "tank/recording.bag"), 100)

    def test_raw_tank_folder_is_localized(self):
        apvi("sim", SCENE, "-o", self.folder / "raw", "--format", "tank", *settings(self.PAIRS))
        self.assert_localized(self.run_with("tank.yaml", self.folder / "raw"), 100)

    @needs("rosbags")
    def test_topics_and_types_match_the_tank_dataset(self):
        messages = Rosbags.read(self.folder / "tank/recording.bag")
        self.assertEqual({topic: kind for topic, (kind, _) in messages.items()}, {
            "/camera/left/image_dehazed/compressed": "sensor_msgs/msg/CompressedImage",
            "/imu/data": "sensor_msgs/msg/Imu", "/dvl/data": "waterlinked_a50_ros_driver/msg/DVL",
            "/depth/data": "nav_msgs/msg/Odometry", "/apriltag_slam/GT": "nav_msgs/msg/Odometry"})

    @needs("rosbags")
    def test_survey_with_absolute_pressure_is_localized(self):
        """Like a BlueROV: pressure of a Bar50 instead of odometry, and another camera topic."""
        path = self.folder / "coral.bag"
        self.rewrite(self.folder / "tank/recording.bag", path)
        rig = (self.folder / "tank/rig.yaml").read_text(encoding="utf-8").replace("depth0:", "pressure0:")
        (self.folder / "coral.yaml").write_text(rig, encoding="utf-8")
        metrics = self.run_with("coral.yaml", path, f"dataset.rig={self.folder / 'coral.yaml'}")
        self.assert_localized(metrics, 100)

    @staticmethod
    def rewrite(source, target):
        from rosbags.rosbag1 import Reader, Writer
        from rosbags.typesys import Stores, get_typestore
        store = get_typestore(Stores.ROS1_NOETIC)
        types = store.types
        names = {"/camera/left/image_dehazed/compressed": "/bluerov/camera/image_raw/compressed"}
        with Reader(source) as reader, Writer(target) as writer:
            kept = {c.id: writer.add_connection(names.get(c.topic, c.topic), c.msgtype, msgdef=c.msgdef.data,
                                                md5sum=c.digest)
                    for c in reader.connections if c.topic != "/depth/data"}
            pressure = writer.add_connection("/bar50/pressure", "sensor_msgs/msg/FluidPressure", typestore=store)
            for connection, stamp, raw in reader.messages():
                if connection.topic != "/depth/data":
                    writer.write(kept[connection.id], stamp, raw)
                    continue
                odometry = store.deserialize_ros1(raw, "nav_msgs/msg/Odometry")
                message = types["sensor_msgs/msg/FluidPressure"](
                    header=odometry.header, variance=0.0,
                    fluid_pressure=101325.0 - 1025.0 * 9.80665 * odometry.pose.pose.position.z)
                writer.write(pressure, stamp, store.serialize_ros1(message, "sensor_msgs/msg/FluidPressure"))


@needs()
class TankRigs(unittest.TestCase):
    def test_camera_and_dvl_axes_are_consistent(self):
        """Camera z and DVL x point forward, camera y and DVL z down."""
        import re
        for name in ("tank_short", "tank_long"):
            text = (ROOT / "configs/rigs" / f"{name}.yaml").read_text(encoding="utf-8")
            camera, dvl = (np.array(list(map(float, cells.split(",")))).reshape(4, 4)[:3, :3]
                           for cells in re.findall(r"T_body_sensor: \[(.*?)\]", text))
            self.assertGreater(camera[:, 2] @ dvl[:, 0], 0.99)
            self.assertGreater(camera[:, 1] @ dvl[:, 2], 0.99)


class Map(Folder):
    """Exports of a small map built with known poses."""
    made = None

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        if not can("export"):
            raise unittest.SkipTest("apvi was built without mapping")
        cls.dive, cls.run_folder = cls.folder / "dive", cls.folder / "run"
        apvi("sim", SCENE, "-o", cls.dive, *settings([*SMALL, "duration_s=5"]))
        apvi("run", ROOT / "configs/default.yaml", "-o", cls.run_folder, *settings([
            f"dataset.path={cls.dive}", "localization.enabled=false", "mapping.enabled=true", "mapping.medium=true",
            "mapping.iterations=40", "mapping.sh_degree=3", "mapping.densification=none"]))
        for kind in ("colmap", "nerfstudio"):
            apvi("export", cls.run_folder, "--format", kind)

    def true_depth(self, name):
        return read_pfm(self.dive / "truth/depth" / f"{pathlib.Path(name).stem}.pfm")


@needs("pycolmap")
class Pycolmap(Map):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        import pycolmap
        cls.model = pycolmap.Reconstruction(cls.run_folder / "colmap/sparse/0")

    def views(self):
        """(name, camera, 3x4 pose) of the images with true depth."""
        for image in self.model.images.values():
            if (self.dive / "truth/depth" / f"{pathlib.Path(image.name).stem}.pfm").exists():
                pose = image.cam_from_world
                yield image.name, image.camera, (pose() if callable(pose) else pose).matrix()

    def test_every_image_is_registered_and_exists(self):
        self.assertEqual(self.model.num_images(), len(list((self.run_folder / "colmap/images").glob("*.png"))))
        for image in self.model.images.values():
            self.assertTrue((self.run_folder / "colmap/images" / image.name).exists())
            self.assertEqual((image.camera.width, image.camera.height), (160, 120))

    def test_reprojection_into_another_image_matches_depth(self):
        views = list(self.views())
        self.assertGreater(len(views), 3)
        (first, camera, A), (second, _, B) = views[0], views[2]
        rows, columns = np.mgrid[10:110:10, 10:150:10]
        pixels = np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5
        z = self.true_depth(first)[rows.ravel(), columns.ravel()]
        rays = np.column_stack([camera.cam_from_img(pixels), np.ones(len(z))])
        world = (rays * z[:, None] - A[:, 3]) @ A[:, :3]  # R^T (x - t)
        there = world @ B[:, :3].T + B[:, 3]
        seen = np.array(camera.img_from_cam(there))
        errors = [abs(self.true_depth(second)[int(v), int(u)] / d - 1.0) for (u, v), d, ok in
                  zip(seen, there[:, 2], z > 0) if ok and 0 <= u < 160 and 0 <= v < 120]
        self.assertGreater(len(errors), 50)
        self.assertLess(np.median(errors), 0.01)

    def test_points_match_true_depth(self):
        points = np.array([point.xyz for point in self.model.points3D.values()])
        self.assertGreater(len(points), 100)
        errors = []
        for name, camera, T in self.views():
            inside = points @ T[:, :3].T + T[:, 3]
            inside = inside[inside[:, 2] > 0.1]
            depth = self.true_depth(name)
            for (u, v), z in zip(np.array(camera.img_from_cam(inside)), inside[:, 2]):
                if 0 <= u < 160 and 0 <= v < 120 and depth[int(v), int(u)] > 0:
                    errors.append(abs(z / depth[int(v), int(u)] - 1.0))
        self.assertGreater(len(errors), 500)
        self.assertLess(np.median(errors), 0.05)


@needs("plyfile")
class Plyfile(Map):
    def test_map_has_standard_properties_in_standard_order(self):
        import plyfile
        vertex = plyfile.PlyData.read(self.run_folder / "map.ply")["vertex"]
        names = ["x", "y", "z", "nx", "ny", "nz", *(f"f_dc_{i}" for i in range(3)),
                 *(f"f_rest_{i}" for i in range(45)), "opacity", *(f"scale_{i}" for i in range(3)),
                 *(f"rot_{i}" for i in range(4))]
        self.assertEqual([p.name for p in vertex.properties], names)
        self.assertEqual({p.val_dtype for p in vertex.properties}, {"f4"})
        self.assertEqual(vertex.count, json.loads((self.run_folder / "metrics.json").read_text())
                         ["mapping"]["gaussians"])
        for name in names:
            self.assertTrue(np.isfinite(vertex[name]).all(), name)

    def test_exported_points_match_the_map(self):
        import plyfile
        points = [np.column_stack([plyfile.PlyData.read(path)["vertex"][axis] for axis in "xyz"])
                  for path in (self.run_folder / "map.ply", self.run_folder / "nerfstudio/points.ply")]
        np.testing.assert_allclose(*points, rtol=1e-5, atol=1e-6)


@needs()
class Nerfstudio(Map):
    def camera_of(self, transforms, frame):
        """camera.json of a frame by Nerfstudio's conventions: camera to world, x right, y up, z backward;
        pixel centers at +0.5."""
        T = np.array(frame["transform_matrix"]) @ np.diag([1.0, -1.0, -1.0, 1.0])
        K = [[transforms["fl_x"], 0, transforms["cx"]], [0, transforms["fl_y"], transforms["cy"]], [0, 0, 1]]
        return {"width": transforms["w"], "height": transforms["h"], "K": K, "pixel_center": 0.5,
                "T_cam_world": np.linalg.inv(T).tolist()}

    def test_exported_cameras_render_the_same_views(self):
        transforms = json.loads((self.run_folder / "nerfstudio/transforms.json").read_text())
        apvi("render", self.run_folder, "--float", "-o", self.folder / "views")
        frames = transforms["frames"]
        for frame in (frames[0], frames[len(frames) // 2], frames[-1]):
            camera = self.folder / "camera.json"
            camera.write_text(json.dumps(self.camera_of(transforms, frame)), encoding="utf-8")
            out = self.folder / "one"
            apvi("render", self.run_folder, "--float", "--camera", camera, "-o", out)
            [image] = out.glob("*.pfm")
            stamp = pathlib.Path(frame["file_path"]).stem
            expected = read_pfm(self.folder / "views" / f"{stamp}.pfm")
            self.assertGreater(np.std(expected), 0.01)
            np.testing.assert_allclose(read_pfm(image), expected, atol=2e-3)
            image.unlink()

    def test_exported_images_exist_and_poses_are_finite(self):
        transforms = json.loads((self.run_folder / "nerfstudio/transforms.json").read_text())
        for frame in transforms["frames"]:
            self.assertTrue((self.run_folder / "nerfstudio" / frame["file_path"]).exists())
        self.assertFalse(any(math.isnan(v) for f in transforms["frames"] for r in f["transform_matrix"] for v in r))


if __name__ == "__main__":
    ended = unittest.main(exit=False, verbosity=2)
    ran = ended.result.testsRun - len(ended.result.skipped)
    if ended.result.wasSuccessful() and ran <= 0:
        print("skipped: no required package is installed: " + __doc__.split("\n\n")[1].strip())
        sys.exit(SKIPPED)
    sys.exit(0 if ended.result.wasSuccessful() else 1)
