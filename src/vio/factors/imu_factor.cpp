// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Cholesky>
#include <algorithm>
#include <iterator>
#include <utility>

#include "apvi/core/error.hpp"
#include "vio/factors/block_math.hpp"
#include "vio/factors/corrected_delta.hpp"
#include "vio/factors/factors.hpp"

namespace apvi::vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Index = imu::Preintegration::Index;
using Vector15 = Eigen::Matrix<double, 15, 1>;
using Matrix15 = imu::Preintegration::Matrix;

// Added to all variances, as the covariance of a single step, or of a bias without random walk, is
// singular. As a standard deviation 1e-9 rad, m/s, m, rad/s, m/s²: far below sensor noise.
constexpr double kVarianceFloor = 1e-18;

Matrix15 sqrt_information_of(const imu::Preintegration& sum) {
  APVI_CHECK(sum.duration_s() > 0.0);
  const Matrix15 regular = sum.covariance() + kVarianceFloor * Matrix15::Identity();
  const Eigen::LLT<Matrix15> llt(regular);
  APVI_CHECK(llt.info() == Eigen::Success);
  return llt.matrixL().solve(Matrix15::Identity());
}

/// Velocity and position change in the frame of body i, without gravity: what the IMU should
/// measure.
struct Relative {
  Matrix3d Rt;  ///< R_iᵀ
  Vector3d velocity, position;

  Relative(const Rigid& i, const Rigid& j, const Vector3d& v_i, const Vector3d& v_j,
           const Vector3d& gravity, double T)
      : Rt(i.R.transpose()),
        velocity(Rt * (v_j - v_i - gravity * T)),
        position(Rt * (j.p - i.p - v_i * T - 0.5 * T * T * gravity)) {}
};

Vector15 error(const CorrectedDelta& delta, const Relative& seen, const Rigid& i, const Rigid& j,
               const MotionView& motion_i, const MotionView& motion_j) {
  Vector15 r;
  r << so3::log(Eigen::Quaterniond(delta.R.transpose() * (i.R.transpose() * j.R))),
      seen.velocity - delta.velocity, seen.position - delta.position,
      motion_j.gyro_bias - motion_i.gyro_bias, motion_j.accel_bias - motion_i.accel_bias;
  return r;
}

/// Quantities needed for the Jacobians, at the linearization point.
struct Point {
  Rigid i, j;
  MotionView motion_i, motion_j;
  CorrectedDelta delta;
  Relative seen;
  double T;

  Point(const imu::Preintegration& sum, const Vector3d& gravity, const double* pose_i,
        const double* m_i, const double* pose_j, const double* m_j)
      : i(pose_i),
        j(pose_j),
        motion_i(m_i),
        motion_j(m_j),
        delta(sum, motion_i.gyro_bias, motion_i.accel_bias),
        seen(i, j, motion_i.velocity, motion_j.velocity, gravity, sum.duration_s()),
        T(sum.duration_s()) {}
  Vector15 residual() const { return error(delta, seen, i, j, motion_i, motion_j); }
};

/// Whitened Jacobians, computed in blocks of three columns, as most 3x3 blocks of the unwhitened
/// ones are zero.
class Columns {
 public:
  Columns(const Matrix15& S, const Point& at, const Eigen::Matrix<double, 9, 6>& by_bias)
      : S_(S),
        at_(at),
        by_bias_(by_bias),
        E_(at.delta.R.transpose() * (at.seen.Rt * at.j.R)),
        Jr_inverse_(so3::right_jacobian_inverse(so3::log(Eigen::Quaterniond(E_)))) {}

  void pose_i(double* out) const {
    PoseJacobian<15> J(out);
    J.leftCols<3>() = part<Index::kVelocity>(so3::hat(at_.seen.velocity)) +
                      part<Index::kPosition>(so3::hat(at_.seen.position)) -
                      part<Index::kRotation>(Jr_inverse_ * at_.j.R.transpose() * at_.i.R);
    J.middleCols<3>(3) = -part<Index::kPosition>(at_.seen.Rt);
    J.col(6).setZero();
  }
  void motion_i(double* out) const {
    MotionJacobian<15> J(out);
    const Matrix3d by_rotation =
        Jr_inverse_ * E_.transpose() * at_.delta.Jr * by_bias_.block<3, 3>(Index::kRotation, 0);
    J.leftCols<3>() =
        -part<Index::kVelocity>(at_.seen.Rt) - part<Index::kPosition>(at_.T * at_.seen.Rt);
    J.middleCols<3>(3) =
        -part<Index::kRotation>(by_rotation) - from_bias(0) - S_.middleCols<3>(Index::kGyroBias);
    J.rightCols<3>() = -from_bias(3) - S_.middleCols<3>(Index::kAccelBias);
  }
  void pose_j(double* out) const {
    PoseJacobian<15> J(out);
    J.leftCols<3>() = part<Index::kRotation>(Jr_inverse_);
    J.middleCols<3>(3) = part<Index::kPosition>(at_.seen.Rt);
    J.col(6).setZero();
  }
  void motion_j(double* out) const {
    MotionJacobian<15> J(out);
    J.leftCols<3>() = part<Index::kVelocity>(at_.seen.Rt);
    J.rightCols<6>() = S_.rightCols<6>();
  }

 private:
  using Strip = Eigen::Matrix<double, 15, 3>;

  // Whitened columns of a Jacobian with `block` in the three rows starting at `Row`.
  template <int Row>
  Strip part(const Matrix3d& block) const {
    Strip strip;
    strip.template topRows<Row>().setZero();
    strip.template bottomRows<15 - Row>().noalias() =
        S_.template block<15 - Row, 3>(Row, Row).lazyProduct(block);
    return strip;
  }
  // Velocity and position by one bias.
  Strip from_bias(Eigen::Index column) const {
    return part<Index::kVelocity>(by_bias_.block<3, 3>(Index::kVelocity, column)) +
           part<Index::kPosition>(by_bias_.block<3, 3>(Index::kPosition, column));
  }

  const Matrix15& S_;
  const Point& at_;
  const Eigen::Matrix<double, 9, 6>& by_bias_;
  Matrix3d E_;  // rotation residual
  Matrix3d Jr_inverse_;
};

}  // namespace

ImuFactor::ImuFactor(std::shared_ptr<const imu::Preintegration> preintegration,
                     const Vector3d& gravity, const FirstEstimate* first_i,
                     const FirstEstimate* first_j)
    : delta_(std::move(preintegration)),
      gravity_(gravity),
      sqrt_information_(sqrt_information_of(*delta_)),
      first_i_(first_i),
      first_j_(first_j) {}

bool ImuFactor::Evaluate(double const* const* parameters, double* residuals,
                         double** jacobians) const {
  const Point now(*delta_, gravity_, parameters[0], parameters[1], parameters[2], parameters[3]);
  Eigen::Map<Vector15>{residuals} =
      sqrt_information_.triangularView<Eigen::Lower>() * now.residual();
  if (jacobians == nullptr) return true;
  const double* const first[] = {
      pose_point(first_i_, parameters[0]), motion_point(first_i_, parameters[1]),
      pose_point(first_j_, parameters[2]), motion_point(first_j_, parameters[3])};
  const Point at = std::equal(std::begin(first), std::end(first), parameters)
                       ? now
                       : Point(*delta_, gravity_, first[0], first[1], first[2], first[3]);
  const Eigen::Matrix<double, 9, 6> by_bias = delta_->bias_jacobian();
  const Columns columns(sqrt_information_, at, by_bias);
  if (jacobians[0] != nullptr) columns.pose_i(jacobians[0]);
  if (jacobians[1] != nullptr) columns.motion_i(jacobians[1]);
  if (jacobians[2] != nullptr) columns.pose_j(jacobians[2]);
  if (jacobians[3] != nullptr) columns.motion_j(jacobians[3]);
  return true;
}

}  // namespace apvi::vio
