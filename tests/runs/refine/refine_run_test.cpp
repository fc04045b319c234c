// SPDX-License-Identifier: BSD-3-Clause
#include "runs/refine/refine_run.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <nlohmann/json.hpp>
#include <thread>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "core/task_claim.hpp"
#include "eval/metrics_file.hpp"
#include "map_io/ply.hpp"
#include "runs/maps/mapping_run.hpp"
#include "runs/refine/refine_task.hpp"
#include "runs/refine/refine_workers.hpp"
#include "runs/views/render_run.hpp"
#include "support/wall_recording.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

/// A mapped dive at a wall, with room for improvement.
class RefineRunTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    dive_ = std::make_unique<test::TmpDir>();
    test::write_wall_recording(*dive_, test::gaussian_wall());
    RunConfig config = test::wall_config(*dive_, 20);
    config.mapping.trainer.gain_compensation = true;
    run_mapping(config, {.folder = run()});
  }
  static void TearDownTestSuite() { dive_.reset(); }

  static fs::path run() { return dive_->path() / "run"; }
  RefineRequest request(const std::string& name) const {
    return {.run = run(),
            .folder = out_.path() / name,
            .plan = {.blocks = 3, .rounds = 2, .steps_per_image = 12}};
  }
  gaussians::Gaussians map_of(const std::string& name) const {
    return map_io::read_ply(out_.path() / name / "map.ply");
  }
  static std::string error_of(const RefineRequest& request) {
    try {
      refine_run(request);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }

  static std::unique_ptr<test::TmpDir> dive_;
  test::TmpDir out_;
};
std::unique_ptr<test::TmpDir> RefineRunTest::dive_;

TEST_F(RefineRunTest, ImprovesTheMap) {
  const RefineResultSummary result = refine_run(request("refined"));
  EXPECT_FALSE(result.interrupted);
  EXPECT_GT(result.psnr_db, result.psnr_before_db + 1.0);
  EXPECT_EQ(result.gaussians, 400);
  const eval::Json metrics = eval::read_metrics(out_.path() / "refined/metrics.json");
  EXPECT_EQ(metrics["refine"]["blocks"], 3);
  EXPECT_EQ(metrics["refine"]["images"], 6);
  EXPECT_DOUBLE_EQ(metrics["mapping"]["psnr_db"].get<double>(), result.psnr_db);
}

TEST_F(RefineRunTest, ItsFolderIsARunThatCanBeRendered) {
  refine_run(request("refined"));
  EXPECT_EQ(render_run({.source = out_.path() / "refined", .out = out_.path() / "views"}), 9U);
  EXPECT_EQ(io::read_trajectory(out_.path() / "refined/keyframes.tum").size(), 9U);
  EXPECT_FALSE(fs::exists(out_.path() / "refined/refine"));
}

TEST_F(RefineRunTest, NeverTrainsOnHeldOutImages) {
  RefineRequest part = request("part");
  part.interrupted = [] { return true; };
  EXPECT_TRUE(refine_run(part).interrupted);
  const RefinePlan plan = read_plan(part.folder);
  ASSERT_EQ(plan.images.size(), 6U);
  for (const RefineImage& image : plan.images) {
    // Images 1, 5 and 9 of nine, one a second.
    EXPECT_NE((image.image.ns / 1'000'000'000 - 1) % 4, 0);
  }
}

TEST_F(RefineRunTest, EveryTrainingImageAndGaussianBelongsToOneBlock) {
  RefineRequest part = request("part");
  part.interrupted = [] { return true; };
  refine_run(part);
  const RefinePlan plan = read_plan(part.folder);
  std::vector<int> owners(plan.images.size(), 0);
  for (std::size_t b = 0; b < plan.blocks.size(); ++b) {
    EXPECT_FALSE(plan.blocks[b].images.empty());
    EXPECT_THAT(plan.blocks[b].neighbors, testing::Contains(static_cast<int>(b)));
    for (const std::size_t i : plan.blocks[b].images) {
      owners[i] += plan.images[i].owner == static_cast<int>(b) ? 1 : 0;
    }
  }
  EXPECT_THAT(owners, testing::Each(1));
}

TEST_F(RefineRunTest, GivesTheSameMapWhenInterruptedAndResumed) {
  refine_run(request("whole"));
  RefineRequest part = request("part");
  int polls = 0;
  part.interrupted = [&polls] { return ++polls == 20; };
  EXPECT_TRUE(refine_run(part).interrupted);
  EXPECT_FALSE(fs::exists(part.folder / "map.ply"));
  part.interrupted = [] { return false; };
  part.resume = true;
  EXPECT_FALSE(refine_run(part).interrupted);
  EXPECT_TRUE(test::bitwise_equal(map_of("whole"), map_of("part")));
}

TEST_F(RefineRunTest, GivesTheSameMapWithSeveralWorkers) {
  refine_run(request("one"));
  RefineRequest two = request("two");
  two.interrupted = [] { return true; };
  refine_run(two);
  const auto never = [] { return false; };
  std::thread other([&] { EXPECT_TRUE(join_refinement(two.folder, 1, never)); });
  EXPECT_TRUE(join_refinement(two.folder, 1, never));
  other.join();
  two.interrupted = never;
  two.resume = true;
  refine_run(two);
  EXPECT_TRUE(test::bitwise_equal(map_of("one"), map_of("two")));
}

TEST_F(RefineRunTest, GivesTheSameMapInTwoProcesses) {
  RefineRequest one = request("one");
  one.threads = 1;
  refine_run(one);
  RefineRequest two = request("two");
  two.devices = 2;
  two.threads = 2;
  two.program = APVI_PROGRAM;
  EXPECT_FALSE(refine_run(two).interrupted);
  EXPECT_TRUE(test::bitwise_equal(map_of("one"), map_of("two")));
}

TEST_F(RefineRunTest, SaysWhyItsProcessesFail) {
  RefineRequest two = request("two");
  two.devices = 2;
  two.program = "/bin/false";
  try {
    refine_run(two);
    FAIL();
  } catch (const RunError& error) {
    EXPECT_THAT(error.what(), HasSubstr("exit status 1"));
    EXPECT_THAT(error.what(), HasSubstr("--resume tries again"));
  }
}

TEST_F(RefineRunTest, DoesATaskAgainWhoseProcessHasDied) {
  refine_run(request("whole"));
  RefineRequest part = request("part");
  part.interrupted = [] { return true; };
  refine_run(part);
  // A claim of a process that does not exist.
  out_.write("part/refine/round1_block2.claim", "nowhere 1 1 0.5\n");
  DeadClaims dead(0.0);
  EXPECT_TRUE(dead.remove_if_dead(part.folder / "refine/round1_block2.claim"));
  part.interrupted = [] { return false; };
  part.resume = true;
  refine_run(part);
  EXPECT_TRUE(test::bitwise_equal(map_of("whole"), map_of("part")));
}

TEST_F(RefineRunTest, NamesADamagedResult) {
  RefineRequest part = request("part");
  int polls = 0;
  part.interrupted = [&polls] { return ++polls == 100; };
  refine_run(part);
  out_.write("part/refine/round1_block1.pt", "not an archive");
  part.interrupted = [] { return false; };
  part.resume = true;
  EXPECT_THAT(error_of(part), HasSubstr("round1_block1.pt"));
}

TEST_F(RefineRunTest, RejectsRunsThatCannotBeRefined) {
  RefineRequest itself = request("x");
  itself.folder = run();
  EXPECT_THAT(error_of(itself), HasSubstr("cannot replace the run itself"));
  RefineRequest missing = request("x");
  missing.run = "/nowhere";
  EXPECT_THAT(error_of(missing), HasSubstr("/nowhere: not a folder"));
  RefineRequest without_map = request("x");
  without_map.run = dive_->path();
  EXPECT_THAT(error_of(without_map), HasSubstr("is this the folder of a run with a map?"));
  RefineRequest nothing = request("x");
  nothing.resume = true;
  EXPECT_THAT(error_of(nothing), HasSubstr("is no refinement"));
}

}  // namespace
}  // namespace apvi::runs
