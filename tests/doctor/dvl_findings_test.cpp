// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "doctor/dive.hpp"

namespace apvi::doctor {
namespace {

using test::Dive;
using test::examine;
using test::healthy_dive;

void turn_beams(DvlSample& sample) {
  std::swap(sample.beams[0], sample.beams[2]);
  std::swap(sample.beams[1], sample.beams[3]);
}

TEST(DvlFindings, WithoutBottomLockIsAnError) {
  Dive dive = healthy_dive();
  for (DvlSample& s : dive.dvl) s.valid = false;
  EXPECT_FINDING(examine(dive), "dvl0", "validity", error, "0.0 %");
}

TEST(DvlFindings, LowFractionOfValidPingsIsAWarning) {
  Dive dive = healthy_dive();
  for (std::size_t i = 0; i < dive.dvl.size(); ++i) dive.dvl[i].valid = i % 3 == 0;
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "validity", warning, "have bottom lock");
  EXPECT_NEAR(test::value_of(report, "dvl0", "validity", "share"), 1.0 / 3.0, 0.01);
}

TEST(DvlFindings, LongDropoutIsAWarningWithTime) {
  Dive dive = healthy_dive();
  for (std::size_t i = 101; i < 150; ++i) dive.dvl[i].valid = false;
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "dropouts", warning, "from 20.0 s on");
  EXPECT_NEAR(test::value_of(report, "dvl0", "dropouts", "longest_s"), 10.0, 1e-6);
}

TEST(DvlFindings, DropoutAtTheEndCounts) {
  Dive dive = healthy_dive();
  for (std::size_t i = dive.dvl.size() - 100; i < dive.dvl.size(); ++i) dive.dvl[i].valid = false;
  EXPECT_NEAR(test::value_of(examine(dive), "dvl0", "dropouts", "longest_s"), 20.0, 1e-6);
}

TEST(DvlFindings, ValidZerosAreAWarning) {
  Dive dive = healthy_dive();
  for (std::size_t i = 200; i < 230; ++i) dive.dvl[i].velocity.setZero();
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "zeros", warning, "30 pings");
}

TEST(DvlFindings, MillimetersPerSecondAreAnError) {
  Dive dive = healthy_dive();
  for (DvlSample& s : dive.dvl) s.velocity *= 1000.0;
  EXPECT_FINDING(examine(dive), "dvl0", "speed", error, "mm/s");
}

TEST(DvlFindings, RepeatedPingsAreAWarning) {
  Dive dive = healthy_dive();
  for (std::size_t i = 0; i < dive.dvl.size(); ++i) {
    const Stamp stamp = dive.dvl[i].stamp;
    dive.dvl[i] = dive.dvl[i - i % 4];
    dive.dvl[i].stamp = stamp;
  }
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "repeats", warning, "repeat the previous one");
  EXPECT_NEAR(test::value_of(report, "dvl0", "repeats", "fresh_hz"), 1.25, 0.02);
}

TEST(DvlFindings, FigureOfMeritWithoutSolutionIsANote) {
  Dive dive = healthy_dive();
  for (std::size_t i = 0; i < dive.dvl.size(); i += 50) dive.dvl[i].figure_of_merit = 17.49;
  EXPECT_FINDING(examine(dive), "dvl0", "figure of merit", note, "no solution");
}

TEST(DvlFindings, WrongBeamOrderFailsParityCheck) {
  Dive dive = healthy_dive();
  for (DvlSample& s : dive.dvl) std::swap(s.beams[1], s.beams[2]);
  EXPECT_FINDING(examine(dive), "dvl0", "beam parity", warning, "beam 0 opposite to beam 1");
}

TEST(DvlFindings, BadBeamFailsParityCheck) {
  Dive dive = healthy_dive();
  for (DvlSample& s : dive.dvl) s.beams[3]->velocity *= 0.2;
  EXPECT_FINDING(examine(dive), "dvl0", "beam parity", warning, "a beam is bad");
}

TEST(DvlFindings, ReportsAngleBetweenBeamsAndVelocity) {
  Dive dive = healthy_dive();
  for (DvlSample& s : dive.dvl) turn_beams(s);
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "beams, velocity", warning, "rotated by 180 deg about z");
  const Finding* found = report.find("dvl0", "beams, velocity");
  EXPECT_THAT(found->advice, testing::HasSubstr("[[0.270598, -0.270598, 0.923880]"));
  EXPECT_EQ(report.find("dvl0", "beam parity")->severity, Severity::ok);
}

TEST(DvlFindings, RotatedBeamsAgreeWithRotatedRig) {
  Dive dive = healthy_dive();
  for (DvlSample& s : dive.dvl) turn_beams(s);
  dive.rig.insert(dive.rig.rfind('}'),
                  ", beams: [[0.270598, -0.270598, 0.923880], [0.270598, 0.270598, 0.923880], "
                  "[-0.270598, 0.270598, 0.923880], [-0.270598, -0.270598, 0.923880]]");
  EXPECT_FINDING(examine(dive), "dvl0", "beams, velocity", ok, "agree");
}

}  // namespace
}  // namespace apvi::doctor
