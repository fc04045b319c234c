// SPDX-License-Identifier: BSD-3-Clause
#include "core/random.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

namespace apvi {
namespace {

// Reference values from an independent implementation of SplitMix64 and xoshiro256++.
TEST(Random, MatchesReferenceImplementation) {
  Random random(42);
  EXPECT_EQ(random.next(), 15021278609987233951ULL);
  EXPECT_EQ(random.next(), 5881210131331364753ULL);
  EXPECT_EQ(random.next(), 18149643915985481100ULL);
}

TEST(Random, DependsOnlyOnSeed) {
  Random a(7);
  Random b(7);
  Random c(8);
  bool differs = false;
  for (int i = 0; i < 100; ++i) {
    const std::uint64_t value = a.next();
    EXPECT_EQ(value, b.next());
    differs = differs || value != c.next();
  }
  EXPECT_TRUE(differs);
}

TEST(Random, UniformHasExpectedMeanAndVariance) {
  Random random(1);
  constexpr int kCount = 100000;
  double sum = 0.0;
  double squares = 0.0;
  for (int i = 0; i < kCount; ++i) {
    const double x = random.uniform(-2.0, 4.0);
    ASSERT_GE(x, -2.0);
    ASSERT_LT(x, 4.0);
    sum += x;
    squares += x * x;
  }
  const double mean = sum / kCount;
  EXPECT_NEAR(mean, 1.0, 5.0 * std::sqrt(3.0 / kCount));
  EXPECT_NEAR(squares / kCount - mean * mean, 3.0, 0.05);
}

TEST(Random, NormalHasExpectedMoments) {
  Random random(2);
  constexpr int kCount = 200000;
  double moments[5] = {};
  for (int i = 0; i < kCount; ++i) {
    const double x = random.normal();
    for (int k = 1; k <= 4; ++k) moments[k] += std::pow(x, k) / kCount;
  }
  EXPECT_NEAR(moments[1], 0.0, 0.012);
  EXPECT_NEAR(moments[2], 1.0, 0.016);
  EXPECT_NEAR(moments[3], 0.0, 0.05);
  EXPECT_NEAR(moments[4], 3.0, 0.12);
}

TEST(Random, NormalAppliesMeanAndSigma) {
  Random a(3);
  Random b(3);
  for (int i = 0; i < 10; ++i) EXPECT_DOUBLE_EQ(a.normal(5.0, 2.0), 5.0 + 2.0 * b.normal());
}

TEST(Random, ForksAreReproducibleAndDistinct) {
  const Random parent(11);
  std::set<std::uint64_t> firsts;
  for (std::uint64_t key = 0; key < 1000; ++key) firsts.insert(parent.fork(key).next());
  EXPECT_EQ(firsts.size(), 1000u);
  EXPECT_EQ(parent.fork(5).next(), parent.fork(5).next());
  Random used(11);
  used.next();
  EXPECT_EQ(used.fork(5).next(), parent.fork(5).next());  // independent of the state
}

TEST(Random, ForkDiffersFromParent) {
  Random parent(11);
  Random child = parent.fork(0);
  EXPECT_NE(parent.next(), child.next());
}

}  // namespace
}  // namespace apvi
