// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/spline.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr int kOrder = 6;  // degree five
using Weights = std::array<double, kOrder>;
using Matrix = std::array<Weights, kOrder>;

double binomial(int n, int k) {
  double value = 1.0;
  for (int i = 1; i <= k; ++i) value = value * (n - k + i) / i;
  return value;
}

// Row j holds the polynomial (in u, ascending) of cumulative basis function j; Sommer et al.,
// Eq. 16.
Matrix cumulative_basis() {
  constexpr int kDegree = kOrder - 1;
  constexpr double kFactorial = 120.0;
  Matrix m{};
  for (int s = 0; s < kOrder; ++s) {
    for (int n = 0; n < kOrder; ++n) {
      double sum = 0.0;
      for (int l = s; l < kOrder; ++l) {
        const double sign = (l - s) % 2 == 0 ? 1.0 : -1.0;
        sum += sign * binomial(kOrder, l - s) * std::pow(kDegree - l, kDegree - n);
      }
      m[s][n] = binomial(kDegree, n) / kFactorial * sum;
    }
  }
  for (int j = kOrder - 2; j >= 0; --j) {
    for (int n = 0; n < kOrder; ++n) m[j][n] += m[j + 1][n];
  }
  return m;
}

struct BasisValues {
  Weights value{};
  Weights first{};   // d/dt
  Weights second{};  // d²/dt²
};

BasisValues basis_at(double u, double period_s) {
  static const Matrix basis = cumulative_basis();
  BasisValues weights;
  for (int j = 0; j < kOrder; ++j) {
    for (int n = kOrder - 1; n >= 0; --n) {
      weights.value[j] = weights.value[j] * u + basis[j][n];
      if (n >= 1) weights.first[j] = weights.first[j] * u + n * basis[j][n];
      if (n >= 2) weights.second[j] = weights.second[j] * u + n * (n - 1) * basis[j][n];
    }
    weights.first[j] /= period_s;
    weights.second[j] /= period_s * period_s;
  }
  return weights;
}

Motion evaluate(const SE3* control, const BasisValues& weights) {
  Motion motion;
  Quaterniond rotation = control[0].rotation;
  Vector3d position = control[0].translation;
  Vector3d omega = Vector3d::Zero();
  Vector3d alpha = Vector3d::Zero();
  for (int j = 1; j < kOrder; ++j) {
    const Vector3d step = control[j].translation - control[j - 1].translation;
    position += weights.value[j] * step;
    motion.velocity_world += weights.first[j] * step;
    motion.acceleration_world += weights.second[j] * step;
    const Vector3d d = so3::log(control[j - 1].rotation.conjugate() * control[j].rotation);
    const Quaterniond a = so3::exp(weights.value[j] * d);
    rotation = rotation * a;
    omega = a.conjugate() * omega + weights.first[j] * d;
    alpha = a.conjugate() * alpha + weights.first[j] * omega.cross(d) + weights.second[j] * d;
  }
  motion.T_world_body = {rotation.normalized(), position};
  motion.angular_velocity_body = omega;
  motion.angular_acceleration_body = alpha;
  return motion;
}

constexpr std::size_t kLeadingPoses = 2;   // control poses before the first knot
constexpr std::size_t kTrailingPoses = 3;  // control poses after the last knot
constexpr int kIterations = 200;           // each reduces the error by a factor of 0.87 or less

// Linear extrapolation beyond both ends.
void extrapolate_ends(std::vector<SE3>& control) {
  const auto continue_from = [&](std::size_t to, std::size_t from, std::size_t before) {
    control[to].translation = 2.0 * control[from].translation - control[before].translation;
    control[to].rotation = control[from].rotation;
  };
  for (std::size_t i = kLeadingPoses; i-- > 0;) continue_from(i, i + 1, i + 2);
  for (std::size_t i = control.size() - kTrailingPoses; i < control.size(); ++i)
    continue_from(i, i - 1, i - 2);
}

}  // namespace

Se3Spline::Se3Spline(Stamp start, Duration period, std::vector<SE3> control_poses)
    : start_(start), period_(period), control_(std::move(control_poses)) {
  APVI_CHECK(control_.size() >= kOrder);
  APVI_CHECK(period_.ns > 0);
}

Se3Spline Se3Spline::through(const Trajectory& trajectory, Duration period) {
  std::vector<SE3> knots;
  if (!trajectory.empty()) {
    const Stamp last = trajectory.poses.back().stamp;
    for (Stamp t = trajectory.poses.front().stamp; t <= last; t = t + period) {
      knots.push_back(trajectory.at(t, Duration{last.ns}).value());
    }
  }
  if (knots.size() < 3)
    fail_input("trajectory too short for a spline: at least three poses are required");
  std::vector<SE3> control(knots.size() + kLeadingPoses + kTrailingPoses);
  std::copy(knots.begin(), knots.end(), control.begin() + kLeadingPoses);
  extrapolate_ends(control);
  const BasisValues at_knot = basis_at(0.0, period.seconds());
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    std::vector<SE3> next = control;
    for (std::size_t i = 0; i < knots.size(); ++i) {
      const SE3 curve = evaluate(&control[i], at_knot).T_world_body;
      SE3& pose = next[i + kLeadingPoses];
      pose.translation += knots[i].translation - curve.translation;
      pose.rotation =
          pose.rotation * so3::exp(so3::log(curve.rotation.conjugate() * knots[i].rotation));
    }
    control = std::move(next);
    extrapolate_ends(control);
  }
  return Se3Spline(trajectory.poses.front().stamp, period, std::move(control));
}

Stamp Se3Spline::end() const {
  return {start_.ns + period_.ns * static_cast<std::int64_t>(control_.size() - kOrder + 1)};
}

Motion Se3Spline::at(Stamp stamp) const {
  const std::int64_t since = std::clamp<std::int64_t>((stamp - start_).ns, 0, (end() - start_).ns);
  const auto segment =
      std::min(static_cast<std::size_t>(since / period_.ns), control_.size() - kOrder);
  const double u = static_cast<double>(since - static_cast<std::int64_t>(segment) * period_.ns) /
                   static_cast<double>(period_.ns);
  return evaluate(&control_[segment], basis_at(u, period_.seconds()));
}

}  // namespace apvi
