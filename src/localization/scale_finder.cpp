// SPDX-License-Identifier: BSD-3-Clause
#include "localization/scale_finder.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace apvi::localization {
namespace {

// Frames of which the poses by images alone are kept: more than VIO needs to initialize.
constexpr Duration kStartHistory{10'000'000'000};

// Error of the vertical: of the mean specific force of the start, and of an assumed one [rad].
constexpr double kLeveledSigma = 0.05;
constexpr double kAssumedSigma = 1.0;

double spread(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) mean += p / static_cast<double>(points.size());
  double sum = 0.0;
  for (const Eigen::Vector3d& p : points) sum += (p - mean).squaredNorm();
  return std::sqrt(sum);
}

// Ratio of the spreads of the camera's positions at equal stamps; nullopt with fewer than three of
// them, or at rest.
std::optional<double> scale_between(const std::deque<StampedPose>& up_to_scale,
                                    const std::vector<StampedPose>& metric,
                                    const Eigen::Vector3d& p_body_camera) {
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (const StampedPose& pose : metric) {
    const auto same = [&](const StampedPose& p) { return p.stamp == pose.stamp; };
    const auto found = std::ranges::find_if(up_to_scale, same);
    if (found == up_to_scale.end()) continue;
    from.push_back(found->T_world_body * p_body_camera);
    to.push_back(pose.T_world_body * p_body_camera);
  }
  if (from.size() < 3) return std::nullopt;
  const double up_to_scale_spread = spread(from);
  if (!(up_to_scale_spread > 0.0)) return std::nullopt;
  return spread(to) / up_to_scale_spread;
}

}  // namespace

ScaleFinder::ScaleFinder(const Rig& rig, const ActiveSensors& sensors)
    : p_body_camera_(rig.cameras.front().T_body_camera.translation) {
  if (sensors.dvl || sensors.dvl_scale) dvl_.emplace(*rig.dvl, p_body_camera_);
  if (sensors.pressure_scale) pressure_.emplace(rig, sensors.imu ? kLeveledSigma : kAssumedSigma);
}

void ScaleFinder::add(const vio::DvlMeasurement& ping) {
  if (dvl_) dvl_->add(ping);
}

void ScaleFinder::add(const vio::PressureDepthMeasurement& depth) {
  if (pressure_) pressure_->add(depth);
}

std::optional<ScaleFound> ScaleFinder::add(const vio::Result& by_images) {
  if (!by_images.has_state() || !by_images.up_to_scale) return std::nullopt;
  if (by_images.status == vio::Status::started) {
    if (dvl_) dvl_->reset();
    if (pressure_) pressure_->reset();
  }
  const StampedPose pose{by_images.stamp, by_images.state.pose()};
  const auto by_dvl = dvl_ ? dvl_->add(pose) : std::nullopt;
  const auto by_pressure = pressure_ ? pressure_->add(pose) : std::nullopt;
  if (!is_waiting() && began_) return std::nullopt;
  remember(by_images);
  if (by_dvl) return found(ScaleSensor::dvl, *by_dvl);
  if (by_pressure) return found(ScaleSensor::pressure, *by_pressure);
  return std::nullopt;
}

void ScaleFinder::remember(const vio::Result& by_images) {
  began_ = true;
  for (const StampedPose& earlier : by_images.earlier) recent_.push_back(earlier);
  recent_.push_back({by_images.stamp, by_images.state.pose()});
  if (!first_) first_ = recent_.front();
  const Stamp oldest = by_images.stamp - kStartHistory;
  while (recent_.front().stamp < oldest) recent_.pop_front();
}

ScaleFound ScaleFinder::found(ScaleSensor by, double scale) const {
  return {.since = first_->stamp,
          .to_meters = {scale, first_->T_world_body * p_body_camera_},
          .p_body_camera = p_body_camera_,
          .by = by};
}

std::optional<VioScale> ScaleFinder::compare(const vio::Result& started) const {
  if (!is_waiting() || started.earlier.empty()) return std::nullopt;
  const auto scale = scale_between(recent_, started.earlier, p_body_camera_);
  if (!scale) return std::nullopt;
  const StampedPose& newest = started.earlier.back();
  const auto known = std::ranges::find(recent_, newest.stamp, &StampedPose::stamp);
  if (known == recent_.end()) return std::nullopt;
  VioScale result{.found = found(ScaleSensor::imu, *scale)};
  result.shift = result.found.to_meters * (known->T_world_body * p_body_camera_) -
                 newest.T_world_body * p_body_camera_;
  return result;
}

}  // namespace apvi::localization
