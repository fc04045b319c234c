# SPDX-License-Identifier: BSD-3-Clause
"""Localizes a recording, builds its map and compares the trajectory with the reference, if there is one.

    01_localize_and_map.py DIVE OUTPUT
"""
import pathlib
import sys

import apvi


def main() -> None:
    dive, output = map(pathlib.Path, sys.argv[1:3])
    output.mkdir(parents=True, exist_ok=True)

    options = apvi.Options(set=["mapping.final_iterations=100"])
    recording = apvi.Recording(dive, options)
    system = apvi.System(options, recording.rig)
    for sample in recording:
        system.process(sample)
    system.finish()
    system.refine()

    trajectory, snapshot = system.trajectory(), system.map()
    trajectory.write_tum(output / "trajectory.tum")
    print(f"{len(trajectory)} poses, {trajectory.path_length_m:.2f} m")
    if snapshot is not None:
        snapshot.save(output / "map.ply")
        print(f"{len(snapshot)} Gaussians, {len(snapshot.keyframes)} keyframes")
    reference = recording.reference()
    if reference is not None:
        metrics = apvi.evaluate(reference, trajectory, world=recording.rig.world)
        print(f"ATE {metrics['ate_rmse_m']:.3f} m")


if __name__ == "__main__":
    main()
