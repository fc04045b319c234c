// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <vector>

#include "apvi/mapping/options.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Optimized per-keyframe corrections of pose and exposure, both with Gaussian priors. Disabled
/// ones stay zero.
class ViewCorrections {
 public:
  ViewCorrections(std::size_t views, const PoseOptions& poses, const ExposureOptions& exposure);

  /// Adds a view with zero corrections.
  void add_view();
  std::size_t views() const { return static_cast<std::size_t>(poses_.steps.size(0)); }

  /// [6] float64: left perturbation of view `i`, translation [m], then rotation [rad]; a leaf that
  /// requires a gradient with `learn`. Undefined when pose correction is disabled.
  torch::Tensor pose_delta(std::size_t i, bool learn) const;
  /// Applies the exposure of view `i` to a rendering [H,W,3]: exp(gain) image + offset, per
  /// channel.
  torch::Tensor expose(std::size_t i, const torch::Tensor& image, bool learn);
  /// Multiplies the translations; their moments start anew.
  void change_scale(double scale);
  /// One Adam step for view `i` with the gradients of the last `pose_delta` (the tensor returned by
  /// pose_delta()) and `expose`.
  void step(std::size_t i, const torch::Tensor& pose_delta);

  /// All pose deltas [n,6] float64 and exposures [n,2,3] float64 (log gain, offset).
  const torch::Tensor& poses() const { return poses_.value; }
  const torch::Tensor& exposures() const { return exposures_.value; }

  void save(torch::serialize::OutputArchive& archive) const;
  /// Throws c10::Error when the number of views differs.
  void load(torch::serialize::InputArchive& archive);

 private:
  /// A value per view with its Adam moments.
  struct OptimizedParameter {
    torch::Tensor value, first, second;
    torch::Tensor steps;  ///< [n] int64
  };
  static OptimizedParameter make(std::size_t views, at::IntArrayRef shape);
  void adam(OptimizedParameter& param, std::size_t i, const torch::Tensor& gradient, double rate);

  PoseOptions pose_options_;
  ExposureOptions exposure_options_;
  OptimizedParameter poses_;
  OptimizedParameter exposures_;
  torch::Tensor exposure_leaf_;  ///< of the last exposed view
};

/// Applies a pose delta: Exp(delta) T_camera_world, [4,4] float64.
torch::Tensor corrected_pose(const torch::Tensor& T_camera_world, const torch::Tensor& pose_delta);

}  // namespace apvi::mapping
