// SPDX-License-Identifier: BSD-3-Clause
#include "importer/gpmf.hpp"

#include <gtest/gtest.h>

#include "importer/mp4_bytes.hpp"

namespace apvi::importer {
namespace {

using namespace test;

GpmfPayload parse(const std::string& payload) {
  return parse_gpmf(as_bytes(payload));
}

TEST(Gpmf, ScalesSamplesAndReadsTheirDescription) {
  const GpmfPayload payload = parse(device(sensor_stream(
      {.key = "ACCL",
       .before = stamp_us(1'500'000) + klv_text("SIUN", "m/s2") + klv_text("ORIN", "YxZ"),
       .scale = 50,
       .samples = {{100, -50, 490}, {0, 25, -1}}})));
  EXPECT_EQ(payload.device, "HERO10 Black");
  const GpmfStream* accel = payload.find("ACCL");
  ASSERT_NE(accel, nullptr);
  EXPECT_EQ(accel->size(), 2U);
  EXPECT_EQ(accel->values, (std::vector<double>{2.0, -1.0, 9.8, 0.0, 0.5, -0.02}));
  EXPECT_EQ(accel->unit, "m/s2");
  EXPECT_EQ(accel->orientation_in, "YxZ");
  EXPECT_EQ(accel->stamp_s, 1.5);
}

TEST(Gpmf, ChannelsMayHaveTheirOwnScale) {
  const std::string scale = klv("SCAL", 's', 2, 3, i16(1) + i16(10) + i16(100));
  const std::string data = klv("WRGB", 's', 6, 1, i16(7) + i16(7) + i16(7));
  EXPECT_EQ(parse(device(nest("STRM", scale + data))).find("WRGB")->values,
            (std::vector<double>{7.0, 0.7, 0.07}));
}

TEST(Gpmf, StopsAtTheFirstDamagedItem) {
  const std::string good = sensor_stream({.samples = {{1, 2, 3}}});
  std::string bytes = device(good);
  bytes.resize(bytes.size() - 3);
  EXPECT_EQ(parse(bytes).find("GYRO"), nullptr);
  EXPECT_TRUE(parse("DEVC").streams.empty());
}

TEST(Gpmf, ReadsSettingsOfTheFieldOfView) {
  const std::string items =
      nest("DEVC", klv_text("VFOV", "L") + klv("ZFOV", 'f', 4, 1, f32(95.5F))) +
      klv_text("MINF", "HERO9 Black");
  const GpmfSettings settings = parse_gpmf_settings(as_bytes(items));
  EXPECT_EQ(settings.field_of_view, "L");
  EXPECT_EQ(settings.diagonal_deg, 95.5);
  EXPECT_EQ(settings.device, "HERO9 Black");
}

}  // namespace
}  // namespace apvi::importer
