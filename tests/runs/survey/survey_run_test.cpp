// SPDX-License-Identifier: BSD-3-Clause
#include "runs/survey/survey_run.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "apvi/core/error.hpp"
#include "map_io/map_file.hpp"
#include "support/tmp_dir.hpp"
#include "survey/flat_ground.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class SurveyOfAMapFile : public testing::Test {
 protected:
  SurveyRequest request(const char* product) const {
    return {.source = dir_.path() / "map.ply",
            .product = product,
            .out = dir_.path() / "out",
            .resolution_m = 0.02};
  }
  void write_map(const gaussians::Gaussians& gaussians) const {
    map_io::write_map(dir_.path() / "map.ply", {.gaussians = gaussians});
  }
  void write_plane(double slope) const {
    write_map(test::plane_map({.slope = slope}).map.gaussians);
  }
  static std::string message_of(const SurveyRequest& request) {
    try {
      export_survey(request);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }

  test::TmpDir dir_;
};

TEST_F(SurveyOfAMapFile, FiguresOfAPlaneAreThoseOfItsShape) {
  write_plane(0.5);
  export_survey(request("survey"));
  std::ifstream in(dir_.path() / "out/survey.json");
  const auto json = nlohmann::json::parse(in);
  EXPECT_NEAR(json.at("area_m2"), 4.0, 0.08);
  EXPECT_NEAR(json.at("rugosity"), std::sqrt(1.25), 0.005);
  EXPECT_NEAR(json.at("mean_slope_deg"), 26.565, 0.2);
  EXPECT_FALSE(json.contains("ground_sampling_distance_m"));
}

TEST_F(SurveyOfAMapFile, PointsAreWritten) {
  write_plane(0.0);
  export_survey(request("las"));
  EXPECT_GT(fs::file_size(dir_.path() / "out/points.las"), 36 * 10000U);
}

TEST_F(SurveyOfAMapFile, WhatNeedsCamerasSaysSo) {
  write_plane(0.0);
  EXPECT_THAT(message_of(request("poses")), HasSubstr("needs a run folder"));
  EXPECT_THAT(message_of(request("mesh")), HasSubstr("needs a run folder"));
  SurveyRequest without = request("survey");
  without.resolution_m.reset();
  EXPECT_THAT(message_of(without), HasSubstr("--resolution: required"));
}

TEST_F(SurveyOfAMapFile, AMapWithoutAMediumHasNoColorsAsSeen) {
  write_plane(0.0);
  SurveyRequest seen = request("las");
  seen.restore = false;
  EXPECT_THAT(message_of(seen), HasSubstr("--as-seen"));
}

TEST_F(SurveyOfAMapFile, AMapWithNothingInItIsNamed) {
  write_map(gaussians::Gaussians::empty(0, torch::kFloat32));
  EXPECT_THAT(message_of(request("survey")), HasSubstr("no surface"));
}

TEST_F(SurveyOfAMapFile, UnknownProductsAreNamed) {
  write_plane(0.0);
  EXPECT_THAT(message_of(request("hologram")), HasSubstr("hologram"));
  EXPECT_FALSE(is_survey_product("ply"));
}

TEST_F(SurveyOfAMapFile, AnInterruptedProductIsNotWritten) {
  write_plane(0.0);
  SurveyRequest stopped = request("survey");
  stopped.interrupted = [] { return true; };
  EXPECT_THROW(export_survey(stopped), RunError);
  EXPECT_TRUE(fs::is_empty(dir_.path() / "out"));
}

}  // namespace
}  // namespace apvi::runs
