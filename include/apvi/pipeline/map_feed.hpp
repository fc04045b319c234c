// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/pipeline/frame_job.hpp"
#include "apvi/pipeline/localizer.hpp"
#include "apvi/pipeline/map_sink.hpp"
#include "apvi/pipeline/run_config.hpp"
#include "apvi/vio/window.hpp"

namespace apvi::pipeline {

/// Decides what of the frames the map gets to see: keyframes while vision is stable, every
/// `eval.heldout_every`-th image for evaluation, and what became of the keyframes in the window.
class MapFeed {
 public:
  MapFeed(const RunConfig& config, const Rig& rig);

  /// A frame that all stages are through with, and the picture of camera 0 (empty: not looked at).
  /// Nothing when the map need not know.
  std::optional<MapFrame> process(const FrameJob& job, const cv::Mat& image,
                                  const FrameOutput& output, const vio::Window& window);

 private:
  std::vector<MapPoint> points(const vio::Window& window) const;
  void note_ranges(const FrameJob& job, const imu::NavState& state);

  std::size_t heldout_every_;
  double ray_sigma_;  // [rad]
  int min_sightings_;
  std::size_t images_ = 0;
  std::vector<Eigen::Vector3d> ranged_;  // since the last frame that went out
  bool was_stable_ = false;
  bool failing_ = false;
};

}  // namespace apvi::pipeline
