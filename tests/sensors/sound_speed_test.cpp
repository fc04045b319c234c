// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/sound_speed.hpp"

#include <gtest/gtest.h>

namespace apvi {
namespace {

// UNESCO technical papers in marine science 44 (1983): the check value and its table.
TEST(SoundSpeed, MatchesPublishedCheckValue) {
  EXPECT_NEAR(sound_speed(40.0, 40.0, 10000.0), 1731.995, 5e-4);
}

TEST(SoundSpeed, MatchesPublishedTable) {
  EXPECT_NEAR(sound_speed(0.0, 25.0, 0.0), 1435.8, 0.05);
  EXPECT_NEAR(sound_speed(20.0, 35.0, 0.0), 1521.5, 0.05);
  EXPECT_NEAR(sound_speed(10.0, 30.0, 1000.0), 1500.2, 0.05);
}

TEST(SoundSpeed, PureWaterAtZeroIsFirstCoefficient) {
  EXPECT_DOUBLE_EQ(sound_speed(0.0, 0.0, 0.0), 1402.388);
}

TEST(SoundSpeed, IncreasesWithTemperatureSalinityAndPressure) {
  EXPECT_GT(sound_speed(11.0, 35.0, 0.0), sound_speed(10.0, 35.0, 0.0));
  EXPECT_GT(sound_speed(10.0, 36.0, 0.0), sound_speed(10.0, 35.0, 0.0));
  EXPECT_GT(sound_speed(10.0, 35.0, 100.0), sound_speed(10.0, 35.0, 0.0));
}

}  // namespace
}  // namespace apvi
