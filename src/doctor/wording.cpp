// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/wording.hpp"

#include <fmt/format.h>

#include <cmath>

namespace apvi::doctor {

std::string describe_offset(double seconds, int decimals) {
  const double unit = std::pow(10.0, -decimals);
  if (std::abs(seconds) < 0.5 * unit)
    return fmt::format("on time (within {:.{}f} s)", unit, decimals);
  return fmt::format("{} by {:.{}f} s", seconds < 0.0 ? "early" : "late", std::abs(seconds),
                     decimals);
}

std::string list(const Eigen::Vector3d& v, const char* format) {
  const auto number = [&](double x) { return fmt::format(fmt::runtime(format), x + 0.0); };
  return fmt::format("({}, {}, {})", number(v.x()), number(v.y()), number(v.z()));
}

std::string rotation_yaml(const Eigen::Matrix3d& r) {
  std::string text;
  for (Eigen::Index i = 0; i < 3; ++i) {
    text += fmt::format("{}{:.3f},{:.3f},{:.3f}", i > 0 ? "; " : "", r(i, 0), r(i, 1), r(i, 2));
  }
  return "[" + text + "]";
}

}  // namespace apvi::doctor
