// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/vertical_motion.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "apvi/core/error.hpp"

namespace apvi::io {
namespace {

// Accelerations of the vehicle average out over two seconds, and attitudes hardly change.
constexpr Duration kBin{500'000'000};
constexpr std::ptrdiff_t kBinsAround = 2;

constexpr double kMaxPingStep_s = 1.5;
// Long enough for a change of depth above the noise, too short for a drift of the velocity.
constexpr double kSpan_s = 8.0;
constexpr double kBetweenSpans_s = 2.0;
constexpr double kReadingStep_s = 2.0;  // between readings that may be interpolated

// Together these leave less than a tenth of doubt about the ratio.
constexpr std::size_t kMinSpans = 5;
constexpr double kMinChange_m = 0.15;  // root mean square over the spans
constexpr double kMinCorrelation = 0.9;

std::optional<double> reading_at(const std::vector<PressureReading>& readings, Stamp stamp) {
  const auto after = std::ranges::lower_bound(readings, stamp, {}, &PressureReading::stamp);
  if (after == readings.begin() || after == readings.end()) return std::nullopt;
  const auto before = std::prev(after);
  const double step = seconds_between(before->stamp, after->stamp);
  if (step <= 0.0 || step > kReadingStep_s) return std::nullopt;
  const double part = seconds_between(before->stamp, stamp) / step;
  return before->value + part * (after->value - before->value);
}

}  // namespace

void VerticalMotion::add(const ImuSample& sample) {
  if (!sample.accel.allFinite()) return;
  const bool later = forces_.empty() || sample.stamp - forces_.back().start >= kBin;
  if (later) forces_.push_back({sample.stamp});
  forces_.back().sum += sample.accel;
}

void VerticalMotion::add(const DvlSample& ping) {
  if (!ping.valid || !ping.velocity.allFinite()) return;
  if (!velocities_.empty() && ping.stamp <= velocities_.back().stamp) return;
  velocities_.push_back({ping.stamp, dvl_.T_body_dvl.rotation * dvl_.true_velocity(ping.velocity)});
}

std::optional<Eigen::Vector3d> VerticalMotion::up_at(Stamp stamp) const {
  const auto next = std::ranges::upper_bound(forces_, stamp, {}, &Force::start);
  if (next == forces_.begin()) return std::nullopt;
  const std::ptrdiff_t here = std::distance(forces_.begin(), next) - 1;
  if (stamp - forces_[static_cast<std::size_t>(here)].start > kBin + kBin) return std::nullopt;
  const std::ptrdiff_t from = std::max<std::ptrdiff_t>(0, here - kBinsAround);
  const std::ptrdiff_t to = std::min(std::ssize(forces_) - 1, here + kBinsAround);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (std::ptrdiff_t i = from; i <= to; ++i) sum += forces_[static_cast<std::size_t>(i)].sum;
  return sum.isZero(0.0) ? std::nullopt : std::optional<Eigen::Vector3d>(sum.normalized());
}

std::vector<VerticalMotion::Depth> VerticalMotion::integrate() const {
  std::vector<Depth> depths;
  std::optional<std::pair<Stamp, double>> before;  // downward velocity
  double depth_m = 0.0;
  int span = 0;
  for (const Velocity& velocity : velocities_) {
    const auto up = up_at(velocity.stamp);
    if (!up) continue;
    const double down = -up->dot(velocity.body);
    const double step_s = before ? seconds_between(before->first, velocity.stamp) : 0.0;
    if (step_s > kMaxPingStep_s) ++span;
    if (before && step_s <= kMaxPingStep_s) depth_m += 0.5 * step_s * (before->second + down);
    depths.push_back({velocity.stamp, depth_m, span});
    before = {velocity.stamp, down};
  }
  return depths;
}

std::optional<double> VerticalMotion::growth_per_meter(
    const std::vector<PressureReading>& readings) const {
  const std::vector<Depth> depths = integrate();
  double squares_m = 0.0;
  double squares = 0.0;
  double products = 0.0;
  std::size_t spans = 0;
  Stamp next = Stamp::min();
  for (std::size_t i = 0, j = 0; i < depths.size(); ++i) {
    if (depths[i].stamp < next) continue;
    while (j < depths.size() && seconds_between(depths[i].stamp, depths[j].stamp) < kSpan_s) ++j;
    if (j == depths.size()) break;
    const auto from = reading_at(readings, depths[i].stamp);
    const auto to = reading_at(readings, depths[j].stamp);
    if (!from || !to || depths[i].span != depths[j].span) continue;
    const double meters = depths[j].depth_m - depths[i].depth_m;
    const double growth = *to - *from;
    squares_m += meters * meters;
    squares += growth * growth;
    products += meters * growth;
    ++spans;
    next = depths[i].stamp + Duration::from_seconds(kBetweenSpans_s);
  }
  if (spans < kMinSpans || products <= 0.0) return std::nullopt;
  if (std::sqrt(squares_m / static_cast<double>(spans)) < kMinChange_m) return std::nullopt;
  if (products < kMinCorrelation * std::sqrt(squares_m * squares)) return std::nullopt;
  // Both have noise, so neither is the regressor.
  return std::sqrt(squares / squares_m);
}

std::optional<DvlCalibration> dvl_of_rig(const config::Node& rig) {
  const config::Node* section = rig.find("dvl0");
  if (section == nullptr) return std::nullopt;
  config::Node dvl;
  dvl.member("dvl0") = *section;
  try {
    return make_rig(dvl).dvl;
  } catch (const InputError&) {  // reported by whoever needs the rig
    return std::nullopt;
  }
}

}  // namespace apvi::io
