// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/camera_gyro_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "core/median.hpp"
#include "doctor/scan.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr std::size_t kBlocks = 10;
constexpr std::size_t kMinPairs = 20;
constexpr std::size_t kSearchPairs = 60;
constexpr std::size_t kSearchPoints = 25;
constexpr double kMaxOffset = 1.0;    // [s]
constexpr double kOffsetStep = 0.05;  // [s]
constexpr double kMaxFocal = 2.0;     // true over the rig's, or its inverse
constexpr double kMaxRadial = 1.0;    // change of the distortion coefficient
constexpr double kMaxUniqueness = 100.0;
constexpr double kSearchNoise_px = 4.0;
constexpr double kMinNoise_px = 0.15;
constexpr double kMinShare = 0.7;  // of the pairs must have IMU data
constexpr double kNearRig = 30.0 * kRadiansPerDegree;
constexpr double kAsGood = 3.0;  // a smaller difference of solutions is chance [sigmas]
constexpr double kSameAngle = 8.0 * kRadiansPerDegree;
constexpr double kSameOffset = 0.05;  // [s]

// Mean robust cost of a corner, times the number of all corners.
double total_cost(const CameraGyroProblem& problem, const CameraGyroModel& model, double noise) {
  const bool is_lens = model.focal < kMaxFocal && model.focal * kMaxFocal > 1.0 &&
                       std::abs(model.radial) < kMaxRadial;
  if (!is_lens) return std::numeric_limits<double>::infinity();
  double sum = 0.0;
  double used = 0.0;
  double all = 0.0;
  const auto costs = problem.costs(model, noise);
  for (std::size_t i = 0; i < costs.size(); ++i) {
    const auto corners = static_cast<double>(problem.pairs()[i].points.size());
    all += corners;
    if (!costs[i]) continue;
    used += corners;
    sum += *costs[i] * corners;
  }
  if (used < kMinShare * all) return std::numeric_limits<double>::infinity();
  return sum / used * all;
}

// Standard deviation of the distances that does not see outliers.
double noise_at(const CameraGyroProblem& problem, const CameraGyroModel& model, double noise) {
  const std::vector<double> d = problem.distances(model, noise);
  if (d.empty()) return noise;
  return std::max(1.4826 * median(d), kMinNoise_px);
}

// Keeps unknowns that the data do not determine near the start.
CameraGyroVector prior() {
  CameraGyroVector sigma;
  sigma << 0.5, 1.0, 1.0, 1.0, 0.7, 0.05, 0.05, 0.05, 0.3, 0.3;
  return sigma.cwiseAbs2().cwiseInverse();
}

CameraGyroNormal sum_of(const std::vector<CameraGyroNormal>& normals) {
  CameraGyroNormal sum;
  for (const CameraGyroNormal& normal : normals) {
    sum.H += normal.H;
    sum.b += normal.b;
  }
  return sum;
}

struct Solution {
  CameraGyroModel model;
  double cost = 0.0;
};

// Levenberg-Marquardt.
Solution refine(const CameraGyroProblem& problem, const CameraGyroModel& start, double noise,
                bool lens, int iterations) {
  Solution best{start, total_cost(problem, start, noise)};
  double damping = 1e-3;
  for (int i = 0; i < iterations; ++i) {
    const CameraGyroNormal normal = sum_of(problem.linearize(best.model, noise, lens, 1));
    bool better = false;
    double gain = 0.0;
    for (int attempt = 0; attempt < 4 && !better; ++attempt) {
      CameraGyroMatrix H = normal.H;
      H.diagonal() += damping * normal.H.diagonal() + prior();
      const CameraGyroVector step = -H.ldlt().solve(normal.b);
      if (!step.allFinite()) break;
      const CameraGyroModel model = moved(best.model, step);
      const double cost = total_cost(problem, model, noise);
      better = cost < best.cost;
      damping *= better ? 0.2 : 8.0;
      if (!better) continue;
      gain = best.cost - cost;
      best = {model, cost};
    }
    if (!better || gain < 1e-6 * best.cost) break;
  }
  return best;
}

// Alternates between the noise and the model.
CameraGyroModel converge(const CameraGyroProblem& problem, CameraGyroModel model, bool lens) {
  double noise = kSearchNoise_px;
  for (int round = 0; round < 3; ++round) {
    noise = std::min(noise, noise_at(problem, model, noise));
    model = refine(problem, model, noise, lens, 6).model;
  }
  return model;
}

// The 24 rotations that permute axes.
std::vector<Matrix3d> axis_permutations() {
  std::vector<Matrix3d> rotations;
  for (int x = 0; x < 3; ++x) {
    for (int y = 0; y < 3; ++y) {
      if (x == y) continue;
      for (const double sx : {1.0, -1.0}) {
        for (const double sy : {1.0, -1.0}) {
          const Vector3d first = sx * Vector3d::Unit(x);
          const Vector3d second = sy * Vector3d::Unit(y);
          Matrix3d R;
          R << first, second, first.cross(second);
          rotations.push_back(R);
        }
      }
    }
  }
  return rotations;
}

CameraGyroProblem thinned(const CameraGyroProblem& problem) {
  std::vector<ImagePair> pairs;
  const std::size_t count = problem.pairs().size();
  const std::size_t wanted = std::min(count, kSearchPairs);
  for (std::size_t i = 0; i < wanted; ++i) {
    ImagePair pair = problem.pairs()[i * count / wanted];
    const std::size_t points = std::min(pair.points.size(), kSearchPoints);
    std::vector<PixelPair> some;
    for (std::size_t k = 0; k < points; ++k)
      some.push_back(pair.points[k * pair.points.size() / points]);
    pair.points = std::move(some);
    pairs.push_back(std::move(pair));
  }
  return {problem.path(), std::move(pairs), problem.camera()};
}

bool are_same(const CameraGyroModel& a, const CameraGyroModel& b) {
  return so3::angle_between(a.R_camera_body, b.R_camera_body) < kSameAngle &&
         std::abs(a.time_offset_s - b.time_offset_s) < kSameOffset &&
         a.gyro_scale * b.gyro_scale > 0.0;
}

// The best time offset of a grid.
CameraGyroModel best_offset(const CameraGyroProblem& problem, CameraGyroModel model) {
  CameraGyroModel best = model;
  double best_cost = std::numeric_limits<double>::infinity();
  for (const double offset : steps(-kMaxOffset, kMaxOffset, kOffsetStep)) {
    model.time_offset_s = offset;
    const double cost = total_cost(problem, model, kSearchNoise_px);
    if (cost >= best_cost) continue;
    best_cost = cost;
    best = model;
  }
  return best;
}

// Distinct minima of the thinned problem, best first.
std::vector<Solution> search(const CameraGyroProblem& all, const CameraGyroModel& rig) {
  const CameraGyroProblem problem = thinned(all);
  std::vector<Solution> found = {refine(problem, rig, kSearchNoise_px, false, 10)};
  for (const Matrix3d& turn : axis_permutations()) {
    for (const double sign : {1.0, -1.0}) {
      CameraGyroModel start = rig;
      start.R_camera_body = Eigen::Quaterniond(turn) * rig.R_camera_body;
      start.gyro_scale = sign;
      start = best_offset(problem, start);
      found.push_back(refine(problem, start, kSearchNoise_px, false, 10));
    }
  }
  std::ranges::sort(found, {}, &Solution::cost);
  std::vector<Solution> distinct;
  for (const Solution& solution : found) {
    const bool is_new = std::ranges::none_of(
        distinct, [&](const Solution& other) { return are_same(solution.model, other.model); });
    if (is_new) distinct.push_back(solution);
  }
  return distinct;
}

// Mean difference of the costs over its standard error, from blocks of pairs.
double sigmas_better(const CameraGyroProblem& problem, const CameraGyroModel& better,
                     const CameraGyroModel& other, double noise) {
  const auto a = problem.costs(better, noise);
  const auto b = problem.costs(other, noise);
  std::vector<double> gain(kBlocks, 0.0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i] && b[i]) gain[i * kBlocks / a.size()] += *b[i] - *a[i];
  }
  double sum = 0.0;
  double sum2 = 0.0;
  for (const double g : gain) {
    sum += g;
    sum2 += g * g;
  }
  const double n = static_cast<double>(kBlocks);
  const double variance = std::max(0.0, sum2 - sum * sum / n) * n / (n - 1.0);
  return sum / std::sqrt(variance + 1e-12);
}

// Leaves out one block at a time, with one step from the solution of all.
CameraGyroVector jackknife(const CameraGyroProblem& problem, const CameraGyroModel& model,
                           double noise, bool lens) {
  const auto normals = problem.linearize(model, noise, lens, kBlocks);
  const CameraGyroNormal sum = sum_of(normals);
  std::vector<CameraGyroVector> left_out;
  for (const CameraGyroNormal& normal : normals) {
    CameraGyroMatrix H = sum.H - normal.H;
    H.diagonal() += prior();
    left_out.emplace_back(-H.ldlt().solve(sum.b - normal.b));
  }
  CameraGyroMatrix H = sum.H;
  H.diagonal() += prior();
  // At least what white noise would give.
  const CameraGyroVector white = H.inverse().diagonal().cwiseSqrt();
  CameraGyroVector sigma;
  for (int k = 0; k < kCameraGyroSize; ++k) {
    std::vector<double> values;
    for (const CameraGyroVector& x : left_out) values.push_back(x(k));
    sigma(k) = std::max(jackknife_sigma(values), white(k));
  }
  return sigma;
}

// The best of the minima, and how much better it is than any other. A minimum near the rig that is
// as good as the best one is preferred: what the data leave open, the rig decides.
void choose(const CameraGyroProblem& problem, const CameraGyroModel& rig,
            const std::vector<Solution>& found, CameraGyroFit& fit) {
  fit.model = converge(problem, found[0].model, false);
  const double noise = noise_at(problem, fit.model, kSearchNoise_px);
  std::vector<CameraGyroModel> others = {refine(problem, rig, noise, false, 10).model};
  for (std::size_t i = 1; i < std::min<std::size_t>(found.size(), 3); ++i)
    others.push_back(refine(problem, found[i].model, noise, false, 6).model);
  fit.uniqueness = kMaxUniqueness;
  for (const CameraGyroModel& other : others) {
    if (are_same(other, fit.model)) continue;
    double better = sigmas_better(problem, fit.model, other, noise);
    const bool is_near = so3::angle_between(other.R_camera_body, rig.R_camera_body) < kNearRig;
    if (better < (is_near ? kAsGood : 0.0)) {
      fit.model = other;
      better = std::abs(better);
    }
    fit.uniqueness = std::min(fit.uniqueness, better);
  }
  fit.is_near_rig = so3::angle_between(fit.model.R_camera_body, rig.R_camera_body) < kNearRig;
}

// How much better the time offset is than the best one of the minima with another.
double time_uniqueness(const CameraGyroProblem& problem, const CameraGyroModel& model,
                       const std::vector<Solution>& found, double noise) {
  const auto other = std::ranges::find_if(found, [&](const Solution& solution) {
    return std::abs(solution.model.time_offset_s - model.time_offset_s) > kSameOffset;
  });
  if (other == found.end()) return kMaxUniqueness;
  const CameraGyroModel refined = refine(problem, other->model, noise, false, 6).model;
  if (std::abs(refined.time_offset_s - model.time_offset_s) <= kSameOffset) return kMaxUniqueness;
  return sigmas_better(problem, model, refined, noise);
}

}  // namespace

std::optional<CameraGyroFit> fit_camera_against_gyro(const CameraGyroProblem& problem,
                                                     const CameraGyroModel& rig) {
  if (problem.pairs().size() < kMinPairs) return std::nullopt;
  const std::vector<Solution> found = search(problem, rig);
  if (!std::isfinite(found[0].cost)) return std::nullopt;
  CameraGyroFit fit;
  fit.pairs = problem.pairs().size();
  choose(problem, rig, found, fit);
  fit.time_uniqueness =
      time_uniqueness(problem, fit.model, found, noise_at(problem, fit.model, kSearchNoise_px));
  fit.rms_px = noise_at(problem, fit.model, kSearchNoise_px);
  CameraGyroModel as_rig = rig;
  as_rig.gyro_bias = fit.model.gyro_bias;
  fit.rms_with_rig_px = noise_at(problem, as_rig, kSearchNoise_px);
  fit.sigma = jackknife(problem, fit.model, fit.rms_px, false);
  fit.lens_model = converge(problem, fit.model, true);
  fit.lens_rms_px = noise_at(problem, fit.lens_model, fit.rms_px);
  fit.lens_sigma = jackknife(problem, fit.lens_model, fit.lens_rms_px, true);
  fit.lens_gain = sigmas_better(problem, fit.lens_model, fit.model, fit.rms_px);
  return fit;
}

}  // namespace apvi::doctor
