// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/discriminator.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>

#include "apvi/geometry/so3.hpp"

namespace apvi::fusion {
namespace {

constexpr std::array<std::string_view, 5> kLevels{"accepted", "input", "coarse", "medium", "fine"};
constexpr std::array<std::string_view, 13> kReasons{"none",
                                                    "no_image",
                                                    "no_estimate",
                                                    "diverged",
                                                    "too_few_features",
                                                    "too_few_stable",
                                                    "too_little_spread",
                                                    "position_differs",
                                                    "height_differs",
                                                    "rotation_differs",
                                                    "no_landmarks",
                                                    "rotation_degenerate",
                                                    "position_degenerate"};
static_assert(kReasons.size() == static_cast<std::size_t>(Reason::position_degenerate) + 1);

// Nuclear norm of a change of covariance: an increase along one axis does not cancel a decrease
// along another.
double nuclear_norm(const Eigen::Matrix3d& change) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(change, Eigen::EigenvaluesOnly);
  return axes.eigenvalues().cwiseAbs().sum();
}

}  // namespace

std::string_view to_string(Level level) {
  return kLevels.at(static_cast<std::size_t>(level));
}

std::string_view to_string(Reason reason) {
  return kReasons.at(static_cast<std::size_t>(reason));
}

Verdict check_tracking(const vio::FrameStatistics& statistics, const TrackingCheckConfig& config) {
  const double features = statistics.tracked + statistics.detected;
  const double stable = statistics.stable;
  if (!(features > config.min_features)) {
    return {Level::coarse, Reason::too_few_features, features,
            static_cast<double>(config.min_features)};
  }
  if (!(stable > config.min_stable_ratio * features)) {
    return {Level::coarse, Reason::too_few_stable, stable / features, config.min_stable_ratio};
  }
  if (statistics.spread < config.min_grid_coverage) {
    return {Level::coarse, Reason::too_little_spread, statistics.spread, config.min_grid_coverage};
  }
  return {};
}

Verdict check_agreement(const SE3& dipo, const SE3& vio, const AgreementCheckConfig& config) {
  const Eigen::Vector3d difference = dipo.translation - vio.translation;
  const double distance = difference.norm();
  if (!(distance < config.max_position_m)) {
    return {Level::medium, Reason::position_differs, distance, config.max_position_m};
  }
  const double height = std::abs(difference.z());
  if (!(height < config.max_height_m)) {
    return {Level::medium, Reason::height_differs, height, config.max_height_m};
  }
  const double angle_deg = so3::angle_between(dipo.rotation, vio.rotation) / kRadiansPerDegree;
  if (!(angle_deg < config.max_rotation_deg)) {
    return {Level::medium, Reason::rotation_differs, angle_deg, config.max_rotation_deg};
  }
  return {};
}

void DriftVariance::add(const PoseEstimate& before, const PoseEstimate& after) {
  const Eigen::Matrix3d change = (after.covariance - before.covariance).bottomRightCorner<3, 3>();
  rotation += nuclear_norm(world_rotation_covariance(after) - world_rotation_covariance(before));
  position += nuclear_norm(change);
  height += std::abs(change(2, 2));
}

DriftVariance DriftVariance::since(const DriftVariance& earlier) const {
  return {rotation - earlier.rotation, position - earlier.position, height - earlier.height};
}

AgreementCheckConfig widen_limits(const AgreementCheckConfig& config, const DriftVariance& dipo) {
  const double sigmas = config.dipo_sigmas;
  AgreementCheckConfig widened = config;
  widened.max_position_m = std::max(config.max_position_m, sigmas * std::sqrt(dipo.position));
  widened.max_height_m = std::max(config.max_height_m, sigmas * std::sqrt(dipo.height));
  widened.max_rotation_deg =
      std::max(config.max_rotation_deg, sigmas * std::sqrt(dipo.rotation) / kRadiansPerDegree);
  return widened;
}

Verdict check_degeneracy(const Eigenvalues& eigenvalues, const EigenThresholds& thresholds) {
  const double rotation = eigenvalues.rotation.minCoeff();
  if (thresholds.rotation > 0.0 && !(rotation >= thresholds.rotation)) {
    return {Level::fine, Reason::rotation_degenerate, rotation, thresholds.rotation};
  }
  const double position = eigenvalues.position.minCoeff();
  if (thresholds.position > 0.0 && !(position >= thresholds.position)) {
    return {Level::fine, Reason::position_degenerate, position, thresholds.position};
  }
  return {};
}

DegeneracyCheckConfig scale_to_camera(const DegeneracyCheckConfig& config, double focal_px) {
  DegeneracyCheckConfig scaled = config;
  if (config.reference_focal_px <= 0.0 || focal_px <= 0.0) return scaled;
  const double ratio = focal_px / config.reference_focal_px;
  scaled.min_rotation_eigenvalue *= ratio * ratio;
  scaled.min_position_eigenvalue *= ratio * ratio;
  scaled.reference_focal_px = focal_px;
  return scaled;
}

Eigenvalues tested_eigenvalues(const VioEstimate& vio, const DegeneracyCheckConfig& config) {
  const Eigenvalues plain = block_eigenvalues(vio.window_information.value_or(vio.information));
  return config.normalization == Normalization::per_inlier ? per_inlier(plain, vio.inliers) : plain;
}

}  // namespace apvi::fusion
