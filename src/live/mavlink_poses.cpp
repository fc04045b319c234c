// SPDX-License-Identifier: BSD-3-Clause
#include "live/mavlink_poses.hpp"

#include <limits>

#include "apvi/geometry/so3.hpp"

namespace apvi::live {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using io::mavlink::Frame;
using io::mavlink::Id;

constexpr std::uint8_t kSystem = 1;
constexpr std::uint8_t kComponent = 197;  // MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY
constexpr std::uint8_t kLocalFrd = 20;
constexpr std::uint8_t kBodyFrd = 12;
constexpr std::uint8_t kVisualInertial = 3;
constexpr std::int8_t kBestQuality = 100;

// Offsets in the payload of ODOMETRY.
constexpr std::size_t kPosition = 8;
constexpr std::size_t kQuaternion = 20;
constexpr std::size_t kVelocity = 36;
constexpr std::size_t kPoseCovariance = 60;
constexpr std::size_t kVelocityCovariance = 144;
constexpr std::size_t kFrames = 228;

void set_floats(Frame& frame, std::size_t offset, std::initializer_list<double> values) {
  for (const double value : values) {
    frame.set<float>(offset, static_cast<float>(value));
    offset += sizeof(float);
  }
}

void set_vector(Frame& frame, std::size_t offset, const Vector3d& v) {
  set_floats(frame, offset, {v.x(), v.y(), v.z()});
}

// Upper triangle by rows, of position and then attitude; NaN first: unknown.
void set_covariance(Frame& frame, const PoseOutput& pose, const Matrix3d& turn) {
  std::size_t offset = kPoseCovariance;
  if (!pose.covariance)
    return set_floats(frame, offset, {std::numeric_limits<double>::quiet_NaN()});
  Eigen::Matrix<double, 6, 6> order = Eigen::Matrix<double, 6, 6>::Zero();
  order.topRightCorner<3, 3>() = turn;
  order.bottomLeftCorner<3, 3>().setIdentity();
  const Eigen::Matrix<double, 6, 6> covariance = order * *pose.covariance * order.transpose();
  for (int row = 0; row < 6; ++row) {
    for (int column = row; column < 6; ++column) {
      set_floats(frame, offset, {covariance(row, column)});
      offset += sizeof(float);
    }
  }
}

std::uint64_t microseconds(std::int64_t ns) {
  return static_cast<std::uint64_t>(ns / 1000);
}

Frame frame_of(Id id, Stamp stamp) {
  Frame frame{.system = kSystem, .component = kComponent, .id = id};
  frame.set<std::uint64_t>(0, microseconds(stamp.ns));
  return frame;
}

}  // namespace

Frame mavlink_odometry(const PoseOutput& pose, bool world_is_up) {
  const Eigen::Quaterniond turn =
      world_is_up ? Eigen::Quaterniond(0.0, 1.0, 0.0, 0.0) : Eigen::Quaterniond::Identity();
  const Eigen::Quaterniond q = turn * pose.T_world_body.rotation;
  Frame frame = frame_of(Id::odometry, pose.stamp);
  set_vector(frame, kPosition, turn * pose.T_world_body.translation);
  set_floats(frame, kQuaternion, {q.w(), q.x(), q.y(), q.z()});
  const double unknown = std::numeric_limits<double>::quiet_NaN();
  set_vector(frame, kVelocity, pose.v_body.value_or(Vector3d::Constant(unknown)));
  set_covariance(frame, pose, turn.toRotationMatrix());
  set_floats(frame, kVelocityCovariance, {unknown});
  frame.set<std::uint8_t>(kFrames, kLocalFrd);
  frame.set<std::uint8_t>(kFrames + 1, kBodyFrd);
  frame.set<std::uint8_t>(kFrames + 2, static_cast<std::uint8_t>(pose.resets));
  frame.set<std::uint8_t>(kFrames + 3, kVisualInertial);
  frame.set<std::int8_t>(kFrames + 4, kBestQuality);
  return frame;
}

std::optional<Frame> mavlink_position_delta(const PoseOutput& from, const PoseOutput& to) {
  if (from.resets != to.resets || to.stamp <= from.stamp) return std::nullopt;
  const SE3 motion = from.T_world_body.inverse() * to.T_world_body;
  Frame frame = frame_of(Id::vision_position_delta, to.stamp);
  frame.set<std::uint64_t>(8, microseconds((to.stamp - from.stamp).ns));
  set_vector(frame, 16, so3::log(motion.rotation));
  set_vector(frame, 28, motion.translation);
  set_floats(frame, 40, {static_cast<double>(kBestQuality)});
  return frame;
}

}  // namespace apvi::live
