// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "live/mavlink_link.hpp"

namespace apvi::live {
namespace {

using mavlink::Id;

TEST(MessageChoice, TakesTheBestThatArrivesAndStaysWithIt) {
  MessageChoice choice({Id::raw_imu, Id::scaled_imu, Id::scaled_imu2}, std::nullopt);
  EXPECT_TRUE(choice.accepts(Id::scaled_imu2));
  EXPECT_TRUE(choice.accepts(Id::scaled_imu));
  EXPECT_FALSE(choice.accepts(Id::scaled_imu2));
  EXPECT_TRUE(choice.accepts(Id::scaled_imu));
  EXPECT_FALSE(choice.changed());
  EXPECT_TRUE(choice.accepts(Id::raw_imu));
  EXPECT_FALSE(choice.accepts(Id::scaled_imu));
  MessageChoice given({Id::raw_imu, Id::scaled_imu}, Id::scaled_imu3);
  EXPECT_FALSE(given.accepts(Id::raw_imu));
  EXPECT_TRUE(given.accepts(Id::scaled_imu3));
}

}  // namespace
}  // namespace apvi::live
