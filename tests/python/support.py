# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of the Python package share. PYTHONPATH has the package, APVI_PROGRAM names the program."""
import atexit
import functools
import importlib.util
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

SKIPPED = 77
ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("APVI_PROGRAM", str(ROOT / "build/cpu/bin/apvi"))
OPTIONS = ["run.threads=1", "mapping.final_iterations=40"]
SMALL = ["duration_s=6", "rig.cam0.resolution=[320, 240]", "rig.cam0.intrinsics=[210, 210, 159.5, 119.5]"]


def program(*arguments):
    command = [PROGRAM, "-q", *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise AssertionError(f"apvi {arguments[0]}: {result.stderr.strip()}")
    return result.stdout


def settings(pairs):
    return [word for pair in pairs for word in ("--set", pair)]


@functools.cache
def scratch():
    """A folder of this process."""
    folder = pathlib.Path(tempfile.mkdtemp(prefix="apvi_python_"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@functools.cache
def dive():
    """A simulated dive of six seconds."""
    folder = scratch() / "dive"
    program("sim", ROOT / "configs/scenes/seabed_easy.yaml", "-o", folder, *settings(SMALL))
    return folder


def python(code, *arguments, timeout=300):
    """Runs code in another interpreter."""
    return subprocess.run([sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True,
                          timeout=timeout, check=False)


def main():
    if not importlib.util.find_spec("numpy"):
        print("skipped: numpy is not installed for", sys.executable)
        sys.exit(SKIPPED)
    result = unittest.main(module="__main__", exit=False).result
    if result.testsRun and len(result.skipped) == result.testsRun:
        print("skipped:", "; ".join(sorted({reason for _, reason in result.skipped})))
        sys.exit(SKIPPED)
    sys.exit(not result.wasSuccessful())
