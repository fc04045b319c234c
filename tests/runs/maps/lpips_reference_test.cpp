// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <opencv2/imgcodecs.hpp>
#include <string>

#include "gaussians/metrics/lpips.hpp"
#include "support/test_data.hpp"

namespace apvi::gaussians {
namespace {

torch::Tensor read_rgb(const std::filesystem::path& path) {
  const cv::Mat image = cv::imread(path.string(), cv::IMREAD_COLOR);
  if (image.empty()) throw std::runtime_error("cannot read " + path.string());
  return torch::from_blob(image.data, {image.rows, image.cols, 3}, torch::kUInt8)
      .flip(2)
      .to(torch::kFloat32)
      .div(255.0);
}

struct Known {
  LpipsNet net;
  double p0, p1;
};

class LpipsReference : public testing::TestWithParam<Known> {};

TEST_P(LpipsReference, MatchesReferenceDistancesOfExampleImages) {
  APVI_NEEDS_DATA(folder, "lpips_reference");
  const auto lpips = Lpips::load(GetParam().net);
  if (!lpips) GTEST_SKIP() << "no weights in " << lpips_folder() << ": " << kLpipsUnavailable;
  const torch::Tensor reference = read_rgb(folder / "ex_ref.png");
  EXPECT_NEAR((*lpips)(reference, read_rgb(folder / "ex_p0.png")), GetParam().p0, 1e-3);
  EXPECT_NEAR((*lpips)(reference, read_rgb(folder / "ex_p1.png")), GetParam().p1, 1e-3);
}

INSTANTIATE_TEST_SUITE_P(Nets, LpipsReference,
                         testing::Values(Known{LpipsNet::alex, 0.7219, 0.1376},
                                         Known{LpipsNet::vgg, 0.5686, 0.4217}),
                         [](const auto& known) {
                           return known.param.net == LpipsNet::alex ? "AlexNet" : "Vgg16";
                         });

}  // namespace
}  // namespace apvi::gaussians
