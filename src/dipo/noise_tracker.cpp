// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/dipo/noise_tracker.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace apvi::dipo {
namespace {

using Eigen::Vector3d;

// Sample variance summed over the axes, of one member of the samples.
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
  double descent;  // [m/s]
  double m;        // depth as measured less as swum
};

// Robust sigma of the differences about what drifts, which a line follows, and about what comes
// late, which goes with the descent. Least squares, once with everything and once without what then
// lies over three sigma off.
double unexplained_spread(const std::vector<Difference>& differences) {
  constexpr double kWeakly = 1e-6;  // without a change of descent nothing can come late
  double sigma = std::numeric_limits<double>::infinity();
  Vector3d fit = Vector3d::Zero();
  const auto off = [&fit](const Difference& d) {
    return std::abs(d.m - fit.dot(Vector3d(1.0, d.t_s, d.descent)));
  };
  for (int pass = 0; pass < 2; ++pass) {
    Eigen::Matrix3d A = Vector3d(0.0, 0.0, kWeakly).asDiagonal();
    Vector3d b = Vector3d::Zero();
    for (const Difference& d : differences) {
      if (off(d) > 3.0 * sigma) continue;
      const Vector3d row(1.0, d.t_s, d.descent);
      A += row * row.transpose();
      b += row * d.m;
    }
    fit = A.ldlt().solve(b);
    std::vector<double> sizes;
    for (const Difference& d : differences) sizes.push_back(off(d));
    const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
    std::nth_element(sizes.begin(), middle, sizes.end());
    sigma = 1.4826 * *middle;  // of a normal distribution
  }
  return sigma;
}

}  // namespace

void VibrationTracker::add(const ImuSample& sample) {
  last_.push_back(sample);
  if (last_.size() < 3) return;
  if (last_.size() > 3) last_.pop_front();
  // The second difference of white noise has six times its variance; three axes are summed. Motion
  // itself is too slow to show in it.
  const Vector3d accel = last_[2].accel - 2.0 * last_[1].accel + last_[0].accel;
  const Vector3d gyro = last_[2].gyro - 2.0 * last_[1].gyro + last_[0].gyro;
  const double weight = ++count_ < 100 ? 1.0 / count_ : 0.01;
  accel_variance_ += weight * (accel.squaredNorm() / 18.0 - accel_variance_);
  gyro_variance_ += weight * (gyro.squaredNorm() / 18.0 - gyro_variance_);
  period_s_ += weight * (seconds_between(last_[1].stamp, last_[2].stamp) - period_s_);
}

imu::Noise VibrationTracker::noise() const {
  const double k = config_.vibration_factor * config_.vibration_factor * period_s_;
  imu::Noise noise = sheet_;
  noise.gyro = std::hypot(sheet_.gyro * config_.gyro_noise_factor, std::sqrt(k * gyro_variance_));
  noise.accel =
      std::hypot(sheet_.accel * config_.accel_noise_factor, std::sqrt(k * accel_variance_));
  return noise;
}

void StillnessDetector::add(const ImuSample& sample) {
  if (!config_.enabled) return;
  imu_.push_back(sample);
  // Twice the window, so that a full window is there whenever it is asked for.
  const Stamp keep = sample.stamp - Duration::from_seconds(1.1 * config_.window_s);
  while (imu_.front().stamp < keep) imu_.pop_front();
  while (!pings_.empty() && pings_.front().stamp < keep) pings_.pop_front();
}

void StillnessDetector::add(const DvlSample& sample) {
  if (config_.enabled && sample.valid) pings_.push_back(sample);
}

bool StillnessDetector::is_still() {
  if (!config_.enabled || imu_.empty()) return false;
  if (seconds_between(imu_.front().stamp, imu_.back().stamp) < config_.window_s) return false;
  const bool dvl_agrees =
      !pings_.empty() && std::all_of(pings_.begin(), pings_.end(), [&](const DvlSample& ping) {
        return ping.velocity.norm() <= config_.max_speed;
      });
  const bool still =
      dvl_agrees && spread(imu_, &ImuSample::gyro) <= config_.max_gyro_std * config_.max_gyro_std &&
      spread(imu_, &ImuSample::accel) <= config_.max_accel_std * config_.max_accel_std;
  imu_.clear();  // one verdict per window
  return still;
}

void SwellTracker::add(Stamp stamp, double depth_m, double descent) {
  if (window_s_ <= 0.0 || (last_ && stamp <= *last_)) return;
  if (last_) swum_m_ += descent * seconds_between(*last_, stamp);
  last_ = stamp;
  readings_.push_back({stamp, depth_m - swum_m_, descent});
  const Stamp keep = stamp - Duration::from_seconds(window_s_);
  while (readings_.front().stamp < keep) readings_.pop_front();
  constexpr double kEvery_s = 0.25;
  if (measured_ && seconds_between(*measured_, stamp) < kEvery_s) return;
  measured_ = stamp;
  measure();
}

void SwellTracker::measure() {
  constexpr double kLeastSpan_s = 3.0;
  constexpr double kFirstGuess_m = 0.0075;  // the start must not follow a wave
  constexpr double kStretch_s = 1.0;        // a sixth of a swell's period: one side of one crest
  const double span = seconds_between(readings_.front().stamp, readings_.back().stamp);
  if (span > 0.0) {
    repeats_ = std::max(1.0, kStretch_s * static_cast<double>(readings_.size()) / span);
  }
  if (span < std::min(kLeastSpan_s, 0.5 * window_s_) || readings_.size() < 5) {
    sigma_m_ = std::max(sigma_m_, kFirstGuess_m);
    return;
  }
  std::vector<Difference> differences;
  for (const Reading& r : readings_) {
    differences.push_back(
        {seconds_between(readings_.front().stamp, r.stamp), r.descent, r.difference_m});
  }
  sigma_m_ = unexplained_spread(differences);
}

std::optional<double> MeasurementGate::judge(double nis) {
  if (nis > hard_gate_ && rejected_ < max_rejected_) {
    ++rejected_;
    return std::nullopt;
  }
  rejected_ = 0;
  return std::max(1.0, nis / soft_gate_);
}

void NoiseAdapter::add(const Vector3d& innovation, double nis, int rows) {
  if (!config_.enabled) return;
  constexpr double kMemory = 0.1;       // of the running means, per ping
  constexpr double kMostPerPing = 5.0;  // an outlier must not speak for all
  product_ += kMemory * (innovation.dot(last_) - product_);
  power_ += kMemory * (innovation.squaredNorm() - power_);
  last_ = innovation;
  const double excess = std::min(nis / rows, kMostPerPing) - 1.0;
  // Trust is lost quickly and won back slowly: the next manoeuvre will be like the last one.
  const double step = std::exp((excess > 0.0 ? config_.rate : config_.recovery_rate) * excess);
  const bool motion_lags = product_ > -0.1 * power_;
  // What is too small grows where the blame lies; what is too large shrinks everywhere.
  if (motion_lags || excess < 0.0) {
    accel_factor_ = std::clamp(accel_factor_ * std::sqrt(step), 1.0, config_.max_accel_factor);
  }
  if (!motion_lags || excess < 0.0) {
    dvl_variance_factor_ =
        std::clamp(dvl_variance_factor_ * step, 1.0, config_.max_dvl_variance_factor);
  }
}

}  // namespace apvi::dipo
