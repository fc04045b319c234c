// SPDX-License-Identifier: BSD-3-Clause
#include "vio/initialization/start_refinement.hpp"

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

#include <memory>

#include "apvi/geometry/so3.hpp"

namespace apvi::vio {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using imu::Preintegration;
using Matrix23 = Eigen::Matrix<double, 2, 3>;
using RowMajor23 = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;

constexpr int kPasses = 2;
constexpr int kIterations = 12;
constexpr double kHuber_px = 1.5;
constexpr double kOutlier_px = 4.0;
constexpr double kMinDepth = 0.02;    // of the anchor's depth
constexpr double kBehind_px = 100.0;  // residual of a point behind the camera

// The parameters of the refinement.
struct Parameters {
  Vector3d gravity, velocity, gyro_bias, accel_bias;
  std::vector<Vector3d> points;  // x/z, y/z, 1/z in the camera of the track's first view
};

// Pose of a keyframe at the current parameters, and its derivatives.
struct KeyframePose {
  Matrix3d R;        // body
  Matrix3d turn;     // by gyro bias, right perturbation
  Vector3d camera;   // position
  Matrix3d by_gyro;  // of the camera's position
  Matrix3d by_accel;
  double t = 0.0;
};

std::vector<Preintegration> integrate(const StartProblem& problem, const Vector3d& gyro_bias,
                                      const Vector3d& accel_bias) {
  std::vector<Preintegration> motion;
  Preintegration now(problem.noise, gyro_bias, accel_bias);
  for (const auto& samples : problem.imu) {
    for (std::size_t i = 1; i < samples.size(); ++i) now.integrate(samples[i - 1], samples[i]);
    motion.push_back(now);
  }
  return motion;
}

Matrix3d block(const Preintegration& motion, int row, int column) {
  return motion.bias_jacobian().block<3, 3>(row, column - Preintegration::kGyroBias);
}

KeyframePose pose_of_keyframe(const Preintegration& motion, const Parameters& x,
                              const Vector3d& lever) {
  const Vector3d d_gyro = x.gyro_bias - motion.gyro_bias();
  const Vector3d rotation_update =
      block(motion, Preintegration::kRotation, Preintegration::kGyroBias) * d_gyro;
  const Preintegration::Delta delta = motion.corrected(x.gyro_bias, x.accel_bias);
  KeyframePose pose;
  pose.t = motion.duration_s();
  pose.R = delta.rotation.toRotationMatrix();
  pose.turn = so3::right_jacobian(rotation_update) *
              block(motion, Preintegration::kRotation, Preintegration::kGyroBias);
  pose.camera =
      x.velocity * pose.t + 0.5 * pose.t * pose.t * x.gravity + delta.position + pose.R * lever;
  pose.by_gyro = block(motion, Preintegration::kPosition, Preintegration::kGyroBias) -
                 pose.R * so3::hat(lever) * pose.turn;
  pose.by_accel = block(motion, Preintegration::kPosition, Preintegration::kAccelBias);
  return pose;
}

// Poses of all keyframes, computed once per evaluation instead of once per residual.
class Path final : public ceres::EvaluationCallback {
 public:
  Path(const StartProblem& problem, const Parameters& x, const std::vector<Preintegration>& motion)
      : T_body_camera_(problem.T_body_camera), x_(x), motion_(motion) {
    update();
  }
  void PrepareForEvaluation(bool, bool new_point) override {
    if (new_point) update();
  }
  const KeyframePose& at(int keyframe) const { return poses_[static_cast<std::size_t>(keyframe)]; }
  Matrix3d camera_rotation() const { return T_body_camera_.rotation.toRotationMatrix(); }

 private:
  void update() {
    poses_.clear();
    for (const Preintegration& motion : motion_) {
      poses_.push_back(pose_of_keyframe(motion, x_, T_body_camera_.translation));
    }
  }

  SE3 T_body_camera_;
  const Parameters& x_;
  const std::vector<Preintegration>& motion_;
  std::vector<KeyframePose> poses_;
};

// A point seen by keyframe j, anchored in keyframe i. Blocks: gravity, velocity, gyro bias,
// accelerometer bias, point. The residual is in sigmas.
class ObservationCost final : public ceres::SizedCostFunction<2, 3, 3, 3, 3, 3> {
 public:
  ObservationCost(const Path& path, int anchor, const StartProblem::View& seen, double weight)
      : path_(path), anchor_(anchor), seen_(seen), weight_(weight) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const KeyframePose& a = path_.at(anchor_);
    const KeyframePose& b = path_.at(seen_.keyframe);
    const Matrix3d R_body_camera = path_.camera_rotation();
    const double inverse_depth = parameters[4][2];
    const Vector3d ray = R_body_camera * Vector3d(parameters[4][0], parameters[4][1], 1.0);
    const Vector3d apart = a.camera - b.camera;
    // The point times its inverse depth, in body j, then in camera j.
    const Vector3d in_body = b.R.transpose() * (a.R * ray + inverse_depth * apart);
    const Vector3d y = R_body_camera.transpose() * in_body;
    const bool visible = y.z() > kMinDepth;
    Eigen::Map<Vector2d> residual(residuals);
    residual = visible ? Vector2d(weight_ * (y.head<2>() / y.z() - seen_.point))
                       : Vector2d::Constant(kBehind_px);
    if (jacobians == nullptr) return true;

    Matrix23 by_y = Matrix23::Zero();
    if (visible) by_y << 1.0, 0.0, -y.x() / y.z(), 0.0, 1.0, -y.y() / y.z();
    const Matrix23 by_body = weight_ / y.z() * by_y * R_body_camera.transpose();
    const Matrix23 by_world = by_body * b.R.transpose();
    const auto set = [&](int block, const Matrix23& value) {
      if (jacobians[block] != nullptr) Eigen::Map<RowMajor23>{jacobians[block]} = value;
    };
    set(0, 0.5 * inverse_depth * (a.t * a.t - b.t * b.t) * by_world);
    set(1, inverse_depth * (a.t - b.t) * by_world);
    set(2, by_world * (inverse_depth * (a.by_gyro - b.by_gyro) - a.R * so3::hat(ray) * a.turn) +
               by_body * so3::hat(in_body) * b.turn);
    set(3, inverse_depth * by_world * (a.by_accel - b.by_accel));
    Matrix23 by_point;
    by_point << (by_world * a.R * R_body_camera).leftCols<2>(), by_world * apart;
    set(4, by_point);
    return true;
  }

 private:
  const Path& path_;
  int anchor_;
  StartProblem::View seen_;
  double weight_;
};

// Zero-mean prior on a bias.
ceres::CostFunction* bias_prior(double sigma) {
  return new ceres::NormalPrior(Matrix3d::Identity() / sigma, Vector3d::Zero());
}

struct Observation {
  std::size_t track;
  int anchor;
  StartProblem::View view;
  bool is_inlier = true;
};

// Alternates solving, re-integrating the IMU at the estimated biases, and outlier rejection.
class Refinement {
 public:
  Refinement(const StartProblem& problem, const StartGuess& guess, const StartSigmas& sigmas)
      : problem_(problem),
        sigmas_(sigmas),
        x_{guess.gravity, guess.velocity, guess.gyro_bias, guess.accel_bias, {}} {
    for (std::size_t t = 0; t < problem.tracks.size(); ++t) {
      const auto& views = problem.tracks[t].views;
      x_.points.emplace_back(views.front().point.x(), views.front().point.y(),
                             guess.inverse_depth[t]);
      if (!(guess.inverse_depth[t] > 0.0)) continue;
      for (const auto& view : views) observations_.push_back({t, views.front().keyframe, view});
    }
  }

  RefinedStart run() {
    RefinedStart out;
    for (int pass = 0; pass < kPasses && !observations_.empty(); ++pass) {
      motion_ = integrate(problem_, x_.gyro_bias, x_.accel_bias);
      solve();
      classify_observations(out);
    }
    if (observations_.empty()) return out;
    motion_ = integrate(problem_, x_.gyro_bias, x_.accel_bias);
    out.guess = {x_.gravity, x_.velocity, x_.gyro_bias, x_.accel_bias, {}};
    for (const Vector3d& point : x_.points) out.guess.inverse_depth.push_back(point.z());
    out.tracks = accepted_tracks();
    out.motion = motion_;
    return out;
  }

 private:
  double weight() const { return sigmas_.focal_px / sigmas_.pixel; }

  void solve() {
    Path path(problem_, x_, motion_);
    ceres::Problem::Options options;
    options.evaluation_callback = &path;
    options.enable_fast_removal = false;
    ceres::Problem ceres_problem(options);
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (const Observation& s : observations_) {
      if (!s.is_inlier) continue;
      double* point = x_.points[s.track].data();
      ceres_problem.AddResidualBlock(new ObservationCost(path, s.anchor, s.view, weight()),
                                     new ceres::HuberLoss(kHuber_px / sigmas_.pixel),
                                     x_.gravity.data(), x_.velocity.data(), x_.gyro_bias.data(),
                                     x_.accel_bias.data(), point);
      ordering->AddElementToGroup(point, 0);
    }
    for (Vector3d* block : {&x_.gravity, &x_.velocity, &x_.gyro_bias, &x_.accel_bias}) {
      ceres_problem.AddParameterBlock(block->data(), 3);
      ordering->AddElementToGroup(block->data(), 1);
    }
    ceres_problem.SetManifold(x_.gravity.data(), new ceres::SphereManifold<3>());
    ceres_problem.AddResidualBlock(bias_prior(sigmas_.gyro_bias), nullptr, x_.gyro_bias.data());
    ceres_problem.AddResidualBlock(bias_prior(sigmas_.accel_bias), nullptr, x_.accel_bias.data());
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::DENSE_SCHUR;
    solver.linear_solver_ordering = ordering;
    solver.max_num_iterations = kIterations;
    solver.function_tolerance = 1e-5;
    solver.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &ceres_problem, &summary);
  }

  // Computes the residuals and reclassifies the inliers.
  void classify_observations(RefinedStart& out) {
    const Path path(problem_, x_, motion_);
    int inlier_count = 0;
    for (Observation& s : observations_) {
      const double* const blocks[] = {nullptr, nullptr, nullptr, nullptr,
                                      x_.points[s.track].data()};
      Vector2d r;
      ObservationCost(path, s.anchor, s.view, weight()).Evaluate(blocks, r.data(), nullptr);
      s.is_inlier = r.norm() * sigmas_.pixel < kOutlier_px && x_.points[s.track].z() > 0.0;
      if (s.is_inlier) ++inlier_count;
    }
    out.inlier_fraction =
        static_cast<double>(inlier_count) / static_cast<double>(observations_.size());
  }

  std::vector<StartProblem::Track> accepted_tracks() const {
    std::vector<StartProblem::Track> tracks(problem_.tracks.size());
    for (const Observation& s : observations_) {
      if (s.is_inlier) tracks[s.track].views.push_back(s.view);
    }
    for (std::size_t t = 0; t < tracks.size(); ++t) {
      auto& views = tracks[t].views;
      const int anchor = problem_.tracks[t].views.front().keyframe;
      if (views.size() < 3 || views.front().keyframe != anchor) views.clear();
    }
    return tracks;
  }

  const StartProblem& problem_;
  const StartSigmas& sigmas_;
  Parameters x_;
  std::vector<Observation> observations_;
  std::vector<Preintegration> motion_;
};

}  // namespace

RefinedStart refine_start(const StartProblem& problem, const StartGuess& guess,
                          const StartSigmas& sigmas) {
  return Refinement(problem, guess, sigmas).run();
}

}  // namespace apvi::vio
