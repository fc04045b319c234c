#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Images per second of the viewer for one page whose view moves all the time.

    viewer_rates.py [--apvi build/cpu/bin/apvi] [--gaussians 100000] [--size 640 480] [--seconds 15]
    viewer_rates.py --dive FOLDER [--set KEY=VALUE]...

The first form shows a made map, a seabed seen from the vehicle's height and from far above. The second
one runs a dive in real time twice, with and without a page that watches, and compares the steps of
the mapper. Sizes are of the images that came, in per cent of the pixels that were asked for.
"""
import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests/viewer"))

import page_client  # noqa: E402  pylint: disable=wrong-import-position
import tiny_run  # noqa: E402  pylint: disable=wrong-import-position

TURN_S = 20.0  # once around the map


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--apvi", type=pathlib.Path, default=ROOT / "build/cpu/bin/apvi")
    parser.add_argument("--gaussians", type=int, default=100_000)
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480))
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--dive", type=pathlib.Path)
    parser.add_argument("--set", action="append", default=[], dest="settings")
    return parser.parse_args()


class Visitor:
    """A page that moves on a circle and asks for the next view whenever an image has come."""

    def __init__(self, port, size, height_m):
        self.page = page_client.Page(port)
        self.size, self.height_m = size, height_m
        self.times, self.pixels, self.bytes = [], [], []
        self.views = 0
        self.start = time.monotonic()

    def look(self):
        angle = 2 * math.pi * (time.monotonic() - self.start) / TURN_S
        self.views += 1
        self.page.look(self.views, (1.5 * math.cos(angle), 1.5 * math.sin(angle), self.height_m), moving=True,
                       width=self.size[0], height=self.size[1])

    def watch(self, is_over):
        self.look()
        while not is_over():
            header, data = self.page.image()
            if header[0] == 1:
                self.times.append(time.monotonic())
                self.pixels.append(header[5] * header[6])
                self.bytes.append(len(data))
            self.look()

    def summary(self):
        if len(self.times) < 3:
            return f"{len(self.times)} images"
        rate = (len(self.times) - 1) / (self.times[-1] - self.times[0])
        share = 100 * sum(self.pixels) / len(self.pixels) / (self.size[0] * self.size[1])
        return f"{rate:5.1f} images/s of {share:3.0f} % and {sum(self.bytes) / len(self.bytes) / 1024:.0f} KiB"


def rate_of_view(arguments, folder):
    run = tiny_run.make(folder / "run", arguments.gaussians)
    for height_m in (0.0, 20.0, 100.0):
        server = page_client.Server(arguments.apvi, "view", run, "--port", "0")
        visitor = Visitor(server.port, arguments.size, height_m)
        end = time.monotonic() + arguments.seconds
        visitor.watch(lambda end=end: time.monotonic() > end)
        visitor.page.close()
        server.stop()
        print(f"{arguments.gaussians} Gaussians from {3 + height_m:.0f} m: {visitor.summary()}")


def command(arguments, run):
    settings = ["run.mode=realtime", *arguments.settings]
    return [arguments.apvi, "run", arguments.dive, "-o", run, "--no-report",
            *(part for setting in settings for part in ("--set", setting))]


def steps_of(run):
    return json.loads((run / "metrics.json").read_text(encoding="utf-8"))["mapping"]["iterations"]


def watch_run(arguments, run):
    server = page_client.Server(*command(arguments, run), "--view=0")
    visitor = Visitor(server.port, arguments.size, 0.0)
    rest = threading.Thread(target=server.process.communicate)
    rest.start()
    try:
        visitor.watch(lambda: server.process.poll() is not None)
    except OSError:  # the run has ended
        pass
    rest.join()
    return visitor


def rate_in_run(arguments, folder):
    subprocess.run(command(arguments, folder / "alone"), check=True, stderr=subprocess.DEVNULL)
    visitor = watch_run(arguments, folder / "watched")
    alone, watched = steps_of(folder / "alone"), steps_of(folder / "watched")
    print(f"{visitor.summary()}; steps of the mapper: {alone} alone, {watched} watched "
          f"({100 * (watched / alone - 1):+.0f} %)")


def main():
    arguments = parse_arguments()
    with tempfile.TemporaryDirectory() as folder:
        (rate_in_run if arguments.dive else rate_of_view)(arguments, pathlib.Path(folder))


if __name__ == "__main__":
    main()
