# SPDX-License-Identifier: BSD-3-Clause
"""Feeds samples of your own sensors: a calibration written in code, and an IMU, a DVL and a pressure sensor that are
simulated here by a vehicle moving ahead at 0.5 m/s in the mean, 5 m deep. A thread acts as the drivers.

    03_own_sensors.py
"""
import math
import threading

import numpy as np

import apvi

GRAVITY = 9.80665
SPEED, SURGE = 0.5, 0.05  # mean, and amplitude at 1 rad/s [m/s]
PERIOD_NS = 5_000_000  # of the IMU, 200 Hz
SAMPLES_PER_PING = 25
DURATION_S = 20.0
RIG = {"imu0": {"rate_hz": 200}, "dvl0": {"T_body_sensor": np.eye(4).ravel()}, "pressure0": {}}


def drive(live: apvi.LiveSequence) -> None:
    for k in range(int(DURATION_S * 1e9) // PERIOD_NS):
        stamp = k * PERIOD_NS
        t = 1e-9 * stamp
        live.push(apvi.ImuSample(stamp, [0, 0, 0], [SURGE * math.cos(t), 0, GRAVITY]))
        if k % SAMPLES_PER_PING == 0:
            live.push(apvi.DvlSample(stamp, [SPEED + SURGE * math.sin(t), 0, 0]))
            live.push(apvi.PressureSample(stamp, 101325 + 1025 * GRAVITY * 5.0))
    live.finish()


def main() -> None:
    rig = apvi.Rig(RIG)
    live = apvi.LiveSequence(rig)
    driver = threading.Thread(target=drive, args=(live,))
    driver.start()
    system = apvi.System(apvi.Options(), rig)
    for sample in live:
        system.process(sample)
    system.finish()
    driver.join()
    x, y, z = system.trajectory().positions[-1]
    print(f"{x:.2f} m ahead, {y:.2f} m aside, {z:.2f} m up")


if __name__ == "__main__":
    main()
