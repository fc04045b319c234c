// SPDX-License-Identifier: BSD-3-Clause
#include "localization/pressure_scale.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace apvi::localization {
namespace {

// A pose is interpolated between neighbors that are at most so far apart.
constexpr Duration kMaxGap{500'000'000};
constexpr std::size_t kKeptPoses = 64;
constexpr std::size_t kKeptDepths = 64;

// Waves and drift act on many samples alike: so many of them per second count as independent.
constexpr double kIndependentPerSecond = 1.0;
constexpr double kMinSpan_s = 2.0;
constexpr int kMinDepths = 10;
constexpr int kRounds = 4;
constexpr double kMaxSigma = 0.05;  // relative

Eigen::Vector3d sensor_position(const Rig& rig) {
  return rig.pressure ? rig.pressure->p_body_sensor : rig.depth->p_body_sensor;
}

}  // namespace

PressureScale::PressureScale(const Rig& rig, double tilt_sigma)
    : down_(0.0, 0.0, rig.down_sign()),
      p_body_camera_(rig.cameras.front().T_body_camera.translation),
      camera_to_sensor_(sensor_position(rig) - p_body_camera_),
      tilt_sigma_(tilt_sigma) {}

void PressureScale::add(const vio::PressureDepthMeasurement& depth) {
  depths_.push_back(depth);
  if (depths_.size() > kKeptDepths) depths_.pop_front();
}

std::optional<double> PressureScale::add(const StampedPose& pose) {
  recent_.poses.push_back(pose);
  while (!depths_.empty() && depths_.front().stamp <= pose.stamp) {
    compare(depths_.front());
    depths_.pop_front();
  }
  if (recent_.size() > kKeptPoses) recent_.poses.erase(recent_.poses.begin());
  return solve();
}

void PressureScale::compare(const vio::PressureDepthMeasurement& depth) {
  const auto pose = recent_.at(depth.stamp, kMaxGap);
  if (!pose) return;
  const Eigen::Vector3d camera = *pose * p_body_camera_;
  if (!first_) {
    first_ = depth;
    origin_ = camera;
  }
  const Eigen::Vector4d a = (camera - origin_).homogeneous();
  const double y = depth.depth_m - first_->depth_m - down_.dot(pose->rotation * camera_to_sensor_);
  AtA_ += a * a.transpose();
  Aty_ += y * a;
  yty_ += y * y;
  last_ = depth.stamp;
  sigma_m_ = std::max(sigma_m_, depth.sigma_m);
  ++count_;
}

// The prior on the tilt contains the scale, hence the rounds.
std::optional<double> PressureScale::solve() const {
  if (count_ < kMinDepths) return std::nullopt;
  const double span_s = seconds_between(first_->stamp, last_);
  if (span_s < kMinSpan_s) return std::nullopt;
  const Eigen::Matrix3d horizontal = Eigen::Matrix3d::Identity() - down_ * down_.transpose();
  const double share = std::min(1.0, kIndependentPerSecond * span_s / count_);
  double variance = sigma_m_ * sigma_m_;
  double scale = 0.0;
  double sigma = 0.0;
  Eigen::Vector4d x = Eigen::Vector4d::Zero();
  for (int round = 0; round < kRounds; ++round) {
    // In the first round the vertical is exact.
    const double tilt = round == 0 ? 1e-9 : std::max(1e-9, scale * tilt_sigma_);
    Eigen::Matrix4d information = AtA_ * share / variance;
    information.topLeftCorner<3, 3>() += horizontal / (tilt * tilt);
    const auto ldlt = information.ldlt();
    if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return std::nullopt;
    x = ldlt.solve(Aty_ * share / variance);
    scale = x.head<3>().norm();
    if (!(scale > 0.0)) return std::nullopt;
    const Eigen::Vector3d direction = x.head<3>() / scale;
    const Eigen::Vector4d row(direction.x(), direction.y(), direction.z(), 0.0);
    sigma = std::sqrt(row.dot(ldlt.solve(row)));
    const double residual = yty_ - 2.0 * x.dot(Aty_) + x.dot(AtA_ * x);
    variance = std::max(sigma_m_ * sigma_m_, residual / count_);
  }
  const bool points_down = x.head<3>().dot(down_) > 0.0;
  return points_down && sigma < kMaxSigma * scale ? std::optional(scale) : std::nullopt;
}

void PressureScale::reset() {
  depths_.clear();
  recent_ = {};
  first_.reset();
  count_ = 0;
  sigma_m_ = 0.0;
  AtA_.setZero();
  Aty_.setZero();
  yty_ = 0.0;
}

}  // namespace apvi::localization
