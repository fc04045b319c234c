// SPDX-License-Identifier: BSD-3-Clause
#include "runs/run_config.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/core/error.hpp"
#include "gaussians/device.hpp"
#include "support/rename_table.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
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

TEST(MappingConfig, DefaultGaussianLimitDependsOnDevice) {
  const bool gpu = gaussians::active_device().is_cuda();
  EXPECT_EQ(most_gaussians(load(kGiven)), gpu ? 1000000 : 100000);
  EXPECT_EQ(mapper_options(load(kGiven)).trainer.densify.max_gaussians, gpu ? 1000000 : 100000);
  EXPECT_EQ(most_gaussians(load(std::string(kGiven) + "  max_gaussians: 5\n")), 5);
}

TEST(MappingConfig, SetsTrainerOptions) {
  const RunConfig config =
      load(std::string(kGiven) +
           "  iterations: 17\n  max_gaussians: 99\n  densification: random\n"
           "  learning_rates: {means: 0.5}\n  pose_refinement: {enabled: true}\nrun: {seed: 4}\n");
  const mapping::TrainerOptions options = trainer_options(config);
  EXPECT_EQ(options.iterations, 17);
  EXPECT_EQ(options.densify.max_gaussians, 99);
  EXPECT_EQ(options.densify.kind, mapping::Densification::random);
  EXPECT_EQ(options.learning_rates.means, 0.5);
  EXPECT_TRUE(options.pose_refinement.enabled);
  EXPECT_EQ(options.seed, 4U);
}

TEST(MappingConfig, AutoLoopClosureIsPoseGraphUnlessRigHasLamp) {
  Rig daylight;
  daylight.cameras.emplace_back();
  Rig lamplight = daylight;
  lamplight.lamp.emplace();
  const RunConfig usual = load("mapping: {enabled: true}\n");
  EXPECT_EQ(resolve_loop_closure_method(usual, daylight), LoopClosureMethod::pose_graph);
  EXPECT_FALSE(mapper_options(usual, daylight).online.align);
  EXPECT_EQ(resolve_loop_closure_method(usual, lamplight), LoopClosureMethod::alignment);
  EXPECT_TRUE(mapper_options(usual, lamplight).online.align);
  const RunConfig none = load("mapping: {enabled: true, loop_closure: {method: none}}\n");
  EXPECT_EQ(resolve_loop_closure_method(none, lamplight), LoopClosureMethod::none);
  EXPECT_FALSE(mapper_options(none, lamplight).online.align);
}

TEST(MappingConfig, SuggestsKeyForTypo) {
  EXPECT_THAT(error_of(std::string(kGiven) + "  max_gausians: 5\n"),
              testing::AllOf(HasSubstr("c.yaml:4"), HasSubstr("max_gaussians")));
}

TEST(MappingConfig, RejectsIncompatibleSettings) {
  EXPECT_THAT(error_of(std::string(kGiven) + "  densification: quadtree\n"),
              HasSubstr("mapping.densification: quadtree"));
  EXPECT_THAT(error_of("mapping: {enabled: true}\nsensors: {use: [imu, dvl]}\n"),
              HasSubstr("sensors.use: camera is missing"));
  EXPECT_THAT(error_of("localization: {enabled: false}\n"), HasSubstr("nothing to do"));
}

TEST(MappingConfig, RejectsContradictoryValues) {
  EXPECT_THAT(error_of(std::string(kGiven) + "  initial_box_m: [0, 0, 0, 1, -1, 1]\n"),
              HasSubstr("mapping.initial_box_m"));
  EXPECT_THAT(error_of(std::string(kGiven) + "  initial_downscale: 3\n"),
              HasSubstr("mapping.initial_downscale"));
  EXPECT_THAT(error_of(std::string(kGiven) + "  iterations: 0\n"), HasSubstr("must be positive"));
  EXPECT_THAT(error_of(std::string(kGiven) + "  densify: {start_fraction: 0.9}\n"),
              HasSubstr("mapping.densify.start_fraction"));
}

TEST(RenamedKeys, OldKeysOfRunsSetTheNewOnes) {
  test::expect_valid_renames<RunConfig>(config::run_renames(), load);
}

TEST(RenamedKeys, OldKeysSetTheirFields) {
  testing::internal::CaptureStderr();
  const RunConfig config = load(
      "mapping: {loops: {least_age_s: 30, pixel_sigma: 2}, revisits: loops}\n"
      "vio: {start: {gyro_bias_sigma: 0.2}, gravity: 9.81}\n");
  EXPECT_EQ(config.mapping.loop_closure.min_age_s, 30.0);
  EXPECT_EQ(config.mapping.loop_closure.pixel_sigma, 2.0);
  EXPECT_EQ(config.mapping.loop_closure.method, LoopClosureMethod::pose_graph);
  EXPECT_EQ(config.vio.initialization.gyro_bias_sigma, 0.2);
  EXPECT_EQ(config.localization.gravity, 9.81);
  EXPECT_THAT(testing::internal::GetCapturedStderr(),
              HasSubstr("c.yaml:1: mapping.loops.least_age_s is now "
                        "mapping.loop_closure.min_age_s; the old name works until 0.3"));
}

}  // namespace
}  // namespace apvi::runs
