// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/keyframes/keyframe_store.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <map>

#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using test::tensors_near;
using torch::Tensor;

Keyframe make_keyframe(std::int64_t height, std::int64_t width, bool held_out = false) {
  torch::manual_seed(5);
  Keyframe keyframe;
  keyframe.name = "a";
  keyframe.intrinsics = {.fx = 100.0,
                         .fy = 90.0,
                         .cx = 4.5,
                         .cy = 3.0,
                         .width = static_cast<int>(width),
                         .height = static_cast<int>(height)};
  keyframe.T_camera_world = torch::eye(4, torch::kFloat64);
  keyframe.image = torch::randint(0, 256, {height, width, 3}, torch::kUInt8);
  keyframe.held_out = held_out;
  return keyframe;
}

TEST(KeyframeStore, DownscalingAveragesPixels) {
  KeyframeStore store;
  store.add(make_keyframe(7, 9));
  const Tensor full = store.image(0, 1, torch::kCPU);
  const Tensor half = store.image(0, 2, torch::kCPU);
  EXPECT_EQ(half.sizes(), at::IntArrayRef({3, 4, 3}));
  const Tensor block = full.slice(0, 2, 4).slice(1, 6, 8).mean(std::vector<std::int64_t>{0, 1});
  EXPECT_TRUE(tensors_near(half[1][3], block, 1e-6));
}

TEST(KeyframeStore, DownscaledCameraMatchesDownscaledImage) {
  KeyframeStore store;
  store.add(make_keyframe(7, 9));
  const gaussians::Intrinsics camera = store.view(0, 2).intrinsics;
  EXPECT_EQ(camera.width, 4);
  EXPECT_EQ(camera.height, 3);
  EXPECT_DOUBLE_EQ(camera.fx * 0.1 + camera.cx, 0.5 * (100.0 * 0.1 + 4.5));
  EXPECT_DOUBLE_EQ(camera.fy * -0.1 + camera.cy, 0.5 * (90.0 * -0.1 + 3.0));
}

TEST(KeyframeStore, SeparatesHeldOutImages) {
  KeyframeStore store;
  for (int i = 0; i < 5; ++i) store.add(make_keyframe(4, 4, i % 2 == 0));
  EXPECT_EQ(store.held_out(), (std::vector<std::size_t>{0, 2, 4}));
  EXPECT_EQ(store.training(), (std::vector<std::size_t>{1, 3}));
}

TEST(KeyframeStore, FlagsSaturatedImages) {
  KeyframeStore store;
  Keyframe even = make_keyframe(30, 40);
  even.image.fill_(200);
  Keyframe glare = even;
  glare.image = even.image.clone();
  glare.image.slice(0, 0, 4).select(2, 2).fill_(253);
  store.add(even);
  store.add(glare);
  EXPECT_FALSE(store[0].saturates);
  EXPECT_TRUE(store[1].saturates);
}

TEST(KeyframeStore, RejectsImagesOfWrongSizeOrType) {
  KeyframeStore store;
  Keyframe keyframe = make_keyframe(4, 4);
  keyframe.intrinsics.width = 5;
  EXPECT_THROW(store.add(keyframe), c10::Error);
  keyframe = make_keyframe(4, 4);
  keyframe.image = keyframe.image.to(torch::kFloat32);
  EXPECT_THROW(store.add(keyframe), c10::Error);
}

TEST(SceneExtent, IsTheScaledCameraRadius) {
  KeyframeStore store;
  for (const double x : {-1.0, 3.0, 1.0}) {
    Keyframe keyframe = make_keyframe(4, 4);
    keyframe.T_camera_world[0][3] = -x;
    store.add(keyframe);
  }
  EXPECT_DOUBLE_EQ(scene_extent(store), 1.1 * 2.0);
}

TEST(KeyframeStore, OrdersKeyframesByStampWithAndWithoutImages) {
  KeyframeStore store;
  for (const std::int64_t stamp_ns : {30, 10, 20}) {
    Keyframe keyframe = make_keyframe(6, 9);
    keyframe.stamp_ns = stamp_ns;
    if (stamp_ns == 20) keyframe.image = Tensor();
    store.add(keyframe);
  }
  EXPECT_EQ(store.by_stamp(), (std::map<std::int64_t, std::size_t>{{10, 1}, {20, 2}, {30, 0}}));
  store.drop_image(1);
  EXPECT_EQ(store.by_stamp().count(10), 1U);
}

TEST(KeyframeStore, AReducedPixelIsSceneIfAllOfItIs) {
  KeyframeStore store;
  const Tensor scene = torch::ones({7, 9}, torch::kBool);
  scene[2][5] = false;
  store.set_mask(scene);
  store.add(make_keyframe(7, 9));
  EXPECT_TRUE(torch::equal(store.scene(0, 1, torch::kCPU), scene));
  const Tensor half = store.scene(0, 2, torch::kCPU);
  EXPECT_EQ(half.sizes(), at::IntArrayRef({3, 4}));
  EXPECT_FALSE(half[1][2].item<bool>());
  EXPECT_EQ(half.sum().item<int>(), 11);
  EXPECT_THROW(store.set_mask(torch::ones({7, 9})), c10::Error);
}

TEST(KeyframeStore, AnImageCanHideMoreThanTheCameraDoes) {
  const Tensor of_camera = torch::ones({7, 9}, torch::kBool);
  of_camera[0].fill_(false);
  Keyframe diver = make_keyframe(7, 9);
  diver.scene = torch::ones({7, 9}, torch::kBool);
  diver.scene.select(1, 3).fill_(false);
  KeyframeStore plain;
  plain.add(make_keyframe(7, 9));
  plain.add(diver);
  EXPECT_FALSE(plain.scene(0, 1, torch::kCPU).defined());
  EXPECT_EQ(plain.scene(1, 1, torch::kCPU).sum().item<int>(), 7 * 8);
  KeyframeStore masked;
  masked.set_mask(of_camera);
  masked.add(make_keyframe(7, 9));
  masked.add(diver);
  EXPECT_EQ(masked.scene(0, 1, torch::kCPU).sum().item<int>(), 6 * 9);
  EXPECT_EQ(masked.scene(1, 1, torch::kCPU).sum().item<int>(), 6 * 8);
  diver.scene = torch::ones({7, 8}, torch::kBool);
  EXPECT_THROW(plain.add(diver), c10::Error);
}

}  // namespace
}  // namespace apvi::mapping
