// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/row_order.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

#include "core/median.hpp"

namespace apvi::io {
namespace {

constexpr std::size_t kFewRows = 20;

// A stamp farther from the middle of the recording is none of it; one row alone so far from both of
// its neighbors is broken.
constexpr double kStray_s = 86'400.0;
constexpr double kBroken_s = 10.0;

// Parts of one recording in another order leave no longer gap between them.
constexpr double kGap_s = 10.0;

// Of the rows, those earlier than the row before them in a file without any order.
constexpr double kNoOrder = 0.1;

// The mean distance of times that come again from those before, in steps between rows: 0.25 for
// a steady rate. That of rows which were left out is 1, or 0.7 for rows at random times.
constexpr double kComesAgain = 0.55;

bool is_broken(const std::vector<double>& t, std::size_t i) {
  return i > 0 && i + 1 < t.size() && std::abs(t[i] - t[i - 1]) > kBroken_s &&
         std::abs(t[i + 1] - t[i]) > kBroken_s && std::abs(t[i + 1] - t[i - 1]) <= kBroken_s;
}

double middle_of(const std::vector<TimedRow>& rows) {
  std::vector<double> times;
  for (const TimedRow& row : rows) {
    if (std::isfinite(row.time_s)) times.push_back(row.time_s);
  }
  return times.empty() ? 0.0 : median(std::move(times));
}

// The times to sort by: rows that must stay have that of the row before.
std::vector<double> times_to_sort_by(const std::vector<TimedRow>& rows) {
  const double middle = middle_of(rows);
  std::vector<double> times;
  double before = -std::numeric_limits<double>::infinity();
  for (const TimedRow& row : rows) {
    if (std::abs(row.time_s - middle) < kStray_s) before = row.time_s;
    times.push_back(before);
  }
  return times;
}

std::vector<std::size_t> late_rows(const std::vector<double>& times) {
  std::vector<std::size_t> late;
  for (std::size_t i = 1; i < times.size(); ++i) {
    if (times[i] < times[i - 1]) late.push_back(i);
  }
  return late;
}

void keep_broken(std::vector<double>& times) {
  const std::vector<double> all = times;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (is_broken(all, i)) times[i] = times[i - 1];
  }
}

double usual_step(const std::vector<double>& times) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < times.size(); ++i) {
    const double step = times[i] - times[i - 1];
    if (step > 0.0 && std::isfinite(step)) steps.push_back(step);
  }
  return steps.empty() ? 0.0 : median(std::move(steps));
}

struct Run {
  std::size_t begin, end;
};

// How far the times of a run are from those of the run before it, where both are, in steps of 1 at
// most; 1 where they do not meet, and for rows that are repeated as they are.
double distance_of(const Run& before, const Run& run, const std::vector<double>& times,
                   const std::vector<TimedRow>& rows, double step) {
  const std::span earlier(times.begin() + static_cast<std::ptrdiff_t>(before.begin),
                          times.begin() + static_cast<std::ptrdiff_t>(before.end));
  double sum = 0.0;
  std::size_t count = 0;
  for (std::size_t i = run.begin; i < run.end; ++i) {
    if (times[i] < earlier.front() || times[i] > earlier.back()) continue;
    const auto next = static_cast<std::size_t>(
        std::lower_bound(earlier.begin(), earlier.end(), times[i]) - earlier.begin());
    double distance = earlier[next] - times[i];
    if (next > 0) distance = std::min(distance, times[i] - earlier[next - 1]);
    const bool repeated = distance == 0.0 && rows[before.begin + next].content == rows[i].content;
    sum += repeated ? 1.0 : std::min(1.0, distance / step);
    ++count;
  }
  return count == 0 ? 1.0 : sum / static_cast<double>(count);
}

bool times_come_again(const std::vector<double>& times, const std::vector<std::size_t>& late,
                      const std::vector<TimedRow>& rows) {
  const double step = usual_step(times);
  double sum = 0.0;
  Run before{0, late.front()};
  for (std::size_t i = 0; i < late.size(); ++i) {
    const Run run{late[i], i + 1 < late.size() ? late[i + 1] : times.size()};
    sum += distance_of(before, run, times, rows, step);
    before = run;
  }
  return step <= 0.0 || sum < kComesAgain * static_cast<double>(late.size());
}

bool has_new_gap(const std::vector<double>& times, const std::vector<std::size_t>& order) {
  for (std::size_t i = 1; i < order.size(); ++i) {
    const bool is_new = order[i] != order[i - 1] + 1;
    if (is_new && times[order[i]] - times[order[i - 1]] > kGap_s) return true;
  }
  return false;
}

}  // namespace

RowOrder order_by_time(const std::vector<TimedRow>& rows) {
  if (rows.size() < kFewRows) return {};
  std::vector<double> times = times_to_sort_by(rows);
  std::vector<std::size_t> late = late_rows(times);
  const auto count = static_cast<double>(rows.size());
  const bool has_order = static_cast<double>(late.size()) < kNoOrder * count;
  if (has_order) {
    keep_broken(times);
    late = late_rows(times);
  }
  if (late.empty() || (has_order && times_come_again(times, late, rows))) return {};
  std::vector<std::size_t> order(rows.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return times[a] < times[b]; });
  if (has_order && has_new_gap(times, order)) return {};
  return {std::move(order), late.size()};
}

}  // namespace apvi::io
