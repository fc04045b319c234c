// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/frame_rate.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::viewer {
namespace {

constexpr double kMinScale = 0.25;
constexpr double kSteps = 8.0;
constexpr double kMaxGrowth = 1.1;  // of the area from one image to the next, so that it settles
constexpr double kMaxShrink = 0.7;
constexpr std::size_t kMemory = 40;  // transfers
constexpr double kMinSpread = 0.05;  // standard deviation of sizes that tells the delay, relative

}  // namespace

// Slope of a line through the transfers: a far link delays large and small images alike, and the
// next one is under way meanwhile. Of images of one size, the delay is not known and counts, too.
double FrameRate::seconds_per_byte() const {
  const auto n = static_cast<double>(transfers_.size());
  Transfer mean;
  for (const Transfer& t : transfers_) {
    mean.bytes += t.bytes / n;
    mean.link_s += t.link_s / n;
  }
  double variance = 0.0;
  double covariance = 0.0;
  for (const Transfer& t : transfers_) {
    variance += (t.bytes - mean.bytes) * (t.bytes - mean.bytes) / n;
    covariance += (t.bytes - mean.bytes) * (t.link_s - mean.link_s) / n;
  }
  if (std::sqrt(variance) < kMinSpread * mean.bytes) return mean.link_s / mean.bytes;
  return std::max(0.0, covariance / variance);
}

void FrameRate::add(double render_s, double link_s, std::size_t bytes) {
  const auto size = static_cast<double>(std::max<std::size_t>(1, bytes));
  transfers_.push_back({size, link_s});
  if (transfers_.size() > kMemory) transfers_.pop_front();
  const double period = std::max({render_s, seconds_per_byte() * size, 1e-4});
  const double ideal = scale() * scale() * target_s_ / period;
  area_ = std::clamp(ideal, kMaxShrink * area_, kMaxGrowth * area_);
  area_ = std::clamp(area_, kMinScale * kMinScale, 1.0);
}

double FrameRate::scale() const {
  return std::clamp(std::floor(std::sqrt(area_) * kSteps + 0.25) / kSteps, kMinScale, 1.0);
}

}  // namespace apvi::viewer
