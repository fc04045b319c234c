// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "support/source_dir.hpp"

// The examples of rig.yaml in the documents are read as a user would paste them.
namespace apvi {
namespace {

// YAML blocks of a document, without the indentation of a list.
std::vector<std::string> yaml_blocks(const std::string& document) {
  std::ifstream in(test::source_dir() / document);
  std::vector<std::string> blocks;
  bool inside = false;
  std::size_t indent = 0;
  for (std::string line; std::getline(in, line);) {
    const std::size_t fence = line.find("```");
    if (fence != std::string::npos) {
      inside = !inside && line.compare(fence, 7, "```yaml") == 0;
      indent = fence;
      if (inside) blocks.emplace_back();
    } else if (inside) {
      blocks.back() += (line.size() > indent ? line.substr(indent) : "") + "\n";
    }
  }
  return blocks;
}

// Blocks that inherit or have a mask name files that are not there.
std::vector<std::string> rigs_of(const std::string& document) {
  std::vector<std::string> rigs = yaml_blocks(document);
  std::erase_if(rigs, [](const std::string& block) {
    return block.find("inherit:") != std::string::npos ||
           block.find("mask:") != std::string::npos ||
           (block.find("cam0:") == std::string::npos && block.find("dvl0:") == std::string::npos);
  });
  return rigs;
}

TEST(RigExamples, AreRigs) {
  for (const char* document : {"README.md", "docs/your-vehicle.md"}) {
    const std::vector<std::string> rigs = rigs_of(document);
    EXPECT_FALSE(rigs.empty()) << document;
    for (const std::string& rig : rigs) {
      EXPECT_NO_THROW(make_rig(config::parse_yaml(rig, document))) << rig;
    }
  }
}

TEST(RigExamples, TheFirstOfEachDocumentHasAllSensorsAndTheDistortionThatItSays) {
  for (const char* document : {"README.md", "docs/your-vehicle.md"}) {
    const Rig rig = make_rig(config::parse_yaml(rigs_of(document).at(0), document));
    EXPECT_TRUE(rig.imu && rig.dvl && rig.pressure) << document;
    ASSERT_EQ(rig.cameras.size(), 1U);
    const CameraModel::Parameters& p = rig.cameras[0].model.parameters();
    EXPECT_EQ(p.distortion, Distortion::radtan);
    EXPECT_EQ(p.coefficients[0], -0.11);
    EXPECT_EQ(rig.cameras[0].T_body_camera.translation.x(), 0.2);
  }
}

}  // namespace
}  // namespace apvi
