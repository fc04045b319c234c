// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/filter_history.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "apvi/core/error.hpp"

namespace apvi::dipo {
namespace {

using Eigen::Vector3d;

constexpr double kGyroHalfWindow_s = 0.03;  // half width of the gyro average
constexpr double kSlopeHalfWindow_s = 0.1;  // half width of the acceleration estimates

// Sampling intervals longer than this leave unobserved motion.
constexpr double kSparse_s = 0.05;
constexpr double kSparseTurnRate = 0.03;     // [rad/s]
constexpr double kSparseAcceleration = 0.1;  // [m/s²]

// Limits of the assumed motion during a gap in the inertial data.
constexpr double kGapMaxTurn = 1.0;   // [rad]
constexpr double kGapMaxSpeed = 2.0;  // [m/s]

struct Mean {
  Vector3d sum = Vector3d::Zero();
  int count = 0;
  void add(const Vector3d& value) {
    sum += value;
    ++count;
  }
};

// Slope of a least-squares line through samples.
struct Slope {
  double n = 0.0, t = 0.0, tt = 0.0;
  Vector3d v = Vector3d::Zero();
  Vector3d tv = Vector3d::Zero();
  void add(double time, const Vector3d& value) {
    n += 1.0;
    t += time;
    tt += time * time;
    v += value;
    tv += time * value;
  }
  Vector3d value() const {
    const double determinant = n * tt - t * t;
    return determinant > 1e-12 ? Vector3d((n * tv - t * v) / determinant) : Vector3d::Zero();
  }
};

}  // namespace

FilterHistory::FilterHistory(const imu::EarthModel& world, const CalibrationRandomWalk& walk,
                             Duration length, Duration max_step)
    : world_(world), walk_(walk), length_(length), max_step_(max_step) {}

void FilterHistory::start(const ImuSample& sample, const Eskf& filter) {
  steps_.clear();
  steps_.push_back({sample, {}, filter, {}});
}

void FilterHistory::push(const ImuSample& sample, const imu::Noise& noise) {
  APVI_CHECK(started() && sample.stamp > newest());
  Step step{sample, noise, newest_filter(), {}};
  const Stamp from = newest();
  steps_.push_back(std::move(step));
  move(steps_.back().filter, from, sample.stamp, steps_.size() - 1);
  while (steps_.size() > 2 && steps_[1].sample.stamp < sample.stamp - length_) steps_.pop_front();
}

// Index of the first step not before `stamp`.
std::size_t FilterHistory::step_after(Stamp stamp) const {
  const auto it =
      std::lower_bound(steps_.begin(), steps_.end(), stamp,
                       [](const Step& s, Stamp value) { return s.sample.stamp < value; });
  return static_cast<std::size_t>(it - steps_.begin());
}

// Propagates over a part of the interval that ends at `step`, with the mean rate and specific force
// of that interval.
void FilterHistory::move(Eskf& filter, Stamp from, Stamp to, std::size_t step) const {
  const Duration span = to - from;
  if (span.ns <= 0) return;
  const Step& end = steps_[step];
  const Step& begin = steps_[step - 1];
  const double dt = span.seconds();
  if (end.sample.stamp - begin.sample.stamp > max_step_) {
    filter.coast(dt, {std::min(imu::kGapTurnRate * dt, kGapMaxTurn),
                      std::min(imu::kGapAcceleration * dt, kGapMaxSpeed)});
    return;
  }
  filter.propagate(0.5 * (begin.sample.gyro + end.sample.gyro),
                   0.5 * (begin.sample.accel + end.sample.accel), dt, world_, end.noise, walk_);
  if (seconds_between(begin.sample.stamp, end.sample.stamp) > kSparse_s) {
    filter.inflate(imu::kTheta, 3, std::pow(kSparseTurnRate * dt, 2));
    filter.inflate(imu::kVelocity, 3, std::pow(kSparseAcceleration * dt, 2));
  }
}

void FilterHistory::apply(Eskf& filter, const Entry& entry) const {
  filter.update(entry.model(filter, kinematics_at(entry.stamp)));
  if (entry.clone_position) filter.clone_position();
}

Eskf FilterHistory::filter_at(Stamp stamp) const {
  APVI_CHECK(started() && stamp >= oldest() && stamp <= newest());
  const std::size_t step = step_after(stamp);
  if (steps_[step].sample.stamp == stamp) return steps_[step].filter;
  Eskf filter = steps_[step - 1].filter;
  Stamp at = steps_[step - 1].sample.stamp;
  for (const Entry& entry : steps_[step].entries) {
    if (entry.stamp > stamp) break;
    move(filter, at, entry.stamp, step);
    apply(filter, entry);
    at = entry.stamp;
  }
  move(filter, at, stamp, step);
  return filter;
}

Kinematics FilterHistory::kinematics_at(Stamp stamp) const {
  // Accelerations only relate the time offset to the velocity. They are averaged over a wider
  // window: otherwise their noise would make the filter overconfident in the offset.
  const Duration slope_span = Duration::from_seconds(kSlopeHalfWindow_s);
  const std::size_t center = std::min(step_after(stamp), steps_.size() - 1);
  Kinematics k{steps_[center].sample.gyro, steps_[center].sample.accel, Vector3d::Zero()};
  Mean gyro;
  Mean accel;
  Slope gyro_slope;
  for (std::size_t i = step_after(stamp - slope_span);
       i < steps_.size() && steps_[i].sample.stamp <= stamp + slope_span; ++i) {
    const double offset_s = seconds_between(stamp, steps_[i].sample.stamp);
    if (std::abs(offset_s) <= kGyroHalfWindow_s) gyro.add(steps_[i].sample.gyro);
    accel.add(steps_[i].sample.accel);
    gyro_slope.add(offset_s, steps_[i].sample.gyro);
  }
  if (gyro.count > 0) k.gyro = gyro.sum / gyro.count;
  if (accel.count > 0) k.accel = accel.sum / accel.count;
  k.angular_acceleration = gyro_slope.value();
  const double density = steps_[center].noise.accel;
  k.accel_variance = density * density / (2.0 * kSlopeHalfWindow_s);
  return k;
}

void FilterHistory::insert(Stamp stamp, Model model, bool clone_position) {
  APVI_CHECK(covers(stamp));
  const std::size_t step = step_after(stamp);
  std::vector<Entry>& entries = steps_[step].entries;
  const auto place = std::upper_bound(entries.begin(), entries.end(), stamp,
                                      [](Stamp value, const Entry& e) { return value < e.stamp; });
  entries.insert(place, {stamp, std::move(model), clone_position});
  for (std::size_t i = step; i < steps_.size(); ++i) replay(i);
}

// Recomputes the filter at a step from the previous step.
void FilterHistory::replay(std::size_t step) {
  Eskf filter = steps_[step - 1].filter;
  Stamp at = steps_[step - 1].sample.stamp;
  for (const Entry& entry : steps_[step].entries) {
    move(filter, at, entry.stamp, step);
    apply(filter, entry);
    at = entry.stamp;
  }
  move(filter, at, steps_[step].sample.stamp, step);
  steps_[step].filter = filter;
}

}  // namespace apvi::dipo
