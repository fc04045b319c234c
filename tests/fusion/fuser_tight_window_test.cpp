// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/fuser.hpp"

#include <gtest/gtest.h>

#include "fusion/fuser_scene.hpp"
#include "support/matchers.hpp"

namespace apvi::fusion {
namespace {

using test::PoseNear;

TEST(Fuser, TightWindowIsNotResetWhenDipoIsUnstable) {
  Scene scene(by_default());
  scene.input.vio_includes_dipo = true;
  for (int i = 0; i < 5; ++i) scene.step();
  scene.pings = false;
  scene.input.statistics = dark();
  for (int i = 0; i < 40; ++i) EXPECT_NE(scene.step().freeze.action, Action::reset) << i;
  EXPECT_EQ(scene.step().freeze.phase, Phase::frozen);
}

TEST(Fuser, TightWindowWithoutBypassFollowsAlgorithm1) {
  Config config = as_printed();
  config.mode = Mode::consistent;
  config.consistent_method = Consistent::intersection;
  config.bypass_for_tight_graph = false;
  Scene scene(config);
  scene.input.vio_includes_dipo = true;
  scene.vio_at(0.2);
  EXPECT_LT(scene.step().pose->T_world_body.translation.x(), 0.199);
  scene.input.statistics = dark();
  FusionResult result = scene.step();
  EXPECT_EQ(result.state, FusionState::frozen);
  EXPECT_THAT(result.pose->T_world_body, PoseNear(SE3{}, 1e-15));
  scene.pings = false;
  for (int i = 0; i < 30 && result.freeze.action != Action::reset; ++i) result = scene.step();
  EXPECT_EQ(result.freeze.action, Action::reset);
  EXPECT_EQ(result.state, FusionState::dropped);
}

TEST(Fuser, TightWindowIsUsedFromItsFirstFrame) {
  Scene scene(by_default());
  scene.input.vio_includes_dipo = true;
  scene.input.statistics = dark();  // no corner is stable yet
  scene.vio_at(0.1);
  const FusionResult result = scene.step();
  EXPECT_EQ(result.freeze.phase, Phase::starting);
  EXPECT_THAT(result.pose->T_world_body, PoseNear(scene.input.vio->T_world_body, 1e-15));
}

TEST(Fuser, TightWindowIsAcceptedAgainWhenItsMotionAgrees) {
  Config config = by_default();
  config.discriminator.agreement.window_s = 2.0;
  Scene scene(config);
  scene.input.vio_includes_dipo = true;
  for (int i = 0; i < 30; ++i) scene.step();
  scene.vio_at(1.0);
  EXPECT_EQ(scene.step().verdict.reason, Reason::position_differs);
  for (int i = 0; i < 18; ++i) EXPECT_FALSE(scene.step().verdict.accepted()) << i;
  for (int i = 0; i < 4; ++i) scene.step();
  EXPECT_TRUE(scene.step().verdict.accepted());
}

}  // namespace
}  // namespace apvi::fusion
