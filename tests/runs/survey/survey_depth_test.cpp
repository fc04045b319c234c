// SPDX-License-Identifier: BSD-3-Clause
#include "runs/survey/survey_depth.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <memory>

#include "apvi/core/error.hpp"
#include "runs/maps/mapping_run.hpp"
#include "support/wall_recording.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

/// A run at a wall, whose map is as good as perfect.
class SurveyDepth : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    dive_ = std::make_unique<test::TmpDir>();
    test::write_wall_recording(*dive_, test::gaussian_wall());
    run_mapping(test::wall_config(*dive_, 2), {.folder = dive_->path() / "run"});
  }
  static void TearDownTestSuite() { dive_.reset(); }

  /// With the map moved away from the cameras, to 1 + `change` of the distance.
  static SurveySource source(double change) {
    SurveySource source = load_survey({.source = dive_->path() / "run", .product = "mesh"});
    source.map.map.gaussians.means *= 1.0 + change;
    return source;
  }
  static torch::Tensor known(const torch::Tensor& change) {
    const torch::Tensor values = change.to(torch::kFloat32);
    return values.index({~values.isnan()});
  }

  static std::unique_ptr<test::TmpDir> dive_;
};
std::unique_ptr<test::TmpDir> SurveyDepth::dive_;

TEST_F(SurveyDepth, ImagesTellWhereTheMapIsTooFarAway) {
  SurveySource moved = source(0.06);
  ASSERT_TRUE(compare_survey_images(moved, [](double) {}));
  const torch::Tensor change = known(moved.views[0].depth_change);
  EXPECT_GT(change.numel(), 50);
  EXPECT_NEAR(change.median().item<double>(), 1.0 / 1.06 - 1.0, 0.03);
}

TEST_F(SurveyDepth, AMapThatIsRightStays) {
  SurveySource right = source(0.0);
  ASSERT_TRUE(compare_survey_images(right, [](double) {}));
  EXPECT_NEAR(known(right.views[0].depth_change).median().item<double>(), 0.0, 0.02);
}

TEST_F(SurveyDepth, WithoutTheRecordingTheMapCounts) {
  SurveySource lost = source(0.0);
  lost.config->dataset.path = (dive_->path() / "gone").string();
  EXPECT_FALSE(compare_survey_images(lost, [](double) {}));
  EXPECT_FALSE(lost.views[0].depth_change.defined());
}

TEST_F(SurveyDepth, ProgressEndsAtOneAndMayStop) {
  SurveySource right = source(0.0);
  double last = 0.0;
  compare_survey_images(right, [&last](double fraction) {
    EXPECT_GE(fraction, last);
    last = fraction;
  });
  EXPECT_GT(last, 0.8);
  EXPECT_LE(last, 1.0);
  EXPECT_THROW(compare_survey_images(right, [](double) { fail_run("stopped"); }), RunError);
}

}  // namespace
}  // namespace apvi::runs
