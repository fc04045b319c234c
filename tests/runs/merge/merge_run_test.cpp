// SPDX-License-Identifier: BSD-3-Clause
#include "runs/merge/merge_run.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "eval/metrics_file.hpp"
#include "gaussians/model/point_cloud.hpp"
#include "map_io/ply.hpp"
#include "runs/maps/mapping_run.hpp"
#include "runs/merge/merge_frame.hpp"
#include "runs/merge/merge_input.hpp"
#include "runs/views/render_run.hpp"
#include "support/wall_recording.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

gaussians::Gaussians dim(gaussians::Gaussians map, const torch::Tensor& light) {
  map.sh_dc = gaussians::color_to_sh_dc(gaussians::sh_dc_to_color(map.sh_dc) * light);
  return map;
}

/// Two mapped dives at one wall, the second in dimmer, bluer light.
class MergeRunTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    dives_ = std::make_unique<std::array<test::TmpDir, 2>>();
    const gaussians::Gaussians wall = test::gaussian_wall();
    test::write_wall_recording(first(), wall);
    test::write_wall_recording(second(), dim(wall, torch::tensor({0.4F, 0.6F, 0.8F})));
    for (const test::TmpDir* dive : {&first(), &second()}) {
      run_mapping(test::wall_config(*dive, 200), {.folder = dive->path() / "run"});
    }
  }
  static void TearDownTestSuite() { dives_.reset(); }

  static test::TmpDir& first() { return (*dives_)[0]; }
  static test::TmpDir& second() { return (*dives_)[1]; }
  fs::path out() const { return out_.path() / "merged"; }
  MergeRequest request() const {
    return {.runs = {first().path() / "run", second().path() / "run"},
            .folder = out(),
            .iterations = 100,
            .same_frame = true};
  }
  static std::string error_of(const MergeRequest& request) {
    try {
      merge_runs(request);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }

  static std::unique_ptr<std::array<test::TmpDir, 2>> dives_;
  test::TmpDir out_;
};
std::unique_ptr<std::array<test::TmpDir, 2>> MergeRunTest::dives_;

TEST_F(MergeRunTest, EverySessionGetsTheMapInItsOwnLight) {
  const MergeResult result = merge_runs(request());
  ASSERT_EQ(result.psnr_db.size(), 2U);
  const eval::Json sessions = eval::read_metrics(out() / "metrics.json")["sessions"];
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_GT(result.psnr_db[i], sessions[i]["psnr_own_map_db"].get<double>() - 0.3) << i;
    EXPECT_EQ(sessions[i]["heldout_views"], 3);
  }
  const auto mean_color = [this](std::size_t session) {
    const gaussians::Gaussians map = map_io::read_ply(session_folder(out(), session) / "map.ply");
    EXPECT_LT(map.size(), 420);
    return gaussians::sh_dc_to_color(map.sh_dc).mean(0);
  };
  const torch::Tensor light = mean_color(1) / mean_color(0);
  EXPECT_TRUE(torch::allclose(light / light[2], torch::tensor({0.5F, 0.75F, 1.0F}), 0.05)) << light;
}

TEST_F(MergeRunTest, ItsFoldersAreRunsThatCanBeRendered) {
  merge_runs(request());
  for (const std::size_t session : {0, 1}) {
    EXPECT_EQ(render_run({.source = session_folder(out(), session), .out = out() / "views"}), 9U);
  }
  EXPECT_TRUE(fs::exists(out() / "session2/renders/1000000000_render.png"));
}

TEST_F(MergeRunTest, ResumesWhereItWasInterrupted) {
  MergeRequest whole = request();
  merge_runs(whole);
  const gaussians::Gaussians map = map_io::read_ply(out() / "map.ply");
  MergeRequest part = request();
  part.folder = out_.path() / "part";
  int steps = 0;
  part.interrupted = [&steps] { return ++steps == 40; };
  EXPECT_TRUE(merge_runs(part).interrupted);
  part.interrupted = [] { return false; };
  part.resume = true;
  EXPECT_EQ(merge_runs(part).iterations, 100);
  EXPECT_TRUE(test::bitwise_equal(map, map_io::read_ply(part.folder / "map.ply")));
}

TEST_F(MergeRunTest, RejectsRunsThatCannotBeMerged) {
  MergeRequest twice = request();
  twice.runs[1] = twice.runs[0];
  EXPECT_THAT(error_of(twice), HasSubstr("given twice"));
  MergeRequest itself = request();
  itself.folder = itself.runs[1];
  EXPECT_THAT(error_of(itself), HasSubstr("cannot replace one of its runs"));
  MergeRequest without_map = request();
  without_map.runs[1] = second().path();
  EXPECT_THAT(error_of(without_map), HasSubstr("is this the folder of a run with a map?"));
  MergeRequest missing = request();
  missing.runs[1] = "/nowhere";
  EXPECT_THAT(error_of(missing), HasSubstr("/nowhere: not a folder"));
  EXPECT_FALSE(fs::exists(out()));
}

TEST_F(MergeRunTest, KeepsAnExistingFolderUnlessToldToOverwrite) {
  MergeRequest again = request();
  again.iterations = 2;
  merge_runs(again);
  EXPECT_THAT(error_of(again), HasSubstr("--overwrite"));
  again.overwrite = true;
  EXPECT_EQ(merge_runs(again).iterations, 2);
}

TEST(MoveSession, MovesGaussiansWithTheirNearestCamera) {
  MergeSession session;
  session.map.gaussians = test::gaussian_wall();
  const auto pose = [](double x, double dx) {
    return StampedPose{Stamp{static_cast<std::int64_t>(1e9 * (x + 3.0))},
                       SE3{Eigen::Quaterniond::Identity(), {x + dx, 0.0, 0.0}}};
  };
  session.poses.poses = {pose(-1.0, 0.0), pose(1.0, 0.0)};
  Trajectory moved;
  moved.poses = {pose(-1.0, 0.1), pose(1.0, 0.3)};
  const torch::Tensor before = session.map.gaussians.means.clone();
  move_session(session, moved);
  const torch::Tensor dx = (session.map.gaussians.means - before).select(1, 0);
  const torch::Tensor expected = torch::where(before.select(1, 0) < 0.0, 0.1F, 0.3F);
  EXPECT_TRUE(torch::allclose(dx, expected, 0.0, 1e-5));
}

TEST(MovedLike, FollowsTheSlowPartOfTheChangeOnly) {
  Trajectory poses;
  Trajectory corrected;
  for (int i = 0; i < 100; ++i) {
    const double s = 0.1 * i;
    const SE3 T{Eigen::Quaterniond::Identity(), {s, 0.0, -2.0}};
    poses.poses.push_back({Stamp{static_cast<std::int64_t>(1e9 * s)}, T});
    const double noise = i % 2 == 0 ? 0.05 : -0.05;
    const SE3 change{so3::exp({0.0, 0.0, 0.01}), {0.02 * s, 0.3 + noise, 0.0}};
    corrected.poses.push_back({poses.poses.back().stamp,
                               {change.rotation * T.rotation, T.translation + change.translation}});
  }
  const Trajectory moved = moved_like(poses, corrected);
  for (int i = 25; i < 75; ++i) {
    const SE3& T = moved.poses[static_cast<std::size_t>(i)].T_world_body;
    EXPECT_NEAR(T.translation.x(), 1.02 * 0.1 * i, 2e-3);
    EXPECT_NEAR(T.translation.y(), 0.3, 2e-3);
    EXPECT_NEAR(so3::log(T.rotation).z(), 0.01, 1e-6);
  }
}

TEST(MovedLike, PosesBeyondTheCorrectedOnesMoveLikeTheNearest) {
  Trajectory poses;
  for (int i = 0; i < 3; ++i) poses.poses.push_back({Stamp{10000000000LL * i}, SE3::identity()});
  Trajectory corrected;
  corrected.poses = {{Stamp{0}, {Eigen::Quaterniond::Identity(), {1.0, 0.0, 0.0}}},
                     {Stamp{1000000000LL}, {Eigen::Quaterniond::Identity(), {1.0, 0.0, 0.0}}}};
  EXPECT_DOUBLE_EQ(moved_like(poses, corrected).poses[2].T_world_body.translation.x(), 1.0);
}

TEST_F(MergeRunTest, NamesWhatItMissesToFindTheRunsInEachOther) {
  MergeRequest without_places = request();
  without_places.same_frame = false;
  EXPECT_THAT(error_of(without_places), HasSubstr("--same-frame"));
  EXPECT_FALSE(fs::exists(out()));
}

}  // namespace
}  // namespace apvi::runs
