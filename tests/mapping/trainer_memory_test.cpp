// SPDX-License-Identifier: BSD-3-Clause
// A device whose memory ends, with the host's in its place.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cstdint>
#include <string>

#include "apvi/mapping/evaluation.hpp"
#include "apvi/mapping/initial_map.hpp"
#include "apvi/mapping/trainer.hpp"
#include "support/ending_memory.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::mapping {
namespace {

using test::EndingMemory;
using test::wall_of_gaussians;

constexpr int kMost = 2500;

class TrainerMemory : public test::EndingMemoryTest {
 protected:
  static TrainerOptions options() {
    TrainerOptions options;
    options.iterations = 120;
    options.sh_degree = 0;
    options.coarsest = 1;
    options.densify.kind = Densification::random;
    options.densify.gradient_threshold = 1e-5;
    options.densify.begin = 0.0;
    options.densify.interval = 10;
    options.densify.random_per_round = 50;
    options.densify.max_gaussians = kMost;
    return options;
  }
  splat::Gaussians rough_map() const {
    const splat::PointCloud points = {.positions = world_.means,
                                      .colors = torch::full({world_.size(), 3}, 0.5F)};
    return initial_map(points, {.sh_degree = 0});
  }
  Trainer trainer(const TrainerOptions& chosen = options()) const {
    return {keyframes_, rough_map(), chosen};
  }
  static void run(Trainer& trainer, int steps) {
    for (int k = 0; k < steps; ++k) trainer.step();
  }
  double psnr(const Trainer& trainer) const {
    return mean_psnr(trainer.whole_map(), keyframes_, keyframes_.training()).value();
  }

  splat::Gaussians world_ = wall_of_gaussians(1500);
  KeyframeStore keyframes_ = test::photographs(world_);
};

TEST_F(TrainerMemory, WhereverItEndsTheTrainingGoesOnSmaller) {
  const int requests = [this] {
    Trainer whole = trainer();
    run(whole, 25);
    EndingMemory memory;
    run(whole, 20);
    return memory.asked();
  }();
  ASSERT_GT(requests, 200);
  int cases = 0;
  int smaller = 0;
  for (int at = 0; at < requests; at += 23) {
    SCOPED_TRACE("request " + std::to_string(at));
    Trainer small = trainer();
    run(small, 25);
    {
      EndingMemory memory;
      memory.end(at);
      ASSERT_NO_THROW(run(small, 20));
    }
    ++cases;
    if (small.most_gaussians() < kMost) ++smaller;
    while (!small.done()) small.step();
    ASSERT_LE(small.size(), small.most_gaussians());
    ASSERT_EQ(small.map().size(), small.size());
    EXPECT_GT(psnr(small), 20.0);
  }
  // But where it can do without.
  EXPECT_GT(smaller, 0.9 * cases);
}

TEST_F(TrainerMemory, WhereLessDoesNotHelpItSaysSoAndTheMapCanBeSaved) {
  Trainer stopped = trainer();
  run(stopped, 30);
  {
    EndingMemory memory;
    memory.end(100, 1000000);
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

TEST_F(TrainerMemory, AMapIsResumedWithFewerAndGrowsNoLarger) {
  Trainer stopped = trainer();
  run(stopped, 30);
  const test::TmpDir dir;
  stopped.save(dir.path() / "checkpoint.pt");
  TrainerOptions fewer = options();
  fewer.densify.max_gaussians = 1000;  // than it began with, too
  Trainer resumed = trainer(fewer);
  resumed.resume(dir.path() / "checkpoint.pt");
  EXPECT_EQ(resumed.size(), 1000);
  run(resumed, 30);
  EXPECT_LE(resumed.size(), 1000);
}

}  // namespace
}  // namespace apvi::mapping
