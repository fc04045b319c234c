// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/metrics/lpips.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cstdlib>
#include <fstream>
#include <string>

#include "apvi/core/error.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

class LpipsOfEveryNet : public testing::TestWithParam<LpipsNet> {};

TEST_P(LpipsOfEveryNet, IsZeroForEqualImagesAndGrowsWithNoise) {
  const auto lpips = Lpips::load(GetParam());
  if (!lpips) GTEST_SKIP() << "no weights in " << lpips_folder() << ": " << kLpipsUnavailable;
  torch::manual_seed(1);
  const Tensor coarse = torch::rand({1, 3, 8, 10});
  const Tensor image =
      torch::upsample_bilinear2d(coarse, {64, 80}, false).squeeze(0).permute({1, 2, 0});
  const Tensor noise = torch::randn({64, 80, 3});
  EXPECT_EQ((*lpips)(image, image), 0.0);
  double last = 0.0;
  for (const double sigma : {0.01, 0.05, 0.2}) {
    const double distance = (*lpips)(image, (image + sigma * noise).clamp(0.0, 1.0));
    EXPECT_GT(distance, last) << net_name(GetParam()) << " at " << sigma;
    last = distance;
  }
}

TEST_P(LpipsOfEveryNet, RejectsInvalidImages) {
  const auto lpips = Lpips::load(GetParam());
  if (!lpips) GTEST_SKIP() << "no weights in " << lpips_folder() << ": " << kLpipsUnavailable;
  EXPECT_THROW((*lpips)(torch::rand({20, 80, 3}), torch::rand({20, 80, 3})), c10::Error);
  EXPECT_THROW((*lpips)(torch::rand({64, 80, 3}), torch::rand({80, 64, 3})), c10::Error);
  EXPECT_THROW((*lpips)(torch::rand({64, 80}), torch::rand({64, 80})), c10::Error);
}

INSTANTIATE_TEST_SUITE_P(Nets, LpipsOfEveryNet, testing::Values(LpipsNet::alex, LpipsNet::vgg),
                         [](const auto& net) {
                           return net.param == LpipsNet::alex ? "AlexNet" : "Vgg16";
                         });

TEST(LpipsWeights, AreAbsentWithoutFile) {
  const test::TmpDir folder;
  EXPECT_FALSE(Lpips::load(LpipsNet::alex, folder.path()).has_value());
}

TEST(LpipsWeights, InvalidFileIsRejectedWithPathAndInstruction) {
  const test::TmpDir folder;
  const auto file = folder.path() / "lpips_alex.bin";
  for (const char* content : {"", "PK\3\4 something else", "apvi-lpips 1 vgg\n",
                              "apvi-lpips 1 alex\nconv0.weight 64 3 9223372036854775807 11\n"}) {
    std::ofstream(file, std::ios::binary) << content;
    try {
      Lpips::load(LpipsNet::alex, folder.path());
      ADD_FAILURE() << "accepted: " << content;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(file.string()), std::string::npos);
      EXPECT_NE(std::string(error.what()).find("make_lpips_weights"), std::string::npos);
    }
  }
}

TEST(LpipsWeights, TruncatedFileIsRejected) {
  const auto whole = lpips_folder() / "lpips_alex.bin";
  if (!std::filesystem::exists(whole)) GTEST_SKIP() << "no " << whole << ": " << kLpipsUnavailable;
  const test::TmpDir folder;
  const auto copy = folder.path() / "lpips_alex.bin";
  std::filesystem::copy_file(whole, copy);
  const auto size = std::filesystem::file_size(copy);
  EXPECT_TRUE(Lpips::load(LpipsNet::alex, folder.path()).has_value());
  std::filesystem::resize_file(copy, size - 1);
  EXPECT_THROW(Lpips::load(LpipsNet::alex, folder.path()), InputError);
  std::filesystem::resize_file(copy, size + 1);
  EXPECT_THROW(Lpips::load(LpipsNet::alex, folder.path()), InputError);
}

}  // namespace
}  // namespace apvi::gaussians
