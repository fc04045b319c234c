// SPDX-License-Identifier: BSD-3-Clause
#include "vio/initialization/start_graph.hpp"

#include <ceres/problem.h>
#include <ceres/solver.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <optional>

#include "apvi/geometry/so3.hpp"
#include "vio/factors/factors.hpp"
#include "vio/marginalization/marginalization.hpp"

namespace apvi::vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Matrix9 = Eigen::Matrix<double, 9, 9>;

struct SolverEffort {
  int iterations;
  double tolerance;
};
constexpr SolverEffort kWarmStart{6, 1e-3};
constexpr SolverEffort kColdStart{30, 1e-6};

constexpr double kHuber_px = 1.5;
constexpr double kOutlier_px = 4.0;
constexpr double kGaugeSigma = 1e-4;  // of the yaw [rad] and position [m] of the first keyframe

// Scale test: the cost must rise by kMinRise when the solution is held at a larger scale; otherwise
// the larger scale is accepted, up to kMaxEnlargements times. A solution of far too small scale
// can lie in a local minimum, so a far larger scale is tried first.
constexpr double kTestScale = 2.0;
constexpr double kLargeTestScale = 8.0;
constexpr double kMinRise = 25.0;
constexpr int kMaxEnlargements = 4;
constexpr double kHeldSigma = 1e-3;         // relative
constexpr double kMaxSigmaToEnlarge = 0.2;  // a larger scale sigma is rejected anyway

// Holds the distance between two keyframes.
class DistanceFactor final : public ceres::SizedCostFunction<1, kPoseSize, kPoseSize> {
 public:
  explicit DistanceFactor(double length_m) : length_m_(length_m) {}

  bool Evaluate(double const* const* poses, double* residual, double** jacobians) const override {
    const Vector3d displacement = to_se3(poses[1]).translation - to_se3(poses[0]).translation;
    const double weight = 1.0 / (kHeldSigma * length_m_);
    *residual = weight * (displacement.norm() - length_m_);
    for (int end = 0; jacobians != nullptr && end < 2; ++end) {
      if (jacobians[end] == nullptr) continue;
      Eigen::Map<Eigen::Matrix<double, 1, kPoseSize>> J(jacobians[end]);
      J.setZero();
      J.segment<3>(3) = (end == 0 ? -weight : weight) * displacement.normalized().transpose();
    }
    return true;
  }

 private:
  double length_m_;
};

// All terms and their parameters; addresses do not change.
class StartGraph {
 public:
  StartGraph(const StartProblem& problem, const RefinedStart& start, const StartSigmas& sigmas)
      : problem_(problem),
        sigmas_(sigmas),
        gravity_(0.0, 0.0, -problem.gravity),
        extrinsics_(to_block(problem.T_body_camera)),
        inverse_depth_(start.guess.inverse_depth),
        refined_fraction_(start.inlier_fraction) {
    add_states(start);
    add_inertial();
    add_priors();
    for (std::size_t t = 0; t < start.tracks.size(); ++t) add_track(start.tracks[t], t);
  }

  SolvedStart run() {
    SolvedStart out;
    std::optional<double> cost = solve(kWarmStart);
    out.scale_sigma = scale_sigma();
    if (cost && out.scale_sigma < kMaxSigmaToEnlarge) {
      escape_small_minimum(cost);
      out.scale_is_observable = enlarge_while_consistent(cost);
      out.scale_sigma = scale_sigma();
    }
    out.usable = cost.has_value();
    out.states = states_;
    compute_statistics(out);
    return out;
  }

 private:
  struct Term {
    const ceres::CostFunction* cost;
    std::vector<Block> blocks;
    bool visual;
  };

  Block pose(std::size_t k) { return {states_[k].pose.data(), kPoseSize}; }
  Block motion(std::size_t k) { return {states_[k].motion.data(), kMotionSize}; }

  void add_states(const RefinedStart& start) {
    const StartGuess& g = start.guess;
    const Eigen::Quaterniond R_world = so3::level_attitude(-g.gravity, gravity_);
    for (const imu::Preintegration& motion : start.motion) {
      const double t = motion.duration_s();
      const auto& delta = motion.delta();
      FrameState state;
      state.pose =
          to_block({R_world * delta.rotation,
                    R_world * (g.velocity * t + 0.5 * t * t * g.gravity + delta.position)});
      Eigen::Map<Vector3d>(state.motion.data()) =
          R_world * (g.velocity + t * g.gravity + delta.velocity);
      Eigen::Map<Vector3d>(state.motion.data() + 3) = g.gyro_bias;
      Eigen::Map<Vector3d>(state.motion.data() + 6) = g.accel_bias;
      states_.push_back(state);
    }
  }

  void add_inertial() {
    const auto bias = [&](int at) {
      return Vector3d(Eigen::Map<const Vector3d>(states_.front().motion.data() + at));
    };
    for (std::size_t k = 1; k < states_.size(); ++k) {
      auto delta = std::make_shared<imu::Preintegration>(problem_.noise, bias(3), bias(6));
      const auto& samples = problem_.imu[k];
      for (std::size_t i = 1; i < samples.size(); ++i) {
        delta->integrate(samples[i - 1], samples[i]);
      }
      inertial_.emplace_back(delta, gravity_, nullptr, nullptr);
      terms_.push_back(
          {&inertial_.back(), {pose(k - 1), motion(k - 1), pose(k), motion(k)}, false});
    }
  }

  // Gauge prior on yaw and position of the first keyframe; zero-mean prior on its biases.
  void add_priors() {
    const SE3 first = to_se3(states_.front().pose.data());
    Matrix6 gauge = Matrix6::Zero();
    gauge.block<1, 3>(0, 0) =
        (first.rotation.conjugate() * Vector3d::UnitZ()).transpose() / kGaugeSigma;
    gauge.bottomRightCorner<3, 3>().diagonal().setConstant(1.0 / kGaugeSigma);
    pose_prior_ = std::make_unique<PosePriorFactor>(first, gauge);
    terms_.push_back({pose_prior_.get(), {pose(0)}, false});

    Matrix9 biases = Matrix9::Zero();
    biases.diagonal().segment<3>(3).setConstant(1.0 / sigmas_.gyro_bias);
    biases.diagonal().segment<3>(6).setConstant(1.0 / sigmas_.accel_bias);
    motion_prior_ = std::make_unique<MotionPriorFactor>(MotionBlock{}, biases);
    terms_.push_back({motion_prior_.get(), {motion(0)}, false});
  }

  void add_track(const StartProblem::Track& track, std::size_t index) {
    const auto& views = track.views;
    if (views.empty()) return;
    const auto view = [](const StartProblem::View& v) { return ReprojectionFactor::View{v.point}; };
    const auto anchor = static_cast<std::size_t>(views.front().keyframe);
    for (std::size_t v = 1; v < views.size(); ++v) {
      observations_.emplace_back(view(views.front()), view(views[v]),
                                 sigmas_.focal_px / sigmas_.pixel, nullptr, nullptr);
      terms_.push_back({&observations_.back(),
                        {pose(anchor),
                         pose(static_cast<std::size_t>(views[v].keyframe)),
                         {extrinsics_.data(), kPoseSize},
                         {&inverse_depth_[index], 1},
                         {&time_offset_, 1},
                         {lens_.data(), kLensSize}},
                        true});
    }
  }

  static std::vector<double*> addresses(const Term& term) {
    std::vector<double*> blocks;
    for (const Block& block : term.blocks) blocks.push_back(block.data);
    return blocks;
  }

  // The final cost; nullopt if the solver fails.
  std::optional<double> solve(const SolverEffort& effort) {
    ceres::Problem::Options borrowed;
    borrowed.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    borrowed.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    borrowed.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::Problem problem(borrowed);
    ceres::Solver::Options options;
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (FrameState& state : states_) {
      problem.AddParameterBlock(state.pose.data(), kPoseSize, &manifold_);
      problem.AddParameterBlock(state.motion.data(), kMotionSize);
      ordering->AddElementToGroup(state.pose.data(), 1);
      ordering->AddElementToGroup(state.motion.data(), 1);
    }
    problem.AddParameterBlock(extrinsics_.data(), kPoseSize, &manifold_);
    for (double* scalar : {&time_offset_, lens_.data()}) {
      problem.AddParameterBlock(scalar, scalar == &time_offset_ ? 1 : kLensSize);
    }
    for (double* calibration : {extrinsics_.data(), &time_offset_, lens_.data()}) {
      problem.SetParameterBlockConstant(calibration);
      ordering->AddElementToGroup(calibration, 1);
    }
    for (const Term& term : terms_) {
      problem.AddResidualBlock(const_cast<ceres::CostFunction*>(term.cost),
                               term.visual ? &loss_ : nullptr, addresses(term));
      if (term.visual) ordering->AddElementToGroup(term.blocks[3].data, 0);
    }
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.linear_solver_ordering = ordering;
    options.max_num_iterations = effort.iterations;
    options.function_tolerance = effort.tolerance;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    if (!summary.IsSolutionUsable()) return std::nullopt;
    return summary.final_cost;
  }

  void compute_statistics(SolvedStart& out) const {
    double sum = 0.0, inertial_sum = 0.0;
    int inliers = 0;
    for (const Term& term : terms_) {
      Eigen::VectorXd r(term.cost->num_residuals());
      term.cost->Evaluate(addresses(term).data(), r.data(), nullptr);
      if (!term.visual) {
        if (r.size() == 15) inertial_sum += r.head<9>().squaredNorm();
        continue;
      }
      const double inverse_depth = *term.blocks[3].data;
      if (r.norm() * sigmas_.pixel >= kOutlier_px || inverse_depth <= 0.0) continue;
      sum += r.squaredNorm();
      ++inliers;
    }
    if (inliers == 0 || inertial_.empty()) return;
    out.reprojection_rms_px = sigmas_.pixel * std::sqrt(sum / inliers);
    out.inlier_fraction = refined_fraction_ * static_cast<double>(inliers) /
                          static_cast<double>(observations_.size());
    out.inertial_rms = std::sqrt(inertial_sum / (9.0 * static_cast<double>(inertial_.size())));
  }

  struct Solution {
    std::vector<FrameState> states;
    std::vector<double> inverse_depth;
  };
  Solution solution() const { return {states_, inverse_depth_}; }
  // In place, as terms hold addresses.
  void restore(const Solution& solution) {
    std::copy(solution.states.begin(), solution.states.end(), states_.begin());
    std::copy(solution.inverse_depth.begin(), solution.inverse_depth.end(), inverse_depth_.begin());
  }

  Vector3d displacement_to(std::size_t keyframe) const {
    return to_se3(states_[keyframe].pose.data()).translation -
           to_se3(states_.front().pose.data()).translation;
  }

  std::size_t farthest() const {
    std::size_t farthest = 0;
    for (std::size_t k = 1; k < states_.size(); ++k) {
      if (displacement_to(k).norm() > displacement_to(farthest).norm()) farthest = k;
    }
    return farthest;
  }

  // Corner noise is explained by acceleration that the IMU did not measure: at nearly constant
  // velocity the scale shrinks, and its sigma with it. The solution is therefore held at a larger
  // scale and released there if the fit is no worse. Returns true if a larger scale is finally
  // contradicted.
  bool enlarge_while_consistent(std::optional<double>& cost) {
    for (int k = 0; k < kMaxEnlargements && cost; ++k) {
      const Solution before = solution();
      const std::optional<double> larger = solve_enlarged(kTestScale);
      if (!larger || 2.0 * (*larger - *cost) > kMinRise) {
        restore(before);
        return larger.has_value();
      }
      cost = solve(kColdStart);
    }
    return false;
  }

  // Accepts a far larger scale if it fits no worse and does not shrink back when released.
  void escape_small_minimum(std::optional<double>& cost) {
    const Solution before = solution();
    const double size = displacement_to(farthest()).norm();
    std::optional<double> larger = solve_enlarged(kLargeTestScale);
    if (larger) larger = solve(kColdStart);
    const bool is_stable = displacement_to(farthest()).norm() > kTestScale * size;
    if (larger && is_stable && 2.0 * (*larger - *cost) < kMinRise) {
      cost = larger;
    } else {
      restore(before);
    }
  }

  std::optional<double> solve_enlarged(double factor) {
    const std::size_t end = farthest();
    if (end == 0) return std::nullopt;
    const DistanceFactor held(factor * displacement_to(end).norm());
    const Vector3d origin = to_se3(states_.front().pose.data()).translation;
    for (FrameState& state : states_) {
      Eigen::Map<Vector3d> position(state.pose.data());
      position = origin + factor * (position - origin);
      Eigen::Map<Vector3d>(state.motion.data()) *= factor;
    }
    for (double& inverse_depth : inverse_depth_) inverse_depth /= factor;
    terms_.push_back({&held, {pose(0), pose(end)}, false});
    const std::optional<double> cost = solve(kColdStart);
    terms_.pop_back();
    return cost;
  }

  double scale_sigma() {
    const std::size_t end = farthest();
    if (end == 0) return 1e9;
    const Vector3d displacement = displacement_to(end);
    Linearizer linearizer;
    linearizer.hold_constant(extrinsics_.data());
    linearizer.hold_constant(&time_offset_);
    linearizer.hold_constant(lens_.data());
    for (const Term& term : terms_) {
      linearizer.add(*term.cost, term.visual ? &loss_ : nullptr, term.blocks);
    }
    const Matrix6 information = linearizer.marginal_information(pose(end).data);
    const Eigen::LDLT<Matrix6> ldlt(information);
    Eigen::Matrix<double, 6, 1> along = Eigen::Matrix<double, 6, 1>::Zero();
    along.tail<3>() = displacement.normalized();
    const double variance = along.dot(ldlt.solve(along));
    return variance >= 0.0 ? std::sqrt(variance) / displacement.norm() : 1e9;
  }

  const StartProblem& problem_;
  const StartSigmas& sigmas_;
  Vector3d gravity_;
  std::vector<FrameState> states_;
  PoseBlock extrinsics_;
  double time_offset_ = 0.0;
  LensBlock lens_{};
  std::vector<double> inverse_depth_;
  double refined_fraction_ = 0.0;  // of all observations, inliers after the refinement
  PoseManifold manifold_;
  ceres::HuberLoss loss_{kHuber_px / sigmas_.pixel};
  std::deque<ReprojectionFactor> observations_;
  std::deque<ImuFactor> inertial_;
  std::unique_ptr<PosePriorFactor> pose_prior_;
  std::unique_ptr<MotionPriorFactor> motion_prior_;
  std::vector<Term> terms_;
};

}  // namespace

SolvedStart solve_start(const StartProblem& problem, const RefinedStart& start,
                        const StartSigmas& sigmas) {
  return StartGraph(problem, start, sigmas).run();
}

}  // namespace apvi::vio
