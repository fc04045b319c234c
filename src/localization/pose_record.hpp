// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <mutex>
#include <optional>

#include "apvi/localization/system.hpp"

namespace apvi::localization {

/// The trajectory so far, which the threads of a pipeline write and any thread reads. Passes
/// everything on to the callbacks of the library's user.
class PoseRecord {
 public:
  PoseRecord(std::function<void(const StampedPose&)> pose,
             std::function<void(const ScaleFound&)> scale_found);

  void add(const StampedPose& pose);
  void change_scale(const ScaleFound& found);
  void set_map_to_odometry(const SE3& T_map_odom);
  void clear();

  Trajectory trajectory() const;
  std::size_t size() const;
  std::optional<StampedPose> newest() const;
  SE3 T_map_odom() const;

 private:
  std::function<void(const StampedPose&)> pose_;
  std::function<void(const ScaleFound&)> scale_found_;
  mutable std::mutex mutex_;
  Trajectory trajectory_;  // guarded by mutex_
  SE3 T_map_odom_;         // guarded by mutex_
};

}  // namespace apvi::localization
