#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""`apvi import` reads the same numbers from an autopilot's logs as pymavlink: vehicle_log_interop_test.py APVI.

    python3 -m venv build/venv && build/venv/bin/pip install -r tests/interop/requirements.txt

Skipped if pymavlink is not installed."""
import csv
import importlib.util
import math
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest

SKIPPED = 77
ROOT = pathlib.Path(__file__).resolve().parents[2]
APVI = sys.argv.pop(1) if len(sys.argv) > 1 else str(ROOT / "build/cpu/bin/apvi")
START_US = 1_700_000_000_000_000
GRAVITY = 9.80665
os.environ["MAVLINK20"] = "1"


def imported(log, folder):
    """The csv files of the data set made of a log: rows of numbers without the header, by sensor."""
    result = subprocess.run([APVI, "import", log, "-o", folder], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise AssertionError(result.stderr)
    tables = {}
    for path in (folder / "mav0").glob("*/data.csv"):
        rows = list(csv.reader(path.read_text().splitlines()))[1:]
        tables[path.parent.name] = [[int(row[0]), *(float(cell or "nan") for cell in row[1:])] for row in rows]
    return tables


class Logs(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)

    def assert_rows(self, rows, expected, delta):
        self.assertEqual(len(rows), len(expected))
        for row, values in zip(rows, expected):
            for ours, theirs in zip(row, values):
                self.assertAlmostEqual(ours, theirs, delta=delta)


class Telemetry(Logs):
    """Messages are packed and read back by pymavlink; all have the same delay, so stamps are exact."""

    def write(self, version):
        from pymavlink.dialects.v10 import ardupilotmega as first
        from pymavlink.dialects.v20 import ardupilotmega as second
        dialect = first if version == 1 else second
        vehicle = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        computer = dialect.MAVLink(None, srcSystem=255, srcComponent=0)
        log = bytearray()
        for i in range(100):
            us = 50_000_000 + 20_000 * i
            messages = [
                vehicle.raw_imu_encode(us, i, -2 * i, -1000, 10 - i, -20, 30, 1, 2, 3),
                vehicle.scaled_pressure_encode(us // 1000, 1000.0, 0.0, 3000),
                vehicle.scaled_pressure2_encode(us // 1000, 1100.0 + 0.125 * i, 0.0, 1500),
                vehicle.attitude_encode(us // 1000, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)]
            packed = [m.pack(vehicle) for m in messages]
            if version == 2:
                motion = [0.01 * i, -0.02, 0.005]
                delta = computer.vision_position_delta_encode(0, 200_000, [0.0, 0.0, 0.0], motion, 80.0)
                packed.append(delta.pack(computer))
            for message in packed:
                log += struct.pack(">Q", START_US + us) + message
        path = self.folder / f"v{version}.tlog"
        path.write_bytes(log)
        return path

    @staticmethod
    def read(path):
        """Messages by type, each with the time of its arrival [us]."""
        from pymavlink import mavutil
        log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
        messages = {}
        while (message := log.recv_match()) is not None:
            messages.setdefault(message.get_type(), []).append((round(message._timestamp * 1e6), message))
        return messages

    def test_samples_are_those_of_pymavlink(self):
        for version in (1, 2):
            path = self.write(version)
            tables = imported(path, self.folder / f"dive{version}")
            messages = self.read(path)
            self.assert_rows(tables["imu0"], [
                [1000 * us, 1e-3 * m.xgyro, 1e-3 * m.ygyro, 1e-3 * m.zgyro, 1e-3 * GRAVITY * m.xacc,
                 1e-3 * GRAVITY * m.yacc, 1e-3 * GRAVITY * m.zacc] for us, m in messages["RAW_IMU"]], 1e-9)
            self.assert_rows(tables["pressure0"],
                             [[1000 * us, 100.0 * m.press_abs] for us, m in messages["SCALED_PRESSURE2"]], 1e-9)
            if version == 2:
                self.assert_rows(tables["dvl0"], [
                    [1000 * us, *(1e6 * d / m.time_delta_usec for d in m.position_delta)]
                    for us, m in messages["VISION_POSITION_DELTA"]], 1e-9)


class Dataflash(Logs):
    """A log as ArduPilot writes it, which pymavlink reads."""

    FORMATS = [
        (129, "IMU", "QBffffffIIfBBHH", "<QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
        (130, "BARO", "QBfffcfff", "<QBfffhfff", "TimeUS,I,Alt,AltAMSL,Press,Temp,CRt,SMS,Offset"),
        (131, "VISO", "Qffffffff", "<Qffffffff", "TimeUS,dt,AngDX,AngDY,AngDZ,PosDX,PosDY,PosDZ,conf"),
        (132, "GPS", "QBBIHBcLLeff", "<QBBIHBhiiiff", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs")]

    def write(self):
        def message(kind, layout, *values):
            return b"\xa3\x95" + bytes([kind]) + struct.pack(layout, *values)

        layouts = {name: (kind, layout) for kind, name, _, layout, _ in self.FORMATS}
        log = message(128, "<BB4s16s64s", 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
        for kind, name, letters, layout, columns in self.FORMATS:
            size = 3 + struct.calcsize(layout)
            log += message(128, "<BB4s16s64s", kind, size, name.encode(), letters.encode(), columns.encode())
        for i in range(100):
            us = 30_000_000 + 20_000 * i
            log += message(*layouts["IMU"], us, 0, 0.01 * i, -0.2, 0.3, 0.1, 0.02 * i, -9.8, 0, 0, 30.0, 1, 1, 0, 0)
            log += message(*layouts["BARO"], us, 0, 0.0, 0.0, 101_000.0, 3000, 0.0, 0, 0.0)
            log += message(*layouts["BARO"], us, 1, 0.0, 0.0, 120_000.0 + i, 1500, 0.0, 0, 0.0)
            log += message(*layouts["VISO"], us, 0.2, 0.0, 0.0, 0.0, 0.01 * i, -0.02, 0.005, 80.0)
            if i % 10 == 0:
                log += message(*layouts["GPS"], us, 0, 3, 345_600_000 + 20 * i, 2312, 9, 120, 473_977_418 + i,
                               85_455_939, 48_812, 0.0, 0.0)
        path = self.folder / "00000001.BIN"
        path.write_bytes(log)
        return path

    @staticmethod
    def read(path):
        from pymavlink import DFReader
        log = DFReader.DFReader_binary(str(path))
        messages = {}
        while (message := log.recv_msg()) is not None:
            messages.setdefault(message.get_type(), []).append(message)
        return messages

    def test_samples_are_those_of_pymavlink(self):
        path = self.write()
        tables = imported(path, self.folder / "dive")
        messages = self.read(path)
        imu = [[m.GyrX, m.GyrY, m.GyrZ, m.AccX, m.AccY, m.AccZ] for m in messages["IMU"]]
        self.assert_rows([row[1:] for row in tables["imu0"]], imu, 1e-9)
        pressure = [[m.Press] for m in messages["BARO"] if m.I == 1]
        self.assert_rows([row[1:] for row in tables["pressure0"]], pressure, 1e-9)
        dvl = [[m.PosDX / m.dt, m.PosDY / m.dt, m.PosDZ / m.dt] for m in messages["VISO"]]
        self.assert_rows([row[1:4] for row in tables["dvl0"]], dvl, 1e-6)
        gnss = [[m.Lat, m.Lng, m.Alt] for m in messages["GPS"]]
        self.assert_rows([row[1:] for row in tables["gnss0"]], gnss, 1e-6)

    def test_dates_are_those_of_pymavlink(self):
        path = self.write()
        tables = imported(path, self.folder / "dive")
        for row, message in zip(tables["imu0"], self.read(path)["IMU"]):
            self.assertTrue(math.isclose(1e-9 * row[0], message._timestamp, abs_tol=1e-3))


if __name__ == "__main__":
    if not importlib.util.find_spec("pymavlink"):
        print("skipped: pymavlink is not installed: " + __doc__.split("\n\n")[1].strip())
        sys.exit(SKIPPED)
    unittest.main(verbosity=2)
