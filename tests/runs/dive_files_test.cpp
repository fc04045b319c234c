// SPDX-License-Identifier: BSD-3-Clause
#include "runs/dive_files.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "apvi/core/error.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

Stamp at_s(double seconds) {
  return Stamp{1'700'000'000'000'000'000} + Duration::from_seconds(seconds);
}

// Of a sensor that reports every `period_s` from `begin_s` to `end_s`.
void add_images(SensorSpans& spans, double begin_s, double end_s, double period_s) {
  for (double t = begin_s; t <= end_s; t += period_s) spans.add(ImageFrame{at_s(t), 0, {}, {}});
}

TEST(SensorSpans, AnOutageEndsASpan) {
  SensorSpans spans;
  add_images(spans, 0.0, 10.0, 0.5);
  add_images(spans, 12.0, 20.0, 0.5);
  spans.add(PressureSample{at_s(1.0), 2e5});
  ASSERT_EQ(spans.all().size(), 3U);
  const SensorSpan first = spans.all().front();
  EXPECT_EQ(first.sensor, "camera");
  EXPECT_EQ(first.begin, at_s(0.0));
  EXPECT_EQ(first.end, at_s(10.0));
  EXPECT_EQ(first.samples, 21U);
  EXPECT_EQ(spans.all()[1].begin, at_s(12.0));
  EXPECT_EQ(spans.all()[2].sensor, "pressure");
  EXPECT_EQ(spans.all()[2].end, at_s(1.0));
}

TEST(SensorSpans, ADvlWithoutBottomLockDoesNotServe) {
  SensorSpans spans;
  for (int k = 0; k <= 100; ++k) {
    DvlSample ping;
    ping.stamp = at_s(0.2 * k);
    ping.valid = k < 40 || k >= 60;
    spans.add(ping);
  }
  ASSERT_EQ(spans.all().size(), 2U);
  EXPECT_EQ(spans.all()[0].end, at_s(0.2 * 39));
  EXPECT_EQ(spans.all()[1].begin, at_s(0.2 * 60));
}

class DiveFilesTest : public testing::Test {
 protected:
  std::filesystem::path with(const std::string& content) const {
    const auto file = tmp_.path() / "file.csv";
    std::ofstream(file) << content;
    return file;
  }
  test::TmpDir tmp_;
};

TEST_F(DiveFilesTest, SpansAreReadAsWritten) {
  const auto file = tmp_.path() / kSensorsFile;
  write_sensor_spans(file,
                     {{"camera", at_s(0.0), at_s(1.5), 31}, {"imu", at_s(0.1), at_s(9.0), 1}});
  const auto spans = read_sensor_spans(file);
  ASSERT_EQ(spans.size(), 2U);
  EXPECT_EQ(spans[0].sensor, "camera");
  EXPECT_EQ(spans[0].end, at_s(1.5));
  EXPECT_EQ(spans[0].samples, 31U);
  EXPECT_EQ(spans[1].begin, at_s(0.1));
}

TEST_F(DiveFilesTest, LoopsAreReadAsWritten) {
  const auto file = tmp_.path() / kLoopsFile;
  write_loops(file, {{at_s(1.0), at_s(50.0)}, {at_s(2.0), at_s(51.0)}});
  const auto loops = read_loops(file);
  ASSERT_EQ(loops.size(), 2U);
  EXPECT_EQ(loops[1].from, at_s(2.0));
  EXPECT_EQ(loops[1].to, at_s(51.0));
  write_loops(file, {});
  EXPECT_TRUE(read_loops(file).empty());
}

TEST_F(DiveFilesTest, AnAbsentFileIsEmpty) {
  EXPECT_TRUE(read_loops(tmp_.path() / "nothing.csv").empty());
  EXPECT_TRUE(read_sensor_spans(tmp_.path() / "nothing.csv").empty());
}

TEST_F(DiveFilesTest, DamagedLinesAreNamed) {
  for (const char* line :
       {"12", "12,", "12,x", "12,-3", "12,13,14", "1e3,4", "12,99999999999999999999"}) {
    try {
      read_loops(with(std::string("#from [ns],to [ns]\n1,2\n") + line + "\n"));
      ADD_FAILURE() << line;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("file.csv:3"), std::string::npos) << error.what();
    }
  }
  EXPECT_THROW(read_sensor_spans(with("imu,1,2\n")), InputError);
  EXPECT_THROW(read_sensor_spans(with("imu,1,2,many\n")), InputError);
}

}  // namespace
}  // namespace apvi::runs
