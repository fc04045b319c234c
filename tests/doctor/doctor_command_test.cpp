// SPDX-License-Identifier: BSD-3-Clause
// The command `apvi doctor`.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "doctor/dive.hpp"
#include "support/run_program.hpp"

namespace apvi::doctor {
namespace {

using testing::HasSubstr;

test::ProgramResult apvi_doctor(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "doctor");
  return test::run_program(APVI_PROGRAM, arguments);
}

TEST(DoctorCommand, ExitsWithZeroWithoutErrors) {
  const test::TmpDir dir;
  test::write_dive(dir, test::healthy_dive());
  const auto result = apvi_doctor({dir.path().string()});
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("0 errors, 0 warnings, 0 notes"));
}

TEST(DoctorCommand, ExitsWithOneWhenAFindingIsAnError) {
  const test::TmpDir dir;
  test::Dive dive = test::healthy_dive();
  for (ImuSample& s : dive.imu) s.accel /= 9.80665;
  test::write_dive(dir, dive);
  const auto result = apvi_doctor({dir.path().string()});
  EXPECT_EQ(result.status, 1);
  EXPECT_THAT(result.out, HasSubstr("these are g"));
}

TEST(DoctorCommand, ExitsWithTwoAndOneLineWhenNothingCanBeOpened) {
  const auto result = apvi_doctor({"/nowhere/at/all"});
  EXPECT_EQ(result.status, 2);
  EXPECT_EQ(result.out, "");
  EXPECT_THAT(result.err, HasSubstr("/nowhere/at/all"));
}

TEST(DoctorCommand, JsonOptionPrintsOnlyJson) {
  const test::TmpDir dir;
  test::write_dive(dir, test::healthy_dive());
  const auto result = apvi_doctor({"--json", dir.path().string()});
  EXPECT_EQ(result.status, 0) << result.err;
  const auto json = nlohmann::json::parse(result.out);
  EXPECT_EQ(json.at("errors"), 0);
  EXPECT_EQ(json.at("dataset"), dir.path().string());
}

TEST(DoctorCommand, AcceptsRigFileAndDatasetKeys) {
  const test::TmpDir dir;
  test::Dive dive = test::healthy_dive();
  test::write_dive(dir, dive);
  const auto rig = dir.write("other.yaml", "body: imu0\nworld: ned\nimu0: {rate_hz: 50}\n");
  const auto result = apvi_doctor({dir.path().string(), "--rig", rig.string(), "--set",
                                   "duration_s=30", "--set", "start_s=10"});
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("nominal 50 Hz"));
  EXPECT_THAT(result.out, HasSubstr("over 30.0 s"));
  EXPECT_EQ(apvi_doctor({dir.path().string(), "--set", "nonsense=1"}).status, 2);
}

}  // namespace
}  // namespace apvi::doctor
