// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "core/random.hpp"

namespace apvi::test {

struct TrajectoryPair {
  Trajectory reference;
  Trajectory estimate;
};

/// A reference at 20 Hz for 60 s over about 120 m, and an estimate at 10 Hz with position and
/// heading drift, noise, another world frame, stamp errors up to 4 ms, and a gap of 5 s.
inline TrajectoryPair synthetic_pair() {
  Random random(2024);
  const auto noise = [&](double sigma) {
    const double x = random.normal(0.0, sigma);
    const double y = random.normal(0.0, sigma);
    return Eigen::Vector3d(x, y, random.normal(0.0, sigma));
  };
  const SE3 T_estimate_reference{so3::exp(Eigen::Vector3d(0.1, -0.2, 1.3)),
                                 Eigen::Vector3d(4.0, -7.0, 1.5)};
  TrajectoryPair pair;
  Eigen::Vector3d drift = Eigen::Vector3d::Zero();
  for (int i = 0; i <= 1200; ++i) {
    const double t = 0.05 * i;
    const Stamp stamp{1'600'000'000'000'000'000 + 50'000'000LL * i};
    const SE3 pose{so3::exp(Eigen::Vector3d(0.1 * std::sin(t), 0.05 * std::cos(t), 0.2 * t)),
                   Eigen::Vector3d(12.0 * std::sin(0.15 * t), 9.0 * std::sin(0.3 * t),
                                   1.5 * std::sin(0.05 * t))};
    pair.reference.poses.push_back({stamp, pose});
    drift += noise(0.01);
    if (i % 2 != 0 || (t > 20.0 && t < 25.0)) continue;
    const SE3 error{so3::exp(Eigen::Vector3d(0.0, 0.0, 0.002 * t) + noise(0.004)),
                    drift + noise(0.02)};
    const auto jitter = static_cast<std::int64_t>(random.uniform(-4e6, 4e6));
    pair.estimate.poses.push_back({stamp + Duration{jitter}, T_estimate_reference * pose * error});
  }
  return pair;
}

}  // namespace apvi::test
