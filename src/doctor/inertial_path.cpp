// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/inertial_path.hpp"

#include <algorithm>
#include <cmath>

#include "apvi/geometry/so3.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Vector3d;

constexpr double kGap = 0.25;        // longer steps count as gaps [s]
constexpr double kNodeStep = 0.004;  // spacing of stored nodes; all samples are integrated [s]
constexpr double kTiltTime = 20.0;   // time constant of the complementary filter [s]
constexpr double kBiasTime = 60.0;   // time constant of its bias [s]
constexpr double kRateSpan = 0.06;   // [s]

// Mahony, Hamel, Pflimlin, "Nonlinear complementary filters on the special orthogonal group", 2008,
// reduced to the direction of gravity.
class TiltFilter {
 public:
  TiltFilter(const Vector3d& up, const Vector3d& bias) : up_(up), bias_(bias) {}

  void step(const Vector3d& gyro, const Vector3d& force, double dt, bool estimate_bias) {
    Vector3d error = Vector3d::Zero();
    if (force.norm() > 1e-6) error = force.normalized().cross(up_);
    const double gain = std::min(1.0 / kTiltTime, 1.0 / std::max(dt, 1e-9));
    const Vector3d rate = gyro - bias_ + gain * error;
    if (estimate_bias) bias_ -= dt / (kTiltTime * kBiasTime) * error;
    up_ = (so3::exp(-rate * dt) * up_).normalized();
  }
  const Vector3d& up() const { return up_; }
  const Vector3d& bias() const { return bias_; }

 private:
  Vector3d up_;
  Vector3d bias_;
};

Vector3d first_up(const std::vector<ImuSample>& samples) {
  Vector3d sum = Vector3d::Zero();
  for (const ImuSample& s : samples) {
    if (seconds_between(samples.front().stamp, s.stamp) > 1.0) break;
    sum += s.accel;
  }
  return sum.norm() > 1e-6 ? Vector3d(sum.normalized()) : Vector3d::UnitZ();
}

double step_between(const ImuSample& a, const ImuSample& b) {
  return seconds_between(a.stamp, b.stamp);
}

// Mean of the filter's bias over the second half, after convergence.
Vector3d estimate_bias(const std::vector<ImuSample>& samples) {
  TiltFilter filter(first_up(samples), Vector3d::Zero());
  Vector3d sum = Vector3d::Zero();
  double time = 0.0;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const double dt = step_between(samples[i - 1], samples[i]);
    if (!(dt > 0.0) || dt > kGap) continue;
    filter.step(samples[i].gyro, samples[i].accel, dt, true);
    if (2 * i < samples.size()) continue;
    sum += dt * filter.bias();
    time += dt;
  }
  return time > 0.0 ? Vector3d(sum / time) : Vector3d::Zero();
}

}  // namespace

InertialPath::InertialPath(const std::vector<ImuSample>& samples) {
  if (samples.size() < 2) return;
  gyro_bias_ = estimate_bias(samples);
  TiltFilter tilt(first_up(samples), gyro_bias_);
  Node now{samples.front().stamp, 0.0, 0, {}};
  now.state.up_body = tilt.up();
  nodes_.push_back(now);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const double dt = step_between(samples[i - 1], samples[i]);
    if (!(dt > 0.0)) continue;
    const bool gap = dt > kGap;
    const Vector3d gyro = 0.5 * (samples[i - 1].gyro + samples[i].gyro) - gyro_bias_;
    InertialState& s = now.state;
    const Eigen::Quaterniond after = (s.R_start_body * so3::exp(gyro * dt)).normalized();
    s.force_integral +=
        0.5 * dt * (s.R_start_body * samples[i - 1].accel + after * samples[i].accel);
    s.rotation_integral +=
        0.5 * dt * (s.R_start_body.toRotationMatrix() + after.toRotationMatrix());
    s.R_start_body = after;
    tilt.step(samples[i].gyro, samples[i].accel, dt, false);
    s.up_body = tilt.up();
    now.stamp = samples[i].stamp;
    now.t = seconds_between(samples.front().stamp, now.stamp);
    if (gap) ++now.gaps_before;
    if (gap || now.t - nodes_.back().t >= kNodeStep) nodes_.push_back(now);
  }
}

std::size_t InertialPath::index_before(double t) const {
  const auto after = std::upper_bound(nodes_.begin(), nodes_.end(), t,
                                      [](double time, const Node& node) { return time < node.t; });
  const auto i = after - nodes_.begin();
  return static_cast<std::size_t>(
      std::clamp<std::ptrdiff_t>(i - 1, 0, static_cast<std::ptrdiff_t>(nodes_.size()) - 2));
}

std::optional<InertialState> InertialPath::at(double t) const {
  if (empty() || !(t >= 0.0 && t <= nodes_.back().t)) return std::nullopt;
  const Node& a = nodes_[index_before(t)];
  const Node& b = nodes_[index_before(t) + 1];
  if (a.gaps_before != b.gaps_before) return std::nullopt;
  const double u = (t - a.t) / (b.t - a.t);
  const auto mix = [u](const auto& x, const auto& y) { return (x + u * (y - x)).eval(); };
  return InertialState{a.state.R_start_body.slerp(u, b.state.R_start_body),
                       mix(a.state.force_integral, b.state.force_integral),
                       mix(a.state.rotation_integral, b.state.rotation_integral),
                       mix(a.state.up_body, b.state.up_body).normalized()};
}

std::optional<Vector3d> InertialPath::rate_at(double t) const {
  const auto before = at(t - 0.5 * kRateSpan);
  const auto after = at(t + 0.5 * kRateSpan);
  if (!before || !after) return std::nullopt;
  const Eigen::Quaterniond turned = before->R_start_body.conjugate() * after->R_start_body;
  return Vector3d(so3::log(turned) / kRateSpan);
}

bool InertialPath::is_continuous(double from, double to) const {
  if (empty() || !(from >= 0.0 && to <= nodes_.back().t && from <= to)) return false;
  return nodes_[index_before(from)].gaps_before == nodes_[index_before(to) + 1].gaps_before;
}

}  // namespace apvi::doctor
