// SPDX-License-Identifier: BSD-3-Clause
// Out-of-memory errors, simulated by the host allocator.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include "mapping/evaluation.hpp"
#include "mapping/mapper.hpp"
#include "mapping/mapper_scene.hpp"
#include "support/out_of_memory.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::mapping {
namespace {

using test::camera_at;
using test::gaussian_wall;
using test::OutOfMemoryAllocator;
using torch::Tensor;

constexpr int kKeyframes = 4;

class MapperMemory : public test::OutOfMemoryTest {
 protected:
  static MapperOptions options() {
    MapperOptions options = small_map_options();
    options.trainer.densify.kind = Densification::gradient;
    options.trainer.densify.gradient_threshold = 1e-5;
    options.trainer.densify.interval = 10;
    options.trainer.densify.max_gaussians = 4000;
    return options;
  }
  void add(Mapper& mapper, int number) const {
    MapperInput input;
    input.keyframe = test::render_keyframe(world_, camera_at(0.1 * number, 0.0), number);
    input.points = points_of(world_, 1000 * std::int64_t{number});
    mapper.add(input);
  }
  void train(Mapper& mapper) const {
    for (int number = 0; number < kKeyframes; ++number) {
      add(mapper, number);
      for (int k = 0; k < 15; ++k) mapper.step();
    }
  }
  static double psnr(const Mapper& mapper) {
    return mean_psnr(mapper.map(), mapper.keyframes(), mapper.keyframes().training()).value();
  }
  static void expect_consistent(const Mapper& mapper) {
    const gaussians::Gaussians map = mapper.snapshot().gaussians;
    for (const Tensor* t : map.tensors()) {
      ASSERT_EQ(t->size(0), mapper.size());
      ASSERT_TRUE(torch::isfinite(*t).all().item<bool>());
    }
    ASSERT_EQ(mapper.optimizer().importance().size(0), mapper.size());
    ASSERT_LE(mapper.size(), mapper.max_gaussians());
  }

  gaussians::Gaussians world_ = gaussian_wall(600);
};

TEST_F(MapperMemory, AStepRecoversFromAnyFailedAllocation) {
  const int requests = [this] {
    Mapper mapper(options());
    train(mapper);
    OutOfMemoryAllocator memory;
    for (int k = 0; k < 40; ++k) mapper.step();
    return memory.request_count();
  }();
  ASSERT_GT(requests, 400);
  int cases = 0;
  int smaller = 0;
  for (int at = 0; at < requests; at += 19) {
    SCOPED_TRACE("request " + std::to_string(at));
    Mapper mapper(options());
    train(mapper);
    const std::int64_t before = mapper.size();
    {
      OutOfMemoryAllocator memory;
      memory.fail_after(at);
      for (int k = 0; k < 40; ++k) ASSERT_NO_THROW(mapper.step());
    }
    ++cases;
    if (mapper.max_gaussians() < 4000) ++smaller;
    EXPECT_GT(mapper.max_gaussians(), before / 2);
    expect_consistent(mapper);
    add(mapper, kKeyframes);
    for (int k = 0; k < 40; ++k) mapper.step();
    expect_consistent(mapper);
    EXPECT_GT(psnr(mapper), 25.0);
  }
  // Except where the failing allocation is optional.
  EXPECT_GT(smaller, 0.9 * cases);
}

// Allocations before the map exists cannot be recovered by shrinking it.
TEST_F(MapperMemory, AFailedKeyframeLeavesAValidMap) {
  const int requests = [this] {
    Mapper mapper(options());
    train(mapper);
    OutOfMemoryAllocator memory;
    add(mapper, kKeyframes);
    return memory.request_count();
  }();
  ASSERT_GT(requests, 50);
  const test::TmpDir dir;
  int refused = 0;
  for (int at = 0; at < requests; ++at) {
    SCOPED_TRACE("request " + std::to_string(at));
    Mapper mapper(options());
    train(mapper);
    {
      OutOfMemoryAllocator memory;
      memory.fail_after(at);
      try {
        add(mapper, kKeyframes);
      } catch (const c10::OutOfMemoryError&) {
        ++refused;
      }
    }
    mapper.save(dir.path() / "checkpoint.pt");
    Mapper resumed(options());
    resumed.resume(dir.path() / "checkpoint.pt");
    add(resumed, kKeyframes + 1);
    for (int k = 0; k < 20; ++k) resumed.step();
    expect_consistent(resumed);
    EXPECT_GT(psnr(resumed), 25.0);
  }
  EXPECT_GT(requests - refused, 20);
}

TEST_F(MapperMemory, ThrowsWhenShrinkingDoesNotHelpAndCanStillSave) {
  Mapper mapper(options());
  train(mapper);
  {
    OutOfMemoryAllocator memory;
    memory.fail_after(100, 1000000);
    const auto step = [&mapper] { mapper.step(); };
    EXPECT_THROW(for (int k = 0; k < 100; ++k) step(), c10::OutOfMemoryError);
  }
  EXPECT_GT(mapper.size(), 100);
  const test::TmpDir dir;
  mapper.save(dir.path() / "checkpoint.pt");
  Mapper again(options());
  again.resume(dir.path() / "checkpoint.pt");
  EXPECT_EQ(again.size(), mapper.size());
  EXPECT_GT(psnr(again), 15.0);
}

TEST_F(MapperMemory, ResumesWithTheMostImportantGaussians) {
  Mapper mapper(options());
  train(mapper);
  const test::TmpDir dir;
  mapper.save(dir.path() / "checkpoint.pt");
  MapperOptions fewer = options();
  fewer.trainer.densify.max_gaussians = static_cast<int>(mapper.size() * 3 / 4);
  Mapper resumed(fewer);
  resumed.resume(dir.path() / "checkpoint.pt");
  ASSERT_EQ(resumed.size(), fewer.trainer.densify.max_gaussians);
  const Tensor all = mapper.optimizer().importance();
  const Tensor kept = resumed.optimizer().importance();
  EXPECT_GE(kept.min().item<double>(),
            std::get<0>(all.topk(resumed.size())).min().item<double>() - 1e-6);
  for (int k = 0; k < 20; ++k) resumed.step();
  EXPECT_LE(resumed.size(), fewer.trainer.densify.max_gaussians);
}

}  // namespace
}  // namespace apvi::mapping
