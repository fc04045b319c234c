// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/bundle_adjustment.hpp"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "apvi/core/constants.hpp"
#include "core/median.hpp"
#include "loop_closure/bundle_factors.hpp"
#include "loop_closure/feature_tracks.hpp"
#include "loop_closure/marginal_covariance.hpp"
#include "loop_closure/ray_intersection.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kMatchSigmas = 10.0;  // of a match with the poses before the adjustment
constexpr double kInlierSigmas = 3.0;
constexpr double kRobustSigmas = 1.5;  // scale of the Cauchy loss of rays
constexpr double kRobustFixSigmas = 3.0;
constexpr double kMinParallax = 0.03;  // of a point [rad]
constexpr std::size_t kMinPoints = 20;
constexpr int kMinShared = 15;      // points of neighboring views
constexpr double kMinJoined = 0.8;  // of the neighboring views, by shared points
constexpr int kIterations = 20;
// Roll and pitch of odometry: mostly the error of gravity in the camera, which views share.
constexpr double kTiltSigma = 0.3 * kRadiansPerDegree;
// Of what is held, and of what nothing else holds.
constexpr double kHeld_m = 1e-4;
constexpr double kHeld_rad = 1e-4;
constexpr double kHeldCamera = 1e-6;
constexpr double kLoose_m = 10.0;
constexpr double kLoose_rad = 1.0;
// Features of one point err alike, so that their errors do not average out as fast as they scatter.
constexpr double kScatterFactor = 2.0;
constexpr double kMedianOfRayleigh = 1.17741;  // for a sigma of 1

struct Pose {
  std::array<double, 4> rotation{};
  std::array<double, 3> position{};
};

Pose to_block(const SE3& T) {
  Pose block;
  Eigen::Map<Eigen::Quaterniond>(block.rotation.data()) = T.rotation;
  Eigen::Map<Eigen::Vector3d>(block.position.data()) = T.translation;
  return block;
}

SE3 to_pose(const Pose& block) {
  return {Eigen::Map<const Eigen::Quaterniond>(block.rotation.data()).normalized(),
          Eigen::Map<const Eigen::Vector3d>(block.position.data())};
}

struct Point {
  FeatureTrack track;
  std::array<double, 3> position{};
};

/// Counts the iterations of all solutions.
class IterationReport : public ceres::IterationCallback {
 public:
  explicit IterationReport(std::function<void(int)> progress) : progress_(std::move(progress)) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& /*iteration*/) override {
    if (progress_) progress_(++iterations_);
    return ceres::SOLVER_CONTINUE;
  }

 private:
  std::function<void(int)> progress_;
  int iterations_ = 0;
};

class Bundle {
 public:
  Bundle(const std::vector<BundleView>& views, const CameraModel& camera,
         const BundleOptions& options)
      : views_(views), model_(camera), options_(options), ray_sigma_(options.ray_sigma) {
    camera_ = to_block(options.T_body_camera);
    for (const BundleView& view : views) {
      poses_.push_back(to_block(view.T_world_body));
      std::vector<DistortionByLens>& distortion = distortion_.emplace_back();
      for (const Eigen::Vector2d& ray : view.place->rays) {
        distortion.push_back(distortion_by_lens(camera, ray));
      }
    }
  }

  void set_points(std::vector<FeatureTrack> tracks) {
    points_.clear();
    for (FeatureTrack& track : tracks) {
      if (const auto position = triangulate(track)) {
        points_.push_back({std::move(track), {position->x(), position->y(), position->z()}});
      }
    }
  }

  bool solve(IterationReport& report);
  /// Of the camera, after `solve`.
  bool find_covariance();

  /// Weights rays by how far they scatter now.
  void weigh_by_scatter() {
    std::vector<double> errors;
    for (const Point& point : points_) {
      for (const TrackedFeature& feature : point.track) errors.push_back(error_of(point, feature));
    }
    const double scatter = ray_sigma_ * median(std::move(errors)) / kMedianOfRayleigh;
    ray_sigma_ = std::min(options_.ray_sigma, kScatterFactor * scatter);
  }

  /// Computes the distortion where the points are, no longer where they were seen.
  void move_distortion() {
    for (const Point& point : points_) {
      for (const TrackedFeature& feature : point.track) {
        if (const auto predicted = predict(point, feature)) {
          distortion_[feature.view][feature.feature] = distortion_by_lens(model_, *predicted);
        }
      }
    }
  }

  /// Tracks without the features that do not fit, triangulated again.
  void drop_outliers() {
    std::vector<FeatureTrack> kept;
    for (Point& point : points_) {
      std::erase_if(point.track, [&](const TrackedFeature& feature) {
        return error_of(point, feature) > kInlierSigmas;
      });
      if (point.track.size() > 1) kept.push_back(std::move(point.track));
    }
    set_points(std::move(kept));
  }

  /// Whether points join most views to the one before. Otherwise odometry alone would join them,
  /// while the graph has the loops of all keyframes between the views.
  bool joins_views() const {
    std::vector<int> shared(views_.size(), 0);  // with the view before
    for (const Point& point : points_) {
      for (std::size_t i = 1; i < point.track.size(); ++i) {
        if (point.track[i].view == point.track[i - 1].view + 1) ++shared[point.track[i].view];
      }
    }
    const auto joined = std::ranges::count_if(shared, [](int n) { return n >= kMinShared; });
    return static_cast<double>(joined) >= kMinJoined * static_cast<double>(views_.size() - 1);
  }
  std::size_t points() const { return points_.size(); }
  std::size_t rays() const {
    std::size_t rays = 0;
    for (const Point& point : points_) rays += point.track.size();
    return rays;
  }
  /// Of the rays, on the plane z = 1.
  double rms() const {
    double sum = 0.0;
    for (const Point& point : points_) {
      for (const TrackedFeature& feature : point.track) {
        const double error = error_of(point, feature);
        sum += error * error;
      }
    }
    return ray_sigma_ * std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, rays())));
  }
  std::vector<SE3> poses() const {
    std::vector<SE3> all;
    for (const Pose& pose : poses_) all.push_back(to_pose(pose));
    return all;
  }
  /// After `solve`.
  BundleCamera camera() const { return {to_pose(camera_), lens(), covariance_}; }

 private:
  LensCorrection lens() const { return {std::exp(lens_[0]), {lens_[1], lens_[2]}}; }
  RayFactor factor_of(const TrackedFeature& feature) const {
    const Eigen::Vector2d& ray = views_[feature.view].place->rays[feature.feature];
    return {ray, distortion_[feature.view][feature.feature], ray_sigma_};
  }
  MapRay map_ray(const TrackedFeature& feature) const {
    const RayFactor seen = factor_of(feature);
    const Eigen::Vector2d ray = true_point(seen.ray, seen.distortion, lens_.data());
    const SE3 T = to_pose(poses_[feature.view]) * to_pose(camera_);
    return {T.translation, T.rotation * ray.homogeneous().normalized()};
  }
  std::optional<Eigen::Vector3d> triangulate(const FeatureTrack& track) const {
    std::vector<MapRay> rays;
    for (const TrackedFeature& feature : track) rays.push_back(map_ray(feature));
    double widest = 0.0;
    for (const MapRay& ray : rays) widest = std::max(widest, parallax(ray, rays));
    if (widest < kMinParallax) return std::nullopt;
    const Eigen::Vector3d point = nearest_point(rays);
    return fits(point, rays, kMatchSigmas * ray_sigma_) ? std::optional(point) : std::nullopt;
  }
  /// On the plane z = 1 of the true lens.
  std::optional<Eigen::Vector2d> predict(const Point& point, const TrackedFeature& feature) const {
    const Pose& pose = poses_[feature.view];
    const Eigen::Vector3d p =
        in_camera(pose.rotation.data(), pose.position.data(), camera_.rotation.data(),
                  camera_.position.data(), point.position.data());
    if (p.z() < kMinDepth_m) return std::nullopt;
    return p.hnormalized();
  }
  double error_of(const Point& point, const TrackedFeature& feature) const {
    const Pose& pose = poses_[feature.view];
    Eigen::Vector2d error;
    if (!factor_of(feature)(pose.rotation.data(), pose.position.data(), camera_.rotation.data(),
                            camera_.position.data(), lens_.data(), point.position.data(),
                            error.data())) {
      return std::numeric_limits<double>::infinity();
    }
    return error.norm();
  }
  void add_rays(ceres::Problem& problem);
  void add_measurements(ceres::Problem& problem);
  void add_gauge(ceres::Problem& problem);
  void add_calibration(ceres::Problem& problem);
  void build(ceres::Problem& problem);

  const std::vector<BundleView>& views_;
  CameraModel model_;  ///< of the rig
  BundleOptions options_;
  double ray_sigma_;
  std::vector<std::vector<DistortionByLens>> distortion_;  ///< of all features, by view
  std::vector<Pose> poses_;
  std::vector<Point> points_;
  Pose camera_;  ///< in the body
  std::array<double, 3> lens_{};
  Eigen::Matrix<double, 9, 9> covariance_ =
      Eigen::Matrix<double, 9, 9>::Zero();  ///< see BundleCamera
};

void Bundle::add_rays(ceres::Problem& problem) {
  for (Point& point : points_) {
    for (const TrackedFeature& feature : point.track) {
      Pose& pose = poses_[feature.view];
      problem.AddResidualBlock(RayFactor::create(factor_of(feature)),
                               new ceres::CauchyLoss(kRobustSigmas), pose.rotation.data(),
                               pose.position.data(), camera_.rotation.data(),
                               camera_.position.data(), lens_.data(), point.position.data());
    }
  }
}

void Bundle::add_measurements(ceres::Problem& problem) {
  for (std::size_t k = 0; k < views_.size(); ++k) {
    const BundleView& view = views_[k];
    Pose& pose = poses_[k];
    const Eigen::Vector3d up = view.T_odometry_body.rotation.conjugate() * Eigen::Vector3d::UnitZ();
    problem.AddResidualBlock(TiltFactor::create(up, std::hypot(kTiltSigma, view.tilt_error)),
                             nullptr, pose.rotation.data());
    if (view.motion) {
      Pose& before = poses_[k - 1];
      problem.AddResidualBlock(
          MotionFactor::create(*view.motion, views_[k - 1].T_odometry_body.rotation), nullptr,
          before.rotation.data(), before.position.data(), pose.rotation.data(),
          pose.position.data());
    }
    if (view.height) {
      problem.AddResidualBlock(ViewHeightFactor::create(*view.height), nullptr,
                               pose.position.data());
    }
    for (const ViewPose& fix : view.fixes) {
      problem.AddResidualBlock(ViewPoseFactor::create(fix), new ceres::CauchyLoss(kRobustFixSigmas),
                               pose.rotation.data(), pose.position.data(), camera_.rotation.data(),
                               camera_.position.data());
    }
  }
}

// Heading and position of the first view are free to choose unless a known map fixes them.
void Bundle::add_gauge(ceres::Problem& problem) {
  const bool is_fixed =
      std::ranges::any_of(views_, [](const BundleView& view) { return !view.fixes.empty(); });
  for (std::size_t k = 0; k < views_.size(); ++k) {
    const bool held = k == 0 && !is_fixed;
    const ViewPose pose{views_[k].T_world_body * options_.T_body_camera,
                        {.heading_rad = held ? kHeld_rad : kLoose_rad,
                         .horizontal_m = held ? kHeld_m : kLoose_m,
                         .vertical_m = kLoose_m}};
    problem.AddResidualBlock(ViewPoseFactor::create(pose), nullptr, poses_[k].rotation.data(),
                             poses_[k].position.data(), camera_.rotation.data(),
                             camera_.position.data());
  }
}

void Bundle::add_calibration(ceres::Problem& problem) {
  const CameraPrior& prior = options_.prior;
  const auto add = [&](bool estimate, ceres::CostFunction* cost, double* values) {
    problem.AddResidualBlock(cost, nullptr, values);
    if (!estimate) problem.SetParameterBlockConstant(values);
  };
  const auto sigma = [](double of_prior) { return of_prior > 0.0 ? of_prior : kHeldCamera; };
  add(prior.mounting_rad > 0.0,
      RotationFactor::create(prior.T_body_camera.rotation, sigma(prior.mounting_rad)),
      camera_.rotation.data());
  add(prior.lever_arm_m > 0.0,
      VectorFactor::create(prior.T_body_camera.translation,
                           Eigen::Vector3d::Constant(sigma(prior.lever_arm_m))),
      camera_.position.data());
  const double principal_point = sigma(prior.principal_point);
  add(prior.focal_length > 0.0 || prior.principal_point > 0.0,
      VectorFactor::create(Eigen::Vector3d::Zero(),
                           {sigma(prior.focal_length), principal_point, principal_point}),
      lens_.data());
}

void Bundle::build(ceres::Problem& problem) {
  add_rays(problem);
  add_measurements(problem);
  add_gauge(problem);
  add_calibration(problem);
  for (Pose& pose : poses_) {
    problem.SetManifold(pose.rotation.data(), new ceres::EigenQuaternionManifold);
  }
  problem.SetManifold(camera_.rotation.data(), new ceres::EigenQuaternionManifold);
}

bool Bundle::solve(IterationReport& report) {
  ceres::Problem problem;
  build(problem);
  auto* order = new ceres::ParameterBlockOrdering;
  for (Point& point : points_) order->AddElementToGroup(point.position.data(), 0);
  for (Pose& pose : poses_) {
    order->AddElementToGroup(pose.rotation.data(), 1);
    order->AddElementToGroup(pose.position.data(), 1);
  }
  order->AddElementToGroup(lens_.data(), 1);
  order->AddElementToGroup(camera_.rotation.data(), 1);
  order->AddElementToGroup(camera_.position.data(), 1);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.linear_solver_ordering.reset(order);
  options.max_num_iterations = kIterations;
  options.function_tolerance = 1e-5;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;  // sums in the same order in every run
  options.callbacks.push_back(&report);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.IsSolutionUsable();
}

bool Bundle::find_covariance() {
  ceres::Problem problem;
  build(problem);
  const auto found = marginal_covariance(
      problem, {camera_.rotation.data(), camera_.position.data(), lens_.data()});
  if (!found) return false;
  // The manifold turns by half of the rotation vector, about the axes of the body.
  Eigen::Matrix<double, 9, 9> J = Eigen::Matrix<double, 9, 9>::Identity();
  J.topLeftCorner<3, 3>() = 2.0 * to_pose(camera_).rotation.conjugate().toRotationMatrix();
  covariance_ = J * *found * J.transpose();
  return true;
}

}  // namespace

std::optional<BundleResult> adjust_bundle(const std::vector<BundleView>& views,
                                          const CameraModel& camera, const BundleOptions& options) {
  std::vector<TrackView> posed;
  for (const BundleView& view : views)
    posed.push_back({view.place, view.T_world_body * options.T_body_camera});
  Bundle bundle(views, camera, options);
  bundle.set_points(
      track_features(posed, overlapping_views(posed, camera), kMatchSigmas * options.ray_sigma));
  if (bundle.points() < kMinPoints || !bundle.joins_views()) return std::nullopt;
  IterationReport report(options.progress);
  BundleResult result;
  result.rms_before = bundle.rms();
  if (!bundle.solve(report)) return std::nullopt;
  bundle.move_distortion();
  bundle.weigh_by_scatter();
  bundle.drop_outliers();
  if (bundle.points() < kMinPoints || !bundle.solve(report)) return std::nullopt;
  if (!bundle.find_covariance()) return std::nullopt;
  result.T_world_body = bundle.poses();
  result.camera = bundle.camera();
  result.points = bundle.points();
  result.rays = bundle.rays();
  result.rms_after = bundle.rms();
  return result;
}

}  // namespace apvi::loop_closure
