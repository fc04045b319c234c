// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/camera_rates.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "doctor/camera_gyro_problem.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kIterations = 8;
constexpr double kNoise_px = 1.0;
constexpr double kMaxRate = 3.0;        // no vehicle turns faster [rad/s]
constexpr double kMaxSigma = 0.15;      // of a rate, about the axis that is known least [rad/s]
constexpr double kRestingStep_s = 0.2;  // less than a gap of the IMU
constexpr double kSmallestStep = 1e-4;  // [rad/s]

// An IMU that rests over the pair. With it the rotation is that of the gyro bias alone.
InertialPath resting_over(const ImagePair& pair) {
  std::vector<ImuSample> samples;
  const Duration step = Duration::from_seconds(kRestingStep_s);
  for (Stamp t = pair.before - step; t < pair.now + step + step; t = t + step) {
    samples.push_back({t, Vector3d::Zero(), Vector3d::Zero()});
  }
  return InertialPath(samples);
}

struct Solution {
  Vector3d rate = Vector3d::Zero();
  double cost = 0.0;
};

CameraGyroModel turning_at(const Vector3d& rate) {
  CameraGyroModel model;
  model.gyro_bias = -rate;
  return model;
}

double cost_at(const CameraGyroProblem& problem, const Vector3d& rate) {
  return problem.costs(turning_at(rate), kNoise_px)
      .front()
      .value_or(std::numeric_limits<double>::infinity());
}

Matrix3d information_at(const CameraGyroNormal& normal) {
  return normal.H.block<3, 3>(kGyroBias, kGyroBias);
}

CameraGyroNormal normal_at(const CameraGyroProblem& problem, const Vector3d& rate) {
  return problem.linearize(turning_at(rate), kNoise_px, false, 1).front();
}

// Levenberg-Marquardt from a rate.
Solution solve(const CameraGyroProblem& problem, const Vector3d& start) {
  Solution best{start, cost_at(problem, start)};
  double damping = 1e-2;
  for (int i = 0; i < kIterations; ++i) {
    const CameraGyroNormal normal = normal_at(problem, best.rate);
    Matrix3d damped = information_at(normal);
    damped.diagonal() *= 1.0 + damping;
    damped.diagonal().array() += 1e-6;
    // The rate is the bias of a gyro that rests, reversed.
    const Vector3d step = damped.ldlt().solve(normal.b.segment<3>(kGyroBias));
    const double cost = cost_at(problem, best.rate + step);
    const bool is_better = cost < best.cost;
    damping *= is_better ? 0.2 : 8.0;
    if (is_better) best = {best.rate + step, cost};
    if (step.norm() < kSmallestStep) break;
  }
  return best;
}

// Of the rate, about the axis that the pair tells least of [rad/s].
double sigma_at(const CameraGyroProblem& problem, const Vector3d& rate) {
  const Matrix3d information = information_at(normal_at(problem, rate));
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(information, Eigen::EigenvaluesOnly);
  return 1.0 / std::sqrt(std::max(eigen.eigenvalues()(0), 1e-12));
}

}  // namespace

std::vector<CameraRate> camera_rates(const std::vector<ImagePair>& pairs,
                                     const CameraModel& camera) {
  std::vector<CameraRate> rates;
  Vector3d last = Vector3d::Zero();
  for (const ImagePair& pair : pairs) {
    const InertialPath resting = resting_over(pair);
    const CameraGyroProblem problem(resting, {pair}, camera);
    Solution best = solve(problem, last);
    if (last.norm() > kSmallestStep) {
      const Solution other = solve(problem, Vector3d::Zero());
      if (other.cost < best.cost) best = other;
    }
    last = best.rate.norm() < kMaxRate ? best.rate : Vector3d::Zero();
    if (!(best.rate.norm() < kMaxRate && sigma_at(problem, best.rate) < kMaxSigma)) continue;
    const double half = 0.5 * seconds_between(pair.before, pair.now);
    rates.push_back({pair.before + Duration::from_seconds(half), best.rate});
  }
  return rates;
}

}  // namespace apvi::doctor
