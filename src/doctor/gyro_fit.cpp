// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/gyro_fit.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "apvi/core/constants.hpp"
#include "doctor/inertial_path.hpp"

namespace apvi::doctor {
namespace {

constexpr double kBaseline = 2.0;      // [s]
constexpr double kMeanDuration = 0.5;  // averaging time of gravity [s]
constexpr double kMinDuration = 20.0;  // of data [s]
// Above the apparent rotation from noise of a low-cost gyro at rest [rad].
constexpr double kMinRotation = 0.05;

std::optional<Eigen::Vector3d> gravity_at(const InertialPath& path, double t) {
  const auto before = path.at(t - 0.5 * kMeanDuration);
  const auto after = path.at(t + 0.5 * kMeanDuration);
  if (!before || !after) return std::nullopt;
  const Eigen::Vector3d mean = after->force_integral - before->force_integral;
  if (!(mean.norm() > 1e-6)) return std::nullopt;
  return Eigen::Vector3d(mean.normalized());
}

// RMS apparent rotation of gravity over the baseline [rad], with the gyro scaled by `factor`.
double apparent_rotation(std::vector<ImuSample> samples, double factor) {
  for (ImuSample& sample : samples) sample.gyro *= factor;
  const InertialPath path(samples);
  const double end = path.seconds(path.end());
  double sum = 0.0;
  double count = 0.0;
  for (double t = 1.0; t + kBaseline < end; t += 0.5) {
    const auto a = gravity_at(path, t);
    const auto b = gravity_at(path, t + kBaseline);
    if (!a || !b || !path.is_continuous(t, t + kBaseline)) continue;
    sum += (*b - *a).squaredNorm();
    count += 1.0;
  }
  return std::sqrt(sum / std::max(1.0, count));
}

}  // namespace

void check_gyro(const std::vector<ImuSample>& samples, Report& report) {
  if (seconds_between(samples.front().stamp, samples.back().stamp) < kMinDuration) return;
  const double as_is = apparent_rotation(samples, 1.0);
  const double without = apparent_rotation(samples, 0.0);
  const double reversed = apparent_rotation(samples, -1.0);
  const double degrees = apparent_rotation(samples, kRadiansPerDegree);
  Finding f{Severity::ok,
            "imu0",
            "gyro, gravity",
            fmt::format("gravity rotated by the gyro is constant within {:.2g} rad over 2 s; "
                        "without the gyro, {:.2g}",
                        as_is, without),
            "",
            {{"with_rad", as_is}, {"without_rad", without}, {"reversed_rad", reversed}}};
  if (as_is > kMinRotation && degrees < 0.5 * as_is && without < 0.5 * as_is) {
    f.severity = Severity::error;
    f.message += fmt::format("; interpreted as deg/s {:.2g}", degrees);
    f.advice = "the gyro reports deg/s: multiply the angular rates by 0.0174533";
  } else if (reversed < 0.7 * as_is && reversed < 0.9 * without) {
    f.severity = Severity::error;
    f.message += fmt::format("; with the gyro reversed {:.2g}", reversed);
    f.advice =
        "gyro and accelerometer disagree about the sense of rotation: check the signs of their "
        "axes";
  } else if (as_is > kMinRotation && as_is > 1.3 * without) {
    f.severity = Severity::warning;
    f.advice = "check that gyro and accelerometer use the same axes";
  }
  report.add(std::move(f));
}

}  // namespace apvi::doctor
