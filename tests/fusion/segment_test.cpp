// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "fusion/fuser_scene.hpp"

namespace apvi::fusion {
namespace {

// Both odometries continue 50 m away after a pause of an hour.
void pause(Scene& scene) {
  scene.input.stamp = scene.input.stamp + Duration::from_seconds(3600.0);
  scene.vio_at(50.0);
  scene.input.dipo->T_world_body.translation.x() = 50.0;
}

TEST(FuserSegment, OutputContinuesAtTheNewPoseAtOnce) {
  Scene scene(by_default());
  for (int k = 0; k < 50; ++k) scene.step();
  scene.fuser.begin_segment();
  pause(scene);
  const FusionResult result = scene.step();
  EXPECT_EQ(result.state, FusionState::fused);
  EXPECT_NEAR(result.pose->T_world_body.translation.x(), 50.0, 1e-9);
  EXPECT_LT(result.pose->covariance(3, 3), 0.1);
}

TEST(FuserSegment, UncertaintyOfAPauseDoesNotMakeDipoUnstable) {
  for (const bool segment : {false, true}) {
    Scene scene(by_default());
    for (int k = 0; k < 50; ++k) scene.step();
    if (segment) scene.fuser.begin_segment();
    pause(scene);
    scene.input.dipo->covariance(5, 5) = 1e8;
    EXPECT_EQ(scene.step().dipo.stable(), segment);
  }
}

TEST(FuserSegment, DipoIsUnstableUntilItsFirstPing) {
  Scene scene(by_default());
  for (int k = 0; k < 50; ++k) scene.step();
  scene.fuser.begin_segment();
  scene.pings = false;
  EXPECT_EQ(scene.step().dipo.reason, StabilityReason::no_ping);
  scene.pings = true;
  EXPECT_TRUE(scene.step().dipo.stable());
}

}  // namespace
}  // namespace apvi::fusion
