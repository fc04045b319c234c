// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/bridge/run_config.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/core/error.hpp"
#include "apvi/splat/device.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::bridge {
namespace {

using testing::HasSubstr;

RunConfig load(const std::string& yaml) {
  const test::TmpDir dir;
  return load_run_config(dir.write("c.yaml", yaml), {});
}

std::string error_of(const std::string& yaml) {
  try {
    load(yaml);
  } catch (const InputError& e) {
    return e.what();
  }
  return "no error";
}

constexpr const char* kGiven = "localization: {enabled: false}\nmapping:\n  enabled: true\n";

TEST(MappingConfig, AMapGrowsAsLargeAsItsDeviceBearsUnlessToldOtherwise) {
  const bool gpu = splat::active_device().is_cuda();
  EXPECT_EQ(most_gaussians(load(kGiven)), gpu ? 1000000 : 100000);
  EXPECT_EQ(mapper_options(load(kGiven)).trainer.densify.max_gaussians, gpu ? 1000000 : 100000);
  EXPECT_EQ(most_gaussians(load(std::string(kGiven) + "  max_gaussians: 5\n")), 5);
}

TEST(MappingConfig, ReachesTheTrainersOptions) {
  const RunConfig config =
      load(std::string(kGiven) +
           "  iterations: 17\n  max_gaussians: 99\n  densification: random\n"
           "  rates: {means: 0.5}\n  poses: {enabled: true}\nrun: {seed: 4}\n");
  const mapping::TrainerOptions options = trainer_options(config);
  EXPECT_EQ(options.iterations, 17);
  EXPECT_EQ(options.densify.max_gaussians, 99);
  EXPECT_EQ(options.densify.kind, mapping::Densification::random);
  EXPECT_EQ(options.rates.means, 0.5);
  EXPECT_TRUE(options.poses.enabled);
  EXPECT_EQ(options.seed, 4U);
}

TEST(MappingConfig, WhatIsMetAgainClosesALoopUnlessALampLightsItDifferently) {
  Rig daylight;
  daylight.cameras.emplace_back();
  Rig lamplight = daylight;
  lamplight.lamp.emplace();
  const RunConfig usual = load("mapping: {enabled: true}\n");
  EXPECT_EQ(revisits_of(usual, daylight), Revisits::loops);
  EXPECT_FALSE(mapper_options(usual, daylight).online.align);
  EXPECT_EQ(revisits_of(usual, lamplight), Revisits::alignment);
  EXPECT_TRUE(mapper_options(usual, lamplight).online.align);
  const RunConfig none = load("mapping: {enabled: true, revisits: none}\n");
  EXPECT_EQ(revisits_of(none, lamplight), Revisits::none);
  EXPECT_FALSE(mapper_options(none, lamplight).online.align);
}

TEST(MappingConfig, ATypoIsAnsweredWithTheKeyThatWasMeant) {
  EXPECT_THAT(error_of(std::string(kGiven) + "  max_gausians: 5\n"),
              testing::AllOf(HasSubstr("c.yaml:4"), HasSubstr("max_gaussians")));
}

TEST(MappingConfig, WhatCannotWorkTogetherIsRefused) {
  EXPECT_THAT(error_of(std::string(kGiven) + "  densification: quadtree\n"),
              HasSubstr("mapping.densification: quadtree"));
  EXPECT_THAT(error_of("mapping: {enabled: true}\nsensors: {use: [imu, dvl]}\n"),
              HasSubstr("sensors.use: camera is missing"));
  EXPECT_THAT(error_of("localization: {enabled: false}\n"), HasSubstr("nothing is left to do"));
}

TEST(MappingConfig, ValuesThatContradictEachOtherAreRefused) {
  EXPECT_THAT(error_of(std::string(kGiven) + "  initial_box_m: [0, 0, 0, 1, -1, 1]\n"),
              HasSubstr("mapping.initial_box_m"));
  EXPECT_THAT(error_of(std::string(kGiven) + "  coarsest: 3\n"), HasSubstr("mapping.coarsest"));
  EXPECT_THAT(error_of(std::string(kGiven) + "  iterations: 0\n"), HasSubstr("make no map"));
  EXPECT_THAT(error_of(std::string(kGiven) + "  densify: {begin: 0.9}\n"),
              HasSubstr("mapping.densify.begin"));
}

}  // namespace
}  // namespace apvi::bridge
