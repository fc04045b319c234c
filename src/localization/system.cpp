// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/localization/system.hpp"

#include <mutex>
#include <utility>

#include "localization/pipeline.hpp"

namespace apvi::localization {

void apply(const ScaleFound& found, Trajectory& poses) {
  for (StampedPose& pose : poses.poses) {
    if (pose.stamp >= found.since)
      pose.T_world_body = changed(found.to_meters, pose.T_world_body, found.p_body_camera);
  }
}

struct System::Implementation {
  Implementation(const Options& options, const Rig& rig, SystemCallbacks receivers)
      : callbacks(std::move(receivers)),
        pipeline(options, rig, select_sensors(options, rig, {.images = !rig.cameras.empty()}),
                 {.pose = [this](const StampedPose& pose) { take(pose); },
                  .scale_found = [this](const ScaleFound& found) { take(found); }}) {}

  void take(const StampedPose& pose) {
    {
      const std::scoped_lock lock(mutex);
      trajectory.merge({pose});
    }
    if (callbacks.pose) callbacks.pose(pose);
  }
  void take(const ScaleFound& found) {
    {
      const std::scoped_lock lock(mutex);
      apply(found, trajectory);
    }
    if (callbacks.scale_found) callbacks.scale_found(found);
  }

  SystemCallbacks callbacks;
  mutable std::mutex mutex;
  Trajectory trajectory;  // guarded by mutex
  Pipeline pipeline;      // last: its threads end before what they use
};

System::System(const Options& options, const Rig& rig, SystemCallbacks callbacks)
    : implementation_(std::make_unique<Implementation>(options, rig, std::move(callbacks))) {}

System::~System() = default;

void System::process(const SensorEvent& event) {
  implementation_->pipeline.process(event);
}

void System::finish() {
  implementation_->pipeline.finish();
}

void System::stop() {
  implementation_->pipeline.stop();
}

void System::reset() {
  implementation_->pipeline.reset();
  const std::scoped_lock lock(implementation_->mutex);
  implementation_->trajectory = {};
}

Trajectory System::trajectory() const {
  const std::scoped_lock lock(implementation_->mutex);
  return implementation_->trajectory;
}

std::optional<StampedPose> System::pose() const {
  const std::scoped_lock lock(implementation_->mutex);
  const Trajectory& trajectory = implementation_->trajectory;
  return trajectory.empty() ? std::nullopt : std::optional(trajectory.poses.back());
}

}  // namespace apvi::localization
