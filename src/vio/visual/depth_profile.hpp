// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "vio/window/window.hpp"

namespace apvi::vio {

/// The squared reprojection errors of a landmark as a function of its inverse depth in the anchor
/// camera, each limited to that of `max_error_px`. Unlike a position, an inverse depth of zero is a
/// point at infinity (Civera, Davison, Montiel, "Inverse depth parametrization for monocular SLAM",
/// T-RO 2008).
class DepthProfile {
 public:
  DepthProfile(const Landmark& landmark, const Window& window, double focal, double max_error_px);

  /// The least sum that Gauss-Newton finds from the given inverse depth and from infinity [px²].
  double least(double inverse_depth) const;
  /// Number of errors in the sum.
  std::size_t count() const { return views_.size(); }

 private:
  struct View {
    Eigen::Vector3d direction;  // of the anchor's ray
    Eigen::Vector3d baseline;   // to the anchor
    Eigen::Vector2d seen;

    Eigen::Vector3d at(double inverse_depth) const { return direction + inverse_depth * baseline; }
  };

  double cost(double inverse_depth) const;
  double step(double inverse_depth) const;
  double descend(double inverse_depth) const;

  double limit_;  // on the plane z = 1
  double focal_;
  std::vector<View> views_;
};

}  // namespace apvi::vio
