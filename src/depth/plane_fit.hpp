// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "gaussians/render/splat_math.hpp"

namespace apvi::depth {

/// Least-squares plane through a block and its neighbors on the same surface, fitted to the
/// relative change of 1/depth (linear in the pixels on a plane) with a weak prior of zero slope.
/// Shared by CPU and GPU.
struct PlaneFit {
  double xx = 1.0, xy = 0.0, yy = 1.0, xw = 0.0, yw = 0.0;
  int inliers = 0;

  /// Adds a neighbor at offset `dx`, `dy` [px] with relative difference `dw` of 1/depth.
  APVI_HD void add(double dx, double dy, double dw) {
    ++inliers;
    xx += dx * dx;
    xy += dx * dy;
    yy += dy * dy;
    xw += dx * dw;
    yw += dy * dw;
  }
  /// Relative change of 1/depth along x and y [1/px], limited to `max_slope`.
  APVI_HD float slope_x(double max_slope) const {
    return clamp((yy * xw - xy * yw) / determinant(), max_slope);
  }
  APVI_HD float slope_y(double max_slope) const {
    return clamp((xx * yw - xy * xw) / determinant(), max_slope);
  }
  /// Fraction of `neighbors` on the same surface; 1 without any.
  APVI_HD float agreement(int neighbors) const {
    return neighbors > 0 ? static_cast<float>(inliers) / static_cast<float>(neighbors) : 1.0F;
  }

 private:
  APVI_HD double determinant() const { return xx * yy - xy * xy; }
  APVI_HD static float clamp(double value, double limit) {
    return static_cast<float>(value < -limit ? -limit : value > limit ? limit : value);
  }
};

}  // namespace apvi::depth
