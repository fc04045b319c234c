// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>
#include <optional>
#include <string>

#include "medium/medium.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::runs {

/// An image from beside the path.
struct OffPathView {
  torch::Tensor image;          ///< [H,W,3] uint8, with the medium, in the camera's exposure
  torch::Tensor T_camera_view;  ///< [4,4] float64, from the camera at that stamp
};

/// Ground truth of a simulated recording (its folder `truth`), undistorted to the map's camera.
class SimulatedTruth {
 public:
  /// Empty when the recording has none.
  static std::optional<SimulatedTruth> open(const std::filesystem::path& recording,
                                            const CameraModel& camera, double scale);

  /// Depth along the optical axis [H,W] float32 [m], 0 where there is no surface; empty without the
  /// file.
  std::optional<torch::Tensor> depth(const std::string& stamp) const;
  /// The image without water [H,W,3] uint8, in the exposure and white balance of the camera image,
  /// or else in one exposure for the recording (`has_own_exposure`).
  std::optional<torch::Tensor> clear(const std::string& stamp) const;
  /// Where something moves [H,W] uint8: 255 a body, 128 its shadow or a pixel that is interpolated
  /// from some that show either, 0 nothing.
  std::optional<torch::Tensor> moving(const std::string& stamp) const;
  std::optional<OffPathView> off_path(const std::string& stamp) const;
  std::optional<medium::Medium> medium() const;
  bool has_own_exposure() const;

 private:
  SimulatedTruth(std::filesystem::path folder, slam::Undistorter undistort);
  std::filesystem::path folder_;
  slam::Undistorter undistort_;
};

}  // namespace apvi::runs
