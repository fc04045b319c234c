// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/row_order.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <random>
#include <sstream>

#include "io/dataset_builder.hpp"
#include "io/trajectory/trajectory_text.hpp"

namespace apvi::io {
namespace {

constexpr std::size_t kRows = 1000;
constexpr double kStep_s = 0.1;

// Rows at these times, with texts of their own.
std::vector<TimedRow> rows_at(const std::function<double(double)>& clock) {
  std::vector<TimedRow> rows;
  for (std::size_t i = 0; i < kRows; ++i) {
    rows.push_back({clock(kStep_s * static_cast<double>(i)), i});
  }
  return rows;
}

std::vector<TimedRow> regular_rows() {
  return rows_at([](double t) { return t; });
}

void expect_sorted(const std::vector<TimedRow>& rows) {
  const RowOrder order = order_by_time(rows);
  ASSERT_EQ(order.rows.size(), rows.size());
  EXPECT_GT(order.late, 0U);
  for (std::size_t i = 1; i < rows.size(); ++i) {
    EXPECT_LE(rows[order.rows[i - 1]].time_s, rows[order.rows[i]].time_s);
  }
}

TEST(RowOrder, MixedRowsAreSorted) {
  std::mt19937 random(1);
  std::vector<TimedRow> all = regular_rows();
  std::shuffle(all.begin(), all.end(), random);
  expect_sorted(all);
  std::vector<TimedRow> reversed = regular_rows();
  std::reverse(reversed.begin(), reversed.end());
  expect_sorted(reversed);
  std::vector<TimedRow> neighbors = regular_rows();
  for (std::size_t i = 40; i < kRows; i += 40) std::swap(neighbors[i], neighbors[i - 1]);
  expect_sorted(neighbors);
}

TEST(RowOrder, PartsInAnotherOrderAreSorted) {
  std::vector<TimedRow> rows = regular_rows();
  std::rotate(rows.begin(), rows.begin() + 300, rows.end());
  expect_sorted(rows);
}

TEST(RowOrder, AFileThatWasAddedToItselfIsSorted) {
  std::vector<TimedRow> rows = regular_rows();
  const std::vector<TimedRow> again = rows;
  rows.insert(rows.end(), again.begin(), again.end());
  expect_sorted(rows);
}

TEST(RowOrder, RowsInOrderStay) {
  EXPECT_TRUE(order_by_time(regular_rows()).rows.empty());
  EXPECT_TRUE(order_by_time({}).rows.empty());
}

TEST(RowOrder, AfterASetClockTheOrderOfTheFileCounts) {
  for (const double back_s : {0.95, 20.03, 600.0, 1e6}) {
    const auto rows = rows_at([=](double t) { return t < 40.0 ? t : t - back_s; });
    EXPECT_TRUE(order_by_time(rows).rows.empty()) << back_s;
    const auto returns = rows_at([=](double t) { return t < 40.0 || t > 60.0 ? t : t - back_s; });
    EXPECT_TRUE(order_by_time(returns).rows.empty()) << back_s;
  }
}

TEST(RowOrder, BrokenStampsStay) {
  std::vector<TimedRow> rows = regular_rows();
  for (std::size_t i = 100; i < kRows; i += 100) rows[i].time_s = i % 200 == 0 ? 0.0 : 5e8;
  rows[50].time_s = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(order_by_time(rows).rows.empty());
}

TEST(CsvOrder, RowsOfAShuffledFileComeInOrderOfTime) {
  std::vector<std::string> lines;
  for (int i = 0; i < 500; ++i) lines.push_back(test::imu_row(1'000'000'000 + 5'000'000LL * i));
  std::mt19937 random(2);
  std::shuffle(lines.begin(), lines.end(), random);
  std::string text = test::kImuHeader;
  for (const std::string& line : lines) text += line;
  text.pop_back();  // no line break at the end
  const test::TmpDir dir;
  test::write_imu(dir, text);
  testing::internal::CaptureStderr();
  const auto out = test::read_dataset(test::config_for(dir.path()));
  EXPECT_THAT(testing::internal::GetCapturedStderr(),
              testing::HasSubstr("of 500 rows are earlier than the row before; all are sorted"));
  ASSERT_EQ(out.delivered("imu"), 500U);
  EXPECT_EQ(out.dropped("imu"), 0U);
  EXPECT_THAT(out.report.at("imu").remark, testing::HasSubstr("sorted by time"));
  for (int i = 0; i < 500; ++i) {
    EXPECT_EQ(stamp_of(out.events[static_cast<std::size_t>(i)]).ns,
              1'000'000'000 + 5'000'000LL * i);
  }
}

TEST(TrajectoryOrder, MixedLinesAreSorted) {
  std::vector<std::string> lines;
  for (int i = 0; i < 100; ++i) lines.push_back(fmt::format("{}.5 {} 0 0 0 0 0 1\n", 10 + i, i));
  std::mt19937 random(3);
  std::shuffle(lines.begin(), lines.end(), random);
  std::string text;
  for (const std::string& line : lines) text += line;
  std::istringstream in(text);
  const Trajectory trajectory = parse_trajectory(in, "mixed.tum", BadLines::fail);
  ASSERT_EQ(trajectory.size(), 100U);
  EXPECT_EQ(trajectory.poses[7].T_world_body.translation.x(), 7.0);
}

}  // namespace
}  // namespace apvi::io
