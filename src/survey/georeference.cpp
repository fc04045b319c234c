// SPDX-License-Identifier: BSD-3-Clause
#include "survey/georeference.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "apvi/core/constants.hpp"

namespace apvi::survey {

Georeference georeference(const GeoreferenceOptions& options, bool z_down) {
  const double heading = options.heading_deg.value_or(z_down ? 0.0 : 90.0) * kRadiansPerDegree;
  const double s = std::sin(heading);
  const double c = std::cos(heading);
  Eigen::Matrix3d R;
  if (z_down) {
    R << s, c, 0.0, c, -s, 0.0, 0.0, 0.0, -1.0;
  } else {
    R << s, -c, 0.0, c, s, 0.0, 0.0, 0.0, 1.0;
  }
  return {options.epsg, {Eigen::Quaterniond(R).normalized(), options.origin}};
}

}  // namespace apvi::survey
