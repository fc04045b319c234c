// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/gyro_fit.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "doctor/inertial_path.hpp"

namespace apvi::doctor {
namespace {

constexpr double kBaseline = 2.0;  // [s]
constexpr double kMean = 0.5;      // gravity is the mean force over this [s]
constexpr double kFewest = 20.0;   // of data [s]
// Less than this the noise of a cheap gyro does at rest [rad].
constexpr double kClear = 0.05;

std::optional<Eigen::Vector3d> gravity_at(const InertialPath& path, double t) {
  const auto before = path.at(t - 0.5 * kMean);
  const auto after = path.at(t + 0.5 * kMean);
  if (!before || !after) return std::nullopt;
  const Eigen::Vector3d mean = after->force_integral - before->force_integral;
  if (!(mean.norm() > 1e-6)) return std::nullopt;
  return Eigen::Vector3d(mean.normalized());
}

// How far gravity seems to turn over the baseline [rad], rms, with the gyro times `factor`.
double apparent_turn(std::vector<ImuSample> samples, double factor) {
  for (ImuSample& sample : samples) sample.gyro *= factor;
  const InertialPath path(samples);
  const double end = path.seconds(path.end());
  double sum = 0.0;
  double count = 0.0;
  for (double t = 1.0; t + kBaseline < end; t += 0.5) {
    const auto a = gravity_at(path, t);
    const auto b = gravity_at(path, t + kBaseline);
    if (!a || !b || !path.unbroken(t, t + kBaseline)) continue;
    sum += (*b - *a).squaredNorm();
    count += 1.0;
  }
  return std::sqrt(sum / std::max(1.0, count));
}

}  // namespace

void check_gyro(const std::vector<ImuSample>& samples, Report& report) {
  if (seconds_between(samples.front().stamp, samples.back().stamp) < kFewest) return;
  const double as_is = apparent_turn(samples, 1.0);
  const double without = apparent_turn(samples, 0.0);
  const double reversed = apparent_turn(samples, -1.0);
  const double degrees = apparent_turn(samples, std::numbers::pi / 180.0);
  Finding f{
      Severity::ok,
      "imu0",
      "gyro, gravity",
      fmt::format("carried by the gyro, gravity stays within {:.2g} rad over 2 s; without, {:.2g}",
                  as_is, without),
      "",
      {{"with_rad", as_is}, {"without_rad", without}, {"reversed_rad", reversed}}};
  if (as_is > kClear && degrees < 0.5 * as_is && without < 0.5 * as_is) {
    f.severity = Severity::error;
    f.message += fmt::format("; taken as deg/s {:.2g}", degrees);
    f.advice = "the gyro reports deg/s: multiply the angular rates by 0.0174533";
  } else if (reversed < 0.7 * as_is && reversed < 0.9 * without) {
    f.severity = Severity::error;
    f.message += fmt::format("; with the gyro reversed {:.2g}", reversed);
    f.advice =
        "gyro and accelerometer disagree about the sense of turning: check their axes' signs";
  } else if (as_is > kClear && as_is > 1.3 * without) {
    f.severity = Severity::warning;
    f.advice = "the gyro makes it worse: are its axes those of the accelerometer?";
  }
  report.add(std::move(f));
}

}  // namespace apvi::doctor
