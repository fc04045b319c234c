// SPDX-License-Identifier: BSD-3-Clause
#include "localization/dvl_scale.hpp"

#include <algorithm>
#include <cmath>

#include "apvi/geometry/so3.hpp"

namespace apvi::localization {
namespace {

// A velocity by images is that over twice this time, at most with this gap between poses.
constexpr Duration kHalfSpan{100'000'000};
constexpr Duration kMaxGap{500'000'000};
constexpr Duration kHistory{2'000'000'000};

constexpr std::size_t kKeptPings = 64;
constexpr int kMinPings = 10;
constexpr double kMaxSigma = 0.03;  // relative

}  // namespace

void DvlScale::add(const vio::DvlMeasurement& ping) {
  pings_.push_back(ping);
  if (pings_.size() > kKeptPings) pings_.pop_front();
}

std::optional<double> DvlScale::add(const StampedPose& pose) {
  recent_.poses.push_back(pose);
  while (!pings_.empty() && pings_.front().stamp + kHalfSpan <= pose.stamp) {
    compare(pings_.front());
    pings_.pop_front();
  }
  std::erase_if(recent_.poses,
                [&](const StampedPose& old) { return old.stamp < pose.stamp - kHistory; });
  if (count_ < kMinPings || !(vm_ > 0.0)) return std::nullopt;
  const double scale = vm_ / vv_;
  const double residual = std::max(0.0, mm_ - scale * vm_) / (3.0 * count_ - 1.0);
  const double sigma = std::sqrt(residual / vv_) / scale;
  return sigma < kMaxSigma ? std::optional(scale) : std::nullopt;
}

void DvlScale::compare(const vio::DvlMeasurement& ping) {
  const auto before = recent_.at(ping.stamp - kHalfSpan, kMaxGap);
  const auto after = recent_.at(ping.stamp + kHalfSpan, kMaxGap);
  if (!before || !after) return;
  const double span_s = 2.0 * kHalfSpan.seconds();
  const Eigen::Quaterniond turn = before->rotation.conjugate() * after->rotation;
  const Eigen::Vector3d rate = so3::log(turn) / span_s;
  const Eigen::Quaterniond R = before->rotation * so3::exp(kHalfSpan.seconds() * rate);
  const Eigen::Vector3d path = *after * p_body_camera_ - *before * p_body_camera_;
  const Eigen::Vector3d v = R.conjugate() * path / span_s;
  const Eigen::Vector3d measured = R_body_dvl_ * ping.velocity - rate.cross(camera_to_dvl_);
  ++count_;
  vv_ += v.squaredNorm();
  vm_ += v.dot(measured);
  mm_ += measured.squaredNorm();
}

void DvlScale::reset() {
  pings_.clear();
  recent_ = {};
  count_ = 0;
  vv_ = vm_ = mm_ = 0.0;
}

}  // namespace apvi::localization
