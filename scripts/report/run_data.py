# SPDX-License-Identifier: BSD-3-Clause
"""Reads a run folder and the parts of its recording that a report shows.

Times are seconds since the first pose. Positions have z up: a ned world is converted to east, north,
up.
"""
import csv
import dataclasses
import datetime
import json
import pathlib
import re

import numpy as np

# Rotation from north, east, down to east, north, up.
NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
POSE_NAMES = {"trajectory_smoothed.tum": "Smoothed", "vio.tum": "VIO", "dipo.tum": "DIPO"}


class InputError(Exception):
    """An invalid input file: what is wrong and where."""


@dataclasses.dataclass
class Track:
    """Poses in order of time: t [n] in seconds, p [n, 3] in meters, R [n, 3, 3] or None."""
    t: np.ndarray
    p: np.ndarray
    R: np.ndarray = None
    planar: bool = False  # without valid heights

    def __len__(self):
        return len(self.t)

    def within(self, first, last):
        keep = (self.t >= first) & (self.t <= last)
        return Track(self.t[keep], self.p[keep], None if self.R is None else self.R[keep],
                     self.planar)


@dataclasses.dataclass
class Table:
    """Columns of a CSV file by name; numeric if all cells are numbers, else text."""
    columns: dict

    def __contains__(self, name):
        return name in self.columns

    def __getitem__(self, name):
        return self.columns[name]

    def __len__(self):
        return len(next(iter(self.columns.values())))


@dataclasses.dataclass
class Run:
    folder: pathlib.Path
    start_s: float                 # stamp of the first pose
    estimate: Track
    others: dict                   # name -> Track of the individual estimators
    metrics: dict
    config: str                    # text of resolved.yaml
    log: str
    calibration: Table = None
    pings: Table = None
    health: Table = None           # one row per camera frame
    timing: Table = None           # one row per camera frame
    mapping: Table = None          # progress of the map
    views: Table = None            # one row per held-out view
    medium: dict = None            # estimated water
    true_medium: dict = None       # ground truth, if known
    dataset: pathlib.Path = None
    reference: Track = None
    reference_note: str = ""       # why there is no reference
    streams: dict = dataclasses.field(default_factory=dict)  # sensor -> stamps
    renders: dict = dataclasses.field(default_factory=dict)  # stamp -> kind -> file
    date: datetime.datetime = None

    def setting(self, *keys, default=""):
        """Scalar of the configuration by its keys."""
        return setting(self.config, keys, default)

    @property
    def name(self):
        return pathlib.PurePath(self.setting("dataset", "path")).name or self.folder.resolve().name

    @property
    def is_ned(self):
        return self.setting("rig", "world") == "ned"

    @property
    def axes_known(self):
        """Whether x and y are east and north."""
        return self.reference is not None and (self.is_ned or self.reference.planar)


def setting(text, keys, default=""):
    """Scalar of a YAML file written by apvi: nested maps, indented by two, one key per line."""
    depth = 0
    for line in text.splitlines():
        indent = len(line) - len(line.lstrip())
        if indent % 2 or indent // 2 < depth:
            break
        match = re.match(rf"{re.escape(keys[depth])}:(?: (.*))?$", line.strip())
        if indent // 2 == depth and match:
            depth += 1
            if depth == len(keys):
                value = (match.group(1) or "").strip()
                return json.loads(value) if value.startswith('"') else value
    return default


def read_text(path):
    return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""


def complete_lines(path):
    """(number, line) of complete lines; a killed run may leave a partial last line."""
    text = read_text(path)
    lines = text.split("\n")[:-1]
    return [(number, line) for number, line in enumerate(lines, start=1) if line.strip()]


def rotation_matrices(q):
    """Rotation matrices [n, 3, 3] of quaternions [n, 4] in the order x, y, z, w."""
    x, y, z, w = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    return np.moveaxis(np.array(rows), 2, 0)


def make_track(t, p, q=None, ned=False, planar=False):
    turn = NED_TO_ENU if ned else np.eye(3)
    R = None if q is None else turn @ rotation_matrices(q)
    return Track(t, p @ turn.T, R, planar)


def read_tum(path, start_s, ned):
    rows = []
    for number, line in complete_lines(path):
        if line.startswith("#"):
            continue
        try:
            rows.append([float(cell) for cell in line.split()])
        except ValueError:
            rows.append([])
        if len(rows[-1]) != 8:
            raise InputError(f"{path}:{number}: expected eight numbers (t x y z qx qy qz qw)")
    if not rows:
        return Track(np.empty(0), np.empty((0, 3)), np.empty((0, 3, 3)))
    data = np.array(rows)
    data = data[np.isfinite(data).all(axis=1)]
    return make_track(data[:, 0] - start_s, data[:, 1:4], data[:, 4:8], ned)


def numbers_or_text(cells):
    try:
        return np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        return np.array(cells)


def read_table(path):
    """None when the file does not exist or has no rows."""
    lines = complete_lines(path)
    if len(lines) < 2:
        return None
    header = re.sub(r"\s*\[[^\]]*\]", "", lines[0][1])  # without units
    names = [name.strip() for name in header.lstrip("#").split(",")]
    cells = list(csv.reader(line for _, line in lines[1:]))
    for (number, _), row in zip(lines[1:], cells):
        if len(row) != len(names):
            raise InputError(f"{path}:{number}: {len(row)} columns, but the header has {len(names)}")
    return Table({name: numbers_or_text(column) for name, column in zip(names, zip(*cells))})


def seconds(table, start_s):
    return table["timestamp"] * 1e-9 - start_s


def first_stamp(path):
    for _, line in complete_lines(path):
        try:
            return float(line.split()[0])
        except ValueError:
            break
    return 0.0


def good_rows(data):
    """The rows of a reference with finite numbers, a rotation if any, and increasing stamps."""
    good = np.isfinite(data).all(axis=1)
    if data.shape[1] == 8:
        good &= np.abs(np.linalg.norm(data[:, 4:8], axis=1) - 1.0) < 0.02
    data = data[good]
    if not len(data):
        raise InputError("it has no usable row")
    latest = np.maximum.accumulate(data[:, 0])
    return data[np.concatenate(([True], data[1:, 0] > latest[:-1]))]


def read_reference(dataset, start_s, ned):
    """(Track or None, note why there is none). A reference is optional: a bad one is a note."""
    try:
        return find_reference(dataset, start_s, ned)
    except (InputError, TypeError, ValueError) as error:
        return None, f"No reference: {error}."


def find_reference(dataset, start_s, ned):
    """(Track or None, note why there is none)."""
    if not (dataset / "mav0").is_dir():
        what = "was not found" if not dataset.exists() else "is not a dataset folder"
        return None, f"No reference: the recording {what}."
    poses = read_table(dataset / "mav0" / "state_groundtruth_estimate0" / "data.csv")
    if poses is not None:
        data = good_rows(np.column_stack(list(poses.columns.values())[:8]))
        q = data[:, [5, 6, 7, 4]] if data.shape[1] == 8 else None
        return make_track(data[:, 0] * 1e-9 - start_s, data[:, 1:4], q, ned), ""
    gnss = read_table(dataset / "mav0" / "gnss0" / "data.csv")
    if gnss is not None:
        data = good_rows(np.column_stack(list(gnss.columns.values())[:4]))
        return make_track(data[:, 0] * 1e-9 - start_s, data[:, 1:4], planar=True), ""
    return None, "The recording has no reference trajectory."


def read_stamps(path, start_s):
    if "dvl" in path.parent.name:
        table = read_table(path)
        if table is None:
            return np.empty(0)
        t = seconds(table, start_s)
        return t[table["valid"] == 1] if "valid" in table else t
    try:
        return np.loadtxt(path, delimiter=",", usecols=0, ndmin=1) * 1e-9 - start_s
    except ValueError:
        return np.empty(0)


def read_streams(dataset, start_s):
    streams = {}
    for path in sorted((dataset / "mav0").glob("*/data.csv")):
        stamps = read_stamps(path, start_s)
        if len(stamps) > 1:
            streams[path.parent.name] = np.sort(stamps)
    return streams


def read_json(path):
    """JSON object; empty when the file does not exist."""
    text = read_text(path)
    if not text:
        return {}
    try:
        found = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}:{error.lineno}: invalid JSON: {error.msg}") from error
    if not isinstance(found, dict):
        raise InputError(f"{path}: expected a JSON object")
    return found


def read_renders(folder):
    """Files STAMP_KIND.png by stamp and kind: truth, render, restored, depth."""
    found = {}
    for path in sorted(folder.glob("*_*.png")):
        stamp, _, kind = path.stem.rpartition("_")
        found.setdefault(stamp, {})[kind] = path
    return found


def load(folder):
    """Reads a run. Raises InputError for folders without a run and for damaged files."""
    trajectory = folder / "trajectory.tum"
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected a run folder of `apvi run`")
    if not trajectory.is_file():
        raise InputError(f"{folder}: no trajectory.tum in it; expected a run folder of `apvi run`")
    config = read_text(folder / "resolved.yaml")
    start_s = first_stamp(trajectory)
    ned = setting(config, ("rig", "world")) == "ned"
    run = Run(folder=folder, start_s=start_s, estimate=read_tum(trajectory, start_s, ned),
              others={name: read_tum(folder / file, start_s, ned)
                      for file, name in POSE_NAMES.items() if (folder / file).is_file()},
              metrics=read_json(folder / "metrics.json"), config=config,
              log=read_text(folder / "log.txt"),
              calibration=read_table(folder / "calibration.csv"),
              pings=read_table(folder / "pings.csv"),
              health=read_table(folder / "health.csv"),
              timing=read_table(folder / "timing.csv"),
              mapping=read_table(folder / "mapping.csv"),
              views=read_table(folder / "renders" / "views.csv"),
              medium=read_json(folder / "medium.json"), renders=read_renders(folder / "renders"),
              date=datetime.datetime.fromtimestamp(trajectory.stat().st_mtime))
    path = run.setting("dataset", "path")
    if path:
        dataset = run.dataset = pathlib.Path(path)
        run.true_medium = read_json(dataset / "truth" / "medium.json")
        run.reference, run.reference_note = read_reference(dataset, start_s, ned)
        run.streams = read_streams(dataset, start_s)
    return run
