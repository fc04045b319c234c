// SPDX-License-Identifier: BSD-3-Clause
// Out-of-memory errors, simulated by the host allocator.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cstdint>
#include <string>

#include "mapping/density/initial_map.hpp"
#include "mapping/evaluation.hpp"
#include "mapping/training/trainer.hpp"
#include "support/out_of_memory.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::mapping {
namespace {

using test::gaussian_wall;
using test::OutOfMemoryAllocator;

constexpr int kMaxGaussians = 2500;

class TrainerMemory : public test::OutOfMemoryTest {
 protected:
  static TrainerOptions options() {
    TrainerOptions options;
    options.iterations = 120;
    options.sh_degree = 0;
    options.initial_downscale = 1;
    options.densify.kind = Densification::random;
    options.densify.gradient_threshold = 1e-5;
    options.densify.start_fraction = 0.0;
    options.densify.interval = 10;
    options.densify.random_per_round = 50;
    options.densify.max_gaussians = kMaxGaussians;
    return options;
  }
  gaussians::Gaussians rough_map() const {
    const gaussians::PointCloud points = {.positions = world_.means,
                                          .colors = torch::full({world_.size(), 3}, 0.5F)};
    return initial_map(points, {.sh_degree = 0});
  }
  Trainer trainer(const TrainerOptions& chosen = options()) {
    return {keyframes_, rough_map(), chosen};
  }
  static void run(Trainer& trainer, int steps) {
    for (int k = 0; k < steps; ++k) trainer.step();
  }
  double psnr(const Trainer& trainer) const {
    return mean_psnr(trainer.full_map(), keyframes_, keyframes_.training()).value();
  }

  gaussians::Gaussians world_ = gaussian_wall(1500);
  KeyframeStore keyframes_ = test::render_keyframes(world_);
};

TEST_F(TrainerMemory, AStepRecoversFromAnyFailedAllocation) {
  const int requests = [this] {
    Trainer whole = trainer();
    run(whole, 25);
    OutOfMemoryAllocator memory;
    run(whole, 20);
    return memory.request_count();
  }();
  ASSERT_GT(requests, 200);
  int cases = 0;
  int smaller = 0;
  for (int at = 0; at < requests; at += 23) {
    SCOPED_TRACE("request " + std::to_string(at));
    Trainer small = trainer();
    run(small, 25);
    {
      OutOfMemoryAllocator memory;
      memory.fail_after(at);
      ASSERT_NO_THROW(run(small, 20));
    }
    ++cases;
    if (small.max_gaussians() < kMaxGaussians) ++smaller;
    while (!small.done()) small.step();
    ASSERT_LE(small.size(), small.max_gaussians());
    ASSERT_EQ(small.map().size(), small.size());
    EXPECT_GT(psnr(small), 20.0);
  }
  // Except where the failing allocation is optional.
  EXPECT_GT(smaller, 0.9 * cases);
}

TEST_F(TrainerMemory, ThrowsWhenShrinkingDoesNotHelpAndCanStillSave) {
  Trainer stopped = trainer();
  run(stopped, 30);
  {
    OutOfMemoryAllocator memory;
    memory.fail_after(100, 1000000);
    EXPECT_THROW(run(stopped, 30), c10::OutOfMemoryError);
  }
  const test::TmpDir dir;
  stopped.save(dir.path() / "checkpoint.pt");
  Trainer resumed = trainer();
  resumed.resume(dir.path() / "checkpoint.pt");
  EXPECT_EQ(resumed.size(), stopped.size());
  while (!resumed.done()) resumed.step();
  EXPECT_GT(psnr(resumed), 20.0);
}

TEST_F(TrainerMemory, ResumesWithFewerGaussiansAndStaysWithinTheLimit) {
  Trainer stopped = trainer();
  run(stopped, 30);
  const test::TmpDir dir;
  stopped.save(dir.path() / "checkpoint.pt");
  TrainerOptions fewer = options();
  fewer.densify.max_gaussians = 1000;  // less than the initial number
  Trainer resumed = trainer(fewer);
  resumed.resume(dir.path() / "checkpoint.pt");
  EXPECT_EQ(resumed.size(), 1000);
  run(resumed, 30);
  EXPECT_LE(resumed.size(), 1000);
}

}  // namespace
}  // namespace apvi::mapping
