// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <fstream>

#include "io/dataset_builder.hpp"
#include "support/test_data.hpp"

namespace apvi {
namespace {

// Lines of a csv below its header.
std::size_t rows_of(const std::filesystem::path& csv) {
  std::ifstream in(csv);
  std::size_t lines = 0;
  for (std::string line; std::getline(in, line);) ++lines;
  return lines == 0 ? 0 : lines - 1;
}

class RealRecording : public testing::TestWithParam<const char*> {};

TEST_P(RealRecording, DeliversAllRowsInOrder) {
  APVI_NEEDS_DATA(folder, GetParam());
  const auto out = test::read_dataset(test::config_for(folder));
  const std::map<std::string, std::string> folders = {
      {"imu", "imu0"},     {"dvl", "dvl0"},    {"pressure", "pressure0"},
      {"depth", "depth0"}, {"camera", "cam0"}, {"gnss", "gnss0"}};
  std::size_t total = 0;
  for (const auto& [kind, report] : out.report) {
    const auto csv = folder / "mav0" / folders.at(kind) / "data.csv";
    EXPECT_EQ(report.delivered + out.dropped(kind), rows_of(csv)) << kind;
    EXPECT_EQ(out.dropped(kind), 0U) << kind;
    total += report.delivered;
  }
  EXPECT_EQ(out.events.size(), total);
  EXPECT_TRUE(
      std::is_sorted(out.events.begin(), out.events.end(),
                     [](const auto& a, const auto& b) { return stamp_of(a) < stamp_of(b); }));
}

INSTANTIATE_TEST_SUITE_P(All, RealRecording,
                         testing::Values("blueye_auto_square", "akit_01", "akit_06",
                                         "sonia_pool_square", "sonia_pool_circle",
                                         "euroc_mh01_apvi", "euroc_v101_posed"),
                         [](const auto& name) { return std::string(name.param); });

TEST(RealRecordings, BlueyeReferenceIsGnssWithoutHeight) {
  APVI_NEEDS_DATA(folder, "blueye_auto_square");
  const auto reference = io::open_sequence(test::config_for(folder), {})->reference();
  ASSERT_TRUE(reference);
  EXPECT_FALSE(reference->has_rotation);
  EXPECT_FALSE(reference->has_height);
  EXPECT_EQ(reference->size(), rows_of(folder / "mav0/gnss0/data.csv"));
}

TEST(RealRecordings, EurocImagesHaveCalibratedSize) {
  APVI_NEEDS_DATA(folder, "euroc_mh01_apvi");
  const auto reader = io::open_sequence(test::config_for(folder), {"camera"});
  const auto event = reader->next();
  ASSERT_TRUE(event);
  const cv::Mat image = std::get<ImageFrame>(*event).decode();
  EXPECT_EQ(image.size(), cv::Size(752, 480));
  EXPECT_EQ(image.type(), CV_8UC1);
}

}  // namespace
}  // namespace apvi
