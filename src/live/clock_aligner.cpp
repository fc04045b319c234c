// SPDX-License-Identifier: BSD-3-Clause
#include "live/clock_aligner.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace apvi::live {
namespace {

constexpr double kWindow_s = 60.0;
constexpr double kBin_s = 0.1;
constexpr double kReady_s = 1.0;
constexpr double kMaxSlew = 0.05;
// Below this span the jitter is larger than the effect of a skew.
constexpr double kMinSkewSpan_s = 15.0;
// Twice the tolerance of common crystal oscillators.
constexpr double kMaxSkew = 200e-6;
// Larger than any correction of the envelope, smaller than what a reboot changes.
constexpr double kStep_s = 0.25;
constexpr Duration kConfirmStep{1'000'000'000};
constexpr std::size_t kConfirmMessages = 3;

double cross(double ax, double ay, double bx, double by) {
  return ax * by - ay * bx;
}

}  // namespace

ClockAligner::Point ClockAligner::point_of(Stamp device, Stamp arrival) const {
  return {(device - origin_).seconds(), (arrival - device - offset_).seconds()};
}

void ClockAligner::restart(Stamp device, Stamp arrival) {
  origin_ = device;
  offset_ = arrival - device;
  lowest_.clear();
  rise_.reset();
  skew_ = intercept_ = applied_x_ = applied_y_ = 0.0;
  started_ = true;
}

void ClockAligner::add(Stamp device, Stamp arrival) {
  if (!started_) restart(device, arrival);
  Point point = point_of(device, arrival);
  const double excess = point.y - line(point.x);
  if (is_step(excess, arrival)) {
    ++steps_;
    last_step_ = Duration::from_seconds(-excess);
    restart(device, arrival);
    point = {};
  } else if (rise_) {
    return;  // a stalled link or a clock set back; neither belongs to the envelope
  }
  insert(point);
  slew(point.x);
}

bool ClockAligner::is_step(double excess, Stamp arrival) {
  if (lowest_.empty() || excess < kStep_s) {
    rise_.reset();
    return !lowest_.empty() && excess < -kStep_s;
  }
  if (!rise_) rise_ = Rise{.since = arrival};
  ++rise_->messages;
  return rise_->messages >= kConfirmMessages && arrival - rise_->since >= kConfirmStep;
}

void ClockAligner::insert(const Point& point) {
  const auto bin = static_cast<std::int64_t>(std::floor(point.x / kBin_s));
  const auto [it, is_new] = lowest_.try_emplace(bin, point);
  const bool lower = point.y < it->second.y;
  if (lower) it->second = point;
  const auto oldest = bin - static_cast<std::int64_t>(kWindow_s / kBin_s);
  lowest_.erase(lowest_.begin(), lowest_.lower_bound(oldest));
  if (is_new || lower) fit();
  if (point.x >= kReady_s) ready_ = true;
}

void ClockAligner::fit() {
  std::vector<Point> hull;
  double mean = 0.0;
  for (const auto& [bin, p] : lowest_) {
    mean += p.x / static_cast<double>(lowest_.size());
    while (hull.size() >= 2) {
      const Point& a = hull[hull.size() - 2];
      const Point& b = hull.back();
      if (cross(b.x - a.x, b.y - a.y, p.x - a.x, p.y - a.y) > 0.0) break;
      hull.pop_back();
    }
    hull.push_back(p);
  }
  skew_ = 0.0;
  if (hull.back().x - hull.front().x >= kMinSkewSpan_s) {
    const auto after = std::find_if(hull.begin() + 1, hull.end() - 1,
                                    [mean](const Point& p) { return p.x > mean; });
    const Point& before = *(after - 1);
    const double slope = (after->y - before.y) / (after->x - before.x);
    skew_ = std::clamp(slope, -kMaxSkew, kMaxSkew);
  }
  intercept_ = std::numeric_limits<double>::infinity();
  for (const Point& p : hull) intercept_ = std::min(intercept_, p.y - skew_ * p.x);
}

void ClockAligner::slew(double x) {
  const double now = applied_y_ + skew_ * (x - applied_x_);
  const double correction = line(x) - now;
  const double limit = kMaxSlew * std::max(0.0, x - applied_x_);
  applied_y_ = ready_ ? now + std::clamp(correction, -limit, limit) : line(x);
  applied_x_ = x;
}

Stamp ClockAligner::to_host(Stamp device) const {
  const double since_s = (device - origin_).seconds() - applied_x_;
  return device + offset_ + Duration::from_seconds(applied_y_ + skew_ * since_s);
}

}  // namespace apvi::live
