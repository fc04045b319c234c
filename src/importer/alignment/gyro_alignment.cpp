// SPDX-License-Identifier: BSD-3-Clause
#include "importer/alignment/gyro_alignment.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "doctor/camera_gyro_fit.hpp"
#include "doctor/camera_rates.hpp"
#include "importer/alignment/rate_search.hpp"

namespace apvi::importer {
namespace {

using doctor::CameraGyroFit;
using doctor::CameraGyroModel;
using doctor::ImagePair;
using doctor::TimeSpan;

constexpr double kMinTime_s = 4.0;        // of known rates
constexpr double kMinVariation = 0.02;    // of the rates [rad/s]
constexpr double kMinSigmas = 3.0;        // by which the best time is better
constexpr double kMinUniqueness = 2.0;    // the same, of the exact time within a second
constexpr double kMinLensGain = 3.0;      // by which a free lens is better [sigmas]
constexpr double kMaxSigma_s = 0.02;      // of the exact time
constexpr double kMaxCorrection_s = 0.3;  // of the time by the rates
constexpr std::size_t kSpans = 13;        // as in the doctor

GyroAlignment failed(GyroAlignment result, std::string why) {
  result.start.reset();
  result.why_not = std::move(why);
  return result;
}

// The lags of a range of starts.
std::pair<double, double> lags_of(const std::pair<Stamp, Stamp>& starts, const RateGrid& camera,
                                  const RateGrid& gyro) {
  const auto lag = [&](Stamp start) {
    return seconds_between(gyro.start, start + (camera.start - Stamp{}));
  };
  return {lag(starts.first), lag(starts.second)};
}

std::vector<ImuSample> samples_within(const std::vector<ImuSample>& imu, const TimeSpan& span) {
  std::vector<ImuSample> samples;
  for (const ImuSample& sample : imu) {
    if (!(sample.stamp < span.from) && sample.stamp < span.to) samples.push_back(sample);
  }
  return samples;
}

// The pairs within the spans, on the gyro's clock.
std::vector<ImagePair> pairs_within(const std::vector<ImagePair>& pairs, Stamp start,
                                    const std::vector<TimeSpan>& spans) {
  std::vector<ImagePair> chosen;
  for (ImagePair pair : pairs) {
    pair.before = start + (pair.before - Stamp{});
    pair.now = start + (pair.now - Stamp{});
    const bool is_within = std::any_of(spans.begin(), spans.end(), [&](const TimeSpan& span) {
      return !(pair.before < span.from) && pair.now < span.to;
    });
    if (is_within) chosen.push_back(std::move(pair));
  }
  return chosen;
}

// The fit of the doctor, of images that turn.
std::optional<CameraGyroFit> fit_near(const std::vector<ImagePair>& pairs,
                                      const CameraModel& camera, const std::vector<ImuSample>& imu,
                                      Stamp start, const Eigen::Quaterniond& R_camera_body) {
  const Duration margin = Duration::from_seconds(2.0);
  const TimeSpan video{start + (pairs.front().before - Stamp{}),
                       start + (pairs.back().now - Stamp{})};
  const doctor::InertialPath path(samples_within(imu, {video.from - margin, video.to + margin}));
  const auto spans = doctor::turning_spans(path, video, kSpans);
  CameraGyroModel guess;
  guess.R_camera_body = R_camera_body;
  return doctor::fit_camera_against_gyro(
      doctor::CameraGyroProblem(path, pairs_within(pairs, start, spans), camera), guess);
}

// The start by the rates of camera and gyro.
std::optional<RateMatch> search(const RateGrid& camera, const RateGrid& gyro,
                                const std::optional<std::pair<Stamp, Stamp>>& near) {
  auto match = match_rates(camera, gyro);
  if (!near || !match || match->sigmas >= kMinSigmas) return match;
  const auto nearer = match_rates(camera, gyro, lags_of(*near, camera, gyro));
  return nearer && nearer->sigmas >= kMinSigmas ? nearer : match;
}

}  // namespace

GyroAlignment align_by_gyro(const std::vector<ImagePair>& pairs, const CameraModel& camera,
                            const std::vector<ImuSample>& imu,
                            const std::optional<std::pair<Stamp, Stamp>>& near) {
  GyroAlignment result;
  const RateGrid seen = rate_grid(doctor::camera_rates(pairs, camera));
  if (static_cast<double>(seen.count_known()) * kRateStep_s < kMinTime_s)
    return failed(result, "too few images show how the camera turns");
  if (seen.variation() < kMinVariation)
    return failed(result, fmt::format("the camera hardly turns ({:.3f} rad/s)", seen.variation()));
  const RateGrid gyro = rate_grid(imu);
  const auto match = search(seen, gyro, near);
  if (!match) return failed(result, "no part of the gyro's data is as long as the video");
  result.correlation = match->correlation;
  result.elsewhere = match->elsewhere;
  if (match->sigmas < kMinSigmas) {
    return failed(result,
                  fmt::format("the rotation of the images fits no time clearly best "
                              "(correlation {:.2f}, at other times up to {:.2f}; {:.1f} of "
                              "{:.0f} sigma)",
                              match->correlation, match->elsewhere, match->sigmas, kMinSigmas));
  }
  const Stamp start = gyro.start + Duration::from_seconds(match->lag_s) - (seen.start - Stamp{});
  const auto fit = fit_near(pairs, camera, imu, start, match->R_camera_body);
  if (!fit) return failed(result, "too few images have corners in common while the camera turns");
  // An assumed lens that does not fit shifts the time.
  const bool is_lens_free = fit->lens_gain > kMinLensGain;
  const double offset_s = (is_lens_free ? fit->lens_model : fit->model).time_offset_s;
  result.sigma_s = (is_lens_free ? fit->lens_sigma : fit->sigma)(doctor::kTimeOffset);
  if (fit->time_uniqueness < kMinUniqueness || result.sigma_s > kMaxSigma_s ||
      std::abs(offset_s) > kMaxCorrection_s) {
    return failed(result, fmt::format("the rotation of the images does not show the exact time "
                                      "(sigma {:.3f} s)",
                                      result.sigma_s));
  }
  result.start = start - Duration::from_seconds(offset_s);
  return result;
}

}  // namespace apvi::importer
