// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <vector>

#include "apvi/mapping/step_backend.hpp"
#include "apvi/splat/view.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Squared distances of pixels from the principal point in the lens's own picture, 1 in a corner of
/// a pinhole's; `x` and `y` [px] broadcast.
torch::Tensor corners2(const splat::Intrinsics& camera, const torch::Tensor& x,
                       const torch::Tensor& y);

/// The part of the light that a lens lets through at pixels: 1 - `vignetting` r^2, with r of 1 in
/// the corners; `x` and `y` [px] broadcast.
torch::Tensor lens_falloff(const splat::Intrinsics& camera, double vignetting,
                           const torch::Tensor& x, const torch::Tensor& y);
/// At every pixel [H,W,1].
torch::Tensor lens_falloff(const splat::Intrinsics& camera, double vignetting,
                           const torch::Device& device);

/// A view as the map has it.
struct DrawnView {
  torch::Tensor image;       ///< [H,W,3] through the water
  torch::Tensor alpha;       ///< [H,W]
  torch::Tensor open_water;  ///< [H,W,3] without any surface; undefined: there is no water
  Horizon horizon = kNoSky;
};

/// How bright each view's picture is over what the map shows: a camera that exposes by itself makes
/// the same surface now brighter and now darker. Never read back to the CPU on the way.
class ViewGains {
 public:
  ViewGains(std::size_t views, const torch::Device& device);

  /// One more view, at first as bright as the one before.
  void add_view();
  /// Brings a new view's gain to what makes `drawn` as bright as `picture` [H,W,3], but for what
  /// new views usually differ by: where the map is solid and, the more so, where the picture shows
  /// open water and the map does not hide it, for a surface may have any colour and water has its
  /// own. Above the horizon, hidden or not, it has nearly all the say. All without the lens'
  /// falloff.
  void find(std::size_t view, const DrawnView& drawn, const torch::Tensor& picture);
  /// The same for a view that is known, a little of the way.
  void follow(std::size_t view, const DrawnView& drawn, const torch::Tensor& picture);

  /// Logarithm [1] of a view's factor, of the memory kept here.
  torch::Tensor log_gain(std::size_t view) const;
  /// Logarithms of all [n].
  const torch::Tensor& logs() const { return logs_; }
  void set_logs(const torch::Tensor& logs) { logs_ = logs.to(logs_.options()); }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  void match(std::size_t view, const DrawnView& drawn, const torch::Tensor& picture,
             const GainPace& pace, const torch::Tensor& usual);

  torch::Tensor logs_;
  torch::Tensor usual_;  ///< [2] what new views usually differ by, and those that are known
};

/// The logarithms [n] of all views at `seconds`, float64, after a survey `found` [k] those of
/// `views`, ascending. The others change as much as the nearest that were looked at, before and
/// after, the less the longer ago, and at last as much as most have: what takes one gain astray is
/// a place or a moment. (Between two readings of an Ornstein-Uhlenbeck process.)
torch::Tensor surveyed_gains(const torch::Tensor& logs, const std::vector<double>& seconds,
                             const std::vector<std::size_t>& views, const torch::Tensor& found);

}  // namespace apvi::mapping
