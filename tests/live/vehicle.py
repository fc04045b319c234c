#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Plays a dataset folder as a vehicle: a Water Linked DVL on TCP, an autopilot with MAVLink on UDP.

    vehicle.py DATASET [--dvl-port 16171] [--mavlink-port 14550] [--duration SECONDS]
               [--dvl-skew-ppm PPM] [--dvl-step SECONDS --dvl-step-at SECONDS]

    apvi live waterlinked://127.0.0.1 mavlink://udp:14550 --rig DATASET/rig.yaml

The autopilot stamps by its time since boot, the DVL by Unix time of a clock of its own. Pings are
sent --dvl-delay seconds after their time of validity, and say so. The clock of the DVL may run too
fast (--dvl-skew-ppm) and be set once (--dvl-step). Waits for a client of the DVL.
"""
import argparse
import csv
import heapq
import json
import pathlib
import socket
import struct
import time

HIGHRES_IMU, SCALED_PRESSURE2 = (105, 93), (137, 195)  # id, CRC_EXTRA
DVL_EPOCH_US = 1_600_000_000_000_000


def free_port(kind):
    """A port of the loopback that nothing uses; kind: socket.SOCK_STREAM or SOCK_DGRAM."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def shift_stamps(trajectory, shift_ns, out):
    """Writes a TUM trajectory with other stamps."""
    with out.open("w") as lines:
        for line in trajectory.read_text().splitlines():
            stamp, pose = line.split(" ", 1)
            seconds, nanoseconds = stamp.split(".")
            ns = int(seconds) * 10**9 + int(nanoseconds) + shift_ns
            lines.write(f"{ns // 10**9}.{ns % 10**9:09} {pose}\n")


def rows_of(path):
    """(stamp [ns], numbers by column) of each row; empty cells are left out."""
    with path.open() as lines:
        table = csv.reader(lines)
        names = [cell.strip("# ").split(" ")[0] for cell in next(table)]
        for cells in table:
            row = {n: float(c) for n, c in zip(names[1:], cells[1:]) if c}
            yield int(cells[0]), row


def checksum(data, extra):
    crc = 0xFFFF
    for byte in [*data, extra]:
        low = (byte ^ crc) & 0xFF
        low ^= (low << 4) & 0xFF
        crc = ((crc >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)) & 0xFFFF
    return crc


def mavlink_frame(message, sequence, payload):
    number, extra = message
    payload = payload.rstrip(b"\0") or b"\0"
    body = struct.pack("<BBBBBB", len(payload), 0, 0, sequence & 0xFF, 1, 1)
    body += number.to_bytes(3, "little") + payload
    return b"\xfd" + body + struct.pack("<H", checksum(body, extra))


def imu_payload(t_ns, row):
    values = [row[k] for k in ("a_x", "a_y", "a_z", "w_x", "w_y", "w_z")]
    return struct.pack("<Q13fHB", t_ns // 1000, *values, *([0.0] * 7), 0x3F, 0)


def pressure_payload(t_ns, row):
    return struct.pack("<Iffhh", t_ns // 1_000_000, row["pressure"] / 100, 0.0, 0, 0)


def dvl_clock_us(t_ns, skew_ppm, step_s, step_at_s):
    step_us = round(1e6 * step_s) if t_ns >= 1e9 * step_at_s else 0
    return DVL_EPOCH_US + round(t_ns * (1 + 1e-6 * skew_ppm)) // 1000 + step_us


def dvl_report(us, row, delay_s):
    beams = [{"id": i, "velocity": row[f"beam{i}_v"], "distance": row.get(f"beam{i}_range", -1),
              "beam_valid": row.get(f"beam{i}_valid") == 1} for i in range(4) if f"beam{i}_v" in row]
    report = {"vx": row.get("v_x", 0.0), "vy": row.get("v_y", 0.0), "vz": row.get("v_z", 0.0),
              "fom": row.get("figure_of_merit", 10.0), "altitude": row.get("altitude", -1), "transducers": beams,
              "velocity_valid": row["valid"] == 1, "type": "velocity", "format": "json_v3.1",
              "time_of_validity": us, "time_of_transmission": us + round(1e6 * delay_s)}
    return (json.dumps(report) + "\r\n").encode()


def stream(root, kind, begin_ns, delay_ns):
    """(time to send [ns], kind, stamp [ns], row) of a sensor; times count from the beginning."""
    for stamp, row in rows_of(root / "mav0" / f"{kind}0" / "data.csv"):
        yield stamp - begin_ns + delay_ns, kind, stamp - begin_ns, row


def schedule(root, begin_ns, delay_s):
    """What `stream` gives, of all sensors in order."""
    delays = {"imu": 0, "pressure": 0, "dvl": round(1e9 * delay_s)}
    streams = [stream(root, kind, begin_ns, delay) for kind, delay in delays.items()]
    return heapq.merge(*streams, key=lambda event: event[0])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=pathlib.Path)
    parser.add_argument("--dvl-port", type=int, default=16171)
    parser.add_argument("--mavlink-port", type=int, default=14550)
    parser.add_argument("--dvl-delay", type=float, default=0.1)
    parser.add_argument("--dvl-skew-ppm", type=float, default=0.0)
    parser.add_argument("--dvl-step", type=float, default=0.0)
    parser.add_argument("--dvl-step-at", type=float, default=0.0)
    parser.add_argument("--duration", type=float, default=1e9)
    arguments = parser.parse_args()

    server = socket.create_server(("127.0.0.1", arguments.dvl_port))
    print(f"waiting for a client on port {server.getsockname()[1]}", flush=True)
    dvl, _ = server.accept()
    autopilot = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener = ("127.0.0.1", arguments.mavlink_port)  # not connected: nobody may listen yet

    begin_ns = min(next(rows_of(arguments.dataset / "mav0" / k / "data.csv"))[0]
                   for k in ("imu0", "pressure0", "dvl0"))
    start = time.monotonic()
    print(f"{begin_ns} {time.time_ns()}", flush=True)  # the first stamp, and when it is sent
    for sequence, (due_ns, kind, stamp, row) in enumerate(
            schedule(arguments.dataset, begin_ns, arguments.dvl_delay)):
        if due_ns > 1e9 * arguments.duration:
            break
        time.sleep(max(0.0, start + 1e-9 * due_ns - time.monotonic()))
        if kind == "dvl":
            us = dvl_clock_us(stamp, arguments.dvl_skew_ppm, arguments.dvl_step, arguments.dvl_step_at)
            dvl.sendall(dvl_report(us, row, arguments.dvl_delay))
        elif kind == "imu":
            autopilot.sendto(mavlink_frame(HIGHRES_IMU, sequence, imu_payload(stamp, row)), listener)
        else:
            autopilot.sendto(mavlink_frame(SCALED_PRESSURE2, sequence, pressure_payload(stamp, row)), listener)
    time.sleep(0.5)


if __name__ == "__main__":
    main()
