// SPDX-License-Identifier: BSD-3-Clause
// Maps larger than the device.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <memory>

#include "mapping/long_wall.hpp"
#include "mapping/mapper.hpp"
#include "medium/medium_initialization.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::mapping {
namespace {

using test::bitwise_equal;
using test::camera_at;
using torch::Tensor;

TEST(MapperStorage, TheLimitIsThatOfTheDeviceNotOfTheMap) {
  const gaussians::Gaussians world = long_wall();
  const Mapper mapper = along_the_wall(world, options_with(100.0));
  EXPECT_LE(mapper.optimizer().size(), kLimit);
  EXPECT_GT(mapper.stored(), kLimit / 2);
  EXPECT_GT(mapper.size(), 1.5 * kLimit);
  EXPECT_EQ(mapper.snapshot().gaussians.size(), mapper.size());
  EXPECT_EQ(own_means(mapper, 0).size(0), 0);
  EXPECT_GT(own_means(mapper, 47).size(0), 0);
}

TEST(MapperStorage, WithoutMemoryForItTheMapItselfIsLimited) {
  const gaussians::Gaussians world = long_wall();
  const Mapper mapper = along_the_wall(world, options_with(0.0));
  EXPECT_EQ(mapper.stored(), 0);
  EXPECT_LE(mapper.size(), kLimit);
}

TEST(MapperStorage, StoredPartsStayAsGoodAsTheyWere) {
  const gaussians::Gaussians world = long_wall();
  Mapper mapper(options_with(100.0));
  for (int number = 0; number < 12; ++number) visit(mapper, world, number, number, 20);
  const double before = psnr(mapper, 0, 8);
  for (int number = 12; number < static_cast<int>(kLength_m); ++number) {
    visit(mapper, world, number, number, 20);
  }
  EXPECT_EQ(own_means(mapper, 0).size(0), 0);
  EXPECT_GT(psnr(mapper, 0, 8), before - 0.2);
}

TEST(MapperStorage, PartsReturnBeforeTheCameraSeesThem) {
  const gaussians::Gaussians world = long_wall();
  Mapper mapper = along_the_wall(world, options_with(100.0));
  const std::int64_t all = mapper.size();
  std::int64_t number = 1000;
  for (double x = kLength_m - 2.0; x >= 0.0; x -= 4.0) {
    MapperInput input;
    input.keyframe = test::render_keyframe(world, camera_at(x, 0.05), number++);
    mapper.add(input);
    EXPECT_GT(own_means(mapper, static_cast<std::int64_t>(x)).size(0), 0) << x;
    EXPECT_LE(mapper.optimizer().size(), kLimit);
  }
  EXPECT_EQ(mapper.size(), all);
}

TEST(MapperStorage, ImagesOfStoredPartsDoNotTakeTheMemoryOfTheOthers) {
  const gaussians::Gaussians world = long_wall();
  const auto kept_images = [&](double stored_memory_mib) {
    MapperOptions options = options_with(stored_memory_mib);
    options.online.image_memory_mib = 0.13;  // 29 of 48
    return along_the_wall(world, options).keyframes().training().size();
  };
  EXPECT_EQ(kept_images(100.0), 42U);  // all but those held out
  EXPECT_LT(kept_images(0.0), 29U);
}

TEST(MapperStorage, CorrectionsMoveStoredGaussians) {
  const gaussians::Gaussians world = long_wall();
  Mapper mapper = along_the_wall(world, options_with(100.0));
  const Tensor before = mapper.snapshot().gaussians.means.mean(0);
  Tensor motion = torch::eye(4, torch::kFloat64);
  motion[1][3] = 0.5;
  std::vector<LoopCorrection> corrections;
  for (std::size_t i = 0; i < mapper.keyframes().size(); ++i) {
    corrections.push_back({mapper.keyframes()[i].stamp_ns, motion});
  }
  mapper.correct(corrections);
  mapper.correct(corrections);
  const Tensor shift = mapper.snapshot().gaussians.means.mean(0) - before;
  EXPECT_NEAR(shift[0].item<double>(), 0.0, 1e-4);
  EXPECT_NEAR(shift[1].item<double>(), 1.0, 1e-4);
}

TEST(MapperStorage, TheFinalRefinementImprovesAllParts) {
  const gaussians::Gaussians world = long_wall();
  Mapper mapper = along_the_wall(world, options_with(100.0));
  const double first = psnr(mapper, 0, 16);
  const double last = psnr(mapper, 32, 48);
  mapper.begin_final();
  while (!mapper.final_done()) mapper.step();
  EXPECT_GT(psnr(mapper, 0, 16), first + 0.3);
  EXPECT_GT(psnr(mapper, 32, 48), last + 0.3);
  EXPECT_LE(mapper.optimizer().size(), kLimit);
}

TEST(MapperStorage, CheckpointsContainTheStoredParts) {
  const test::TmpDir tmp;
  const gaussians::Gaussians world = long_wall();
  const MapperOptions options = options_with(100.0);
  Mapper mapper = along_the_wall(world, options);
  mapper.save(tmp.path() / "checkpoint");
  Mapper resumed(options);
  resumed.resume(tmp.path() / "checkpoint");
  EXPECT_EQ(resumed.stored(), mapper.stored());
  EXPECT_TRUE(bitwise_equal(resumed.snapshot().gaussians, mapper.snapshot().gaussians));
  for (Mapper* one : {&mapper, &resumed}) {
    visit(*one, world, 0.5, 2000, 5);
    one->begin_final();
    for (int k = 0; k < 20; ++k) one->step();
  }
  EXPECT_TRUE(bitwise_equal(resumed.snapshot().gaussians, mapper.snapshot().gaussians));
}

TEST(MapperStorage, APreviewHasFewerGaussiansOfTheStoredParts) {
  const gaussians::Gaussians world = long_wall();
  const Mapper mapper = along_the_wall(world, options_with(100.0));
  const gaussians::Gaussians preview = mapper.preview().gaussians;
  EXPECT_LT(preview.size(), mapper.optimizer().size() + mapper.stored() / 4);
  EXPECT_LT(preview.means.select(1, 0).min().item<double>(), 1.0);
  const Mapper whole = along_the_wall(world, options_with(0.0));
  EXPECT_EQ(whole.preview().gaussians.size(), whole.size());
}

TEST(MapperStorage, PartsOfDifferentTimesReturnTogetherInAnyOrder) {
  const gaussians::Gaussians world = test::gaussian_wall();
  const KeyframeStore keyframes = test::render_keyframes(world);
  MapOptimizer optimizer(gaussians::Gaussians::empty(0, torch::kFloat32), TrainerOptions{}, 3);
  optimizer.insert(world, torch::arange(world.size(), torch::kInt64) % 9);
  GaussianStorage storage(std::make_shared<StorageFolder>("", 0.0));
  storage.add(optimizer.detach(optimizer.anchors() == 1));
  while (optimizer.full_map().log_gains.size(0) < 9) optimizer.add_view();
  storage.add(optimizer.detach(optimizer.anchors() == 7));
  const std::vector<DetachedGaussians> parts = storage.take({7, 1});
  ASSERT_EQ(parts.size(), 1U);
  EXPECT_EQ(parts[0].appearance->log_gains.size(0), 9);
  EXPECT_EQ(storage.size(), 0);
  EXPECT_EQ(storage.bytes(), 0);
  optimizer.start_medium(medium::coastal_medium(), keyframes);
  optimizer.attach(parts[0], keyframes);
  EXPECT_EQ(optimizer.size(), world.size());
}

TEST(MapperStorage, StoredGaussiansGetTheColorsOfAMediumFoundLater) {
  const gaussians::Gaussians world = test::gaussian_wall();
  const KeyframeStore keyframes = test::render_keyframes(world);
  const Tensor anchors = torch::arange(world.size(), torch::kInt64) % 9;
  const auto make = [&] {
    MapOptimizer optimizer(gaussians::Gaussians::empty(0, torch::kFloat32), TrainerOptions{}, 9);
    optimizer.insert(world, anchors);
    return optimizer;
  };
  const medium::Medium water = {.beta_d = torch::tensor({0.3, 0.1, 0.05}),
                                .beta_b = torch::tensor({0.2, 0.1, 0.1}),
                                .b_inf = torch::tensor({0.1, 0.3, 0.4})};
  MapOptimizer stored = make();
  const DetachedGaussians detached = stored.detach(stored.anchors() == 2);
  EXPECT_EQ(stored.size(), (anchors != 2).sum().item<std::int64_t>());
  stored.start_medium(water, keyframes);
  stored.attach(detached, keyframes);
  MapOptimizer present = make();
  present.start_medium(water, keyframes);
  const Tensor expected = present.map().sh_dc.index({anchors == 2});
  const Tensor found = stored.map().sh_dc.index({stored.anchors() == 2});
  const Tensor before = world.sh_dc.index({anchors == 2});
  const double change = (expected - before).abs().mean().item<double>();
  EXPECT_GT(change, 0.3);
  // Recolored from their own keyframe, not from all.
  EXPECT_LT((found - expected).abs().mean().item<double>(), 0.2 * change);
}

}  // namespace
}  // namespace apvi::mapping
