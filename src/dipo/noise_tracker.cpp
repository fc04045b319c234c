// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/noise_tracker.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "core/median.hpp"

namespace apvi::dipo {
namespace {

using Eigen::Vector3d;

// Sample variance of one member, summed over the axes.
template <typename Member>
double spread(const std::deque<ImuSample>& samples, Member member) {
  Vector3d mean = Vector3d::Zero();
  for (const ImuSample& s : samples) mean += s.*member / static_cast<double>(samples.size());
  double sum = 0.0;
  for (const ImuSample& s : samples) sum += (s.*member - mean).squaredNorm();
  return sum / static_cast<double>(samples.size());
}

struct Difference {
  double t_s;
  double descent_rate;  // [m/s]
  double m;             // measured - integrated depth
};

// Robust sigma of the differences after fitting an offset, a linear drift and a delay (proportional
// to the descent rate) by least squares. The second pass excludes differences beyond three sigma of
// the first fit.
double residual_sigma(const std::vector<Difference>& differences) {
  constexpr double kRegularization = 1e-6;  // keeps the fit regular at a constant descent rate
  double sigma = std::numeric_limits<double>::infinity();
  Vector3d fit = Vector3d::Zero();
  const auto off = [&fit](const Difference& d) {
    return std::abs(d.m - fit.dot(Vector3d(1.0, d.t_s, d.descent_rate)));
  };
  for (int pass = 0; pass < 2; ++pass) {
    Eigen::Matrix3d A = Vector3d(0.0, 0.0, kRegularization).asDiagonal();
    Vector3d b = Vector3d::Zero();
    for (const Difference& d : differences) {
      if (off(d) > 3.0 * sigma) continue;
      const Vector3d row(1.0, d.t_s, d.descent_rate);
      A += row * row.transpose();
      b += row * d.m;
    }
    fit = A.ldlt().solve(b);
    std::vector<double> sizes;
    for (const Difference& d : differences) sizes.push_back(off(d));
    sigma = 1.4826 * median(std::move(sizes));  // for a normal distribution
  }
  return sigma;
}

}  // namespace

void VibrationTracker::add(const ImuSample& sample) {
  last_.push_back(sample);
  if (last_.size() < 3) return;
  if (last_.size() > 3) last_.pop_front();
  // The second difference of white noise has six times its variance; three axes are summed. The
  // motion of the vehicle is too slow to contribute.
  const Vector3d accel = last_[2].accel - 2.0 * last_[1].accel + last_[0].accel;
  const Vector3d gyro = last_[2].gyro - 2.0 * last_[1].gyro + last_[0].gyro;
  const double weight = ++count_ < 100 ? 1.0 / count_ : 0.01;
  accel_variance_ += weight * (accel.squaredNorm() / 18.0 - accel_variance_);
  gyro_variance_ += weight * (gyro.squaredNorm() / 18.0 - gyro_variance_);
  period_s_ += weight * (seconds_between(last_[1].stamp, last_[2].stamp) - period_s_);
}

imu::Noise VibrationTracker::noise() const {
  const double k = config_.vibration_factor * config_.vibration_factor * period_s_;
  imu::Noise noise = datasheet_;
  noise.gyro =
      std::hypot(datasheet_.gyro * config_.gyro_noise_factor, std::sqrt(k * gyro_variance_));
  noise.accel =
      std::hypot(datasheet_.accel * config_.accel_noise_factor, std::sqrt(k * accel_variance_));
  return noise;
}

void StationaryDetector::add(const ImuSample& sample) {
  if (!config_.enabled) return;
  imu_.push_back(sample);
  // Slightly more than the window, so that a full window is available when tested.
  const Stamp keep = sample.stamp - Duration::from_seconds(1.1 * config_.window_s);
  while (imu_.front().stamp < keep) imu_.pop_front();
  while (!pings_.empty() && pings_.front().stamp < keep) pings_.pop_front();
}

void StationaryDetector::add(const DvlSample& sample) {
  if (config_.enabled && sample.valid) pings_.push_back(sample);
}

bool StationaryDetector::is_stationary() {
  if (!config_.enabled || imu_.empty()) return false;
  if (seconds_between(imu_.front().stamp, imu_.back().stamp) < config_.window_s) return false;
  const bool dvl_agrees =
      !pings_.empty() && std::all_of(pings_.begin(), pings_.end(), [&](const DvlSample& ping) {
        return ping.velocity.norm() <= config_.max_speed;
      });
  const bool still =
      dvl_agrees && spread(imu_, &ImuSample::gyro) <= config_.max_gyro_std * config_.max_gyro_std &&
      spread(imu_, &ImuSample::accel) <= config_.max_accel_std * config_.max_accel_std;
  imu_.clear();  // one decision per window
  return still;
}

void SwellTracker::add(Stamp stamp, double depth_m, double descent_rate) {
  if (window_s_ <= 0.0 || (last_ && stamp <= *last_)) return;
  if (last_) integrated_depth_m_ += descent_rate * seconds_between(*last_, stamp);
  last_ = stamp;
  readings_.push_back({stamp, depth_m - integrated_depth_m_, descent_rate});
  const Stamp keep = stamp - Duration::from_seconds(window_s_);
  while (readings_.front().stamp < keep) readings_.pop_front();
  constexpr double kMeasurePeriod_s = 0.25;
  if (last_measured_ && seconds_between(*last_measured_, stamp) < kMeasurePeriod_s) return;
  last_measured_ = stamp;
  measure();
}

void SwellTracker::measure() {
  constexpr double kMinSpan_s = 3.0;
  constexpr double kInitialSigma_m = 0.0075;  // prevents the initial state from following a wave
  constexpr double kCorrelationTime_s =
      1.0;  // a sixth of a typical swell period: one side of one crest
  const double span = seconds_between(readings_.front().stamp, readings_.back().stamp);
  if (span > 0.0) {
    correlated_samples_ =
        std::max(1.0, kCorrelationTime_s * static_cast<double>(readings_.size()) / span);
  }
  if (span < std::min(kMinSpan_s, 0.5 * window_s_) || readings_.size() < 5) {
    sigma_m_ = std::max(sigma_m_, kInitialSigma_m);
    return;
  }
  std::vector<Difference> differences;
  for (const Reading& r : readings_) {
    differences.push_back(
        {seconds_between(readings_.front().stamp, r.stamp), r.descent_rate, r.difference_m});
  }
  sigma_m_ = residual_sigma(differences);
}

std::optional<double> MeasurementGate::validate(double nis) {
  if (nis > hard_gate_ && rejected_ < max_rejected_) {
    ++rejected_;
    return std::nullopt;
  }
  rejected_ = 0;
  return std::max(1.0, nis / soft_gate_);
}

void NoiseAdapter::add(const Vector3d& innovation, double nis, int rows) {
  if (!config_.enabled) return;
  constexpr double kSmoothing = 0.1;   // smoothing of the running means, per ping
  constexpr double kMaxPerPing = 5.0;  // limits the influence of an outlier
  product_ += kSmoothing * (innovation.dot(last_) - product_);
  power_ += kSmoothing * (innovation.squaredNorm() - power_);
  last_ = innovation;
  const double excess = std::min(nis / rows, kMaxPerPing) - 1.0;
  // The noise grows fast and decays slowly, as further maneuvers of the same kind are likely.
  const double step = std::exp((excess > 0.0 ? config_.rate : config_.recovery_rate) * excess);
  const bool motion_lags = product_ > -0.1 * power_;
  // Growth applies to the noise at fault only, decay to both.
  if (motion_lags || excess < 0.0) {
    accel_factor_ = std::clamp(accel_factor_ * std::sqrt(step), 1.0, config_.max_accel_factor);
  }
  if (!motion_lags || excess < 0.0) {
    dvl_variance_factor_ =
        std::clamp(dvl_variance_factor_ * step, 1.0, config_.max_dvl_variance_factor);
  }
}

}  // namespace apvi::dipo
