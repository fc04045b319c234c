// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/render_run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "support/test_data.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

TEST(RenderRun, MatchesReferenceRasterizerOnExternalMap) {
  APVI_NEEDS_DATA(data, "splat_reference");
  const test::TmpDir dir;
  render_run({.source = data / "garden.ply",
              .path = {},
              .camera = data / "camera.json",
              .out = dir.path(),
              .format = ImageFormat::pfm});
  const cv::Mat image = cv::imread((dir.path() / "garden.pfm").string(), cv::IMREAD_UNCHANGED);
  const cv::Mat truth = cv::imread((data / "garden_rgb.pfm").string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(image.size(), truth.size());
  const double mse =
      cv::norm(image, truth, cv::NORM_L2SQR) / static_cast<double>(3 * truth.total());
  EXPECT_GT(-10.0 * std::log10(mse), 75.0);
}

}  // namespace
}  // namespace apvi::runs
