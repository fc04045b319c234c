// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/rig_calibration.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>

#include "apvi/core/error.hpp"
#include "apvi/io/rig_file.hpp"
#include "support/source_dir.hpp"
#include "support/test_data.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using test::TmpDir;

constexpr const char* kRig = R"(
imu0: {rate_hz: 200}
cam0:
  intrinsics: [400, 400, 320, 240]
  resolution: [640, 480]
  T_body_sensor: [0, 0, 1, 0.1, -1, 0, 0, 0, 0, -1, 0, 0.05, 0, 0, 0, 1]
dvl0:
  T_body_sensor: [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, -0.1, 0, 0, 0, 1]
)";

config::Node rig_node() {
  return config::parse_yaml(kRig, "rig.yaml");
}

Eigen::VectorXd scalar(double value) {
  return Eigen::VectorXd::Constant(1, value);
}

// A window whose focal length is 404 px, seen from the current rig, with a sigma of 0.1 % and a
// prior of 1 %; its DVL's time offset is not observable.
vio::CalibrationEstimate estimate(const config::Node& rig, double true_focal_px) {
  const double now = make_rig(rig).cameras.front().model.parameters().fx;
  vio::CalibrationEstimate found;
  found.covariance = Eigen::Vector2d(1e-6, 0.01).asDiagonal();
  const double change = 0.99 * (true_focal_px - now) / now;  // less what the prior pulls
  found.parameters = {{"cam0.focal_length", scalar(change), scalar(1e-3), 0.01},
                      {"dvl0.time_offset_s", scalar(0.02), scalar(0.1), 0.1}};
  return found;
}

TEST(RefineRig, RepeatsUntilNothingMoves) {
  int runs = 0;
  const auto localize = [&](std::size_t, const config::Node& rig, int) {
    ++runs;
    return estimate(rig, 408.0);
  };
  const RigCalibration found = refine_rig(rig_node(), {"a", "b"}, localize);
  EXPECT_EQ(found.rounds, 2);
  EXPECT_EQ(runs, 4);
  EXPECT_TRUE(found.settled);
  EXPECT_NEAR(make_rig(found.rig).cameras.front().model.parameters().fx, 408.0, 0.1);
}

TEST(RefineRig, EndsAfterThreeRoundsAndSaysThatItStillMoves) {
  double focal = 402.0;
  const auto localize = [&](std::size_t, const config::Node& rig, int) {
    return estimate(rig, focal += 2.0);
  };
  const RigCalibration found = refine_rig(rig_node(), {"a"}, localize);
  EXPECT_EQ(found.rounds, 3);
  EXPECT_FALSE(found.settled);
}

TEST(RefineRig, NamesAndLeavesOutADiveThatCannotBeLocalized) {
  const auto localize = [](std::size_t dive, const config::Node& rig, int) {
    if (dive == 1) fail_run("no pose was estimated");
    return estimate(rig, 402.0);
  };
  const RigCalibration found = refine_rig(rig_node(), {"good", "dark", "fine"}, localize);
  EXPECT_EQ(found.dives, (std::vector<std::string>{"good", "fine"}));
  EXPECT_THAT(found.left_out, testing::ElementsAre("dark: no pose was estimated"));
  EXPECT_THROW(refine_rig(rig_node(), {"good", "dark"},
                          [](std::size_t, const config::Node&,
                             int) -> std::optional<vio::CalibrationEstimate> { fail_run("dark"); }),
               RunError);
}

TEST(RefineRig, ThrowsWhenInterrupted) {
  const auto localize = [](std::size_t dive, const config::Node& rig, int) {
    return dive == 0 ? std::optional(estimate(rig, 402.0)) : std::nullopt;
  };
  EXPECT_THROW(refine_rig(rig_node(), {"a", "b"}, localize), RunError);
}

TEST(RefineRig, ReportsValuesInTheUnitsOfTheRig) {
  const auto localize = [](std::size_t dive, const config::Node& rig, int) {
    return estimate(rig, dive == 0 ? 402.0 : 403.0);
  };
  const RigCalibration found = refine_rig(rig_node(), {"a", "b"}, localize);
  ASSERT_EQ(found.components.size(), 2U);
  const RigComponent& focal = found.components[0];
  EXPECT_EQ(focal.name, "cam0.focal_length [px]");
  EXPECT_EQ(focal.rig, 400.0);
  EXPECT_NEAR(focal.value, 402.5, 0.1);
  EXPECT_NEAR(focal.dives[1] - focal.dives[0], 1.0, 0.05);
  EXPECT_NEAR(focal.dive_sigmas[0], 0.4, 1e-6);
  EXPECT_NEAR(focal.consistency, 0.5 * std::pow(1.0 / 0.4, 2), 0.2);
  EXPECT_FALSE(found.components[1].observable);
  EXPECT_EQ(found.components[1].value, 0.0);
  EXPECT_THAT(to_table(found), testing::HasSubstr("| dvl0.time_offset_s | 0 | kept |"));
}

// A recording of one image.
fs::path write_recording(const TmpDir& tmp, const std::string& name, const std::string& rig) {
  tmp.write(name + "/rig.yaml", rig);
  tmp.write(name + "/mav0/cam0/data.csv", "#timestamp [ns],filename\n0,0.png\n");
  return tmp.path() / name;
}

std::string message_of(const RigCalibrationOptions& options) {
  try {
    calibrate_rig(options);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

TEST(CalibrateRig, SaysWhatIsWrongWithItsDives) {
  const TmpDir tmp;
  RigCalibrationOptions options;
  options.config = test::source_dir() / "configs/localization.yaml";
  options.overrides = {"sensors.use=[camera]"};  // the folders have no other samples
  options.output = tmp.path() / "out.yaml";
  options.dives = {tmp.path() / "absent"};
  EXPECT_THAT(message_of(options), testing::HasSubstr("no such recording"));
  const fs::path a = write_recording(tmp, "a", kRig);
  options.dives = {a, a};
  EXPECT_THAT(message_of(options), testing::HasSubstr("given twice"));
  tmp.write("blind/rig.yaml", "imu0: {rate_hz: 200}\n");
  tmp.write("blind/mav0/imu0/data.csv",
            "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n0,0,0,0,0,0,9.8\n5000000,0,0,0,0,0,9.8\n");
  options.dives = {tmp.path() / "blind"};
  RigCalibrationOptions all_sensors = options;
  all_sensors.overrides = {};
  EXPECT_THAT(message_of(all_sensors), testing::HasSubstr("no camera"));
  options.dives = {a, write_recording(tmp, "b", std::string(kRig) + "  time_offset_s: 0.1\n")};
  EXPECT_THAT(message_of(options), testing::HasSubstr("with --rig"));
  const std::string with_depth = std::string(kRig) + "depth0: {noise_m: 0.01}\n";
  options.dives = {a, write_recording(tmp, "c", with_depth)};
  EXPECT_THAT(message_of(options), testing::HasSubstr("different sensors"));
  EXPECT_FALSE(fs::exists(options.output));
}

TEST(CalibrateRig, FindsTheFocalLengthOfARealRecording) {
  APVI_NEEDS_DATA(dataset, "euroc_mh01_apvi");
  const TmpDir tmp;
  RigCalibrationOptions options;
  options.dives = {dataset};
  options.config = test::source_dir() / "configs/datasets/euroc_apvi.yaml";
  options.output = tmp.path() / "rig.yaml";
  options.runs = tmp.path() / "runs";
  const RigCalibration found = calibrate_rig(options);
  EXPECT_TRUE(fs::exists(options.runs / "dive1-round1" / "metrics.json"));
  const auto focal = [](const config::Node& rig) {
    return make_rig(rig).cameras.front().model.parameters().fx;
  };
  EXPECT_NEAR(focal(found.rig), 458.65, 0.02 * 458.65);
  EXPECT_EQ(focal(io::load_rig_file(options.output)), focal(found.rig));
}

}  // namespace
}  // namespace apvi::runs
