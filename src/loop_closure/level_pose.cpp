// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/level_pose.hpp"

#include <ceres/ceres.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "core/random.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kInlierSigmas = 3.0;
constexpr int kSamples = 1000;
constexpr double kConfidence = 0.9999;
constexpr double kMinElevation = 0.02;   // sine of a ray's angle to the horizontal plane
constexpr double kMinDistance_m = 0.05;  // between the two points of a sample
constexpr int kRefinements = 2;
constexpr int kIterations = 10;

/// A point and its unit ray in level axes, from the camera.
struct LevelRay {
  Eigen::Vector3d point, ray;
};

// From map points to level axes at the camera.
using LevelTransform = SE3;

// λ_1 f_1 - λ_2 f_2 = R_z (X_1 - X_2): its vertical part gives λ_1 = a + b λ_2, its horizontal
// length a quadratic equation of λ_2.
std::vector<LevelTransform> solve_two_points(const LevelRay& first, const LevelRay& second) {
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
  std::vector<LevelTransform> solutions;
  for (const double sign : {-1.0, 1.0}) {
    const double l2 = (-B + sign * std::sqrt(root)) / A;
    if (l2 <= 0.0 || a + b * l2 <= 0.0) continue;
    const Eigen::Vector2d seen = start + l2 * slope;
    const double heading = std::atan2(seen.y(), seen.x()) - std::atan2(between.y(), between.x());
    const Eigen::Quaterniond R = so3::exp({0.0, 0.0, heading});
    solutions.push_back({R, l2 * f2 - R * second.point});
  }
  return solutions;
}

/// Error of a ray on the plane z = 1, in sigmas, as a function of heading and translation.
struct RayError {
  PointOnRay seen;
  Eigen::Quaterniond R_camera_level;
  double sigma;

  template <typename T>
  bool operator()(const T* state, T* error) const {
    using std::cos;
    using std::sin;
    const T c = cos(state[0]);
    const T s = sin(state[0]);
    const Eigen::Vector3d& p = seen.point;
    const Eigen::Matrix<T, 3, 1> level(c * p.x() - s * p.y() + state[1],
                                       s * p.x() + c * p.y() + state[2], p.z() + state[3]);
    const Eigen::Matrix<T, 3, 1> q = R_camera_level.cast<T>() * level;
    error[0] = (q.x() / q.z() - seen.ray.x()) / sigma;
    error[1] = (q.y() / q.z() - seen.ray.y()) / sigma;
    return true;
  }
};

/// The points of an image and the transforms that fit them.
class Problem {
 public:
  Problem(const std::vector<PointOnRay>& seen, const Eigen::Quaterniond& R_level_camera,
          double sigma)
      : seen_(seen), R_camera_level_(R_level_camera.conjugate()), sigma_(sigma) {
    for (const PointOnRay& s : seen) {
      level_.push_back({s.point, R_level_camera * s.ray.homogeneous().normalized()});
    }
  }

  std::vector<std::size_t> inliers(const LevelTransform& T) const {
    std::vector<std::size_t> found;
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      const Eigen::Vector3d p = R_camera_level_ * (T * seen_[i].point);
      if (p.z() <= 0.0) continue;
      if ((p.hnormalized() - seen_[i].ray).norm() < kInlierSigmas * sigma_) found.push_back(i);
    }
    return found;
  }

  /// The transform with the most inliers.
  LevelTransform sample() const {
    LevelTransform best;
    std::size_t most = 0;
    Random random(seen_.size());
    double needed = kSamples;
    for (int k = 0; k < kSamples && k < needed; ++k) {
      for (const LevelTransform& T : solve_two_points(pick(random), pick(random))) {
        const std::size_t count = inliers(T).size();
        if (count <= most) continue;
        most = count;
        best = T;
        needed = samples_for(count);
      }
    }
    return best;
  }

  LevelTransform refined(const LevelTransform& T, const std::vector<std::size_t>& chosen) const {
    std::array<double, 4> state{so3::yaw(T.rotation), T.translation.x(), T.translation.y(),
                                T.translation.z()};
    ceres::Problem problem;
    for (const std::size_t i : chosen) {
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<RayError, 2, 4>(
                                   new RayError{seen_[i], R_camera_level_, sigma_}),
                               new ceres::CauchyLoss(1.0), state.data());
    }
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.max_num_iterations = kIterations;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    return {so3::exp({0.0, 0.0, state[0]}), {state[1], state[2], state[3]}};
  }

 private:
  const LevelRay& pick(Random& random) const { return level_[random.next() % level_.size()]; }
  double samples_for(std::size_t inliers) const {
    const double part = static_cast<double>(inliers) / static_cast<double>(seen_.size());
    return std::log(1.0 - kConfidence) / std::log(1.0 - std::min(0.999, part * part));
  }

  const std::vector<PointOnRay>& seen_;
  std::vector<LevelRay> level_;
  Eigen::Quaterniond R_camera_level_;
  double sigma_;
};

}  // namespace

std::optional<LevelPose> find_level_pose(const std::vector<PointOnRay>& seen,
                                         const SE3& T_world_camera, double sigma,
                                         std::size_t min_inliers) {
  if (seen.size() < std::max<std::size_t>(2, min_inliers)) return std::nullopt;
  const Problem problem(seen, T_world_camera.rotation, sigma);
  LevelTransform T = problem.sample();
  std::vector<std::size_t> inliers = problem.inliers(T);
  for (int k = 0; k < kRefinements; ++k) {
    if (inliers.size() < min_inliers) return std::nullopt;
    T = problem.refined(T, inliers);
    inliers = problem.inliers(T);
  }
  if (inliers.size() < min_inliers) return std::nullopt;
  T.translation += T_world_camera.translation;
  return LevelPose{T, inliers};
}

}  // namespace apvi::loop_closure
