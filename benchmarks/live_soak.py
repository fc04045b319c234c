#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""`apvi live` for hours with a simulated vehicle on the loopback, whose DVL has a bad clock.

    live_soak.py [--apvi build/cpu/bin/apvi] [--minutes 60] [--skew-ppm 50] [--step 2] [-o FOLDER]

Simulates a dive without images, plays it at its own pace (tests/live/vehicle.py) and sets the clock
of the DVL by `--step` seconds in the middle. Prints the memory of `apvi live` over time, what it says
about clocks, lost samples and the error of its poses beside that of the same dive offline.
"""
import argparse
import json
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests/live"))

from vehicle import free_port, shift_stamps  # noqa: E402  pylint: disable=wrong-import-position

NO_MAP = ["--no-report", "--set", "mapping.enabled=false"]
SAMPLES = 12  # of the memory


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--apvi", type=pathlib.Path, default=ROOT / "build/cpu/bin/apvi")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--skew-ppm", type=float, default=50.0)
    parser.add_argument("--step", type=float, default=2.0)
    parser.add_argument("-o", "--output", type=pathlib.Path)
    return parser.parse_args()


def resident_mib(process):
    status = pathlib.Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


def simulate(arguments, dive):
    subprocess.run([arguments.apvi, "-q", "sim", ROOT / "configs/scenes/seabed_easy.yaml", "-o", dive,
                    "--no-images", "--set", f"duration_s={60 * arguments.minutes}"], check=True)


def play(arguments, dive, run):
    """Plays the dive; returns the stamp shift [ns], (minute, MiB) pairs and the log."""
    dvl, autopilot = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
    duration_s = 60 * arguments.minutes
    vehicle = subprocess.Popen(
        [sys.executable, ROOT / "tests/live/vehicle.py", dive, "--dvl-port", str(dvl), "--mavlink-port",
         str(autopilot), "--dvl-skew-ppm", str(arguments.skew_ppm), "--dvl-step", str(arguments.step),
         "--dvl-step-at", str(duration_s / 2)], stdout=subprocess.PIPE, text=True)
    vehicle.stdout.readline()  # it waits
    log = run.with_suffix(".log")
    with log.open("w", encoding="utf-8") as out:
        live = subprocess.Popen(
            [arguments.apvi, "live", f"waterlinked://127.0.0.1:{dvl}", f"mavlink://udp:{autopilot}", "--rig",
             dive / "rig.yaml", "-o", run, *NO_MAP], stdout=subprocess.DEVNULL, stderr=out)
    first_ns, sent_ns = map(int, vehicle.stdout.readline().split())
    memory, start = [], time.monotonic()
    while vehicle.poll() is None:
        elapsed = time.monotonic() - start
        if elapsed >= len(memory) * duration_s / SAMPLES:
            memory.append((elapsed / 60, resident_mib(live)))
        time.sleep(1.0)
    live.send_signal(signal.SIGINT)
    live.wait(timeout=600)
    return first_ns - sent_ns, memory, log.read_text(encoding="utf-8")


def ate(apvi, dive, trajectory):
    reference = dive / "mav0/state_groundtruth_estimate0/data.csv"
    figures = subprocess.run([apvi, "eval", "trajectory", "--reference", reference, "--estimate", trajectory,
                              "--json"], check=True, capture_output=True, text=True)
    return json.loads(figures.stdout)["trajectory"]["ate_rmse_m"]


def main():
    arguments = parse_arguments()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.output or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        dive = folder / "dive"
        simulate(arguments, dive)
        shift_ns, memory, log = play(arguments, dive, folder / "live")
        print("minute  memory [MiB]")
        for minute, mib in memory:
            print(f"{minute:6.1f}  {mib:8.1f}")
        print(*[line for line in log.splitlines() if line.startswith("warning")], sep="\n")
        metrics = json.loads((folder / "live/metrics.json").read_text(encoding="utf-8"))
        print(json.dumps({key: metrics["live"].get(key) for key in ("latency", "recording")}, indent=1))
        offline = folder / "offline"
        subprocess.run([arguments.apvi, "-q", "run", dive, "-o", offline, *NO_MAP], check=True,
                       stdout=subprocess.DEVNULL)
        poses = folder / "shifted.tum"
        shift_stamps(folder / "live/trajectory.tum", shift_ns, poses)
        print(f"ATE live {ate(arguments.apvi, dive, poses):.4f} m, "
              f"offline {ate(arguments.apvi, dive, offline / 'trajectory.tum'):.4f} m")


if __name__ == "__main__":
    main()
