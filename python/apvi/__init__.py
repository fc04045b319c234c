# SPDX-License-Identifier: BSD-3-Clause
"""Localization and mapping under water: see docs/python.md.

    options = apvi.Options(set=["run.threads=2"])
    recording = apvi.Recording("dive", options)
    system = apvi.System(options, recording.rig)
    for sample in recording:
        system.process(sample)
    system.finish()
"""
from . import _libtorch, _numpy

_numpy.prepare()
_libtorch.prepare()

from ._apvi import (  # noqa: E402
    Camera,
    CameraCalibration,
    DvlBeam,
    DvlSample,
    Error,
    Finding,
    GnssSample,
    ImageFrame,
    ImuSample,
    InputError,
    LiveSequence,
    Mapper,
    MapSnapshot,
    Medium,
    Options,
    PressureDepthSample,
    PressureSample,
    Recording,
    RenderedImages,
    Report,
    Rig,
    RosDecoder,
    RunError,
    Status,
    System,
    Trajectory,
    __version__,
    backend,
    evaluate,
    examine,
    git_revision,
    set_log_level,
)

__all__ = [
    "Camera",
    "CameraCalibration",
    "DvlBeam",
    "DvlSample",
    "Error",
    "Finding",
    "GnssSample",
    "ImageFrame",
    "ImuSample",
    "InputError",
    "LiveSequence",
    "MapSnapshot",
    "Mapper",
    "Medium",
    "Options",
    "PressureDepthSample",
    "PressureSample",
    "Recording",
    "RenderedImages",
    "Report",
    "Rig",
    "RosDecoder",
    "RunError",
    "Status",
    "System",
    "Trajectory",
    "__version__",
    "backend",
    "evaluate",
    "examine",
    "git_revision",
    "set_log_level",
]
