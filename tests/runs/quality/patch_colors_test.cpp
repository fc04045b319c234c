// SPDX-License-Identifier: BSD-3-Clause
#include "runs/quality/patch_colors.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

using testing::HasSubstr;

std::string error_of(const std::string& csv) {
  const test::TmpDir dir;
  try {
    read_patches(dir.write("patches.csv", csv));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

constexpr const char* kHeader = "#timestamp [ns],x,y,width,height,red,green,blue\n";

TEST(PatchColors, AnglesDoNotDependOnBrightness) {
  EXPECT_NEAR(color_angle_deg({0.2, 0.2, 0.2}, {0.9, 0.9, 0.9}), 0.0, 1e-4);
  EXPECT_NEAR(color_angle_deg({1.0, 0.0, 0.0}, {0.0, 0.5, 0.0}), 90.0, 1e-9);
  EXPECT_NEAR(color_angle_deg({1.0, 1.0, 0.0}, {1.0, 0.0, 0.0}), 45.0, 1e-9);
}

TEST(PatchColors, OneWhiteBalanceRemovesACastThatAllPatchesHave) {
  std::vector<PatchColor> patches;
  for (const double gray : {0.1, 0.3, 0.6}) {
    patches.push_back({.reference = {gray, gray, gray},
                       .image = {gray * std::exp(-10.0 * gray), gray, gray},  // differs by patch
                       .restored = {0.5 * gray, gray, 1.5 * gray}});
  }
  const PatchErrors errors = errors_of(patches);
  EXPECT_EQ(errors.patches, 3U);
  EXPECT_NEAR(errors.restored_deg, color_angle_deg({0.5, 1.0, 1.5}, {1.0, 1.0, 1.0}), 1e-9);
  EXPECT_NEAR(*errors.restored_balanced_deg, 0.0, 1e-4);
  EXPECT_GT(*errors.image_balanced_deg, 5.0);
}

TEST(PatchColors, OnePatchHasNoWhiteBalanceOfItsOwn) {
  const std::array<double, 3> gray = {0.2, 0.2, 0.2};
  const PatchErrors errors = errors_of({{.reference = gray, .image = gray, .restored = gray}});
  EXPECT_NEAR(errors.image_deg, 0.0, 1e-4);
  EXPECT_FALSE(errors.image_balanced_deg);
  EXPECT_FALSE(to_json(errors).contains("image_balanced_angle_deg"));
}

TEST(PatchColors, AreReadAsLinearLight) {
  const test::TmpDir dir;
  const auto patches = read_patches(
      dir.write("patches.csv", std::string(kHeader) + "1700000000000000000,10,20,8,6,255,188,0\n"));
  ASSERT_EQ(patches.size(), 1U);
  EXPECT_EQ(patches[0].stamp_ns, 1700000000000000000);
  EXPECT_THAT(patches[0].rectangle, testing::ElementsAre(10, 20, 8, 6));
  EXPECT_NEAR(patches[0].reference[0], 1.0, 1e-6);
  EXPECT_NEAR(patches[0].reference[1], 0.503, 1e-3);
  EXPECT_NEAR(patches[0].reference[2], 0.0, 1e-6);
}

TEST(PatchColors, UnusableFilesAreRefusedWithTheReason) {
  EXPECT_THAT(error_of(kHeader), HasSubstr("no patches"));
  EXPECT_THAT(error_of("#timestamp [ns],x,y\n1700000000000000000,1,2\n"), HasSubstr("width"));
  const std::string row = "1700000000000000000,10,20,";
  EXPECT_THAT(error_of(kHeader + row + "0,6,1,1,1\n"), HasSubstr("width and height"));
  EXPECT_THAT(error_of(kHeader + row + "5,6,1,1,300\n"), HasSubstr("0 to 255"));
  EXPECT_THAT(error_of(kHeader + row + "5,6,1,x,3\n"), HasSubstr("green"));
}

}  // namespace
}  // namespace apvi::runs
