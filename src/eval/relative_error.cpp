// SPDX-License-Identifier: BSD-3-Clause
#include "eval/relative_error.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::eval {
namespace {

constexpr double kTolerance = 0.1;  // of the span, as evo's default

// From every pose to the one whose `position` (increasing) is `span` further, within a tolerance.
IndexPairs all_pairs(const std::vector<double>& position, double span) {
  IndexPairs found;
  for (std::size_t i = 0; i + 1 < position.size(); ++i) {
    const double goal = position[i] + span;
    const auto from = position.begin() + static_cast<std::ptrdiff_t>(i) + 1;
    auto best = std::lower_bound(from, position.end(), goal);
    if (best == position.end() || (best != from && goal - *std::prev(best) <= *best - goal)) {
      best = std::lower_bound(from, position.end(), *std::prev(best));  // the first of equals
    }
    if (std::abs(*best - goal) > kTolerance * span) continue;
    found.emplace_back(i, static_cast<std::size_t>(best - position.begin()));
  }
  return found;
}

std::vector<double> path_lengths(const std::vector<PosePair>& pairs) {
  std::vector<double> distance(pairs.size(), 0.0);
  for (std::size_t i = 1; i < pairs.size(); ++i) {
    distance[i] = distance[i - 1] +
                  (pairs[i].estimate.translation - pairs[i - 1].estimate.translation).norm();
  }
  return distance;
}

}  // namespace

IndexPairs pairs_by_time(const std::vector<PosePair>& pairs, double seconds) {
  std::vector<double> time;
  for (const PosePair& pair : pairs) {
    time.push_back(seconds_between(pairs.front().stamp, pair.stamp));
  }
  IndexPairs found = all_pairs(time, seconds);
  // Drops pairs of the last poses, which have no pose a full span later (unlike evo by distance).
  constexpr double kJitter = 0.01;  // of the span
  std::erase_if(found, [&](const auto& ends) {
    return time[ends.first] + seconds > time.back() + kJitter * seconds;
  });
  return found;
}

IndexPairs consecutive_pairs_by_path(const std::vector<PosePair>& pairs, double distance_m) {
  IndexPairs found;
  std::size_t start = 0;
  double path = 0.0;
  for (std::size_t i = 1; i < pairs.size(); ++i) {
    path += (pairs[i].estimate.translation - pairs[i - 1].estimate.translation).norm();
    if (path < distance_m) continue;
    if (start > 0) found.emplace_back(start, i);
    start = i;
    path = 0.0;
  }
  return found;
}

IndexPairs all_pairs_by_path(const std::vector<PosePair>& pairs, double distance_m) {
  return all_pairs(path_lengths(pairs), distance_m);
}

std::vector<double> relative_errors(const std::vector<PosePair>& pairs, const IndexPairs& indices) {
  std::vector<double> errors;
  for (const auto& [i, j] : indices) {
    const SE3 truth = pairs[i].reference.inverse() * pairs[j].reference;
    const SE3 estimated = pairs[i].estimate.inverse() * pairs[j].estimate;
    errors.push_back((truth.inverse() * estimated).translation.norm());
  }
  return errors;
}

}  // namespace apvi::eval
