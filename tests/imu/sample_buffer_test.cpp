// SPDX-License-Identifier: BSD-3-Clause
#include "imu/sample_buffer.hpp"

#include <gtest/gtest.h>

namespace apvi::imu {
namespace {

constexpr std::int64_t kMillisecond = 1'000'000;

ImuSample sample_at(std::int64_t milliseconds) {
  const double value = static_cast<double>(milliseconds);
  return {{milliseconds * kMillisecond}, {value, 0.0, 0.0}, {0.0, 2.0 * value, 0.0}};
}

SampleBuffer buffer_of(std::initializer_list<std::int64_t> milliseconds) {
  SampleBuffer buffer(Duration::from_seconds(1.0));
  for (const auto t : milliseconds) buffer.add(sample_at(t));
  return buffer;
}

TEST(SampleBuffer, InterpolatesSpanEnds) {
  const SampleBuffer buffer = buffer_of({0, 10, 20, 30});
  const auto span = buffer.between({5 * kMillisecond}, {22 * kMillisecond});
  ASSERT_EQ(span.size(), 4u);
  EXPECT_DOUBLE_EQ(span.front().gyro.x(), 5.0);
  EXPECT_DOUBLE_EQ(span[1].gyro.x(), 10.0);
  EXPECT_DOUBLE_EQ(span[2].gyro.x(), 20.0);
  EXPECT_DOUBLE_EQ(span.back().accel.y(), 44.0);
}

TEST(SampleBuffer, DoesNotDuplicateSamplesAtSpanEnds) {
  const SampleBuffer buffer = buffer_of({0, 10, 20, 30});
  const auto span = buffer.between({10 * kMillisecond}, {30 * kMillisecond});
  ASSERT_EQ(span.size(), 3u);
  EXPECT_EQ(span[1].stamp.ns, 20 * kMillisecond);
}

TEST(SampleBuffer, ReturnsNothingOutsideBuffer) {
  const SampleBuffer buffer = buffer_of({10, 20});
  EXPECT_TRUE(buffer.between({5 * kMillisecond}, {15 * kMillisecond}).empty());
  EXPECT_TRUE(buffer.between({15 * kMillisecond}, {25 * kMillisecond}).empty());
  EXPECT_TRUE(buffer.between({15 * kMillisecond}, {15 * kMillisecond}).empty());
  EXPECT_FALSE(buffer.at({9 * kMillisecond}));
  EXPECT_FALSE(SampleBuffer(Duration{1}).newest());
}

TEST(SampleBuffer, TellsTheTimeBetweenMeasuredSamples) {
  const SampleBuffer buffer = buffer_of({0, 10, 500, 510});
  EXPECT_DOUBLE_EQ(buffer.step_at({5 * kMillisecond}), 0.01);
  EXPECT_DOUBLE_EQ(buffer.step_at({10 * kMillisecond}), 0.49);
  EXPECT_DOUBLE_EQ(buffer.step_at({300 * kMillisecond}), 0.49);
  EXPECT_DOUBLE_EQ(buffer.step_at({500 * kMillisecond}), 0.01);
  EXPECT_DOUBLE_EQ(buffer.step_at({510 * kMillisecond}), 0.0);
}

TEST(SampleBuffer, RejectsNonIncreasingStamps) {
  SampleBuffer buffer = buffer_of({0, 10});
  EXPECT_FALSE(buffer.add(sample_at(10)));
  EXPECT_FALSE(buffer.add(sample_at(3)));
  EXPECT_TRUE(buffer.add(sample_at(11)));
}

TEST(SampleBuffer, KeepsOnlyRetentionTime) {
  SampleBuffer buffer(Duration::from_seconds(0.1));
  for (std::int64_t t = 0; t <= 1000; t += 10) buffer.add(sample_at(t));
  EXPECT_EQ(buffer.oldest()->ns, 900 * kMillisecond);
  EXPECT_EQ(buffer.newest()->ns, 1000 * kMillisecond);
}

}  // namespace
}  // namespace apvi::imu
