// SPDX-License-Identifier: BSD-3-Clause
#include "vio/initialization/closed_form_start.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "core/median.hpp"
#include "imu/preintegration.hpp"

namespace apvi::vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix9 = Eigen::Matrix<double, 9, 9>;
using Matrix39 = Eigen::Matrix<double, 3, 9>;
using Vector9 = Eigen::Matrix<double, 9, 1>;

constexpr int kVelocity = 0, kAccelBias = 3, kGravity = 6;  // order of the unknowns
constexpr int kIterations = 6;
constexpr double kMinDistance = 0.1;  // [m]

// Pose of a keyframe camera: R known, p = by_x x + p0 in the frame of the first body.
struct Camera {
  Matrix3d R;
  Matrix39 by_x = Matrix39::Zero();
  Vector3d p0;
};

std::vector<Camera> make_cameras(const StartProblem& problem, const Vector3d& gyro_bias) {
  std::vector<Camera> cameras;
  imu::Preintegration motion(problem.noise, gyro_bias, Vector3d::Zero());
  for (const auto& samples : problem.imu) {
    for (std::size_t i = 1; i < samples.size(); ++i) motion.integrate(samples[i - 1], samples[i]);
    const double t = motion.duration_s();
    const Matrix3d R = motion.delta().rotation.toRotationMatrix();
    Camera camera;
    camera.R = R * problem.T_body_camera.rotation.toRotationMatrix();
    camera.by_x.middleCols<3>(kVelocity) = t * Matrix3d::Identity();
    camera.by_x.middleCols<3>(kAccelBias) = motion.bias_jacobian().block<3, 3>(
        imu::Preintegration::kPosition,
        imu::Preintegration::kAccelBias - imu::Preintegration::kGyroBias);
    camera.by_x.middleCols<3>(kGravity) = 0.5 * t * t * Matrix3d::Identity();
    camera.p0 = motion.delta().position + R * problem.T_body_camera.translation;
    cameras.push_back(camera);
  }
  return cameras;
}

// Quadratic cost of a track in the unknowns x: xᵀ H x + 2 bᵀ x + c, with its point eliminated:
// point = by_x x + p0.
struct TrackCost {
  Matrix9 H = Matrix9::Zero();
  Vector9 b = Vector9::Zero();
  double c = 0.0;
  Matrix39 by_x = Matrix39::Zero();
  Vector3d p0 = Vector3d::Zero();
};

TrackCost make_track_cost(const StartProblem::Track& track, const std::vector<Camera>& cameras,
                          const std::vector<double>& distances, double focal_px) {
  TrackCost e;
  Matrix3d A = Matrix3d::Zero();
  Matrix39 B = Matrix39::Zero();
  Vector3d d = Vector3d::Zero();
  for (std::size_t v = 0; v < track.views.size(); ++v) {
    const Camera& camera = cameras[static_cast<std::size_t>(track.views[v].keyframe)];
    const Vector3d ray = camera.R * track.views[v].point.homogeneous().normalized();
    const double to_px = focal_px / distances[v];
    const Matrix3d across = to_px * to_px * (Matrix3d::Identity() - ray * ray.transpose());
    const Matrix39 across_by_x = across * camera.by_x;
    A += across;
    B += across_by_x;
    d += across * camera.p0;
    e.H += camera.by_x.transpose() * across_by_x;
    e.b += across_by_x.transpose() * camera.p0;
    e.c += camera.p0.dot(across * camera.p0);
  }
  A.diagonal().array() += 1e-9 * A.trace();  // keeps parallel rays regular
  const Matrix3d A_inverse = A.inverse();
  e.by_x = A_inverse * B;
  e.p0 = A_inverse * d;
  e.H -= B.transpose() * e.by_x;
  e.b -= B.transpose() * e.p0;
  e.c -= d.dot(e.p0);
  return e;
}

std::optional<Vector9> solve(const Matrix9& H, const Vector9& b, double gravity) {
  const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> others(H.topLeftCorner<6, 6>());
  if (others.info() != Eigen::Success || !(others.vectorD().minCoeff() > 0.0)) return std::nullopt;
  const Eigen::Matrix<double, 6, 3> K = others.solve(H.topRightCorner<6, 3>());
  const Eigen::Matrix<double, 6, 1> k = others.solve(b.head<6>());
  const Matrix3d S = H.bottomRightCorner<3, 3>() - H.bottomLeftCorner<3, 6>() * K;
  const Vector3d s = b.tail<3>() - H.bottomLeftCorner<3, 6>() * k;
  Vector9 x;
  x.tail<3>() = minimize_on_sphere(0.5 * (S + S.transpose()), s, gravity);
  x.head<6>() = -k - K * x.tail<3>();
  if (!x.allFinite()) return std::nullopt;
  return x;
}

// The linear system, iterated with the distances and residuals of the previous solution.
class ClosedForm {
 public:
  ClosedForm(const StartProblem& problem, const Vector3d& gyro_bias,
             const std::vector<double>& track_weights, const StartSigmas& sigmas)
      : problem_(problem),
        sigmas_(sigmas),
        track_weights_(track_weights),
        cameras_(make_cameras(problem, gyro_bias)),
        weights_(track_weights) {
    for (const auto& track : problem.tracks) distances_.emplace_back(track.views.size(), 1.0);
  }

  std::optional<Vector9> run() {
    std::optional<Vector9> x;
    for (int i = 0; i < kIterations; ++i) {
      // The first solution has unknown distances, so its residuals are not in pixels and the bias
      // prior is meaningless: hold the bias at zero.
      x = iterate(i == 0 ? 1e-3 : sigmas_.accel_bias);
      if (!x) return std::nullopt;
      update(*x);
    }
    return x;
  }

  double inverse_depth(std::size_t track, const Vector9& x) const {
    const auto& view = problem_.tracks[track].views.front();
    const Camera& camera = cameras_[static_cast<std::size_t>(view.keyframe)];
    const Vector3d p = track_costs_[track].by_x * x + track_costs_[track].p0;
    return 1.0 / (camera.R.transpose() * (p - camera.by_x * x - camera.p0)).z();
  }

 private:
  std::optional<Vector9> iterate(double accel_bias_sigma) {
    track_costs_.clear();
    Matrix9 H = Matrix9::Zero();
    Vector9 b = Vector9::Zero();
    H.diagonal().segment<3>(kAccelBias).setConstant(1.0 / (accel_bias_sigma * accel_bias_sigma));
    H.diagonal().segment<3>(kVelocity).setConstant(1e-6);
    for (std::size_t t = 0; t < problem_.tracks.size(); ++t) {
      track_costs_.push_back(
          make_track_cost(problem_.tracks[t], cameras_, distances_[t], sigmas_.focal_px));
      H += weights_[t] * track_costs_[t].H;
      b += weights_[t] * track_costs_[t].b;
    }
    return solve(H, b, problem_.gravity);
  }

  void update(const Vector9& x) {
    std::vector<double> misfits;
    for (std::size_t t = 0; t < problem_.tracks.size(); ++t) misfits.push_back(misfit(t, x));
    const double usual = median(misfits);
    for (std::size_t t = 0; t < problem_.tracks.size(); ++t) {
      const double s = misfits[t] / (9.0 * usual + 1e-12);
      weights_[t] = track_weights_[t] / ((1.0 + s) * (1.0 + s));
      measure_distances(t, x);
    }
  }

  // Mean squared residual of the track.
  double misfit(std::size_t track, const Vector9& x) const {
    const TrackCost& e = track_costs_[track];
    const double cost = x.dot(e.H * x) + 2.0 * e.b.dot(x) + e.c;
    return std::max(cost, 0.0) / static_cast<double>(problem_.tracks[track].views.size());
  }

  void measure_distances(std::size_t track, const Vector9& x) {
    const Vector3d p = track_costs_[track].by_x * x + track_costs_[track].p0;
    for (std::size_t v = 0; v < distances_[track].size(); ++v) {
      const auto& view = problem_.tracks[track].views[v];
      const Camera& camera = cameras_[static_cast<std::size_t>(view.keyframe)];
      distances_[track][v] = std::max((p - camera.by_x * x - camera.p0).norm(), kMinDistance);
    }
  }

  const StartProblem& problem_;
  const StartSigmas& sigmas_;
  const std::vector<double>& track_weights_;
  std::vector<Camera> cameras_;
  std::vector<double> weights_;  // of tracks
  std::vector<std::vector<double>>
      distances_;  // distance of the point of each track from each view
  std::vector<TrackCost> track_costs_;
};

}  // namespace

Vector3d minimize_on_sphere(const Matrix3d& S, const Vector3d& s, double radius) {
  // Lagrange: (S + λ) x = -s with |x| = radius; the length falls as λ grows beyond minus the
  // smallest eigenvalue, and the minimum lies there.
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(S);
  const Vector3d d = eigen.eigenvalues().array() - eigen.eigenvalues()(0);
  const Vector3d q = eigen.eigenvectors().transpose() * s;
  double low = std::abs(q(0)) / radius;
  double high = std::max(q.norm() / radius, 1e-300);
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    const double length = q.cwiseQuotient((d.array() + middle).matrix()).norm();
    (length > radius ? low : high) = middle;
  }
  const Vector3d x = -q.cwiseQuotient((d.array() + high).matrix());
  return radius * (eigen.eigenvectors() * x).normalized();
}

std::optional<StartGuess> closed_form_start(const StartProblem& problem, const Vector3d& gyro_bias,
                                            const std::vector<double>& track_weights,
                                            const StartSigmas& sigmas) {
  ClosedForm system(problem, gyro_bias, track_weights, sigmas);
  const std::optional<Vector9> x = system.run();
  if (!x) return std::nullopt;
  StartGuess guess{.gravity = x->segment<3>(kGravity),
                   .velocity = x->segment<3>(kVelocity),
                   .gyro_bias = gyro_bias,
                   .accel_bias = x->segment<3>(kAccelBias),
                   .inverse_depth = {}};
  for (std::size_t t = 0; t < problem.tracks.size(); ++t) {
    guess.inverse_depth.push_back(system.inverse_depth(t, *x));
  }
  return guess;
}

}  // namespace apvi::vio
