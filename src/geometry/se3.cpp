// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/geometry/se3.hpp"

namespace apvi {

SE3 interpolate(const SE3& a, const SE3& b, double u) {
  return {a.rotation.slerp(u, b.rotation).normalized(),
          (1.0 - u) * a.translation + u * b.translation};
}

}  // namespace apvi
