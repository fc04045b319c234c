// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

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

/// A lens correction.
struct Lens {
  double focal_ratio;
  Vector2d shift;

  explicit Lens(const double* lens) : focal_ratio(std::exp(lens[0])), shift(lens[1], lens[2]) {}
  Vector2d true_point(const Vector2d& point) const { return (point - shift) / focal_ratio; }
  Vector2d rig_point(const Vector2d& point) const { return focal_ratio * point + shift; }
};

/// The body when an image was taken, in the body of its frame.
struct Shift {
  Eigen::Matrix3d R;
  Vector3d p;
  const ImageMotion& motion;

  Shift(const ImageMotion& m, double offset_s) : motion(m) {
    const SE3 shift = m.shift(offset_s);
    R = shift.rotation.toRotationMatrix();
    p = shift.translation;
  }
  Rigid operator*(const Rigid& camera) const { return {R * camera.R, R * camera.p + p}; }
  /// Derivative of a point (times λ) in the frame's body by the time of the image.
  Vector3d by_time(const Vector3d& point, double lambda) const {
    return motion.rate.cross(point - lambda * p) + lambda * motion.velocity;
  }
};

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
                       const Vector3d& bearing_i, double lambda, const Shift& shift) {
  rotation -= times_hat(c.by_body_i * a.R, bearing_i);
  position += lambda * c.by_body_i * shift.R;
}
void add_other_camera(Matrix23& rotation, Matrix23& position, const Chain& c, const Transfer& t,
                      double lambda, const Shift& shift) {
  rotation += times_hat(c.by_camera_j, t.in_camera_j);
  position -= lambda * c.by_body_j * shift.R;
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
  double* lens_a;
  double* lens_b;
};

/// Inputs of a term between two frames: measurements, and cameras in the bodies of their frames.
struct Seen {
  const View& i;
  const View& j;
  Shift shift_i, shift_j;
  Rigid a, b;
  const Lens& lens_a;
  const Lens& lens_b;
  double weight;

  Seen(const View& view_i, const View& view_j, double offset_s, const Rigid& camera_a,
       const Rigid& camera_b, const Lens& first, const Lens& second, double w)
      : i(view_i),
        j(view_j),
        shift_i(view_i.motion, offset_s),
        shift_j(view_j.motion, offset_s),
        a(shift_i * camera_a),
        b(shift_j * camera_b),
        lens_a(first),
        lens_b(second),
        weight(w) {}
};

void write_cameras(const Slots& out, const Chain& c, const Sight& at, const Seen& seen) {
  Matrix23 rotation = Matrix23::Zero();
  Matrix23 position = Matrix23::Zero();
  if (out.camera_a != nullptr) {
    add_anchor_camera(rotation, position, c, seen.a, at.ray, at.lambda, seen.shift_i);
    if (out.camera_b == out.camera_a) {
      add_other_camera(rotation, position, c, at.t, at.lambda, seen.shift_j);
    }
    write_pose(out.camera_a, rotation, position);
  }
  if (out.camera_b != nullptr && out.camera_b != out.camera_a) {
    rotation.setZero();
    position.setZero();
    add_other_camera(rotation, position, c, at.t, at.lambda, seen.shift_j);
    write_pose(out.camera_b, rotation, position);
  }
}

// Derivatives by the lens corrections: of the ray in the anchor, `by_ray`, and of the prediction.
void write_lenses(double* out_a, double* out_b, const Matrix23& by_ray, const Vector3d& ray,
                  const Lens& lens_a, const Vector2d& predicted, double weight) {
  using LensJacobian = Eigen::Map<Eigen::Matrix<double, 2, kLensSize, Eigen::RowMajor>>;
  if (out_a != nullptr) {
    LensJacobian J(out_a);
    J.col(0) = -by_ray.leftCols<2>() * ray.head<2>();
    J.rightCols<2>() = -by_ray.leftCols<2>() / lens_a.focal_ratio;
  }
  if (out_b == nullptr) return;
  LensJacobian J(out_b);
  if (out_b != out_a) J.setZero();
  J.col(0) += weight * predicted;
  J.rightCols<2>().diagonal().array() += weight;
}

void write_jacobians(const Slots& out, const Seen& seen, const Sight& at) {
  const Chain c(at.t, at.i, at.j, seen.b, seen.weight * seen.lens_b.focal_ratio);
  if (out.pose_i != nullptr) {
    write_pose(out.pose_i, -times_hat(c.by_body_i, at.t.in_body_i), at.lambda * c.by_world);
  }
  if (out.pose_j != nullptr) {
    write_pose(out.pose_j, times_hat(c.by_body_j, at.t.in_body_j), -at.lambda * c.by_world);
  }
  write_cameras(out, c, at, seen);
  if (out.lambda != nullptr) {
    Eigen::Map<Vector2d>{out.lambda} =
        c.by_body_i * seen.a.p + c.by_world * (at.i.p - at.j.p) - c.by_body_j * seen.b.p;
  }
  if (out.offset != nullptr) {
    Eigen::Map<Vector2d>{out.offset} =
        c.by_body_j * seen.shift_j.by_time(at.t.in_body_j, at.lambda) -
        c.by_body_i * seen.shift_i.by_time(at.t.in_body_i, at.lambda);
  }
  write_lenses(out.lens_a, out.lens_b, c.by_body_i * seen.a.R, at.ray, seen.lens_a,
               seen.lens_b.focal_ratio * project(at.t.in_camera_j), seen.weight);
}

/// The residual at the poses, Jacobians at the linearization points.
void evaluate(const Seen& seen, const double* const poses[2], const double* const points[2],
              double lambda, double* residuals, const Slots* out) {
  const Vector3d ray = seen.lens_a.true_point(seen.i.point).homogeneous();
  const Sight now(poses[0], poses[1], seen.a, seen.b, ray, lambda);
  Eigen::Map<Vector2d>{residuals} =
      seen.weight * (seen.lens_b.rig_point(project(now.t.in_camera_j)) - seen.j.point);
  if (out == nullptr) return;
  if (points[0] == poses[0] && points[1] == poses[1]) {
    write_jacobians(*out, seen, now);
  } else {
    write_jacobians(*out, seen, Sight(points[0], points[1], seen.a, seen.b, ray, lambda));
  }
}

}  // namespace

ReprojectionFactor::ReprojectionFactor(const View& i, const View& j, double weight,
                                       const FirstEstimate* first_i, const FirstEstimate* first_j)
    : i_(i), j_(j), weight_(weight), first_i_(first_i), first_j_(first_j) {}

bool ReprojectionFactor::Evaluate(double const* const* parameters, double* residuals,
                                  double** jacobians) const {
  const Rigid camera(parameters[2]);
  const Lens lens(parameters[5]);
  const double* const points[] = {pose_point(first_i_, parameters[0]),
                                  pose_point(first_j_, parameters[1])};
  const Seen seen(i_, j_, *parameters[4], camera, camera, lens, lens, weight_);
  if (jacobians == nullptr) {
    evaluate(seen, parameters, points, *parameters[3], residuals, nullptr);
    return true;
  }
  const Slots out{jacobians[0], jacobians[1], jacobians[2], jacobians[2],
                  jacobians[3], jacobians[4], jacobians[5], jacobians[5]};
  evaluate(seen, parameters, points, *parameters[3], residuals, &out);
  return true;
}

CrossCameraFactor::CrossCameraFactor(const View& i, const View& j, double weight,
                                     const FirstEstimate* first_i, const FirstEstimate* first_j)
    : i_(i), j_(j), weight_(weight), first_i_(first_i), first_j_(first_j) {}

bool CrossCameraFactor::Evaluate(double const* const* parameters, double* residuals,
                                 double** jacobians) const {
  const Rigid a(parameters[2]);
  const Rigid b(parameters[3]);
  const Lens lens_a(parameters[6]);
  const Lens lens_b(parameters[7]);
  const double* const points[] = {pose_point(first_i_, parameters[0]),
                                  pose_point(first_j_, parameters[1])};
  const Seen seen(i_, j_, *parameters[5], a, b, lens_a, lens_b, weight_);
  if (jacobians == nullptr) {
    evaluate(seen, parameters, points, *parameters[4], residuals, nullptr);
    return true;
  }
  const Slots out{jacobians[0], jacobians[1], jacobians[2], jacobians[3],
                  jacobians[4], jacobians[5], jacobians[6], jacobians[7]};
  evaluate(seen, parameters, points, *parameters[4], residuals, &out);
  return true;
}

StereoFactor::StereoFactor(const Vector2d& point_a, const Vector2d& point_b, double weight)
    : a_(point_a), b_(point_b), weight_(weight) {}

bool StereoFactor::Evaluate(double const* const* parameters, double* residuals,
                            double** jacobians) const {
  const Rigid a(parameters[0]);
  const Rigid b(parameters[1]);
  const double lambda = *parameters[2];
  const Lens lens_a(parameters[3]);
  const Lens lens_b(parameters[4]);
  const Vector3d ray = lens_a.true_point(a_).homogeneous();
  const Vector3d baseline = a.p - b.p;
  const Vector3d h = b.R.transpose() * (a.R * ray + lambda * baseline);
  Eigen::Map<Vector2d>{residuals} = weight_ * (lens_b.rig_point(project(h)) - b_);
  if (jacobians == nullptr) return true;
  const Matrix23 by_camera = projection_jacobian(h, weight_ * lens_b.focal_ratio);
  const Matrix23 by_body = by_camera * b.R.transpose();
  if (jacobians[0] != nullptr) {
    write_pose(jacobians[0], -times_hat(by_body * a.R, ray), lambda * by_body);
  }
  if (jacobians[1] != nullptr) {
    write_pose(jacobians[1], times_hat(by_camera, h), -lambda * by_body);
  }
  if (jacobians[2] != nullptr) Eigen::Map<Vector2d>{jacobians[2]} = by_body * baseline;
  write_lenses(jacobians[3], jacobians[4], by_body * a.R, ray, lens_a,
               lens_b.focal_ratio * project(h), weight_);
  return true;
}

}  // namespace apvi::vio
