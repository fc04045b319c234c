// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/log_clock.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace apvi::importer {

LogClock::Point LogClock::point_of(Stamp device, Stamp arrival) const {
  return {seconds_between(origin_, device), ((arrival - device) - offset_).seconds()};
}

void LogClock::add(Stamp device, Stamp arrival) {
  if (!started_) {
    started_ = true;
    origin_ = device;
    last_ = device;
    offset_ = arrival - device;
  }
  last_ = std::max(last_, device);
  const Point point = point_of(device, arrival);
  const auto [it, is_first] = lowest_.try_emplace(std::lround(point.x), point);
  if (point.y < it->second.y) it->second = point;
}

bool LogClock::is_restart(Stamp device) const {
  constexpr double kOutOfOrder_s = 2.0;  // messages overtake each other
  return started_ && seconds_between(device, last_) > kOutOfOrder_s;
}

void LogClock::fit() {
  constexpr double kMaxSkew = 1e-3;  // more is a clock that was set
  std::vector<Point> hull;
  double mean = 0.0;
  double least = 0.0;
  for (const auto& entry : lowest_) {
    const Point& p = entry.second;
    const auto is_above = [&] {
      const Point& a = hull[hull.size() - 2];
      const Point& b = hull.back();
      return (b.y - a.y) * (p.x - a.x) >= (p.y - a.y) * (b.x - a.x);
    };
    while (hull.size() > 1 && is_above()) hull.pop_back();
    hull.push_back(p);
    mean += p.x / static_cast<double>(lowest_.size());
    least = std::min(least, p.y);
  }
  intercept_ = least;
  const auto right = std::ranges::find_if(hull, [&](const Point& p) { return p.x > mean; });
  if (right == hull.begin() || right == hull.end()) return;
  const Point& left = *(right - 1);
  const double slope = (right->y - left.y) / (right->x - left.x);
  if (std::abs(slope) > kMaxSkew) return;
  slope_ = slope;
  intercept_ = left.y - slope * left.x;
}

Stamp LogClock::to_arrival(Stamp device) const {
  const double x = seconds_between(origin_, device);
  return device + offset_ + Duration::from_seconds(intercept_ + slope_ * x);
}

}  // namespace apvi::importer
