// SPDX-License-Identifier: BSD-3-Clause
#include "runs/scale.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

TEST(Scale, ImportedPosesHaveTheScaleOfTheImport) {
  const test::TmpDir dir;
  EXPECT_EQ(scale_of_given_poses(dir.path(), ""), ScaleSource::given_poses);
  dir.write("import.yaml", "scale: known\n");
  EXPECT_EQ(scale_of_given_poses(dir.path(), ""), ScaleSource::given_poses);
  dir.write("import.yaml", "scale: unknown\n");
  EXPECT_EQ(scale_of_given_poses(dir.path(), ""), ScaleSource::unknown);
}

TEST(Scale, PosesFileReplacesTheScaleOfTheImport) {
  const test::TmpDir dir;
  dir.write("import.yaml", "scale: unknown\n");
  EXPECT_EQ(scale_of_given_poses(dir.path(), "poses.tum"), ScaleSource::given_poses);
}

TEST(Scale, IsKnownUnlessItsSourceIsUnknown) {
  EXPECT_TRUE(scale_json(ScaleSource::accelerometer)["known"]);
  EXPECT_FALSE(scale_json(ScaleSource::unknown)["known"]);
  EXPECT_EQ(scale_json(ScaleSource::dvl)["source"], "dvl");
}

}  // namespace
}  // namespace apvi::runs
