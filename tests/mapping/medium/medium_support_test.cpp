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
  for (int i = 0; i < 100; ++i) support.add(214.0);
  EXPECT_NEAR(support.saved_deviance(), 214.0, 1e-6);
  EXPECT_FALSE(support.is_sufficient());
}

TEST(MediumSupport, ClearlyBetterFitsOutweighABadFirstOne) {
  MediumSupport support;
  support.add(-50.0);
  EXPECT_FALSE(support.is_sufficient());
  for (int i = 0; i < 2; ++i) support.add(5000.0);
  EXPECT_TRUE(support.is_sufficient());
}

}  // namespace
}  // namespace apvi::mapping
