// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/level_pose.hpp"

#include <ceres/ceres.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "apvi/geometry/so3.hpp"
#include "core/random.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kInlierSigmas = 3.0;
constexpr int kMaxSamples = 1000;
constexpr double kConfidence = 0.9999;
constexpr double kMinElevation = 0.02;   // sine of a ray's angle to the horizontal plane
constexpr double kMinDistance_m = 0.05;  // between the two points of a sample, horizontally
constexpr int kIterations = 20;

/// A point and its unit ray in world axes.
struct LevelRay {
  Eigen::Vector3d point, ray;
};

std::vector<LevelRay> level_rays(const LevelView& view) {
  std::vector<LevelRay> rays;
  for (const PointOnRay& s : view.seen) {
    rays.push_back({s.point, view.T_world_camera.rotation * s.ray.homogeneous().normalized()});
  }
  return rays;
}

// From the map to world axes at the camera. λ_1 f_1 - λ_2 f_2 = R_z (X_1 - X_2): the vertical part
// gives λ_1 = a + b λ_2, the horizontal length a quadratic equation of λ_2.
std::vector<SE3> solve_two_points(const LevelRay& first, const LevelRay& second) {
  const Eigen::Vector3d between = first.point - second.point;
  const Eigen::Vector3d& f1 = first.ray;
  const Eigen::Vector3d& f2 = second.ray;
  if (std::abs(f1.z()) < kMinElevation || between.head<2>().norm() < kMinDistance_m) return {};
  const double a = between.z() / f1.z();
  const double b = f2.z() / f1.z();
  const Eigen::Vector2d slope = b * f1.head<2>() - f2.head<2>();
  const Eigen::Vector2d start = a * f1.head<2>();
  const double A = slope.squaredNorm();
  const double B = start.dot(slope);
  const double root = B * B - A * (start.squaredNorm() - between.head<2>().squaredNorm());
  if (root < 0.0 || A < 1e-12) return {};
  std::vector<SE3> solutions;
  for (const double sign : {-1.0, 1.0}) {
    const double distance = (-B + sign * std::sqrt(root)) / A;
    if (distance <= 0.0 || a + b * distance <= 0.0) continue;
    const Eigen::Vector2d seen = start + distance * slope;
    const double heading = std::atan2(seen.y(), seen.x()) - std::atan2(between.y(), between.x());
    const Eigen::Quaterniond R = so3::exp({0.0, 0.0, heading});
    solutions.push_back({R, distance * f2 - R * second.point});
  }
  return solutions;
}

// Samples after which one without an outlier has been drawn.
double needed_samples(std::size_t inliers, std::size_t all) {
  const double part = static_cast<double>(inliers) / static_cast<double>(all);
  return std::log(1.0 - kConfidence) / std::log(1.0 - std::min(0.999, part * part));
}

/// Where camera and map are linearized, so that heading and translation are hardly correlated.
struct Center {
  Eigen::Vector3d in_world, in_map;
};

using State = std::array<double, 4>;  // displacement of the center [m], heading [rad]

SE3 to_pose(const State& state, const Center& center) {
  const Eigen::Quaterniond R = so3::exp({0.0, 0.0, state[3]});
  const Eigen::Vector3d moved(state[0], state[1], state[2]);
  return {R, center.in_world + moved - R * center.in_map};
}

/// Error of a ray on the plane z = 1, in sigmas, as a function of the state.
struct RayError {
  PointOnRay seen;
  SE3 T_camera_world;
  Center center;
  double sigma = 1.0;

  template <typename T>
  bool operator()(const T* state, T* error) const {
    using std::cos;
    using std::sin;
    const T c = cos(state[3]);
    const T s = sin(state[3]);
    const Eigen::Vector3d p = seen.point - center.in_map;
    const Eigen::Vector3d& o = center.in_world;
    const Eigen::Matrix<T, 3, 1> world(c * p.x() - s * p.y() + state[0] + o.x(),
                                       s * p.x() + c * p.y() + state[1] + o.y(),
                                       p.z() + state[2] + o.z());
    const Eigen::Matrix<T, 3, 1> q =
        T_camera_world.rotation.cast<T>() * world + T_camera_world.translation.cast<T>();
    error[0] = (q.x() / q.z() - seen.ray.x()) / sigma;
    error[1] = (q.y() / q.z() - seen.ray.y()) / sigma;
    return true;
  }
};

void add_errors(const std::vector<LevelView>& views, const Center& center, double sigma,
                State& state, ceres::Problem& problem) {
  for (const LevelView& view : views) {
    const SE3 T_camera_world = view.T_world_camera.inverse();
    for (const PointOnRay& seen : view.seen) {
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<RayError, 2, 4>(
                                   new RayError{seen, T_camera_world, center, sigma}),
                               new ceres::CauchyLoss(1.0), state.data());
    }
  }
}

std::optional<Eigen::Matrix4d> covariance_of(const State& state, ceres::Problem& problem) {
  ceres::Covariance covariance({});
  const std::vector<std::pair<const double*, const double*>> blocks{{state.data(), state.data()}};
  if (!covariance.Compute(blocks, &problem)) return std::nullopt;
  Eigen::Matrix<double, 4, 4, Eigen::RowMajor> result;
  if (!covariance.GetCovarianceBlock(state.data(), state.data(), result.data()))
    return std::nullopt;
  return Eigen::Matrix4d(result);
}

}  // namespace

std::vector<std::size_t> fitting_points(const LevelView& view, const SE3& T_world_map,
                                        double sigma) {
  const SE3 T_camera_map = view.T_world_camera.inverse() * T_world_map;
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < view.seen.size(); ++i) {
    const Eigen::Vector3d p = T_camera_map * view.seen[i].point;
    if (p.z() <= 0.0) continue;
    if ((p.hnormalized() - view.seen[i].ray).norm() < kInlierSigmas * sigma) found.push_back(i);
  }
  return found;
}

std::optional<SE3> sample_level_pose(const LevelView& view, double sigma) {
  const std::vector<LevelRay> rays = level_rays(view);
  if (rays.size() < 2) return std::nullopt;
  Random random(rays.size());
  const auto pick = [&] { return rays[random.next() % rays.size()]; };
  std::optional<SE3> best;
  std::size_t most = 0;
  double needed = kMaxSamples;
  for (int k = 0; k < kMaxSamples && k < needed; ++k) {
    const LevelRay first = pick();
    for (SE3 pose : solve_two_points(first, pick())) {
      pose.translation += view.T_world_camera.translation;
      const std::size_t count = fitting_points(view, pose, sigma).size();
      if (count <= most) continue;
      most = count;
      best = pose;
      needed = needed_samples(count, rays.size());
    }
  }
  return best;
}

std::optional<LevelPose> fit_level_pose(const std::vector<LevelView>& views, const SE3& T_world_map,
                                        double sigma) {
  if (views.empty()) return std::nullopt;
  const Eigen::Vector3d& camera = views.back().T_world_camera.translation;
  const Center center{camera, T_world_map.inverse() * camera};
  State state{0.0, 0.0, 0.0, so3::yaw(T_world_map.rotation)};
  ceres::Problem problem;
  add_errors(views, center, sigma, state, problem);
  if (problem.NumResidualBlocks() < 2) return std::nullopt;
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = kIterations;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return std::nullopt;
  const auto covariance = covariance_of(state, problem);
  if (!covariance) return std::nullopt;
  return LevelPose{to_pose(state, center), *covariance};
}

}  // namespace apvi::loop_closure
