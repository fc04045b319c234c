// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/slam/system.hpp"

#include <utility>

#include "apvi/core/error.hpp"
#include "localization/pipeline.hpp"
#include "localization/pose_record.hpp"
#include "slam/async_mapper.hpp"
#include "slam/map_access.hpp"
#include "slam/mapper_options.hpp"

namespace apvi::slam {

struct System::Implementation {
  Implementation(const Options& options, const Rig& rig, SystemCallbacks callbacks)
      : record_(std::move(callbacks.pose), std::move(callbacks.scale_found)) {
    const bool camera = options.localization.sensors.includes("camera") && !rig.cameras.empty();
    if (options.mapping.enabled == MapSwitch::on && !camera) {
      fail_input("mapping.enabled: true: the rig has no camera");
    }
    if (options.mapping.enabled != MapSwitch::off && camera) {
      mapper_.emplace(async_mapper_options(options, rig), rig, AsyncMapperCallbacks{});
    }
    localization::PipelineCallbacks out;
    out.pose = [this](const StampedPose& pose) { record_.add(pose); };
    out.scale_found = [this](const localization::ScaleFound& found) {
      record_.change_scale(found);
    };
    out.map_to_odometry = [this](const SE3& T_map_odom) {
      record_.set_map_to_odometry(T_map_odom);
    };
    out.map = mapper_ ? &*mapper_ : nullptr;
    const localization::ActiveSensors sensors =
        localization::select_sensors(options.localization, rig, {.images = !rig.cameras.empty()});
    localization_.emplace(options.localization, rig, sensors, std::move(out));
  }

  localization::PoseRecord record_;
  std::optional<AsyncMapper> mapper_;
  std::optional<localization::Pipeline> localization_;  // last: its threads end before the mapper
};

System::System(const Options& options, const Rig& rig, SystemCallbacks callbacks) {
  options.check();
  translate_errors([&] {
    implementation_ = std::make_unique<Implementation>(options, rig, std::move(callbacks));
  });
}

System::~System() = default;

void System::process(const SensorEvent& event) {
  implementation_->localization_->process(event);
}

void System::finish() {
  implementation_->localization_->finish();
  implementation_->localization_->adjust();
  if (implementation_->mapper_) implementation_->mapper_->finish();
}

void System::refine() {
  auto& mapper = implementation_->mapper_;
  if (!mapper || mapper->failed() || mapper->gaussian_count() == 0) return;
  translate_errors([&] { mapper->refine(); });
}

void System::stop() {
  implementation_->localization_->stop();
  if (implementation_->mapper_) implementation_->mapper_->stop();
}

Trajectory System::trajectory() const {
  return implementation_->record_.trajectory();
}

std::optional<StampedPose> System::pose() const {
  return implementation_->record_.newest();
}

SE3 System::T_map_odom() const {
  return implementation_->record_.T_map_odom();
}

Status System::status() const {
  Status status;
  status.poses = implementation_->record_.size();
  if (const auto& mapper = implementation_->mapper_) {
    status.keyframes = static_cast<std::size_t>(mapper->keyframe_count());
    status.gaussians = static_cast<std::size_t>(mapper->gaussian_count());
  }
  if (implementation_->mapper_) status.mapping_error = error_of(*implementation_->mapper_);
  return status;
}

std::optional<MapSnapshot> System::map() const {
  const auto& mapper = implementation_->mapper_;
  return mapper ? snapshot_of(*mapper) : std::nullopt;
}

std::optional<RenderedImages> System::render(const RenderView& view) const {
  const auto& mapper = implementation_->mapper_;
  return mapper ? render_of(*mapper, view) : std::nullopt;
}

}  // namespace apvi::slam
