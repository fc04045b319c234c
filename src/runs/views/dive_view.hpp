// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "loop_closure/correction_log.hpp"
#include "runs/run_config.hpp"
#include "runs/sensor_spans.hpp"
#include "viewer/scene.hpp"

/// What the viewer shows of a dive besides map and path.
namespace apvi::runs {

std::vector<viewer::LoopLine> shown_loops(const std::vector<loop_closure::ClosedLoop>& loops);

/// Of camera, IMU, DVL and pressure. Gaps that are too short to be seen are closed, so that there
/// are at most some 2000 spans of a sensor.
std::vector<viewer::SensorTrack> shown_sensors(const std::vector<SensorSpan>& spans);

/// The beams of a DVL, without a ping.
viewer::Beams shown_beams(const DvlCalibration& dvl);
/// Lengths are the ranges; where none is reported, by the altitude, or else 1 m.
viewer::BeamPing shown_ping(const DvlSample& ping, const DvlCalibration& dvl);
/// The beams with all pings of the recording that a run names. Nothing when it is not there any
/// more, has no DVL, or `interrupted`.
std::optional<viewer::Beams> read_beams(const RunConfig& config,
                                        const std::function<bool()>& interrupted);

}  // namespace apvi::runs
