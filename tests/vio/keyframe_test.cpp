// SPDX-License-Identifier: BSD-3-Clause
// Choice of keyframes.
#include <gtest/gtest.h>

#include <memory>

#include "apvi/core/constants.hpp"
#include "vio/window/window_update.hpp"

namespace apvi::vio {
namespace {

// Two frames in which all corners move by `motion_deg`, at the given interval.
Window moved(double motion_deg, double interval_s) {
  Window window;
  for (int k = 0; k < 2; ++k) {
    auto frame = std::make_unique<Frame>();
    frame->stamp = Stamp{} + Duration::from_seconds(k * interval_s);
    TrackedFrame tracked{frame->stamp, {}, {}};
    for (int i = 0; i < 20; ++i) {
      FeatureObservation seen;
      seen.id = i;
      seen.point = {0.01 * i + k * motion_deg * kRadiansPerDegree, 0.0};
      tracked.observations.push_back(seen);
    }
    window.frames.push_back(std::move(frame));
    add_observations(window, window.newest(), tracked);
  }
  return window;
}

TEST(Keyframe, IsChosenByTheAngleThatCornersMoved) {
  Config config;
  config.window.keyframe_parallax_deg = 2.5;
  EXPECT_FALSE(is_keyframe(moved(2.4, 0.1), config));
  EXPECT_TRUE(is_keyframe(moved(2.6, 0.1), config));
}

TEST(Keyframe, IsChosenAfterATimeWithoutMotion) {
  Config config;
  config.window.keyframe_max_interval_s = 0.5;
  EXPECT_FALSE(is_keyframe(moved(0.0, 0.45), config));
  EXPECT_TRUE(is_keyframe(moved(0.0, 0.55), config));
}

}  // namespace
}  // namespace apvi::vio
