# SPDX-License-Identifier: BSD-3-Clause
"""A run folder with a small map, and the DVL's recording: a seabed with bumps 3 m below a vehicle that looks down, in greenish water."""
import math
import random
import struct

WATER = "comment beta_d 0.4 0.12 0.15\ncomment beta_b 0.35 0.2 0.2\ncomment b_inf 0.05 0.3 0.35\n"
NAMES = ("x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3").split()
SH_DC = 0.28209479177387814
DEPTH_M = 3.0
STATES = ("fused", "fused", "fused", "dipo_only", "frozen", "fused")
SECONDS = 60

RESOLVED = """rig:
  cam0:
    intrinsics: [400, 400, 319.5, 239.5]
    distortion: none
    resolution: [640, 480]
    rate_hz: 10
    T_body_sensor: [0, -1, 0, 0,  -1, 0, 0, 0,  0, 0, -1, 0,  0, 0, 0, 1]
  dvl0:
    T_body_sensor: [1, 0, 0, 0.2,  0, -1, 0, 0,  0, 0, -1, 0,  0, 0, 0, 1]
dataset:
  path: {recording}
"""
LOOPS = ((2, 50), (10, 55), (4, 58))  # seconds
NO_BOTTOM_LOCK = (30, 36)
RANGE_M = 3.1


def height(x, y):
    return -DEPTH_M + 0.25 * math.sin(1.3 * x) * math.cos(1.7 * y)


def write_map(path, count, half_m=4.0):
    """`count` flat Gaussians on the seabed, in stripes of color."""
    draw = random.Random(3)
    sigma = math.log(1.2 * half_m / math.sqrt(count))
    header = f"ply\nformat binary_little_endian 1.0\n{WATER}element vertex {count}\n"
    header += "".join(f"property float {name}\n" for name in NAMES) + "end_header\n"
    with path.open("wb") as out:
        out.write(header.encode())
        for _ in range(count):
            x, y = draw.uniform(-half_m, half_m), draw.uniform(-half_m, half_m)
            bright = 0.75 if (math.floor(x) + math.floor(y)) % 2 else 0.3
            color = [bright * c * draw.uniform(0.8, 1.2) for c in (1.0, 0.8, 0.6)]
            out.write(struct.pack("<14f", x, y, height(x, y), *[(c - 0.5) / SH_DC for c in color], 3.0,
                                  sigma, sigma, sigma - 1.5, 1.0, 0.0, 0.0, 0.0))


def body_pose(t):
    """On a circle, with the heading along it: position and quaternion x y z w."""
    angle = 2 * math.pi * t / SECONDS
    heading = angle + math.pi / 2
    return 1.5 * math.cos(angle), 1.5 * math.sin(angle), 0.0, 0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)


def write_poses(path, step_s):
    lines = [" ".join([f"{1000 + t:.9f}", *(f"{x:.9f}" for x in body_pose(t))])
             for t in (k * step_s for k in range(int(SECONDS / step_s) + 1))]
    path.write_text("\n".join(lines) + "\n")


def write_health(path):
    columns = ["#timestamp [ns]", "state", "level", "vio", "landmarks"]
    columns += [f"{kind}_eigenvalue_{k}" for kind in ("rotation", "position") for k in (1, 2, 3)]
    lines = [",".join(columns)]
    for k in range(10 * SECONDS):
        state = STATES[k * len(STATES) // (10 * SECONDS)]
        lines.append(f"{(1000 + k // 10) * 10**9 + k % 10 * 10**8},{state},accepted,tracking,100" + ",1" * 6)
    path.write_text("\n".join(lines) + "\n")


def ns(t):
    return 1000 * 10**9 + round(t * 10**9)


def write_loops(path):
    path.write_text("#from [ns],to [ns]\n" + "".join(f"{ns(a)},{ns(b)}\n" for a, b in LOOPS))


def write_sensors(path):
    spans = [("camera", 0, 20), ("camera", 25, 60), ("dvl", 0, NO_BOTTOM_LOCK[0]), ("dvl", NO_BOTTOM_LOCK[1], 60),
             ("imu", 0, 60), ("pressure", 5, 60)]
    path.write_text("#sensor,begin [ns],end [ns],samples\n" + "".join(
        f"{name},{ns(begin)},{ns(end)},100\n" for name, begin, end in spans))


def write_recording(folder):
    """The DVL alone. Beam 3 never sees the bottom, and reports no range."""
    (folder / "mav0/dvl0").mkdir(parents=True)
    names = [f"beam{i}_{what}" for what in ("v", "range", "valid") for i in range(4)]
    lines = [",".join(["#timestamp [ns]", "v_x", "v_y", "v_z", "altitude", "valid", *names])]
    for k in range(5 * SECONDS):
        locked = not NO_BOTTOM_LOCK[0] <= k / 5 < NO_BOTTOM_LOCK[1]
        ranges = [RANGE_M if locked else "", RANGE_M if locked else "", RANGE_M if locked else "", ""]
        lines.append(",".join(str(x) for x in (
            ns(k / 5), 0.1, 0, 0, 2.5, int(locked), *[0.05] * 4, *ranges, *[int(locked)] * 3, 0)))
    (folder / "mav0/dvl0/data.csv").write_text("\n".join(lines) + "\n")


def make(folder, gaussians=4000):
    folder.mkdir(parents=True)
    write_map(folder / "map.ply", gaussians)
    write_poses(folder / "trajectory.tum", 0.1)
    write_poses(folder / "keyframes.tum", 2.0)
    write_health(folder / "health.csv")
    write_loops(folder / "loops.csv")
    write_sensors(folder / "sensors.csv")
    write_recording(folder / "recording")
    (folder / "resolved.yaml").write_text(RESOLVED.format(recording=folder / "recording"))
    return folder
