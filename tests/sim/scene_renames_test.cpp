// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <string>

#include "config/renamed_keys.hpp"
#include "sim/scene_config.hpp"
#include "support/rename_table.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::sim {
namespace {

SceneConfig load(const std::string& yaml) {
  const test::TmpDir dir;
  SceneConfig scene;
  config::read(config::load_config(dir.write("scene.yaml", yaml), {}, config::scene_renames()),
               scene);
  return scene;
}

TEST(RenamedKeys, OldKeysOfScenesSetTheNewOnes) {
  test::expect_valid_renames<SceneConfig>(config::scene_renames(), load);
}

TEST(RenamedKeys, OldValuesOfScenesAreAccepted) {
  EXPECT_EQ(load("motion: {look: centre, centre: [1, 2]}\n").motion.look, HeadingMode::point);
}

}  // namespace
}  // namespace apvi::sim
