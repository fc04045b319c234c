# SPDX-License-Identifier: BSD-3-Clause
"""Renders the map of a run at a keyframe, with the water and restored, into PPM files.

    02_render_map.py RUN RIG OUTPUT
"""
import pathlib
import sys

import numpy as np
import numpy.typing as npt

import apvi


def write_ppm(path: pathlib.Path, image: npt.NDArray[np.float32]) -> None:
    """image: float RGB [h,w,3] in image values."""
    pixels = (255.0 * np.clip(image, 0.0, 1.0) + 0.5).astype(np.uint8)
    height, width = pixels.shape[:2]
    path.write_bytes(b"P6\n%d %d\n255\n" % (width, height) + pixels.tobytes())


def main() -> None:
    run, rig_file, output = map(pathlib.Path, sys.argv[1:4])
    output.mkdir(parents=True, exist_ok=True)
    snapshot = apvi.MapSnapshot.read(run)
    calibration = apvi.Rig(rig_file).cameras[0]
    middle = snapshot.keyframes.matrices[len(snapshot.keyframes) // 2]
    images = snapshot.render(calibration.camera.pinhole(), middle @ calibration.T_body_camera)
    write_ppm(output / "color.ppm", images.color)
    write_ppm(output / "restored.ppm", images.restored)
    seen = images.alpha > 0.5
    print(f"{seen.mean():.0%} of the image shows a surface, at {np.median(images.depth[seen]):.2f} m")
    if snapshot.medium is not None:
        print("attenuation [1/m]:", snapshot.medium.beta_d.round(3))


if __name__ == "__main__":
    main()
