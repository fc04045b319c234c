// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/initializer.hpp"

#include <algorithm>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "imu/preintegration.hpp"

namespace apvi::dipo {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
constexpr double kPositionSigma = 1e-3;         // the origin is the initial position by definition
constexpr double kVelocitySigma = 0.3;          // [m/s], first ping with unknown delay
constexpr double kPressureDepthSigma_m = 0.05;  // [m]

// Index of the last sample not after the stamp, which must exist.
std::size_t last_not_after(const std::deque<ImuSample>& imu, Stamp stamp) {
  const auto it = std::upper_bound(imu.begin(), imu.end(), stamp,
                                   [](Stamp value, const ImuSample& s) { return value < s.stamp; });
  return static_cast<std::size_t>(it - imu.begin()) - 1;
}

}  // namespace

void Initializer::add(const ImuSample& sample) {
  imu_.push_back({sample.stamp, sample.gyro - gyro_bias_, sample.accel - accel_bias_});
  const Stamp keep = sample.stamp - Duration::from_seconds(3.0 * config_.initialization.window_s);
  while (imu_.front().stamp < keep) imu_.pop_front();
  while (!pings_.empty() && pings_.front().stamp < imu_.front().stamp) pings_.pop_front();
}

void Initializer::add(const DvlSample& sample) {
  if (sample.valid && !imu_.empty() && sample.stamp >= imu_.front().stamp) pings_.push_back(sample);
}

void Initializer::add_pressure_depth(double depth_m, const Vector3d& p_body_sensor) {
  depth_ = Depth{depth_m, p_body_sensor};
}

Initializer::Waiting Initializer::waiting() const {
  if (imu_.empty()) return Waiting::imu;
  return pings_.empty() ? Waiting::dvl_lock : Waiting::window;
}

Vector3d Initializer::body_velocity(const DvlSample& ping, const Vector3d& gyro) const {
  const SE3& mount = rig_.dvl->T_body_dvl;
  return mount.rotation * rig_.dvl->true_velocity(ping.velocity) - gyro.cross(mount.translation);
}

std::optional<Initializer::Start> Initializer::try_start() const {
  if (pings_.size() < 2 || imu_.size() < 2) return std::nullopt;
  const DvlSample& first = pings_.front();
  const auto reaches = [&](const DvlSample& ping) {
    return seconds_between(first.stamp, ping.stamp) >= 0.99 * config_.initialization.window_s &&
           ping.stamp <= imu_.back().stamp;
  };
  const auto last = std::find_if(pings_.begin(), pings_.end(), reaches);
  if (last == pings_.end()) return std::nullopt;
  const std::size_t from = last_not_after(imu_, first.stamp);
  const std::size_t to = last_not_after(imu_, last->stamp);
  if (to <= from) return std::nullopt;

  imu::Preintegration sum({}, Vector3d::Zero(), Vector3d::Zero());
  for (std::size_t i = from + 1; i <= to; ++i) sum.integrate(imu_[i - 1], imu_[i]);
  const Vector3d v_from = body_velocity(first, imu_[from].gyro);
  const Vector3d v_to = sum.delta().rotation * body_velocity(*last, imu_[to].gyro);
  // Δv = R_iᵀ (v_j - v_i - g T): the specific force not explained by the change of velocity
  // compensates gravity.
  const Vector3d force = (sum.delta().velocity - (v_to - v_from)) / sum.duration_s();
  // The gyro bias rotates the final velocity and the integrated specific force.
  const Eigen::Matrix<double, 9, 6> by_bias = sum.bias_jacobian();
  Eigen::Matrix<double, 3, 6> force_by_bias = by_bias.middleRows<3>(imu::Preintegration::kVelocity);
  force_by_bias += so3::hat(v_to) * sum.delta().rotation.toRotationMatrix() *
                   by_bias.middleRows<3>(imu::Preintegration::kRotation);
  force_by_bias /= sum.duration_s();
  const State state = make_state(force, v_from);
  const ImuSample raw{imu_[from].stamp, imu_[from].gyro + gyro_bias_,
                      imu_[from].accel + accel_bias_};
  return Start{raw, state, make_covariance(state, force, force_by_bias), depth_.has_value()};
}

State Initializer::make_state(const Vector3d& force_body, const Vector3d& v_body) const {
  State state;
  const double heading =
      config_.earth.heading_deg.value_or(config_.initialization.heading_deg) * kRadiansPerDegree;
  const Vector3d gravity = rig_.gravity(config_.gravity);
  state.nav.R_world_body =
      so3::exp(Vector3d(0.0, 0.0, heading)) * so3::level_attitude(force_body, gravity);
  state.nav.v_body = v_body;
  state.nav.gyro_bias = gyro_bias_;
  state.nav.accel_bias = accel_bias_;
  state.dvl_time_offset_s = rig_.dvl->time_offset_s;
  state.R_body_dvl = rig_.dvl->T_body_dvl.rotation;
  state.p_body_dvl = rig_.dvl->T_body_dvl.translation;
  if (depth_) {
    const Vector3d lever = state.nav.R_world_body * depth_->p_body_sensor;
    state.nav.p_world.z() = rig_.down_sign() * depth_->depth_m - lever.z();
  }
  state.p_last_ping = state.nav.p_world;
  return state;
}

Matrix Initializer::make_covariance(const State& state, const Vector3d& force_body,
                                    const Eigen::Matrix<double, 3, 6>& force_by_bias) const {
  Matrix P = Matrix::Zero();
  const auto set = [&](int index, int count, double sigma) {
    P.diagonal().segment(index, count).setConstant(sigma * sigma);
  };
  const InitializationConfig& init = config_.initialization;
  // Roll and pitch are uncertain, heading is given: the variance is in the horizontal axes.
  const Matrix3d Rt = state.nav.R_world_body.conjugate().toRotationMatrix();
  const double tilt = init.tilt_sigma_deg * kRadiansPerDegree;
  P.topLeftCorner<3, 3>() =
      Rt * Vector3d(tilt * tilt, tilt * tilt, 1e-10).asDiagonal() * Rt.transpose();
  set(imu::kPosition, 3, kPositionSigma);
  if (depth_) set(imu::kPosition + 2, 1, kPressureDepthSigma_m);
  set(imu::kVelocity, 3, kVelocitySigma);
  set(imu::kGyroBias, 3, init.gyro_bias_sigma.value_or(rig_.imu->gyro_noise_density));
  set(imu::kAccelBias, 3, init.accel_bias_sigma);
  const auto set_if = [&](int index, int count, const CalibrationState& c) {
    if (c.estimate) set(index, count, c.sigma);
  };
  set_if(kTimeOffset, 1, config_.dvl.time_offset);
  set_if(kScale, 1, config_.dvl.scale);
  set_if(kMounting, 3, config_.dvl.mounting);
  set_if(kLeverArm, 3, config_.dvl.lever_arm);
  set_if(kDepthBias, 1, config_.depth.bias);
  // Biases assumed zero cause a tilt error: tilt = (d force) x force / |force|^2.
  const Eigen::Matrix<double, 3, 6> tilt_by_bias =
      -so3::hat(force_body) * force_by_bias / force_body.squaredNorm();
  const Eigen::Matrix<double, 6, 6> biases = P.block<6, 6>(imu::kGyroBias, imu::kGyroBias);
  P.topLeftCorner<3, 3>() += tilt_by_bias * biases * tilt_by_bias.transpose();
  P.block<3, 6>(0, imu::kGyroBias) = tilt_by_bias * biases;
  P.block<6, 3>(imu::kGyroBias, 0) = biases * tilt_by_bias.transpose();
  return P;
}

}  // namespace apvi::dipo
