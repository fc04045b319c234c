// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/medium_support.hpp"

#include <gtest/gtest.h>

namespace apvi::mapping {
namespace {

TEST(MediumSupport, IsMissingBeforeAnEstimation) {
  EXPECT_FALSE(MediumSupport().is_sufficient());
}

TEST(MediumSupport, ErrorsOfAMapDoNotAddUpToAMedium) {
  MediumSupport support;
  for (int i = 0; i < 100; ++i) support.add(120.0, 2500);
  EXPECT_NEAR(support.saved_deviance(), 120.0, 1e-6);
  EXPECT_FALSE(support.is_sufficient());
}

TEST(MediumSupport, AShortDiveShowsItsWater) {
  MediumSupport support;
  support.add(69.0, 381);
  EXPECT_TRUE(support.is_sufficient());
}

TEST(MediumSupport, AFewObservationsDoNot) {
  MediumSupport support;
  support.add(45.0, 477);
  EXPECT_FALSE(support.is_sufficient());
}

TEST(MediumSupport, ClearlyBetterFitsOutweighABadFirstOne) {
  MediumSupport support;
  support.add(-50.0, 500);
  EXPECT_FALSE(support.is_sufficient());
  for (int i = 0; i < 2; ++i) support.add(4000.0, 19000);
  EXPECT_TRUE(support.is_sufficient());
}

}  // namespace
}  // namespace apvi::mapping
