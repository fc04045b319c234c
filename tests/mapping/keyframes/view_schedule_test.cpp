// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/keyframes/view_schedule.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <map>

namespace apvi::mapping {
namespace {

std::map<std::size_t, int> draws(const ViewSchedule& schedule, int count) {
  Random random(3);
  std::map<std::size_t, int> drawn;
  for (int i = 0; i < count; ++i) ++drawn[schedule.draw(random)];
  return drawn;
}

void use(ViewSchedule& schedule, std::size_t view, double loss, int times = 1) {
  for (int i = 0; i < times; ++i) {
    schedule.use(view);
    schedule.report(view, loss);
  }
}

TEST(ViewSchedule, PrefersTheNewestViews) {
  ViewSchedule schedule(2, 0.5);
  for (std::size_t view = 0; view < 10; ++view) schedule.add(view);
  auto drawn = draws(schedule, 10000);
  EXPECT_NEAR(drawn[8] + drawn[9], 6000, 300);  // half of all, plus their share of the other half
  schedule.disable_recency_bias();
  drawn = draws(schedule, 10000);
  EXPECT_NEAR(drawn[8] + drawn[9], 2000, 200);
}

TEST(ViewSchedule, PrefersHighLossAndFewUses) {
  ViewSchedule schedule(1, 0.0);
  for (std::size_t view = 0; view < 3; ++view) schedule.add(view);
  use(schedule, 0, 0.1, 9);
  use(schedule, 1, 0.3, 9);
  use(schedule, 2, 0.1);
  auto drawn = draws(schedule, 10000);
  EXPECT_NEAR(static_cast<double>(drawn[1]) / drawn[0], 3.0, 0.5);
  // Nine uses have decayed to 7.1.
  EXPECT_NEAR(static_cast<double>(drawn[2]) / drawn[0], 8.1 / 2.0, 0.6);
  EXPECT_EQ(schedule.uses(1), 9);
}

TEST(ViewSchedule, PausedViewsAreNotDrawn) {
  ViewSchedule schedule(2, 0.5);
  for (std::size_t view = 0; view < 5; ++view) schedule.add(view);
  schedule.pause({1, 4});
  EXPECT_THAT(draws(schedule, 1000),
              testing::UnorderedElementsAre(testing::Key(0U), testing::Key(2U), testing::Key(3U)));
  EXPECT_EQ(schedule.size(), 5U);
  schedule.pause({0, 1, 2, 3, 4});
  EXPECT_EQ(draws(schedule, 1000).size(), 5U);
}

TEST(ViewSchedule, OldUsesDecay) {
  ViewSchedule schedule(1, 0.0);
  for (std::size_t view = 0; view < 2; ++view) schedule.add(view);
  use(schedule, 0, 0.1, 300);
  use(schedule, 1, 0.1, 300);
  auto drawn = draws(schedule, 10000);
  EXPECT_GT(drawn[0], 8 * drawn[1]);
  EXPECT_EQ(schedule.uses(0), schedule.uses(1));
}

TEST(ViewSchedule, CountsUsesBeforeTheirLossIsKnown) {
  ViewSchedule schedule(1, 0.0);
  for (std::size_t view = 0; view < 3; ++view) schedule.add(view);
  for (int i = 0; i < 9; ++i) schedule.use(0);
  use(schedule, 1, 0.1);
  auto drawn = draws(schedule, 10000);
  EXPECT_GT(drawn[2], 3 * drawn[0]);  // same loss, fewer uses
  EXPECT_GT(drawn[0], 0);
  EXPECT_EQ(schedule.uses(0), 9);
  schedule.report(0, 0.3);  // three times the other known loss
  const int before = drawn[0];
  drawn = draws(schedule, 10000);
  EXPECT_GT(drawn[0], before);
}

TEST(ViewSchedule, PenalizesOutlierViews) {
  ViewSchedule schedule(1, 0.0);
  for (std::size_t view = 0; view < 8; ++view) schedule.add(view);
  for (std::size_t view = 0; view < 8; ++view) {
    use(schedule, view, view == 3 ? 0.5 : 0.05, 20);
  }
  auto drawn = draws(schedule, 10000);
  EXPECT_LT(drawn[3], drawn[2]);
  EXPECT_GT(drawn[3], 0);
  schedule.reset_penalties();
  drawn = draws(schedule, 10000);
  EXPECT_GT(drawn[3], 4 * drawn[2]);
}

TEST(ViewSchedule, NeverDrawsRemovedViews) {
  ViewSchedule schedule(3, 0.5);
  for (std::size_t view = 0; view < 5; ++view) schedule.add(view);
  schedule.remove(4);
  schedule.remove(1);
  const auto drawn = draws(schedule, 2000);
  EXPECT_EQ(drawn.size(), 3U);
  EXPECT_EQ(drawn.count(4), 0U);
  EXPECT_EQ(drawn.count(1), 0U);
  ViewSchedule empty(3, 0.5);
  Random random(0);
  EXPECT_THROW(empty.draw(random), c10::Error);
}

}  // namespace
}  // namespace apvi::mapping
