// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "vio/factors/block_math.hpp"
#include "vio/factors/factors.hpp"

namespace apvi::vio {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using View = ReprojectionFactor::View;

// Lower bound of the depth ratio between the second and the first camera: points at or behind the
// image plane get a large but finite residual.
constexpr double kMinDepthRatio = 1e-2;

Vector3d bearing(const View& view, double dt) {
  return (view.point + dt * view.velocity).homogeneous();
}

/// Transfers a point times its inverse depth from the anchor to the observing camera, so that
/// points at infinity (λ = 0) need no special case.
struct Transfer {
  Vector3d in_body_i, in_body_j, in_camera_j;

  Transfer(const Rigid& i, const Rigid& j, const Rigid& a, const Rigid& b,
           const Vector3d& bearing_i, double lambda)
      : in_body_i(a.R * bearing_i + lambda * a.p),
        in_body_j(j.R.transpose() * (i.R * in_body_i + lambda * (i.p - j.p))),
        in_camera_j(b.R.transpose() * (in_body_j - lambda * b.p)) {}
};

Vector2d project(const Vector3d& h) {
  return h.head<2>() / std::max(h.z(), kMinDepthRatio);
}

/// Derivative of `project` times `weight`; constant where the depth is clamped.
Matrix23 projection_jacobian(const Vector3d& h, double weight) {
  const double s = weight / std::max(h.z(), kMinDepthRatio);
  const Vector2d by_depth =
      h.z() > kMinDepthRatio ? Vector2d(-s / h.z() * h.head<2>()) : Vector2d(0.0, 0.0);
  Matrix23 jacobian;
  jacobian << s, 0.0, by_depth.x(), 0.0, s, by_depth.y();
  return jacobian;
}

void write_pose(double* jacobian, const Matrix23& by_rotation, const Matrix23& by_position) {
  PoseJacobian<2> J(jacobian);
  J.leftCols<3>() = by_rotation;
  J.middleCols<3>(3) = by_position;
  J.col(6).setZero();
}

/// Derivatives of the weighted residual by the point (times λ) in each frame of the chain.
struct Chain {
  Matrix23 by_camera_j, by_body_j, by_world, by_body_i;

  Chain(const Transfer& t, const Rigid& i, const Rigid& j, const Rigid& b, double weight)
      : by_camera_j(projection_jacobian(t.in_camera_j, weight)),
        by_body_j(by_camera_j * b.R.transpose()),
        by_world(by_body_j * j.R.transpose()),
        by_body_i(by_world * i.R) {}
};

// Derivative by T_body_camera of the anchor camera, and of the observing camera.
void add_anchor_camera(Matrix23& rotation, Matrix23& position, const Chain& c, const Rigid& a,
                       const Vector3d& bearing_i, double lambda) {
  rotation -= times_hat(c.by_body_i * a.R, bearing_i);
  position += lambda * c.by_body_i;
}
void add_other_camera(Matrix23& rotation, Matrix23& position, const Chain& c, const Transfer& t,
                      double lambda) {
  rotation += times_hat(c.by_camera_j, t.in_camera_j);
  position -= lambda * c.by_body_j;
}

/// Transfer of one observation at given poses.
struct Sight {
  Rigid i, j;
  Vector3d ray;  ///< in the anchor, z = 1
  double lambda;
  Transfer t;

  Sight(const double* pose_i, const double* pose_j, const Rigid& a, const Rigid& b,
        const Vector3d& bearing_i, double inverse_depth)
      : i(pose_i), j(pose_j), ray(bearing_i), lambda(inverse_depth), t(i, j, a, b, ray, lambda) {}
};

// Output pointers of the Jacobians; null if not requested. With one camera both camera pointers are
// equal.
struct Slots {
  double* pose_i;
  double* pose_j;
  double* camera_a;
  double* camera_b;
  double* lambda;
  double* offset;
};

void write_cameras(const Slots& out, const Chain& c, const Sight& at, const Rigid& a) {
  Matrix23 rotation = Matrix23::Zero();
  Matrix23 position = Matrix23::Zero();
  if (out.camera_a != nullptr) {
    add_anchor_camera(rotation, position, c, a, at.ray, at.lambda);
    if (out.camera_b == out.camera_a) add_other_camera(rotation, position, c, at.t, at.lambda);
    write_pose(out.camera_a, rotation, position);
  }
  if (out.camera_b != nullptr && out.camera_b != out.camera_a) {
    rotation.setZero();
    position.setZero();
    add_other_camera(rotation, position, c, at.t, at.lambda);
    write_pose(out.camera_b, rotation, position);
  }
}

/// Inputs of a term between two frames: measurements and camera extrinsics.
struct Seen {
  const View& i;
  const View& j;
  const Rigid& a;
  const Rigid& b;
  double weight;
};

void write_jacobians(const Slots& out, const Seen& seen, const Sight& at) {
  const Chain c(at.t, at.i, at.j, seen.b, seen.weight);
  if (out.pose_i != nullptr) {
    write_pose(out.pose_i, -times_hat(c.by_body_i, at.t.in_body_i), at.lambda * c.by_world);
  }
  if (out.pose_j != nullptr) {
    write_pose(out.pose_j, times_hat(c.by_body_j, at.t.in_body_j), -at.lambda * c.by_world);
  }
  write_cameras(out, c, at, seen.a);
  if (out.lambda != nullptr) {
    Eigen::Map<Vector2d>{out.lambda} =
        c.by_body_i * seen.a.p + c.by_world * (at.i.p - at.j.p) - c.by_body_j * seen.b.p;
  }
  if (out.offset != nullptr) {
    Eigen::Map<Vector2d>{out.offset} =
        c.by_body_i * (seen.a.R.leftCols<2>() * seen.i.velocity) - seen.weight * seen.j.velocity;
  }
}

/// The residual at the poses, Jacobians at the linearization points.
void evaluate(const Seen& seen, const double* const poses[2], const double* const points[2],
              double lambda, double dt, double* residuals, const Slots* out) {
  const Vector3d ray = bearing(seen.i, dt);
  const Sight now(poses[0], poses[1], seen.a, seen.b, ray, lambda);
  Eigen::Map<Vector2d>{residuals} =
      seen.weight * (project(now.t.in_camera_j) - seen.j.point - dt * seen.j.velocity);
  if (out == nullptr) return;
  if (points[0] == poses[0] && points[1] == poses[1]) {
    write_jacobians(*out, seen, now);
  } else {
    write_jacobians(*out, seen, Sight(points[0], points[1], seen.a, seen.b, ray, lambda));
  }
}

}  // namespace

ReprojectionFactor::ReprojectionFactor(const View& i, const View& j, double weight, double offset_s,
                                       const FirstEstimate* first_i, const FirstEstimate* first_j)
    : i_(i), j_(j), weight_(weight), offset_s_(offset_s), first_i_(first_i), first_j_(first_j) {}

bool ReprojectionFactor::Evaluate(double const* const* parameters, double* residuals,
                                  double** jacobians) const {
  const Rigid camera(parameters[2]);
  const double* const points[] = {pose_point(first_i_, parameters[0]),
                                  pose_point(first_j_, parameters[1])};
  const Seen seen{i_, j_, camera, camera, weight_};
  const double dt = *parameters[4] - offset_s_;
  if (jacobians == nullptr) {
    evaluate(seen, parameters, points, *parameters[3], dt, residuals, nullptr);
    return true;
  }
  const Slots out{jacobians[0], jacobians[1], jacobians[2],
                  jacobians[2], jacobians[3], jacobians[4]};
  evaluate(seen, parameters, points, *parameters[3], dt, residuals, &out);
  return true;
}

CrossCameraFactor::CrossCameraFactor(const View& i, const View& j, double weight, double offset_s,
                                     const FirstEstimate* first_i, const FirstEstimate* first_j)
    : i_(i), j_(j), weight_(weight), offset_s_(offset_s), first_i_(first_i), first_j_(first_j) {}

bool CrossCameraFactor::Evaluate(double const* const* parameters, double* residuals,
                                 double** jacobians) const {
  const Rigid a(parameters[2]);
  const Rigid b(parameters[3]);
  const double* const points[] = {pose_point(first_i_, parameters[0]),
                                  pose_point(first_j_, parameters[1])};
  const Seen seen{i_, j_, a, b, weight_};
  const double dt = *parameters[5] - offset_s_;
  if (jacobians == nullptr) {
    evaluate(seen, parameters, points, *parameters[4], dt, residuals, nullptr);
    return true;
  }
  const Slots out{jacobians[0], jacobians[1], jacobians[2],
                  jacobians[3], jacobians[4], jacobians[5]};
  evaluate(seen, parameters, points, *parameters[4], dt, residuals, &out);
  return true;
}

StereoFactor::StereoFactor(const Vector2d& point_a, const Vector2d& point_b, double weight)
    : a_(point_a), b_(point_b), weight_(weight) {}

bool StereoFactor::Evaluate(double const* const* parameters, double* residuals,
                            double** jacobians) const {
  const Rigid a(parameters[0]);
  const Rigid b(parameters[1]);
  const double lambda = *parameters[2];
  const Vector3d ray = a_.homogeneous();
  const Vector3d baseline = a.p - b.p;
  const Vector3d h = b.R.transpose() * (a.R * ray + lambda * baseline);
  Eigen::Map<Vector2d>{residuals} = weight_ * (project(h) - b_);
  if (jacobians == nullptr) return true;
  const Matrix23 by_camera = projection_jacobian(h, weight_);
  const Matrix23 by_body = by_camera * b.R.transpose();
  if (jacobians[0] != nullptr) {
    write_pose(jacobians[0], -times_hat(by_body * a.R, ray), lambda * by_body);
  }
  if (jacobians[1] != nullptr) {
    write_pose(jacobians[1], times_hat(by_camera, h), -lambda * by_body);
  }
  if (jacobians[2] != nullptr) Eigen::Map<Vector2d>{jacobians[2]} = by_body * baseline;
  return true;
}

}  // namespace apvi::vio
