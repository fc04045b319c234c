// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/frame_rate.hpp"

#include <gtest/gtest.h>

namespace apvi::viewer {
namespace {

constexpr double kTarget_s = 0.05;

// A renderer and a link whose times are proportional to the area of the images.
double settled_scale(double render_s, double link_s, double delay_s) {
  FrameRate rate(kTarget_s);
  for (int i = 0; i < 100; ++i) {
    const double area = rate.scale() * rate.scale();
    rate.add(render_s * area, delay_s + link_s * area, static_cast<std::size_t>(1e5 * area));
  }
  return rate.scale();
}

TEST(FrameRate, FastRenderersDrawAtFullSize) {
  EXPECT_EQ(FrameRate(kTarget_s).scale(), 1.0);
  EXPECT_EQ(settled_scale(0.02, 0.001, 0.0), 1.0);
}

TEST(FrameRate, ASlowRendererDrawsSmallerImagesInTime) {
  const double scale = settled_scale(0.2, 0.001, 0.0);
  EXPECT_LT(scale, 0.6);
  EXPECT_GT(scale, 0.3);
  EXPECT_LT(0.2 * scale * scale, 1.4 * kTarget_s);
}

TEST(FrameRate, ASlowLinkGetsSmallerImages) {
  EXPECT_LT(settled_scale(0.02, 0.4, 0.0), 0.6);
}

TEST(FrameRate, AFarLinkKeepsTheSize) {
  EXPECT_EQ(settled_scale(0.02, 0.001, 0.3), 1.0);
}

TEST(FrameRate, NeverDrawsSmallerThanAQuarter) {
  EXPECT_EQ(settled_scale(100.0, 1.0, 0.0), 0.25);
}

TEST(FrameRate, RecoversWhenTheLoadIsGone) {
  FrameRate rate(kTarget_s);
  for (int i = 0; i < 50; ++i) rate.add(1.0, 0.0, 1000);
  ASSERT_LT(rate.scale(), 0.5);
  for (int i = 0; i < 200; ++i) rate.add(0.01, 0.0, 1000);
  EXPECT_EQ(rate.scale(), 1.0);
}

}  // namespace
}  // namespace apvi::viewer
