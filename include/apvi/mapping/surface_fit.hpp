// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/splat/splat_math.hpp"

namespace apvi::mapping {

/// The plane through a block and those of its neighbours that lie on the same surface, by least
/// squares of how 1/depth changes over the picture (a plane's is linear in the pixels). One square
/// pixel says that it does not. The same on a CPU and on a GPU.
struct SurfaceFit {
  double xx = 1.0, xy = 0.0, yy = 1.0, xw = 0.0, yw = 0.0;
  int alike = 0;

  /// A neighbour `dx`, `dy` [px] away whose 1/depth is `dw` larger, relatively.
  APVI_HD void add(double dx, double dy, double dw) {
    ++alike;
    xx += dx * dx;
    xy += dx * dy;
    yy += dy * dy;
    xw += dx * dw;
    yw += dy * dw;
  }
  /// Relative change of 1/depth to the right and down [1/px], `steepest` at most.
  APVI_HD float to_right(double steepest) const {
    return within((yy * xw - xy * yw) / determinant(), steepest);
  }
  APVI_HD float down(double steepest) const {
    return within((xx * yw - xy * xw) / determinant(), steepest);
  }
  /// Part of `neighbors` that lie on the surface; 1: there are none.
  APVI_HD float agreement(int neighbors) const {
    return neighbors > 0 ? static_cast<float>(alike) / static_cast<float>(neighbors) : 1.0F;
  }

 private:
  APVI_HD double determinant() const { return xx * yy - xy * xy; }
  APVI_HD static float within(double value, double limit) {
    return static_cast<float>(value < -limit ? -limit : value > limit ? limit : value);
  }
};

}  // namespace apvi::mapping
