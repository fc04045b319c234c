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

/// What is learnt about single keyframes beside the map: how their poses differ from the given ones
/// and how their exposure differs from the others'. Both are held by Gaussian priors, and what is
/// switched off stays zero.
class ViewCorrections {
 public:
  ViewCorrections(std::size_t views, const PoseOptions& poses, const ExposureOptions& exposure);

  /// Makes room for one more view, of which nothing is known.
  void add_view();
  std::size_t views() const { return static_cast<std::size_t>(poses_.steps.size(0)); }

  /// [6] float64: the left perturbation of view `i`, translation [m], then rotation [rad]; a leaf
  /// that requires a gradient when `learn` and poses are corrected. Undefined when they are not.
  torch::Tensor pose_delta(std::size_t i, bool learn) const;
  /// The rendered image [H,W,3] as view `i` exposed it: exp(gain) image + offset, per channel.
  torch::Tensor expose(std::size_t i, const torch::Tensor& image, bool learn);
  /// One step of Adam for view `i` with the gradients that a backward pass left in `pose_delta`
  /// (the tensor that `pose_delta` gave) and behind `expose`.
  void step(std::size_t i, const torch::Tensor& pose_delta);

  /// All pose deltas [n,6] float64 and exposures [n,2,3] float64 (logarithm of the gain, offset).
  const torch::Tensor& poses() const { return poses_.value; }
  const torch::Tensor& exposures() const { return exposures_.value; }

  void save(torch::serialize::OutputArchive& archive) const;
  /// Throws c10::Error when the archive holds those of another number of views.
  void load(torch::serialize::InputArchive& archive);

 private:
  /// A value for each view with Adam's memory of it.
  struct Learnt {
    torch::Tensor value, first, second;
    torch::Tensor steps;  ///< [n] int64
  };
  static Learnt make(std::size_t views, at::IntArrayRef shape);
  void adam(Learnt& learnt, std::size_t i, const torch::Tensor& gradient, double rate);

  PoseOptions pose_options_;
  ExposureOptions exposure_options_;
  Learnt poses_;
  Learnt exposures_;
  torch::Tensor exposure_leaf_;  ///< of the view that was exposed last
};

/// The pose delta applied: Exp(delta) T_camera_world, [4,4] float64.
torch::Tensor corrected_pose(const torch::Tensor& T_camera_world, const torch::Tensor& pose_delta);

}  // namespace apvi::mapping
