// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/localization/system.hpp"

#include <utility>

#include "localization/pipeline.hpp"
#include "localization/pose_record.hpp"

namespace apvi::localization {

void apply(const ScaleFound& found, Trajectory& poses) {
  for (StampedPose& pose : poses.poses) {
    if (pose.stamp >= found.since)
      pose.T_world_body = changed(found.to_meters, pose.T_world_body, found.p_body_camera);
  }
}

struct System::Implementation {
  Implementation(const Options& options, const Rig& rig, SystemCallbacks callbacks)
      : record(std::move(callbacks.pose), std::move(callbacks.scale_found)),
        pipeline(options, rig, select_sensors(options, rig, {.images = !rig.cameras.empty()}),
                 {.pose = [this](const StampedPose& pose) { record.add(pose); },
                  .scale_found = [this](const ScaleFound& found) { record.change_scale(found); },
                  .map_to_odometry =
                      [this](const SE3& T_map_odom) { record.set_map_to_odometry(T_map_odom); }}) {}

  PoseRecord record;
  Pipeline pipeline;  // last: its threads end before what they use
};

System::System(const Options& options, const Rig& rig, SystemCallbacks callbacks)
    : implementation_(std::make_unique<Implementation>(options, rig, std::move(callbacks))) {}

System::~System() = default;

void System::process(const SensorEvent& event) {
  implementation_->pipeline.process(event);
}

void System::finish() {
  implementation_->pipeline.finish();
  implementation_->pipeline.adjust();
}

void System::stop() {
  implementation_->pipeline.stop();
}

void System::reset() {
  implementation_->pipeline.reset();
  implementation_->record.clear();
}

Trajectory System::trajectory() const {
  return implementation_->record.trajectory();
}

std::optional<StampedPose> System::pose() const {
  return implementation_->record.newest();
}

SE3 System::T_map_odom() const {
  return implementation_->record.T_map_odom();
}

}  // namespace apvi::localization
