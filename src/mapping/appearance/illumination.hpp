// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "gaussians/render/view.hpp"
#include "mapping/keyframes/keyframe_store.hpp"

namespace apvi::mapping {

/// Whether the training images are so close in time that the light on the scene hardly changes
/// between them.
bool resolves_moving_light(const KeyframeStore& keyframes);

/// Moving light, such as caustics on a shallow reef, as a smooth field of gains for each image:
/// logarithms on a coarse grid for each channel, interpolated bilinearly. Its mean over the
/// training images is zero, so it takes no color from the map. Gains of a held-out image are
/// interpolated in time, never taken from its own image.
///
/// The logarithms are those of image values, so that rate and prior suit every tone curve; of light
/// they are `contrast` times as large (1 / ToneCurve::exponent).
class Illumination {
 public:
  /// `training`: the images whose fields have a mean of zero.
  Illumination(std::size_t views, const std::vector<std::size_t>& training,
               const gaussians::Intrinsics& camera, const torch::Device& device);

  /// The image [H,W,3] of a view, as light, times its field. Recorded by autograd for `step`.
  torch::Tensor apply(std::size_t view, const torch::Tensor& image, double contrast);
  /// Optimizes the field of the view that was applied last.
  void step(std::size_t view);
  /// Logarithms of the gains [n,3,rows,columns].
  const torch::Tensor& logs() const { return logs_; }
  void set_logs(const torch::Tensor& logs) { logs_.copy_(logs); }

  void save(torch::serialize::OutputArchive& archive) const;
  /// Throws c10::Error when the archive has another number of images.
  void load(torch::serialize::InputArchive& archive);

 private:
  torch::Tensor training_;  ///< int64
  torch::Tensor logs_, first_, second_;
  std::vector<std::int64_t> view_steps_;
  std::int64_t steps_ = 0;
  torch::Tensor leaf_;
  std::map<std::int64_t, std::pair<torch::Tensor, torch::Tensor>> interpolation_;  ///< by width
};

/// Gains of light [height,width,3] of a field of logarithms [3,rows,columns].
torch::Tensor illumination_gain(const torch::Tensor& logs, double contrast, std::int64_t height,
                                std::int64_t width);

}  // namespace apvi::mapping
