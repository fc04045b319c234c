// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/dive_view.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

Stamp at_s(double seconds) {
  return Stamp{1'700'000'000'000'000'000} + Duration::from_seconds(seconds);
}

// Beams 30 degrees off the z axis.
DvlCalibration janus() {
  DvlCalibration dvl;
  const double c = std::sqrt(0.75);
  dvl.beams = {Eigen::Vector3d(0.5, 0, c), Eigen::Vector3d(0, 0.5, c), Eigen::Vector3d(-0.5, 0, c),
               Eigen::Vector3d(0, -0.5, c)};
  dvl.time_offset_s = 0.1;
  dvl.scale = 1.1;
  return dvl;
}

TEST(ShownPing, HasTheRangesAndWhichBeamsAreValid) {
  DvlSample ping;
  ping.stamp = at_s(5.0);
  ping.valid = true;
  ping.beams[0] = {.velocity = 0.0, .range = 2.0, .valid = true};
  ping.beams[1] = {.velocity = 0.0, .range = 3.0, .valid = false};
  ping.beams[2] = {.velocity = 0.0, .range = std::nullopt, .valid = true};
  const viewer::BeamPing shown = shown_ping(ping, janus());
  EXPECT_EQ(shown.stamp, at_s(4.9));
  EXPECT_NEAR(shown.length_m[0], 2.2, 1e-12);  // at the true speed of sound
  EXPECT_NEAR(shown.length_m[1], 3.3, 1e-12);
  EXPECT_EQ(shown.length_m[2], 1.0);
  EXPECT_EQ(shown.measured, (std::array<bool, 4>{true, true, false, false}));
  EXPECT_EQ(shown.valid, (std::array<bool, 4>{true, false, true, true}));
}

TEST(ShownPing, WithoutRangesBeamsEndAtTheAltitude) {
  DvlSample ping;
  ping.altitude = 3.0;
  const viewer::BeamPing shown = shown_ping(ping, janus());
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(shown.length_m.at(i), 3.3 / std::sqrt(0.75), 1e-9);
    EXPECT_FALSE(shown.valid.at(i));
    EXPECT_FALSE(shown.measured.at(i));
  }
  ping.altitude = 1e30;
  EXPECT_EQ(shown_ping(ping, janus()).length_m[0], 1000.0);
}

TEST(ShownSensors, AreOrderedAndGnssIsNone) {
  const auto tracks = shown_sensors({{"depth", at_s(0), at_s(9), 9},
                                     {"gnss", at_s(0), at_s(9), 9},
                                     {"imu", at_s(0), at_s(4), 9},
                                     {"imu", at_s(5), at_s(9), 9}});
  ASSERT_EQ(tracks.size(), 2U);
  EXPECT_EQ(tracks[0].name, "imu");
  EXPECT_EQ(tracks[0].spans.size(), 2U);
  EXPECT_EQ(tracks[1].name, "depth");
  EXPECT_TRUE(shown_sensors({}).empty());
}

TEST(ShownSensors, SpansAreBounded) {
  std::vector<SensorSpan> spans;
  for (int k = 0; k < 100'000; ++k) spans.push_back({"imu", at_s(k), at_s(k + 0.5), 1});
  const auto tracks = shown_sensors(spans);
  EXPECT_LE(tracks.at(0).spans.size(), 2001U);
  EXPECT_EQ(tracks.at(0).spans.back().second, at_s(99'999.5));
}

TEST(ReadBeams, WithoutARecordingThereAreNone) {
  const test::TmpDir tmp;
  RunConfig config;
  EXPECT_FALSE(read_beams(config, [] { return false; }));
  config.dataset.path = (tmp.path() / "gone").string();
  EXPECT_FALSE(read_beams(config, [] { return false; }));
}

}  // namespace
}  // namespace apvi::runs
