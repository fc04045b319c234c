// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/system.hpp"

#include <algorithm>
#include <utility>

#include "apvi/core/error.hpp"

namespace apvi::pipeline {

Sensors find_sensors(const RunConfig& config, const Rig& rig, bool has_images) {
  Sensors sensors;
  sensors.dvl = config.sensors.includes("dvl") && rig.dvl.has_value();
  if (config.sensors.includes("camera") && has_images) {
    sensors.cameras = std::min<std::size_t>(rig.cameras.size(), config.vio.stereo ? 2 : 1);
  }
  if (sensors.dvl || sensors.cameras > 0) return sensors;
  fail_input(
      "{}: nothing to localize with: neither a DVL nor a camera is in the recording and in "
      "sensors.use",
      config.dataset.path);
}

System::System(const RunConfig& config, const Rig& rig, const Sensors& sensors, SystemSinks sinks)
    : config_(config), rig_(rig), sensors_(sensors), sinks_(std::move(sinks)) {
  make_stages();
}

void System::make_stages() {
  visual_.reset();  // its threads first
  navigator_.emplace(config_.dipo, rig_, sensors_.dvl, sensors_.cameras);
  if (sensors_.cameras == 0) return;
  const auto tell = [this](const FrameOutput& output) {
    if (sinks_.frame) sinks_.frame(output);
    const auto pose = output.fused();
    if (pose && sinks_.pose) sinks_.pose(*pose);
  };
  visual_.emplace(config_, rig_, sensors_.cameras, tell, sinks_.map);
}

void System::process(const SensorEvent& event) {
  watch_.see(event);
  Navigator::Output output = navigator_->process(event);
  for (const LocalizationOutput& ping : output.pings) {
    if (sinks_.ping) sinks_.ping(ping);
    const imu::NavState& nav = ping.estimate.state.nav;
    if (!visual_ && sinks_.pose) {
      sinks_.pose({ping.estimate.stamp, nav.pose()});
    }
  }
  for (FrameJob& job : output.frames) visual_->push(std::move(job));
}

void System::finish() {
  if (visual_) visual_->finish();
}

void System::stop() {
  if (visual_) visual_->stop();
}

void System::reset() {
  stop();
  watch_ = {};
  make_stages();
}

}  // namespace apvi::pipeline
