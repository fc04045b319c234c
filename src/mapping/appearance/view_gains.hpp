// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <vector>

#include "gaussians/render/view.hpp"
#include "mapping/training/step_backend.hpp"
#include "medium/vignetting.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Squared distances of pixels from the principal point in the distorted image, normalized to 1 in
/// the corners of a pinhole image; `x` and `y` [px] broadcast.
torch::Tensor corners2(const gaussians::Intrinsics& camera, const torch::Tensor& x,
                       const torch::Tensor& y);

/// Vignetting factor at pixels; `x` and `y` [px] broadcast.
torch::Tensor lens_falloff(const gaussians::Intrinsics& camera,
                           const medium::Vignetting& vignetting, const torch::Tensor& x,
                           const torch::Tensor& y);
/// The same at every pixel [H,W,1].
torch::Tensor lens_falloff(const gaussians::Intrinsics& camera,
                           const medium::Vignetting& vignetting, const torch::Device& device);

/// A rendered view.
struct RenderedView {
  torch::Tensor image;       ///< [H,W,3] with the medium
  torch::Tensor alpha;       ///< [H,W]
  torch::Tensor open_water;  ///< [H,W,3] medium without any surface; undefined: no medium
  Horizon horizon = kNoSky;
};

/// Gains of the views relative to the map, which compensate for automatic exposure. Computed on the
/// device without synchronization.
class ViewGains {
 public:
  ViewGains(std::size_t views, const torch::Device& device);

  /// Adds a view with the gain of the previous one.
  void add_view();
  /// Initializes a new view's gain from the ratio of `image` [H,W,3] to `rendered`, corrected by
  /// the usual bias of new views. Compares solid pixels and, with more weight, open water that the
  /// map does not cover, because its color is known; pixels above the horizon dominate. All without
  /// lens falloff.
  void initialize(std::size_t view, const RenderedView& rendered, const torch::Tensor& image);
  /// The same for a finished map that has been optimized with the image, without such a bias.
  void measure(std::size_t view, const RenderedView& rendered, const torch::Tensor& image);
  /// The same for a known view, with a small step.
  void track(std::size_t view, const RenderedView& rendered, const torch::Tensor& image);

  /// The median of the gains of `views`, which must not be empty, stays from now on as it is now:
  /// `restore_median` undoes what has moved all of them alike. With a fixed veiling light, images
  /// hardly tell a brighter map from larger gains.
  void hold_median(const std::vector<std::size_t>& views);
  void restore_median();

  /// Log gain [1] of a view; shares memory.
  torch::Tensor log_gain(std::size_t view) const;
  /// Log gains of all views [n].
  const torch::Tensor& logs() const { return logs_; }
  void set_logs(const torch::Tensor& logs) { logs_ = logs.to(logs_.options()); }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  void update(std::size_t view, const RenderedView& rendered, const torch::Tensor& image,
              const GainUpdate& options, const torch::Tensor& bias);

  torch::Tensor logs_;
  torch::Tensor held_;    ///< [m] int64: views whose median is held; undefined: none
  torch::Tensor median_;  ///< [] of these
  torch::Tensor bias_;    ///< [2] mean log gain difference of new and of known views
};

/// Log gains [n] float64 of all views at `seconds`, given `estimated` [k] of `views` (ascending).
/// The changes are interpolated in time between the nearest estimated views (Ornstein-Uhlenbeck
/// process) and decay to the median change with distance.
torch::Tensor interpolate_gains(const torch::Tensor& logs, const std::vector<double>& seconds,
                                const std::vector<std::size_t>& views,
                                const torch::Tensor& estimated);

}  // namespace apvi::mapping
