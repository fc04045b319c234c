// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/keyframes/keyframe_selection.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

namespace apvi::mapping {
namespace {

constexpr int kHeight = 90;
constexpr int kWidth = 160;
constexpr double kImageMib = kHeight * kWidth * 3.0 / (1024.0 * 1024.0);

Keyframe keyframe(int i, bool held_out) {
  Keyframe keyframe;
  keyframe.stamp_ns = i;
  keyframe.number = i / 2;  // of the held-out images
  keyframe.held_out = held_out;
  keyframe.intrinsics = {
      .fx = 100.0, .fy = 100.0, .cx = 80.0, .cy = 45.0, .width = kWidth, .height = kHeight};
  keyframe.T_camera_world = torch::eye(4, torch::kFloat64);
  keyframe.T_camera_world[0][3] = 0.1 * i;
  keyframe.image = torch::full({kHeight, kWidth, 3}, 100, torch::kUInt8);
  return keyframe;
}

// With large images a hundred held-out ones alone would exceed the memory.
TEST(KeyframeSelection, HeldOutImagesLeaveThreeQuartersOfTheMemoryToTraining) {
  OnlineOptions options;
  options.image_memory_mib = 40.0 * kImageMib;
  options.max_heldout_views = 100;
  options.recent_keyframes = 5;
  KeyframeSelection selection(options);
  KeyframeStore keyframes;
  for (int i = 0; i < 600; ++i) {
    keyframes.add(keyframe(i, i % 2 == 1));
    if (i % 2 == 1) selection.thin_held_out(keyframes);
    selection.limit_image_memory(keyframes);
  }
  EXPECT_LE(keyframes.held_out().size(), 10U);
  EXPECT_GE(keyframes.held_out().size(), 1U);
  EXPECT_GE(keyframes.training().size(), 30U);
  EXPECT_LE(static_cast<double>(keyframes.image_bytes()), 40.0 * kImageMib * 1024.0 * 1024.0);
}

}  // namespace
}  // namespace apvi::mapping
