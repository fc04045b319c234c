// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/fusion/discriminator.hpp"

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

// Of a change of variance: more along one axis does not make up for less along another.
double size_of(const Eigen::Matrix3d& change) {
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

Verdict coarse(const vio::FrameStatistics& statistics, const CoarseConfig& config) {
  const double features = statistics.tracked + statistics.detected;
  const double stable = statistics.stable;
  if (!(features > config.min_features)) {
    return {Level::coarse, Reason::too_few_features, features,
            static_cast<double>(config.min_features)};
  }
  if (!(stable > config.min_stable_ratio * features)) {
    return {Level::coarse, Reason::too_few_stable, stable / features, config.min_stable_ratio};
  }
  if (statistics.spread < config.min_spread) {
    return {Level::coarse, Reason::too_little_spread, statistics.spread, config.min_spread};
  }
  return {};
}

Verdict medium(const SE3& dipo, const SE3& vio, const MediumConfig& config) {
  const Eigen::Vector3d apart = dipo.translation - vio.translation;
  const double distance = apart.norm();
  if (!(distance < config.max_position_m)) {
    return {Level::medium, Reason::position_differs, distance, config.max_position_m};
  }
  const double height = std::abs(apart.z());
  if (!(height < config.max_height_m)) {
    return {Level::medium, Reason::height_differs, height, config.max_height_m};
  }
  const double turned = so3::angle_between(dipo.rotation, vio.rotation) / kRadiansPerDegree;
  if (!(turned < config.max_rotation_deg)) {
    return {Level::medium, Reason::rotation_differs, turned, config.max_rotation_deg};
  }
  return {};
}

void Wander::add(const PoseEstimate& before, const PoseEstimate& after) {
  const Eigen::Matrix3d moved = (after.covariance - before.covariance).bottomRightCorner<3, 3>();
  rotation += size_of(world_rotation_covariance(after) - world_rotation_covariance(before));
  position += size_of(moved);
  height += std::abs(moved(2, 2));
}

Wander Wander::since(const Wander& then) const {
  return {rotation - then.rotation, position - then.position, height - then.height};
}

MediumConfig widened(const MediumConfig& config, const Wander& dipo) {
  const double sigmas = config.dipo_sigmas;
  MediumConfig wide = config;
  wide.max_position_m = std::max(config.max_position_m, sigmas * std::sqrt(dipo.position));
  wide.max_height_m = std::max(config.max_height_m, sigmas * std::sqrt(dipo.height));
  wide.max_rotation_deg =
      std::max(config.max_rotation_deg, sigmas * std::sqrt(dipo.rotation) / kRadiansPerDegree);
  return wide;
}

Verdict fine(const Eigenvalues& eigenvalues, const EigenThresholds& thresholds) {
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

FineConfig for_camera(const FineConfig& config, double focal_px) {
  FineConfig scaled = config;
  if (config.focal_px <= 0.0 || focal_px <= 0.0) return scaled;
  const double ratio = focal_px / config.focal_px;
  scaled.min_rotation *= ratio * ratio;
  scaled.min_position *= ratio * ratio;
  scaled.focal_px = focal_px;
  return scaled;
}

Eigenvalues tested_eigenvalues(const VioEstimate& vio, const FineConfig& config) {
  const Eigenvalues plain = split(vio.window_information.value_or(vio.information));
  return config.normalisation == Normalisation::per_inlier ? per_inlier(plain, vio.inliers) : plain;
}

}  // namespace apvi::fusion
