// SPDX-License-Identifier: BSD-3-Clause
#include "runs/run_config.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/core/error.hpp"
#include "gaussians/device.hpp"
#include "mapping/density/gaussian_limit.hpp"
#include "slam/mapper_options.hpp"
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
  const auto limit = [](const std::string& yaml) {
    return mapping::gaussian_limit(load(yaml).mapping.trainer.densify);
  };
  EXPECT_EQ(limit(kGiven), gpu ? 600000 : 100000);
  EXPECT_EQ(limit(std::string(kGiven) + "  max_gaussians: 5\n"), 5);
}

TEST(MappingConfig, SetsTrainerOptions) {
  const RunConfig config =
      load(std::string(kGiven) +
           "  iterations: 17\n  max_gaussians: 99\n  densification: random\n"
           "  learning_rates: {means: 0.5}\n  pose_refinement: {enabled: true}\nrun: {seed: 4}\n");
  const mapping::TrainerOptions options =
      slam::trainer_options(config.mapping, config.run.seed, Rig{});
  EXPECT_EQ(options.iterations, 17);
  EXPECT_EQ(options.densify.max_gaussians, 99);
  EXPECT_EQ(options.densify.kind, mapping::Densification::random);
  EXPECT_EQ(options.learning_rates.means, 0.5);
  EXPECT_TRUE(options.pose_refinement.enabled);
  EXPECT_EQ(options.seed, 4U);
}

TEST(MappingConfig, DefaultIsMapWithDepthAndMediumWhereThereIsCamera) {
  const slam::MappingOptions usual = load("run: {seed: 1}\n").mapping;
  EXPECT_EQ(usual.enabled, slam::MapSwitch::automatic);
  EXPECT_TRUE(usual.medium);
  EXPECT_EQ(usual.trainer.densify.kind, mapping::Densification::quadtree);
  EXPECT_EQ(load(kGiven).mapping.trainer.densify.kind, mapping::Densification::gradient);
}

/// A recording that has not been read yet.
class UnreadRecording : public io::SequenceReader {
 public:
  UnreadRecording(const std::string& rig, const std::string& sensor)
      : rig_(config::parse_yaml(rig, "rig.yaml")), report_{{sensor, {}}} {}

  const config::Node& rig() const override { return rig_; }
  std::optional<SensorEvent> next() override { return std::nullopt; }
  double fraction() const override { return 0.0; }
  const std::map<std::string, io::StreamReport>& report() const override { return report_; }
  std::optional<Trajectory> reference() const override { return std::nullopt; }

 private:
  config::Node rig_;
  std::map<std::string, io::StreamReport> report_;
};

TEST(MappingConfig, MapIsMadeWhereRecordingAndRigHaveCamera) {
  const std::string camera =
      "cam0: {model: pinhole, intrinsics: [200, 200, 160, 120], resolution: [320, 240]}\n";
  const RunConfig automatic = load("run: {seed: 1}\n");
  EXPECT_TRUE(makes_map(automatic, UnreadRecording(camera, "camera")));
  EXPECT_FALSE(makes_map(automatic, UnreadRecording(camera, "dvl")));
  EXPECT_FALSE(makes_map(automatic, UnreadRecording("imu0: {}\n", "camera")));
  EXPECT_FALSE(makes_map(load("sensors: {use: [imu, dvl]}\n"), UnreadRecording(camera, "camera")));
  EXPECT_FALSE(makes_map(load("mapping: {enabled: false}\n"), UnreadRecording(camera, "camera")));
  EXPECT_TRUE(makes_map(load("mapping: {enabled: true}\n"), UnreadRecording(camera, "dvl")));
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
  EXPECT_THAT(error_of("localization: {enabled: false}\nmapping: {enabled: false}\n"),
              HasSubstr("nothing to do"));
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
  EXPECT_EQ(config.mapping.loop_closure.method, slam::LoopClosureMethod::pose_graph);
  EXPECT_EQ(config.vio.initialization.gyro_bias_sigma, 0.2);
  EXPECT_EQ(config.localization.gravity, 9.81);
  EXPECT_THAT(testing::internal::GetCapturedStderr(),
              HasSubstr("c.yaml:1: mapping.loops.least_age_s is now "
                        "mapping.loop_closure.min_age_s; the old name works until 0.3"));
}

}  // namespace
}  // namespace apvi::runs
