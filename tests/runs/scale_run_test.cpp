// SPDX-License-Identifier: BSD-3-Clause
#include "runs/scale_run.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "eval/metrics_file.hpp"
#include "loop_closure/place_map.hpp"
#include "map_io/map_file.hpp"
#include "runs/maps/mapping_run.hpp"
#include "runs/views/render_run.hpp"
#include "support/wall_recording.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

medium::Medium lamp_water() {
  const auto rgb = [](double r, double g, double b) { return torch::tensor({r, g, b}); };
  return {.beta_d = rgb(0.4, 0.2, 0.1),
          .beta_b = rgb(0.3, 0.2, 0.15),
          .b_inf = rgb(0.1, 0.3, 0.4),
          .lamp = medium::LampLight{.lamps = {{.position_m = {0.3, 0.1, 0.0}}},
                                    .unit_range_m = 2.0,
                                    .daylight = rgb(0.1, 0.2, 0.3),
                                    .backscatter = rgb(0.05, 0.04, 0.03)}};
}

/// Where the wall of `gaussian_wall` is seen by a column of pixels from the origin, at the height
/// of the camera.
Eigen::Vector3d on_wall(double u) {
  double z = 3.0;
  for (int k = 0; k < 100; ++k) z = 3.0 + 0.3 * std::sin(2.0 * (u - 24.0) / 40.0 * z);
  return {(u - 24.0) / 40.0 * z, 0.0, z};
}

class ScaleRunTest : public testing::Test {
 protected:
  ScaleRunTest() {
    const gaussians::Gaussians wall = test::gaussian_wall(4000);
    test::write_wall_recording(recording_, wall);
    run_mapping(test::wall_config(recording_, 1), {.folder = run()});
    map_io::write_map(run() / "map.ply", {.gaussians = wall, .medium = lamp_water()});
    loop_closure::PlaceMap places;
    places.places.push_back({Stamp{5}, {Eigen::Quaterniond::Identity(), {1.0, 2.0, 3.0}}, {}, {}});
    places.places.back().points.emplace_back(0.5F, 0.0F, 2.0F);
    places.places.back().descriptors = cv::Mat::zeros(1, 128, CV_8U);
    loop_closure::save(places, run() / loop_closure::kPlacesFile);
  }
  fs::path run() const { return recording_.path() / "run"; }
  fs::path scaled() const { return recording_.path() / "scaled"; }
  ScaleRequest request() const { return {.run = run(), .folder = scaled()}; }
  std::string error_of(const ScaleRequest& wrong) {
    try {
      scale_run(wrong);
    } catch (const InputError& e) {
      return e.what();
    }
    return "no error";
  }
  /// In the middle of the central image, whose camera is at the origin.
  static ScaleBar bar(double from, double to, double length_m) {
    return {Stamp{5'000'000'000}, {from, 16.0}, {to, 16.0}, length_m};
  }

  test::TmpDir recording_;
};

TEST_F(ScaleRunTest, ABarInAnImageShowsTheScale) {
  ScaleRequest by_bar = request();
  by_bar.bars = {bar(12.0, 36.0, 2.5 * (on_wall(36.0) - on_wall(12.0)).norm()),
                 bar(18.0, 27.0, 2.5 * (on_wall(27.0) - on_wall(18.0)).norm())};
  const ScaleResult result = scale_run(by_bar);
  EXPECT_NEAR(result.meters_per_unit, 2.5, 0.05);
  ASSERT_EQ(result.of_each.size(), 2U);
  const eval::Json scale = eval::read_metrics(scaled() / "metrics.json")["scale"];
  EXPECT_TRUE(scale["known"]);
  EXPECT_EQ(scale["meters_per_unit"], result.meters_per_unit);
}

TEST_F(ScaleRunTest, LengthsAreFittedByLeastSquares) {
  ScaleRequest by_distance = request();
  by_distance.distances = {{{0, 0, 0}, {3, 0, 0}, 6.0}, {{0, 1, 0}, {0, 2, 0}, 2.2}};
  EXPECT_NEAR(scale_run(by_distance).meters_per_unit, (3 * 6.0 + 1 * 2.2) / 10.0, 1e-12);
}

// Up to rounding, which decides on the order of Gaussians of the same depth, and to the steps in
// which the backscatter of lamps is tabulated along rays.
TEST_F(ScaleRunTest, ImagesOfTheMapStayTheSame) {
  ScaleRequest by_factor = request();
  by_factor.factor = 1.5;
  scale_run(by_factor);
  render_run({.source = run(),
              .out = recording_.path() / "a",
              .restore = true,
              .exposure = 1.0,
              .white_balance = false});
  render_run({.source = scaled(),
              .out = recording_.path() / "b",
              .restore = true,
              .exposure = 1.0,
              .white_balance = false});
  std::size_t images = 0;
  for (const auto& file : fs::directory_iterator(recording_.path() / "a")) {
    const cv::Mat a = cv::imread(file.path().string());
    const cv::Mat b = cv::imread((recording_.path() / "b" / file.path().filename()).string());
    ASSERT_EQ(a.size(), b.size()) << file.path();
    EXPECT_LT(cv::norm(a, b, cv::NORM_L1) / static_cast<double>(3 * a.total()), 0.5);
    ++images;
  }
  EXPECT_GE(images, 18U);
}

TEST_F(ScaleRunTest, PosesAndPlacesAreScaled) {
  ScaleRequest by_factor = request();
  by_factor.factor = 2.5;
  scale_run(by_factor);
  const Trajectory before = io::read_trajectory(run() / "keyframes.tum");
  const Trajectory after = io::read_trajectory(scaled() / "keyframes.tum");
  ASSERT_EQ(before.size(), after.size());
  for (std::size_t i = 0; i < before.size(); ++i) {
    EXPECT_LT(
        (after.poses[i].T_world_body.translation - 2.5 * before.poses[i].T_world_body.translation)
            .norm(),
        1e-6);
  }
  const auto places = loop_closure::load_place_map(scaled() / loop_closure::kPlacesFile);
  EXPECT_EQ(places.places.at(0).T_map_camera.translation.z(), 7.5);
  EXPECT_EQ(places.places.at(0).points.at(0).z(), 5.0F);
}

TEST_F(ScaleRunTest, ErrorsSayWhatIsWrong) {
  EXPECT_THAT(error_of(request()), HasSubstr("no known length"));
  ScaleRequest wrong = request();
  wrong.bars = {bar(12.0, 60.0, 1.0)};
  EXPECT_THAT(error_of(wrong), HasSubstr("pixel 60, 16 is outside the image of 48 x 32"));
  wrong.bars = {{Stamp{17}, {1.0, 1.0}, {2.0, 2.0}, 1.0}};
  EXPECT_THAT(error_of(wrong), HasSubstr("the map has no image 17"));
  wrong.bars = {bar(12.0, 36.0, -1.0)};
  EXPECT_THAT(error_of(wrong), HasSubstr("must be positive"));
  wrong = request();
  wrong.run = recording_.path() / "mav0";
  EXPECT_THAT(error_of(wrong), HasSubstr("is this a run folder?"));
  wrong = request();
  wrong.folder = run();
  EXPECT_THAT(error_of(wrong), HasSubstr("the run itself"));
  EXPECT_FALSE(fs::exists(scaled()));
}

}  // namespace
}  // namespace apvi::runs
