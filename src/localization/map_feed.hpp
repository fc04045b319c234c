// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/localization/options.hpp"
#include "localization/frame_job.hpp"
#include "localization/fusion_stage.hpp"
#include "localization/map_sink.hpp"
#include "vio/window/window.hpp"

namespace apvi::localization {

/// Whether VIO tracks and the failure detection accepts it.
bool is_stable(const FrameOutput& output);

/// Selects what is passed to the map: keyframes while vision is stable, every
/// `eval.heldout_every`-th image for evaluation, and updated poses of the window's keyframes.
class MapFeed {
 public:
  MapFeed(const Options& options, const Rig& rig);

  /// `image` is of camera 0, empty when it was skipped. Returns nothing when the frame has no news
  /// for the map.
  std::optional<MapFrame> process(const FrameJob& job, const cv::Mat& image,
                                  const FrameOutput& output, const vio::Window& window);

 private:
  std::vector<MapPoint> points(const vio::Window& window) const;
  void add_range_points(const FrameJob& job, const imu::NavState& state);

  std::size_t heldout_every_;
  double ray_sigma_;  // [rad]
  int min_observations_;
  std::size_t images_ = 0;
  std::vector<Eigen::Vector3d> range_points_;  // since the last frame passed on
  bool was_stable_ = false;
  bool failing_ = false;
};

}  // namespace apvi::localization
