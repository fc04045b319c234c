// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/LU>

#include "fusion/fuser.hpp"
#include "fusion/two_odometries.hpp"

namespace apvi::fusion {

// Algorithm 1 and Eq. 7 as printed.
inline Config as_printed() {
  Config config;
  config.mode = Mode::paper;
  config.discriminator.agreement.require_stable_dipo = false;
  config.discriminator.agreement.dipo_sigmas = 0.0;
  config.hysteresis = {.good_s = 0.0, .bad_s = 0.0, .recovery_stable_ratio_factor = 1.0};
  config.slew.time_constant_s = 0.0;
  config.discriminator.degeneracy = {.min_rotation_eigenvalue = 0.0,
                                     .min_position_eigenvalue = 0.0};
  return config;
}

// The default without step 3, whose thresholds are for real data.
inline Config by_default() {
  Config config;
  config.discriminator.degeneracy = {.min_rotation_eigenvalue = 0.0,
                                     .min_position_eigenvalue = 0.0};
  return config;
}

inline vio::FrameStatistics rich() {
  vio::FrameStatistics statistics;
  statistics.tracked = 120;
  statistics.stable = 80;
  return statistics;
}

inline vio::FrameStatistics dark() {
  vio::FrameStatistics statistics;
  statistics.tracked = 4;
  return statistics;
}

// A vehicle at rest with one ping per frame, 0.1 s apart.
class Scene {
 public:
  explicit Scene(const Config& config, const FreezeConfig& freeze = {}) : fuser(config, freeze) {
    input.dipo = PoseEstimate{SE3{}, test::diagonal(1.0, 0.1)};
    input.vio = VioEstimate{};
    input.vio->information = test::diagonal(1.0, 0.1).inverse();
    input.vio->inliers = 80;
    input.statistics = rich();
  }
  FusionResult step() {
    input.stamp = input.stamp + Duration::from_seconds(0.1);
    if (pings) {
      fuser.add({.stamp = input.stamp, .verdict = dipo::Verdict::accepted, .nis = 3.0, .rows = 3});
    }
    return fuser.update(input);
  }
  void vio_at(double x, double y = 0.0, double z = 0.0) {
    input.vio->T_world_body.translation = {x, y, z};
  }

  Fuser fuser;
  FusionInput input;
  bool pings = true;
};

}  // namespace apvi::fusion
