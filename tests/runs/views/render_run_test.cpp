// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/render_run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "support/test_data.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

/// The garden from its camera, with details of so many pixels.
cv::Mat render_garden(const std::filesystem::path& data, double detail_px) {
  const test::TmpDir dir;
  render_run({.source = data / "garden.ply",
              .path = {},
              .camera = data / "camera.json",
              .out = dir.path(),
              .detail_px = detail_px,
              .format = ImageFormat::pfm});
  return cv::imread((dir.path() / "garden.pfm").string(), cv::IMREAD_UNCHANGED);
}

double psnr_db(const cv::Mat& image, const cv::Mat& truth) {
  const double mse =
      cv::norm(image, truth, cv::NORM_L2SQR) / static_cast<double>(3 * truth.total());
  return -10.0 * std::log10(mse);
}

TEST(RenderRun, MatchesReferenceRasterizerOnExternalMap) {
  APVI_NEEDS_DATA(data, "splat_reference");
  const cv::Mat image = render_garden(data, 0.0);
  const cv::Mat truth = cv::imread((data / "garden_rgb.pfm").string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(image.size(), truth.size());
  EXPECT_GT(psnr_db(image, truth), 75.0);
}

TEST(RenderRun, LooksTheSameWithoutDetailsBelowAPixel) {
  APVI_NEEDS_DATA(data, "splat_reference");
  const cv::Mat all = render_garden(data, 0.0);
  EXPECT_GT(psnr_db(render_garden(data, 1.0), all), 40.0);
  EXPECT_LT(psnr_db(render_garden(data, 30.0), all), 35.0);
}

}  // namespace
}  // namespace apvi::runs
