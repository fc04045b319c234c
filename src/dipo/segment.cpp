// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/segment.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace apvi::dipo {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Matrix46 = Eigen::Matrix<double, 4, 6>;

// Motion of a vehicle that drifts or is moved during the pause. The limits are what a pause of any
// length cannot exceed: a uniform heading, half the Earth's circumference, the deepest sea.
constexpr double kTurnRate = 0.2;                                   // [rad/s]
const double kAnyHeading = std::numbers::pi / std::numbers::sqrt3;  // [rad], one sigma
constexpr double kSpeed = 2.0;                                      // [m/s]
constexpr double kMaxDistance = 2e7;                                // [m]
constexpr double kMaxHeightChange = 1.1e4;                          // [m]

Vector3d up_in_body(const Quaterniond& R_world_body) {
  return R_world_body.conjugate() * Vector3d::UnitZ();
}

double pause_between(const Segment& before, const Initializer::Start& fresh) {
  return seconds_between(before.end, fresh.sample.stamp);
}

// The rotation about z that takes one attitude closest to another.
Quaterniond heading_change(const Quaterniond& from, const Quaterniond& to) {
  const Matrix3d R = (to * from.conjugate()).toRotationMatrix();
  const double angle = std::atan2(R(1, 0) - R(0, 1), R(0, 0) + R(1, 1));
  return Quaterniond(Eigen::AngleAxisd(angle, Vector3d::UnitZ()));
}

// Attitude errors are in the body frame: their covariance does not change with the heading.
void continue_heading(const State& old, Initializer::Start& start) {
  Quaterniond& attitude = start.state.nav.R_world_body;
  attitude = (heading_change(attitude, old.nav.R_world_body) * attitude).normalized();
}

void continue_position(const Segment& before, const Initializer::Start& fresh, const Rig& rig,
                       Initializer::Start& start) {
  const State& old = before.filter.state();
  Vector3d& position = start.state.nav.p_world;
  position.head<2>() = old.nav.p_world.head<2>();
  if (fresh.has_depth) {
    position.z() -= rig.down_sign() * old.depth_bias_m;
  } else {
    constexpr int kHeight = imu::kPosition + 2;
    const double moved = std::min(kSpeed * pause_between(before, fresh), kMaxHeightChange);
    position.z() = old.nav.p_world.z();
    start.covariance(kHeight, kHeight) =
        before.filter.covariance()(kHeight, kHeight) + moved * moved;
  }
  start.state.p_last_ping = position;
}

// Parameters drift by their random walk, to no more than their uncertainty at the start of a run.
void continue_calibration(const Segment& before, double pause_s, const CalibrationRandomWalk& walk,
                          Initializer::Start& start) {
  const State& old = before.filter.state();
  State& state = start.state;
  state.dvl_time_offset_s = old.dvl_time_offset_s;
  state.dvl_scale_error = old.dvl_scale_error;
  state.R_body_dvl = old.R_body_dvl;
  state.p_body_dvl = old.p_body_dvl;
  state.depth_bias_m = old.depth_bias_m;
  const auto keep = [&](int index, int count, double rate) {
    for (int i = index; i < index + count; ++i) {
      const double grown = before.filter.covariance()(i, i) + rate * rate * pause_s;
      start.covariance(i, i) = std::min(start.covariance(i, i), grown);
    }
  };
  keep(kTimeOffset, 1, walk.time_offset);
  keep(kScale, 1, walk.scale);
  keep(kMounting, 3, walk.mounting);
  keep(kLeverArm, 3, walk.lever_arm);
  keep(kDepthBias, 1, walk.depth_bias);
}

}  // namespace

SegmentError::SegmentError(const SE3& pose, const Matrix6& covariance, double pause_s, bool height)
    : origin_(pose.translation) {
  Matrix46 J = Matrix46::Zero();
  J.block<1, 3>(0, 0) = up_in_body(pose.rotation).transpose();
  J.block<3, 3>(1, 3).setIdentity();
  heading_position_ = J * covariance * J.transpose();
  const double turned = std::min(kTurnRate * pause_s, kAnyHeading);
  const double moved = std::min(kSpeed * pause_s, kMaxDistance);
  heading_position_(0, 0) += turned * turned;
  heading_position_.diagonal().tail<3>().array() += moved * moved;
  if (height) return;
  heading_position_.row(3).setZero();
  heading_position_.col(3).setZero();
}

// A heading error turns the segment about its origin.
SegmentError::Matrix6 SegmentError::covariance(const SE3& pose) const {
  Eigen::Matrix<double, 6, 4> J = Eigen::Matrix<double, 6, 4>::Zero();
  J.block<3, 1>(0, 0) = up_in_body(pose.rotation);
  J.block<3, 1>(3, 0) = Vector3d::UnitZ().cross(pose.translation - origin_);
  J.block<3, 3>(3, 1).setIdentity();
  return J * heading_position_ * J.transpose();
}

Initializer::Start continue_segment(const Segment& before, const Initializer::Start& fresh,
                                    const CalibrationRandomWalk& walk, const Rig& rig) {
  Initializer::Start start = fresh;
  continue_heading(before.filter.state(), start);
  continue_position(before, fresh, rig, start);
  continue_calibration(before, pause_between(before, fresh), walk, start);
  return start;
}

// The filter's covariance has the height.
SegmentError error_after(const Segment& before, const Initializer::Start& fresh) {
  const SE3 pose = before.filter.state().nav.pose();
  const SegmentError::Matrix6 covariance =
      before.filter.covariance().topLeftCorner<6, 6>() + before.error.covariance(pose);
  return {pose, covariance, pause_between(before, fresh), false};
}

}  // namespace apvi::dipo
