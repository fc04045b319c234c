// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>
#include <optional>
#include <string>

#include "apvi/bridge/camera_conversion.hpp"
#include "apvi/splat/medium.hpp"

namespace apvi::bridge {

/// What a simulated recording knows of itself (its folder `truth`), as the map's pinhole sees it.
class SimulatedTruth {
 public:
  /// Nothing when the recording has none.
  static std::optional<SimulatedTruth> open(const std::filesystem::path& recording,
                                            const CameraModel& camera, double scale);

  /// Depth along the optical axis [H,W] float32 [m], 0 where nothing is; nothing without the file.
  std::optional<torch::Tensor> depth(const std::string& stamp) const;
  /// The picture as it would be without water [H,W,3] uint8.
  std::optional<torch::Tensor> clear(const std::string& stamp) const;
  std::optional<splat::Medium> medium() const;

 private:
  SimulatedTruth(std::filesystem::path folder, Undistorter undistort);
  std::filesystem::path folder_;
  Undistorter undistort_;
};

}  // namespace apvi::bridge
