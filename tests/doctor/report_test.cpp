// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/report.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

namespace apvi::doctor {
namespace {

using testing::HasSubstr;

Report example() {
  Report report;
  report.dataset = "some/folder";
  report.add({Severity::ok, "imu0", "rate", "100 Hz", "", {{"median_hz", 100.0}}});
  report.add({Severity::error,
              "dvl0",
              "speed",
              std::string(40, 'a') + " " + std::string(60, 'b'),
              "do this",
              {{"median_m_s", std::nan("")}}});
  report.add({Severity::note, "imu0", "gaps", "none", "", {}});
  return report;
}

TEST(Report, CountsAndFindsFindings) {
  const Report report = example();
  EXPECT_EQ(report.count(Severity::error), 1u);
  EXPECT_EQ(report.count(Severity::warning), 0u);
  EXPECT_EQ(report.find("imu0", "gaps")->message, "none");
  EXPECT_EQ(report.find("imu0", "speed"), nullptr);
}

TEST(ReportText, GroupsBySensorAlignsAndWraps) {
  const std::string text = to_text(example());
  EXPECT_THAT(text, HasSubstr("some/folder\n\nimu0\n"
                              "  ok       rate                100 Hz\n"
                              "  note     gaps                none\n\ndvl0\n"));
  EXPECT_THAT(text, HasSubstr("\n                               " + std::string(60, 'b') + "\n"));
  EXPECT_THAT(text, HasSubstr("\n                            -> do this\n"));
  EXPECT_THAT(text, HasSubstr("\n1 error, 0 warnings, 1 note\n"));
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) EXPECT_LE(line.size(), 110u);
}

TEST(ReportJson, IsOneObjectWithNumbersAndNullForNan) {
  const auto json = nlohmann::json::parse(to_json(example()));
  EXPECT_EQ(json.at("errors"), 1);
  EXPECT_EQ(json.at("findings").size(), 3u);
  EXPECT_EQ(json.at("findings")[0].at("values").at("median_hz"), 100.0);
  EXPECT_TRUE(json.at("findings")[1].at("values").at("median_m_s").is_null());
  EXPECT_EQ(json.at("findings")[1].at("severity"), "error");
}

TEST(ReportJson, HandlesNonUtf8Bytes) {
  Report report = example();
  report.dataset = "a\xff\xfe";
  EXPECT_NO_THROW(nlohmann::json::parse(to_json(report)));
}

}  // namespace
}  // namespace apvi::doctor
