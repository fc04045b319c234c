// SPDX-License-Identifier: BSD-3-Clause
#include "runs/diff/diff_run.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "change/two_dives.hpp"
#include "map_io/map_file.hpp"
#include "slam/camera_conversion.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr const char* kConfig =
    "dataset: {path: dive}\nlocalization: {enabled: false}\nrig:\n  body: imu0\n  world: up\n"
    "  cam0:\n    model: pinhole\n    intrinsics: [130, 130, 79.5, 59.5]\n    resolution: [160, "
    "120]\n"
    "    T_body_sensor: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n";
constexpr map_io::Origin kFar = {691200.0, 5331200.0, 0.0};

class DiffRuns : public testing::Test {
 protected:
  /// A run folder; `origin` is that of its map.
  fs::path write_run(const std::string& name, const gaussians::Gaussians& gaussians,
                     const map_io::Origin& origin = kFar) const {
    const fs::path run = dir_.write(name + "/resolved.yaml", kConfig).parent_path();
    map_io::MapFile file{.gaussians = gaussians, .origin = origin};
    const torch::Tensor shift =
        torch::tensor({kFar[0] - origin[0], kFar[1] - origin[1], kFar[2] - origin[2]});
    file.gaussians.means = gaussians.means + shift.to(torch::kFloat32);
    map_io::write_map(run / "map.ply", file);
    Trajectory poses;
    for (const gaussians::View& view : test::views_over(-1.0, 1.0)) {
      SE3 pose = slam::to_se3(view.T_camera_world).inverse();
      pose.translation += Eigen::Vector3d(kFar[0], kFar[1], kFar[2]);
      poses.poses.push_back(
          {Stamp{static_cast<std::int64_t>(poses.size() + 1) * 1000000000}, pose});
    }
    io::write_tum(run / "keyframes.tum", poses);
    return run;
  }
  fs::path write_floor(const std::string& name) const {
    return write_run(name, test::floor_at(-2.0));
  }
  fs::path write_floor_with_box(const std::string& name) const {
    return write_run(name, test::joined(test::floor_at(-2.0), test::box_on(-2.0, 0.4, -0.3, 0.2)),
                     {691300.0, 5331200.0, 0.0});
  }
  static std::string message_of(const DiffRequest& request) {
    try {
      diff_runs(request);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }

  test::TmpDir dir_;
};

TEST_F(DiffRuns, ABoxIsListedInTheCoordinatesOfTheRecording) {
  const fs::path out = dir_.path() / "changes";
  const DiffSummary found =
      diff_runs({.before = write_floor("a"), .after = write_floor_with_box("b"), .out = out});
  EXPECT_EQ(found.appeared, 1U);
  EXPECT_EQ(found.vanished + found.color, 0U);
  std::ifstream in(out / "changes.json");
  const auto json = nlohmann::json::parse(in);
  ASSERT_EQ(json.at("changes").size(), 1U);
  const auto& change = json.at("changes")[0];
  EXPECT_EQ(change.at("kind"), "appeared");
  EXPECT_NEAR(change.at("center_m")[0], kFar[0] + 0.4, 0.03);
  EXPECT_NEAR(change.at("center_m")[1], kFar[1] - 0.3, 0.03);
  EXPECT_NEAR(change.at("relief_m"), 0.2, 0.06);
  EXPECT_GT(json.at("compared_m2"), 8.0);
  for (const char* name : {"images/001_appeared_before.png", "images/001_appeared_after.png",
                           "before.png", "after.png", "changes.png"}) {
    EXPECT_FALSE(cv::imread((out / name).string()).empty()) << name;
  }
  EXPECT_GT(fs::file_size(out / "changes.ply"), 300U);
  EXPECT_FALSE(fs::exists(dir_.path() / "changes.partial"));
}

TEST_F(DiffRuns, AnEarlierChangeMapIsReplacedOnlyOnDemand) {
  DiffRequest request{
      .before = write_floor("a"), .after = write_floor("b"), .out = dir_.path() / "c"};
  const fs::path stale = dir_.write("c/images/009_vanished_before.png", "");
  const fs::path other = dir_.write("c/notes.txt", "mine");
  dir_.write("c/changes.json", "{}");
  EXPECT_THAT(message_of(request), HasSubstr("--overwrite"));
  request.overwrite = true;
  diff_runs(request);
  EXPECT_FALSE(fs::exists(stale));
  EXPECT_TRUE(fs::exists(other));
}

TEST_F(DiffRuns, AnInterruptedComparisonWritesNothing) {
  DiffRequest request{
      .before = write_floor("a"), .after = write_floor("b"), .out = dir_.path() / "c"};
  int left = 45;
  request.interrupted = [&left] { return --left < 0; };
  EXPECT_THROW(diff_runs(request), RunError);
  EXPECT_FALSE(fs::exists(request.out));
}

TEST_F(DiffRuns, ARunFolderIsNoPlaceForChanges) {
  const fs::path run = write_floor("a");
  EXPECT_THAT(message_of({.before = run, .after = write_floor("b"), .out = run}),
              HasSubstr("holds a run"));
}

/// Two runs that estimated their own poses.
class FramesOfRuns : public DiffRuns {
 protected:
  void SetUp() override {
    for (const char* name : {"a", "b"}) {
      write_floor(name);
      dir_.write(std::string(name) + "/resolved.yaml", "dataset: {path: dive}\n");
    }
  }
  void relocalized(const char* run, const fs::path& map, bool found) const {
    dir_.write(
        std::string(run) + "/metrics.json",
        nlohmann::json{{"relocalization", {{"map", map.string()}, {"found", found}}}}.dump());
  }
  std::string message() const {
    return message_of(
        {.before = dir_.path() / "a", .after = dir_.path() / "b", .out = dir_.path() / "c"});
  }
};

TEST_F(FramesOfRuns, RunsWithFramesOfTheirOwnAreRefused) {
  EXPECT_THAT(message(), HasSubstr("its frame is its own; run it again with apvi run DIVE --map"));
  EXPECT_THAT(message(), HasSubstr("--same-frame"));
}

TEST_F(FramesOfRuns, ADiveThatWasNotFoundIsRefused) {
  relocalized("b", dir_.path() / "a", false);
  EXPECT_THAT(message(), HasSubstr("it was not found in the map of"));
}

TEST_F(FramesOfRuns, ADiveFoundElsewhereIsRefused) {
  relocalized("b", dir_.path() / "other", true);
  EXPECT_THAT(message(), HasSubstr("it is in the frame of"));
}

TEST_F(FramesOfRuns, DivesFoundInOneAnotherOrInAThirdOneAreAccepted) {
  const std::string no_camera = "has no cam0";  // the next thing that is wrong with these folders
  relocalized("b", dir_.path() / "a/", true);
  EXPECT_THAT(message(), HasSubstr(no_camera));
  relocalized("a", dir_.path() / "b", true);
  relocalized("b", dir_.path() / "other", true);
  EXPECT_THAT(message(), HasSubstr(no_camera));
  dir_.write("third/map.ply", "");
  relocalized("a", dir_.path() / "third", true);
  relocalized("b", dir_.path() / "third", true);
  EXPECT_THAT(message(), HasSubstr(no_camera));
}

}  // namespace
}  // namespace apvi::runs
