// SPDX-License-Identifier: BSD-3-Clause
#include "localization/pipeline.hpp"

#include <algorithm>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>

#include "apvi/core/error.hpp"
#include "localization/map_sink.hpp"
#include "localization/sensor_monitor.hpp"
#include "localization/synchronizer.hpp"
#include "localization/visual_pipeline.hpp"

namespace apvi::localization {
namespace {

dipo::Config dipo_config(const Options& options) {
  dipo::Config out = options.dipo;
  out.gravity = options.gravity;
  return out;
}

// OpenCV's exceptions do not leave the library.
template <typename Work>
void translate_errors(const Work& work) {
  try {
    work();
  } catch (const cv::Exception& error) {
    fail_run("OpenCV: {}", error.what());
  }
}

}  // namespace

ActiveSensors select_sensors(const Options& options, const Rig& rig,
                             const RecordedSensors& recorded) {
  ActiveSensors sensors;
  sensors.imu = options.sensors.includes("imu") && recorded.imu;
  sensors.dvl = sensors.imu && options.sensors.includes("dvl") && rig.dvl.has_value();
  if (options.sensors.includes("camera") && recorded.images) {
    sensors.cameras = std::min<std::size_t>(rig.cameras.size(), options.vio.stereo ? 2 : 1);
  }
  sensors.dvl_scale = !sensors.imu && options.sensors.includes("dvl") && rig.dvl.has_value();
  sensors.pressure_scale = !sensors.dvl && options.sensors.includes("pressure") &&
                           (rig.pressure.has_value() || rig.depth.has_value());
  if (sensors.dvl || sensors.cameras > 0) return sensors;
  fail_input(
      "no odometry possible: needs a camera, or a DVL and an IMU, both in the recording and in "
      "sensors.use");
}

struct Pipeline::Stages {
  SensorMonitor sensor_monitor;
  std::optional<Synchronizer> synchronizer;
  std::optional<VisualPipeline> visual;  // last: its threads end before what they use

  explicit Stages(Pipeline& pipeline) {
    const std::size_t cameras = pipeline.sensors_.cameras;
    synchronizer.emplace(dipo_config(pipeline.options_), pipeline.rig_, pipeline.sensors_);
    if (cameras == 0) return;
    const auto forward = [&pipeline](const FrameOutput& output) {
      if (pipeline.callbacks_.frame) pipeline.callbacks_.frame(output);
      if (output.scale_found && pipeline.callbacks_.scale_found) {
        pipeline.callbacks_.scale_found(*output.scale_found);
      }
      if (!pipeline.callbacks_.pose) return;
      for (const StampedPose& earlier : output.vio.earlier) pipeline.callbacks_.pose(earlier);
      if (const auto pose = output.fused()) pipeline.callbacks_.pose(*pose);
    };
    visual.emplace(pipeline.options_, pipeline.rig_, pipeline.sensors_, forward,
                   pipeline.callbacks_.map, pipeline.callbacks_.map_to_odometry);
  }
};

Pipeline::Pipeline(const Options& options, const Rig& rig, const ActiveSensors& sensors,
                   PipelineCallbacks callbacks)
    : options_(options), rig_(rig), sensors_(sensors), callbacks_(std::move(callbacks)) {
  options_.check();
  translate_errors([this] { stages_ = std::make_unique<Stages>(*this); });
}

Pipeline::~Pipeline() = default;

void Pipeline::process(const SensorEvent& event) {
  translate_errors([&] {
    stages_->sensor_monitor.process(event);
    Synchronizer::Output output = stages_->synchronizer->process(event);
    for (const PingOutput& ping : output.pings) {
      if (callbacks_.ping) callbacks_.ping(ping);
      const imu::NavState& nav = ping.estimate.state.nav;
      if (!stages_->visual && callbacks_.pose) callbacks_.pose({ping.estimate.stamp, nav.pose()});
    }
    for (FrameJob& job : output.frames) stages_->visual->push(std::move(job));
  });
}

void Pipeline::finish() {
  translate_errors([&] {
    if (stages_->visual) stages_->visual->finish();
  });
}

void Pipeline::adjust(const std::function<void(int iteration)>& progress) {
  translate_errors([&] {
    if (stages_->visual) stages_->visual->adjust(progress);
  });
}

void Pipeline::stop() {
  if (stages_->visual) stages_->visual->stop();
}

void Pipeline::reset() {
  stop();
  stages_.reset();  // its threads first
  translate_errors([this] { stages_ = std::make_unique<Stages>(*this); });
}

const SensorMonitor& Pipeline::sensor_monitor() const {
  return stages_->sensor_monitor;
}

const Synchronizer& Pipeline::synchronizer() const {
  return *stages_->synchronizer;
}

const VisualPipeline* Pipeline::visual() const {
  return stages_->visual ? &*stages_->visual : nullptr;
}

}  // namespace apvi::localization
