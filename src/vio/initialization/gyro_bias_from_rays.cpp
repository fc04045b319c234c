// SPDX-License-Identifier: BSD-3-Clause
#include "vio/initialization/gyro_bias_from_rays.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "core/median.hpp"

namespace apvi::vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kIterations = 20;
constexpr double kConverged = 1e-5;  // [rad/s]
constexpr int kMinCommon = 8;        // minimum number of common rays of a keyframe pair
constexpr double kMinNoise_px = 0.3;

// A ray in the frame of the first body, and its derivative by the gyro bias.
struct Ray {
  Vector3d direction;
  Matrix3d by_bias;
};

// One corner in two keyframes.
struct Match {
  int ray_i, ray_j;
  int track;
  double weight = 1.0;
  double residual_px = 0.0;
};

struct Pair {
  std::vector<Match> matches;
};

// Attitude of each keyframe: R(b + δ) = R Exp(J δ).
struct Turn {
  Matrix3d R = Matrix3d::Identity();
  Matrix3d J = Matrix3d::Zero();
};

std::vector<Turn> integrate_turns(const StartProblem& problem, const Vector3d& bias) {
  std::vector<Turn> turns(1);
  Eigen::Quaterniond R = Eigen::Quaterniond::Identity();
  Matrix3d J = Matrix3d::Zero();
  for (std::size_t k = 1; k < problem.imu.size(); ++k) {
    const auto& samples = problem.imu[k];
    for (std::size_t i = 1; i < samples.size(); ++i) {
      const double dt = seconds_between(samples[i - 1].stamp, samples[i].stamp);
      const Vector3d phi = (0.5 * (samples[i - 1].gyro + samples[i].gyro) - bias) * dt;
      const Eigen::Quaterniond step = so3::exp(phi);
      R = (R * step).normalized();
      J = step.conjugate().toRotationMatrix() * J - dt * so3::right_jacobian(phi);
    }
    turns.push_back({R.toRotationMatrix(), J});
  }
  return turns;
}

// Least-squares problem over all keyframe pairs with common tracks.
class RayProblem {
 public:
  RayProblem(const StartProblem& problem, const StartSigmas& sigmas)
      : problem_(problem), sigmas_(sigmas) {
    const auto n = static_cast<std::size_t>(problem.keyframes());
    pairs_.resize(n * n);
    for (int t = 0; t < static_cast<int>(problem.tracks.size()); ++t) add_track(t);
    std::erase_if(pairs_, [](const Pair& pair) { return pair.matches.size() < kMinCommon; });
    for (const Pair& pair : pairs_) matches_ += pair.matches.size();
  }

  bool empty() const { return pairs_.empty(); }

  // One Gauss-Newton step with the translation of every pair eliminated, using the weights of the
  // previous step.
  Vector3d step(const Vector3d& bias) {
    const double prior = 1.0 / (sigmas_.gyro_bias * sigmas_.gyro_bias);
    H_ = prior * Matrix3d::Identity();
    g_ = prior * bias;
    turn_rays(bias);
    for (Pair& pair : pairs_) add_pair(pair);
    reweigh();
    return -H_.ldlt().solve(g_);
  }

  Matrix3d information() const { return H_; }
  double scale_px() const { return scale_px_; }

  std::vector<double> track_weights() const {
    std::vector<double> sum(problem_.tracks.size(), 0.0);
    std::vector<int> count(problem_.tracks.size(), 0);
    for (const Pair& pair : pairs_) {
      for (const Match& match : pair.matches) {
        sum[static_cast<std::size_t>(match.track)] += match.weight;
        ++count[static_cast<std::size_t>(match.track)];
      }
    }
    for (std::size_t t = 0; t < sum.size(); ++t) sum[t] = count[t] > 0 ? sum[t] / count[t] : 0.0;
    return sum;
  }

 private:
  void add_track(int track) {
    const auto& views = problem_.tracks[static_cast<std::size_t>(track)].views;
    const int base = static_cast<int>(bodies_.size());
    const int n = problem_.keyframes();
    for (int a = 0; a < static_cast<int>(views.size()); ++a) {
      const auto& view = views[static_cast<std::size_t>(a)];
      bodies_.push_back(problem_.T_body_camera.rotation * view.point.homogeneous().normalized());
      keyframes_.push_back(view.keyframe);
      for (int b = 0; b < a; ++b) {
        const int pair = views[static_cast<std::size_t>(b)].keyframe * n + view.keyframe;
        pairs_[static_cast<std::size_t>(pair)].matches.push_back({base + b, base + a, track});
      }
    }
  }

  void turn_rays(const Vector3d& bias) {
    const std::vector<Turn> turns = integrate_turns(problem_, bias);
    rays_.resize(bodies_.size());
    for (std::size_t r = 0; r < bodies_.size(); ++r) {
      const Turn& turn = turns[static_cast<std::size_t>(keyframes_[r])];
      rays_[r] = {turn.R * bodies_[r], -turn.R * so3::hat(bodies_[r]) * turn.J};
    }
  }

  const Ray& ray(int index) const { return rays_[static_cast<std::size_t>(index)]; }

  void add_pair(Pair& pair) {
    Matrix3d M = Matrix3d::Zero();
    for (const Match& match : pair.matches) {
      const Vector3d n = ray(match.ray_i).direction.cross(ray(match.ray_j).direction);
      M += match.weight * n * n.transpose();
    }
    Eigen::SelfAdjointEigenSolver<Matrix3d> eigen;
    eigen.computeDirect(M);
    const Vector3d t = eigen.eigenvectors().col(0);
    const Eigen::Matrix<double, 3, 2> others = eigen.eigenvectors().rightCols<2>();

    Matrix3d A = Matrix3d::Zero();
    Eigen::Matrix<double, 3, 2> B = Eigen::Matrix<double, 3, 2>::Zero();
    Eigen::Matrix2d C = Eigen::Matrix2d::Zero();
    Vector3d a = Vector3d::Zero();
    Eigen::Vector2d c = Eigen::Vector2d::Zero();
    for (Match& match : pair.matches) {
      const Ray& i = ray(match.ray_i);
      const Ray& j = ray(match.ray_j);
      const Vector3d across_i = i.direction.cross(t);
      const Vector3d across_j = j.direction.cross(t);
      const double to_px =
          sigmas_.focal_px / std::sqrt(across_i.squaredNorm() + across_j.squaredNorm() + 1e-12);
      const Vector3d n = i.direction.cross(j.direction);
      const double r = to_px * t.dot(n);
      const Vector3d by_bias =
          to_px * (i.by_bias.transpose() * across_j - j.by_bias.transpose() * across_i);
      const Eigen::Vector2d by_t = to_px * (others.transpose() * n);
      A += match.weight * by_bias * by_bias.transpose();
      B += match.weight * by_bias * by_t.transpose();
      C += match.weight * by_t * by_t.transpose();
      a += match.weight * r * by_bias;
      c += match.weight * r * by_t;
      match.residual_px = r;
    }
    C.diagonal().array() += 1.0;
    const Eigen::Matrix<double, 3, 2> K = C.ldlt().solve(B.transpose()).transpose();
    H_ += A - K * B.transpose();
    g_ += a - K * c;
  }

  // Geman-McClure weights; the scale is a robust estimate from the residuals, assuming at least
  // half are inliers.
  void reweigh() {
    std::vector<double> sizes;
    sizes.reserve(matches_);
    for (const Pair& pair : pairs_) {
      for (const Match& match : pair.matches) sizes.push_back(std::abs(match.residual_px));
    }
    scale_px_ = std::max(1.4826 * median(std::move(sizes)), kMinNoise_px);
    for (Pair& pair : pairs_) {
      for (Match& match : pair.matches) {
        const double s = match.residual_px / (3.0 * scale_px_);
        match.weight = 1.0 / ((1.0 + s * s) * (1.0 + s * s));
      }
    }
  }

  const StartProblem& problem_;
  const StartSigmas& sigmas_;
  std::vector<Vector3d> bodies_;  // unit rays in the body frame
  std::vector<int> keyframes_;    // of each ray
  std::vector<Ray> rays_;
  std::vector<Pair> pairs_;
  std::size_t matches_ = 0;
  Matrix3d H_ = Matrix3d::Zero();
  Vector3d g_ = Vector3d::Zero();
  double scale_px_ = 0.0;
};

}  // namespace

GyroBias find_gyro_bias(const StartProblem& problem, const StartSigmas& sigmas) {
  GyroBias found;
  RayProblem rays(problem, sigmas);
  found.track_weights.assign(problem.tracks.size(), 0.0);
  found.sigma.setConstant(sigmas.gyro_bias);
  if (rays.empty()) return found;
  for (int i = 0; i < kIterations; ++i) {
    const Vector3d step = rays.step(found.bias);
    found.bias += step;
    if (step.norm() < kConverged) break;
  }
  found.rms_px = rays.scale_px();
  found.sigma = rays.scale_px() * rays.information().inverse().diagonal().cwiseSqrt();
  found.track_weights = rays.track_weights();
  return found;
}

}  // namespace apvi::vio
