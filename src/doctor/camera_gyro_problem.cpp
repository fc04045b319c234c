// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/camera_gyro_problem.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "apvi/geometry/so3.hpp"
#include "vio/factors/projection.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Columns = Eigen::Matrix<double, kCameraGyroSize, Eigen::Dynamic>;

constexpr double kKernel = 3.0;      // width, in units of the noise
constexpr double kOutside = 10.0;    // distance of a corner outside the lens model, likewise
constexpr double kTimeStep = 0.004;  // of the derivative by time [s]
constexpr double kLensStep = 1e-3;   // of the derivatives by the lens

// Geman-McClure: corners far off have no pull, however many they are.
double robust_weight(double distance) {
  const double w = 1.0 / (1.0 + distance * distance / (kKernel * kKernel));
  return w * w;
}

double robust_cost(double distance) {
  return distance * distance / (1.0 + distance * distance / (kKernel * kKernel));
}

// Pixels per unit of t . (a x b) for unit rays of both images in the same axes.
double scale_of(const Vector3d& a, const Vector3d& b, const Vector3d& t) {
  return 1.0 / std::sqrt(a.cross(t).squaredNorm() + b.cross(t).squaredNorm() + 1e-12);
}

// Epipolar distance [px].
double distance_px(const Vector3d& a, const Vector3d& b, const Vector3d& t, double focal) {
  return focal * scale_of(a, b, t) * t.dot(a.cross(b));
}

Vector3d smallest_eigenvector(const Matrix3d& m) {
  Eigen::SelfAdjointEigenSolver<Matrix3d> eigen;
  eigen.computeDirect(m);
  return eigen.eigenvectors().col(0);
}

// Direction t that all a x b are perpendicular to. First each corner counts by its parallax, with a
// limit, then with robust weights of its distance, ever narrower.
Vector3d common_direction(const Matrix3Xd& a, const Matrix3Xd& b, double noise) {
  Matrix3d sum = Matrix3d::Zero();
  for (Eigen::Index i = 0; i < a.cols(); ++i) {
    const Vector3d n = a.col(i).cross(b.col(i));
    if (n.allFinite()) sum += n * n.transpose() / (n.squaredNorm() + noise * noise);
  }
  Vector3d t = smallest_eigenvector(sum);
  for (const double width : {4.0, 2.0, 1.0}) {
    sum.setZero();
    for (Eigen::Index i = 0; i < a.cols(); ++i) {
      const Vector3d n = a.col(i).cross(b.col(i));
      if (!n.allFinite()) continue;
      const double scale = scale_of(a.col(i), b.col(i), t) / (width * noise);
      sum += robust_weight(scale * t.dot(n)) * scale * scale * n * n.transpose();
    }
    t = smallest_eigenvector(sum);
  }
  return t;
}

}  // namespace

CameraGyroModel moved(const CameraGyroModel& model, const CameraGyroVector& step) {
  CameraGyroModel after = model;
  after.time_offset_s += step(kTimeOffset);
  after.R_camera_body = (so3::exp(step.segment<3>(kTurn)) * model.R_camera_body).normalized();
  after.gyro_scale += step(kGyroScale);
  after.gyro_bias += step.segment<3>(kGyroBias);
  after.focal *= std::exp(step(kFocal));
  after.radial += step(kRadial);
  return after;
}

CameraModel with_lens(const CameraModel& camera, double focal, double radial) {
  CameraModel::Parameters p = camera.parameters();
  p.fx *= focal;
  p.fy *= focal;
  p.coefficients[0] += radial;
  if (p.distortion == Distortion::none && radial != 0.0) p.distortion = Distortion::radtan;
  return CameraModel(p);
}

CameraGyroProblem::CameraGyroProblem(const InertialPath& path, std::vector<ImagePair> pairs,
                                     const CameraModel& camera)
    : path_(&path), pairs_(std::move(pairs)), camera_(camera) {
  for (const ImagePair& pair : pairs_) rig_rays_.push_back(rays_of(pair, 1.0, 0.0));
}

CameraGyroProblem::Rays CameraGyroProblem::rays_of(const ImagePair& pair, double focal,
                                                   double radial) const {
  const CameraModel camera = with_lens(camera_, focal, radial);
  const Vector3d outside = Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  const auto count = static_cast<Eigen::Index>(pair.points.size());
  Rays rays{Matrix3Xd(3, count), Matrix3Xd(3, count)};
  for (Eigen::Index i = 0; i < count; ++i) {
    const PixelPair& point = pair.points[static_cast<std::size_t>(i)];
    rays.before.col(i) = camera.unproject(point.before).value_or(outside);
    rays.now.col(i) = camera.unproject(point.now).value_or(outside);
  }
  return rays;
}

std::optional<Vector3d> CameraGyroProblem::body_turn(const ImagePair& pair, double offset) const {
  const auto before = path_->at(path_->seconds(pair.before) - offset);
  const auto now = path_->at(path_->seconds(pair.now) - offset);
  if (!before || !now) return std::nullopt;
  return so3::log(before->R_start_body.conjugate() * now->R_start_body);
}

std::optional<CameraGyroProblem::Seen> CameraGyroProblem::see(const CameraGyroModel& model,
                                                              double noise_px,
                                                              std::size_t pair) const {
  const auto turn = body_turn(pairs_[pair], model.time_offset_s);
  if (!turn) return std::nullopt;
  const double time = seconds_between(pairs_[pair].before, pairs_[pair].now);
  Seen seen;
  seen.turn = model.R_camera_body * (model.gyro_scale * *turn - time * model.gyro_bias);
  const bool is_rig = model.focal == 1.0 && model.radial == 0.0;
  seen.rays = is_rig ? rig_rays_[pair] : rays_of(pairs_[pair], model.focal, model.radial);
  seen.rays.now = so3::exp(seen.turn).toRotationMatrix() * seen.rays.now;
  seen.focal_px = model.focal * vio::focal_length(camera_);
  seen.direction = common_direction(seen.rays.before, seen.rays.now, noise_px / seen.focal_px);
  return seen;
}

// By central differences of the whole distance: the rays change, and the pixels per angle.
void CameraGyroProblem::add_lens_columns(const CameraGyroModel& model, std::size_t pair,
                                         const Seen& seen, Columns& columns) const {
  const Matrix3d R = so3::exp(seen.turn).toRotationMatrix();
  for (const int column : {kFocal, kRadial}) {
    CameraGyroVector step = CameraGyroVector::Zero();
    step(column) = kLensStep;
    const CameraGyroModel up = moved(model, step);
    const CameraGyroModel down = moved(model, -step);
    const Rays above = rays_of(pairs_[pair], up.focal, up.radial);
    const Rays below = rays_of(pairs_[pair], down.focal, down.radial);
    for (Eigen::Index i = 0; i < columns.cols(); ++i) {
      const double high = distance_px(above.before.col(i), R * above.now.col(i), seen.direction,
                                      up.focal * vio::focal_length(camera_));
      const double low = distance_px(below.before.col(i), R * below.now.col(i), seen.direction,
                                     down.focal * vio::focal_length(camera_));
      const double slope = (high - low) / (2.0 * kLensStep);
      columns(column, i) = std::isfinite(slope) ? slope : 0.0;
    }
  }
}

// Gauss-Newton with the two unknowns of the direction eliminated.
std::optional<CameraGyroNormal> CameraGyroProblem::normal_of(const CameraGyroModel& model,
                                                             double noise_px, bool lens,
                                                             std::size_t pair) const {
  const auto seen = see(model, noise_px, pair);
  const auto earlier = body_turn(pairs_[pair], model.time_offset_s - kTimeStep);
  const auto later = body_turn(pairs_[pair], model.time_offset_s + kTimeStep);
  if (!seen || !earlier || !later) return std::nullopt;
  const double time = seconds_between(pairs_[pair].before, pairs_[pair].now);
  const Matrix3d R_camera_body = model.R_camera_body.toRotationMatrix();
  const Vector3d turn = R_camera_body.transpose() * seen->turn;
  Eigen::Matrix<double, 3, kCameraGyroSize> by_unknown =
      Eigen::Matrix<double, 3, kCameraGyroSize>::Zero();
  by_unknown.col(kTimeOffset) =
      R_camera_body * (model.gyro_scale / (2.0 * kTimeStep) * (*later - *earlier));
  by_unknown.middleCols<3>(kTurn) = -so3::hat(seen->turn);
  by_unknown.col(kGyroScale) = R_camera_body * (turn + time * model.gyro_bias) / model.gyro_scale;
  by_unknown.middleCols<3>(kGyroBias) = -time * R_camera_body;
  by_unknown = so3::right_jacobian(-seen->turn) * by_unknown;

  const Vector3d& t = seen->direction;
  const auto count = seen->rays.before.cols();
  Columns columns = Columns::Zero(kCameraGyroSize, count);
  Eigen::Matrix2Xd across(2, count);
  Eigen::VectorXd residual(count);
  Eigen::VectorXd weight(count);
  const Vector3d side = t.unitOrthogonal();
  Eigen::Matrix<double, 3, 2> others;
  others << side, t.cross(side);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Vector3d a = seen->rays.before.col(i);
    const Vector3d b = seen->rays.now.col(i);
    const double scale = seen->focal_px * scale_of(a, b, t);
    residual(i) = scale * t.dot(a.cross(b));
    if (!std::isfinite(residual(i))) {
      residual(i) = weight(i) = 0.0;
      across.col(i).setZero();
      continue;
    }
    weight(i) = robust_weight(residual(i) / noise_px) / (noise_px * noise_px);
    columns.col(i) = scale * by_unknown.transpose() * b.cross(t.cross(a));
    across.col(i) = scale * others.transpose() * a.cross(b);
  }
  if (lens) add_lens_columns(model, pair, *seen, columns);

  const Columns weighted = columns * weight.asDiagonal();
  const Eigen::Matrix<double, kCameraGyroSize, 2> B = weighted * across.transpose();
  Eigen::Matrix2d C = across * weight.asDiagonal() * across.transpose();
  C.diagonal().array() += 1.0;
  const Eigen::Matrix<double, kCameraGyroSize, 2> K = C.ldlt().solve(B.transpose()).transpose();
  return CameraGyroNormal{weighted * columns.transpose() - K * B.transpose(),
                          weighted * residual - K * (across * weight.cwiseProduct(residual))};
}

std::vector<CameraGyroNormal> CameraGyroProblem::linearize(const CameraGyroModel& model,
                                                           double noise_px, bool lens,
                                                           std::size_t blocks) const {
  std::vector<CameraGyroNormal> normals(blocks);
  for (std::size_t pair = 0; pair < pairs_.size(); ++pair) {
    const auto normal = normal_of(model, noise_px, lens, pair);
    if (!normal) continue;
    CameraGyroNormal& sum = normals[pair * blocks / pairs_.size()];
    sum.H += normal->H;
    sum.b += normal->b;
  }
  return normals;
}

std::vector<std::optional<double>> CameraGyroProblem::costs(const CameraGyroModel& model,
                                                            double noise_px) const {
  std::vector<std::optional<double>> costs(pairs_.size());
  for (std::size_t pair = 0; pair < pairs_.size(); ++pair) {
    const auto seen = see(model, noise_px, pair);
    if (!seen) continue;
    double sum = 0.0;
    for (Eigen::Index i = 0; i < seen->rays.before.cols(); ++i) {
      const double distance = distance_px(seen->rays.before.col(i), seen->rays.now.col(i),
                                          seen->direction, seen->focal_px);
      sum += robust_cost(std::isfinite(distance) ? distance / noise_px : kOutside);
    }
    costs[pair] = sum / static_cast<double>(seen->rays.before.cols());
  }
  return costs;
}

std::vector<double> CameraGyroProblem::distances(const CameraGyroModel& model,
                                                 double noise_px) const {
  std::vector<double> distances;
  for (std::size_t pair = 0; pair < pairs_.size(); ++pair) {
    const auto seen = see(model, noise_px, pair);
    if (!seen) continue;
    for (Eigen::Index i = 0; i < seen->rays.before.cols(); ++i) {
      const double distance = distance_px(seen->rays.before.col(i), seen->rays.now.col(i),
                                          seen->direction, seen->focal_px);
      if (std::isfinite(distance)) distances.push_back(std::abs(distance));
    }
  }
  return distances;
}

// The sign is that for which b lies from a toward -t: a point in front moves against the camera.
std::optional<Vector3d> CameraGyroProblem::direction(const CameraGyroModel& model, double noise_px,
                                                     std::size_t pair) const {
  const auto seen = see(model, noise_px, pair);
  if (!seen) return std::nullopt;
  double forward = 0.0;
  double backward = 0.0;
  for (Eigen::Index i = 0; i < seen->rays.before.cols(); ++i) {
    const Vector3d a = seen->rays.before.col(i);
    const Vector3d b = seen->rays.now.col(i);
    // Parallax, with sign, and whether it is more than noise.
    const double moved = seen->focal_px * seen->direction.dot(a - b);
    if (!(std::abs(moved) > 3.0 * noise_px)) continue;
    (moved > 0.0 ? forward : backward) += 1.0;
  }
  if (forward + backward < 10.0) return std::nullopt;
  if (std::max(forward, backward) < 0.9 * (forward + backward)) return std::nullopt;
  return forward > backward ? seen->direction : Vector3d(-seen->direction);
}

}  // namespace apvi::doctor
