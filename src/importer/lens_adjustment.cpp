// SPDX-License-Identifier: BSD-3-Clause
#include "importer/lens_adjustment.hpp"

#include <ceres/autodiff_cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/rotation.h>
#include <ceres/solver.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "core/median.hpp"
#include "vio/visual/two_view.hpp"

namespace apvi::importer {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kMaxAngle = 1.5;  // [rad] in air; greater ones continue linearly
constexpr double kMotionError_px = 2.0;
constexpr double kHuber_px = 1.0;
constexpr double kScaleWeight = 100.0;
constexpr double kMinCost_px2 = 1e-6;  // keeps logarithms of exact tracks finite
constexpr int kMaxIterations = 30;

template <typename T>
T angle_in_air(const LensShape& shape, const T& angle) {
  if (!shape.port) return angle;
  const double limit = std::asin(std::sin(kMaxAngle) / kWaterRefraction);
  if (angle > T(limit)) return T(kMaxAngle) + (angle - T(limit));
  using std::asin, std::sin;
  return asin(T(kWaterRefraction) * sin(angle));
}

template <typename T>
T radius_of(Lens lens, const T& angle) {
  if (lens == Lens::equidistant) return angle;
  if (angle > T(kMaxAngle)) return T(std::tan(kMaxAngle)) + (angle - T(kMaxAngle));
  using std::tan;
  return tan(angle);
}

// Position from the principal point in focal lengths.
template <typename T>
std::array<T, 2> project(const LensShape& shape, const T* point) {
  using std::atan2, std::sqrt;
  const T across = sqrt(point[0] * point[0] + point[1] * point[1] + T(1e-18));
  const T radius = radius_of(shape.lens, angle_in_air(shape, T(atan2(across, point[2]))));
  return {radius * point[0] / across, radius * point[1] / across};
}

/// Pose of an image: T_image_first as a rotation vector and a translation.
using Pose = std::array<double, 6>;

struct Reprojection {
  LensShape shape;
  Vector2d seen;  // from the principal point [px]

  template <typename T>
  bool operator()(const T* log_focal, const T* pose, const T* point, T* residual) const {
    std::array<T, 3> p{};
    ceres::AngleAxisRotatePoint(pose, point, p.data());
    for (std::size_t i = 0; i < 3; ++i) p[i] += pose[3 + i];
    const std::array<T, 2> r = project(shape, p.data());
    using std::exp;
    residual[0] = exp(*log_focal) * r[0] - T(seen.x());
    residual[1] = exp(*log_focal) * r[1] - T(seen.y());
    return true;
  }
};

/// Holds the scale, which images do not tell.
struct UnitDistance {
  template <typename T>
  bool operator()(const T* pose, T* residual) const {
    using std::sqrt;
    const T square = pose[3] * pose[3] + pose[4] * pose[4] + pose[5] * pose[5];
    residual[0] = T(kScaleWeight) * (sqrt(square + T(1e-18)) - T(1.0));
    return true;
  }
};

/// A segment with its poses and points, in units of the distance from first to last image.
struct Reconstruction {
  const TrackSegment* tracks = nullptr;
  std::vector<Pose> poses;
  std::vector<Vector3d> points;
};

std::vector<vio::PointPair> pairs_of(const LensShape& shape, double focal_px,
                                     const Vector2d& center, const TrackSegment& segment) {
  std::vector<vio::PointPair> pairs;
  for (const auto& track : segment.tracks) {
    pairs.push_back({ray_of(shape, focal_px, track.front() - center).head<2>(),
                     ray_of(shape, focal_px, track.back() - center).head<2>()});
  }
  return pairs;
}

// Points that the motion does not place before the cameras begin at the median depth.
std::vector<Vector3d> points_of(const std::vector<vio::PointPair>& pairs, const SE3& T_first_last) {
  std::vector<std::optional<double>> depths;
  std::vector<double> known;
  for (const vio::PointPair& pair : pairs) {
    const auto point = vio::triangulate(pair, T_first_last);
    depths.push_back(point ? std::optional(point->depth) : std::nullopt);
    if (point) known.push_back(point->depth);
  }
  const double middle = known.empty() ? 1.0 : median(known);
  std::vector<Vector3d> points;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    points.emplace_back(depths[i].value_or(middle) * pairs[i].before.homogeneous());
  }
  return points;
}

// Images in between lie evenly on the way.
std::vector<Pose> poses_of(const SE3& T_first_last, std::size_t images) {
  std::vector<Pose> poses;
  for (std::size_t k = 0; k < images; ++k) {
    const double share = static_cast<double>(k) / static_cast<double>(images - 1);
    const Eigen::Quaterniond R =
        Eigen::Quaterniond::Identity().slerp(share, T_first_last.rotation).conjugate();
    const Vector3d t = -(R * (share * T_first_last.translation));
    const Eigen::AngleAxisd turn(R);
    const Vector3d w = turn.angle() * turn.axis();
    poses.push_back({w.x(), w.y(), w.z(), t.x(), t.y(), t.z()});
  }
  return poses;
}

std::optional<Reconstruction> begin(const LensShape& shape, double focal_px, const Vector2d& center,
                                    const TrackSegment& segment) {
  const auto pairs = pairs_of(shape, focal_px, center, segment);
  const std::vector<SE3> motions = vio::possible_motions(pairs, kMotionError_px / focal_px);
  if (motions.empty()) return std::nullopt;
  return Reconstruction{&segment, poses_of(motions.front(), segment.images()),
                        points_of(pairs, motions.front())};
}

class Adjustment {
 public:
  Adjustment(const LensShape& shape, double focal_px, ImageSize size,
             const std::vector<TrackSegment>& segments)
      : shape_(shape),
        center_(0.5 * (size.width - 1), 0.5 * (size.height - 1)),
        log_focal_(std::log(focal_px)) {
    for (const TrackSegment& segment : segments) {
      parts_.push_back(begin(shape, focal_px, center_, segment));
    }
  }

  LensFit run(bool free_focal) {
    ceres::Problem problem;
    for (auto& part : parts_) {
      if (part) add(*part, problem);
    }
    if (problem.NumResiduals() > 0) {
      if (!free_focal) problem.SetParameterBlockConstant(&log_focal_);
      ceres::Solver::Options options;
      options.linear_solver_type = ceres::DENSE_SCHUR;
      options.max_num_iterations = kMaxIterations;
      options.function_tolerance = 1e-5;
      options.logging_type = ceres::SILENT;
      ceres::Solver::Summary summary;
      ceres::Solve(options, &problem, &summary);
    }
    return result();
  }

 private:
  void add(Reconstruction& part, ceres::Problem& problem) {
    const auto& tracks = part.tracks->tracks;
    for (std::size_t i = 0; i < tracks.size(); ++i) {
      for (std::size_t k = 0; k < part.poses.size(); ++k) {
        using Cost = ceres::AutoDiffCostFunction<Reprojection, 2, 1, 6, 3>;
        problem.AddResidualBlock(new Cost(new Reprojection{shape_, tracks[i][k] - center_}),
                                 new ceres::HuberLoss(kHuber_px), &log_focal_, part.poses[k].data(),
                                 part.points[i].data());
      }
    }
    using Scale = ceres::AutoDiffCostFunction<UnitDistance, 1, 6>;
    problem.AddResidualBlock(new Scale(new UnitDistance), nullptr, part.poses.back().data());
    problem.SetParameterBlockConstant(part.poses.front().data());
  }

  LensFit result() const {
    LensFit fit{.focal_px = std::exp(log_focal_),
                .cost = {},
                .total = std::numeric_limits<double>::infinity()};
    double sum = 0.0;
    int count = 0;
    for (const auto& part : parts_) {
      fit.cost.push_back(part ? cost(*part) : std::numeric_limits<double>::quiet_NaN());
      if (part) sum += std::log(fit.cost.back() + kMinCost_px2);
      if (part) ++count;
    }
    if (count > 0) fit.total = std::exp(sum / count);
    return fit;
  }

  double cost(const Reconstruction& part) const {
    const ceres::HuberLoss huber(kHuber_px);
    double sum = 0.0;
    for (std::size_t i = 0; i < part.points.size(); ++i) {
      for (std::size_t k = 0; k < part.poses.size(); ++k) {
        Vector2d r;
        Reprojection{shape_, part.tracks->tracks[i][k] - center_}(&log_focal_, part.poses[k].data(),
                                                                  part.points[i].data(), r.data());
        std::array<double, 3> rho{};
        huber.Evaluate(r.squaredNorm(), rho.data());
        sum += rho[0];
      }
    }
    return sum / (2.0 * static_cast<double>(part.points.size() * part.poses.size()));
  }

  LensShape shape_;
  Vector2d center_;
  double log_focal_;
  std::vector<std::optional<Reconstruction>> parts_;
};

}  // namespace

Vector3d ray_of(const LensShape& shape, double focal_px, const Vector2d& from_center) {
  const double radius = from_center.norm() / focal_px;
  double angle = shape.lens == Lens::rectilinear ? std::atan(radius) : radius;
  angle = std::min(angle, kMaxAngle);
  if (shape.port) angle = std::asin(std::sin(angle) / kWaterRefraction);
  if (radius == 0.0) return Vector3d::UnitZ();
  return (std::tan(angle) / (radius * focal_px) * from_center).homogeneous();
}

Vector2d pixel_of(const LensShape& shape, double focal_px, const Vector3d& ray) {
  const std::array<double, 2> r = project(shape, ray.data());
  return focal_px * Vector2d(r[0], r[1]);
}

LensFit fit_lens(const LensShape& shape, double focal_px, bool free_focal, ImageSize size,
                 const std::vector<TrackSegment>& segments) {
  return Adjustment(shape, focal_px, size, segments).run(free_focal);
}

}  // namespace apvi::importer
