// SPDX-License-Identifier: BSD-3-Clause
#include "vio/window/window_update.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "core/median.hpp"

namespace apvi::vio {
namespace {

using Matrix15 = Eigen::Matrix<double, 15, 15>;

constexpr Duration kMaxPressureDepthGap{60'000'000};

// Landmarks with a mean error of less than this, or than so many times the median of all, are no
// outliers. Wrong calibration raises all errors.
constexpr double kMinOutlier_px = 1.0;
constexpr double kOutlierMedians = 3.0;

double focal(const Rig& rig, int camera) {
  return rig.cameras[static_cast<std::size_t>(camera)].model.parameters().fx;
}

/// Mean reprojection error over all observations but the anchor's.
std::optional<double> mean_error_px(const Landmark& landmark, const Window& window,
                                    const Rig& rig) {
  double sum = 0.0;
  for (std::size_t k = 1; k < landmark.observations.size(); ++k) {
    sum += reprojection_error_px(landmark, landmark.observations[k], window, rig);
  }
  if (landmark.observations.size() < 2) return std::nullopt;
  return sum / static_cast<double>(landmark.observations.size() - 1);
}

void hold_fixed_blocks(Linearizer& linearizer, Window& window, const Config& config) {
  for (const CalibrationBlock& part : blocks(window.calibration, config.calibration)) {
    if (!part.estimate) linearizer.hold_constant(part.block.data);
  }
  for (const auto& frame : window.frames) {
    if (frame->frozen) linearizer.hold_constant(frame->state.pose.data());
    if (frame->frozen) linearizer.hold_constant(frame->state.motion.data());
  }
  for (const auto& [id, landmark] : window.landmarks) {
    if (landmark.frozen) linearizer.hold_constant(&landmark.inverse_depth);
  }
}

// Landmarks that are marginalized together with their anchor frame.
std::set<const Landmark*> landmarks_to_marginalize(const Window& window, const Config& config) {
  const Frame* oldest = window.frames.front().get();
  std::set<const Landmark*> found;
  for (const auto& [id, landmark] : window.landmarks) {
    if (landmark.observations.empty() || landmark.observations.front().frame != oldest) continue;
    if (!is_in_graph(landmark, config.vision.min_observations)) continue;
    const bool continues = landmark.observations.back().frame == &window.newest();
    if (continues && config.window.continuing_tracks == ContinuingTracks::reanchor) continue;
    found.insert(&landmark);
  }
  return found;
}

bool is_marginalized(const Term& term, const Frame* oldest,
                     const std::set<const Landmark*>& landmarks) {
  if (term.is_hold) return false;
  if (term.landmark != nullptr) return landmarks.contains(term.landmark);
  return term.frame == oldest || (term.frame == nullptr);  // the prior belongs to no frame
}

// Fixes the linearization points of all states in the prior.
void fix_first_estimates(Window& window) {
  std::map<const double*, Frame*> owners;
  for (const auto& frame : window.frames) {
    owners[frame->state.pose.data()] = frame.get();
    owners[frame->state.motion.data()] = frame.get();
  }
  for (const Prior::Kept& kept : window.prior->kept) {
    const auto owner = owners.find(kept.block.data);
    if (owner == owners.end()) continue;
    Frame& frame = *owner->second;
    if (kept.block.size == kPoseSize) {
      if (!frame.first.pose) frame.first.pose = frame.state.pose;
    } else if (!frame.first.motion) {
      frame.first.motion = frame.state.motion;
    }
  }
}

}  // namespace

FrameState predict(const FrameState& from, const imu::Preintegration& motion,
                   const Eigen::Vector3d& gravity) {
  const SE3 pose = to_se3(from.pose.data());
  const Eigen::Map<const Eigen::Vector3d> velocity(from.motion.data());
  const double T = motion.duration_s();
  const imu::Preintegration::Delta& delta = motion.delta();
  FrameState to = from;
  to.pose = to_block(
      {(pose.rotation * delta.rotation).normalized(),
       pose.translation + velocity * T + 0.5 * T * T * gravity + pose.rotation * delta.position});
  Eigen::Map<Eigen::Vector3d>(to.motion.data()) =
      velocity + T * gravity + pose.rotation * delta.velocity;
  return to;
}

DvlPing ping_factor(const DvlMeasurement& measured,
                    std::shared_ptr<const imu::Preintegration> since_frame,
                    const Eigen::Vector3d& gyro, const Rig& rig) {
  // Adds the noise of the inertial prediction, which grows with the time since the frame.
  const Eigen::Matrix3d R_dvl_body = rig.dvl->T_body_dvl.rotation.conjugate().toRotationMatrix() *
                                     since_frame->delta().rotation.conjugate().toRotationMatrix();
  const Eigen::Matrix3d predicted = since_frame->covariance().block<3, 3>(
      imu::Preintegration::kVelocity, imu::Preintegration::kVelocity);
  const Eigen::Matrix3d covariance =
      measured.covariance + R_dvl_body * predicted * R_dvl_body.transpose();
  const Eigen::Matrix3d information = covariance.inverse();
  return {.since_frame = std::move(since_frame),
          .gyro = gyro,
          .velocity = measured.velocity,
          .sqrt_information = Eigen::LLT<Eigen::Matrix3d>(information).matrixU(),
          .predicted = measured.predicted};
}

Eigen::Vector3d pressure_sensor_position(const Rig& rig) {
  if (rig.pressure) return rig.pressure->p_body_sensor;
  return rig.depth ? rig.depth->p_body_sensor : Eigen::Vector3d::Zero();
}

std::optional<PressureDepthMeasurement> pressure_depth_at(
    const Frame& frame, const std::deque<PressureDepthMeasurement>& depths, double down_sign) {
  const PressureDepthMeasurement* nearest = nullptr;
  Duration best = kMaxPressureDepthGap;
  for (const PressureDepthMeasurement& depth : depths) {
    const Duration apart{std::abs((depth.stamp - frame.stamp).ns)};
    if (apart >= best) continue;
    best = apart;
    nearest = &depth;
  }
  if (nearest == nullptr) return std::nullopt;
  PressureDepthMeasurement carried = *nearest;
  const double rate = down_sign * frame.state.motion[2];
  carried.depth_m -= rate * seconds_between(frame.stamp, nearest->stamp);
  return carried;
}

std::shared_ptr<Prior> make_prior(const Frame& frame, const Eigen::MatrixXd& J) {
  auto prior = std::make_shared<Prior>();
  auto* pose = const_cast<double*>(frame.state.pose.data());
  auto* motion = const_cast<double*>(frame.state.motion.data());
  prior->kept.push_back({{pose, kPoseSize}, {pose, pose + kPoseSize}});
  prior->kept.push_back({{motion, kMotionSize}, {motion, motion + kMotionSize}});
  prior->J = J;
  prior->r = Eigen::VectorXd::Zero(J.rows());
  return prior;
}

std::shared_ptr<Prior> make_state_prior(const Frame& frame, const StatePrior& prior,
                                        double min_sigma) {
  // Converts the covariance from body-frame to world-frame velocity.
  const Eigen::Matrix3d R = prior.state.R_world_body.toRotationMatrix();
  Matrix15 T = Matrix15::Identity();
  T.block<3, 3>(imu::kVelocity, imu::kTheta) = -R * so3::hat(prior.state.v_body);
  T.block<3, 3>(imu::kVelocity, imu::kVelocity) = R;
  Matrix15 covariance = T * prior.covariance * T.transpose();
  covariance.diagonal().head<6>().array() += min_sigma * min_sigma;
  covariance.diagonal().tail<9>().array() += 1e-10;
  const Matrix15 information = covariance.inverse();
  return make_prior(frame, Eigen::LLT<Matrix15>(information).matrixU());
}

double reprojection_error_px(const Landmark& landmark, const Landmark::Observation& observation,
                             const Window& window, const Rig& rig) {
  const SE3 T_world_camera = camera_pose(observation, window);
  const Eigen::Vector3d p = T_world_camera.inverse() * position(landmark, window);
  if (p.z() < 0.01) return std::numeric_limits<double>::infinity();
  return (p / p.z() - ray(observation, window)).norm() * focal(rig, observation.camera);
}

void reject_outliers(Window& window, const Rig& rig, double max_error_px) {
  for (auto& [id, landmark] : window.landmarks) {
    if (!landmark.triangulated()) {
      landmark.inverse_depth = 0.0;
      continue;
    }
    if (mean_error_px(landmark, window, rig).value_or(0.0) <= max_error_px) continue;
    landmark.inverse_depth = 0.0;
    window.rejected_tracks.insert(id);
  }
}

double outlier_limit_px(const Window& window, const Rig& rig, double max_error_px) {
  std::vector<double> errors;
  for (const auto& [id, landmark] : window.landmarks) {
    if (!landmark.triangulated()) continue;
    if (const auto error = mean_error_px(landmark, window, rig)) errors.push_back(*error);
  }
  if (errors.empty()) return max_error_px;
  const double limit_px = kOutlierMedians * median(std::move(errors));
  return std::min(max_error_px, std::max(kMinOutlier_px, limit_px));
}

void remove_rejected(Window& window) {
  for (const std::int64_t id : window.rejected_tracks) window.landmarks.erase(id);
}

double newest_rms_px(const Window& window, const Rig& rig) {
  double sum = 0.0;
  int count = 0;
  for (const auto& [id, landmark] : window.landmarks) {
    if (!landmark.triangulated() || landmark.observations.size() < 2) continue;
    const Landmark::Observation& last = landmark.observations.back();
    if (last.frame != &window.newest()) continue;
    const double error = reprojection_error_px(landmark, last, window, rig);
    sum += error * error;
    ++count;
  }
  return count == 0 ? 0.0 : std::sqrt(sum / count);
}

bool is_keyframe(const Window& window, const Config& config) {
  const Frame& newest = window.newest();
  const Frame& last = *window.frames[window.frames.size() - 2];
  const WindowConfig& c = config.window;
  if (seconds_between(last.stamp, newest.stamp) >= c.keyframe_max_interval_s) return true;
  double parallax = 0.0;
  int common = 0;
  for (const auto& entry : window.landmarks) {
    const Landmark& landmark = entry.second;
    const auto seen_by = [&](const Frame& frame) {
      return std::find_if(landmark.observations.begin(), landmark.observations.end(),
                          [&](const auto& s) { return s.frame == &frame && s.camera == 0; });
    };
    const auto now = seen_by(newest);
    const auto before = seen_by(last);
    if (now == landmark.observations.end() || before == landmark.observations.end()) continue;
    parallax += (now->view.point - before->view.point).norm();
    ++common;
  }
  if (common == 0) return newest.tracks > 0;
  if (common < c.keyframe_min_tracked_ratio * last.tracks) return true;
  return parallax / common >= c.keyframe_parallax_deg * kRadiansPerDegree;
}

PoseInformation newest_pose_information(const Graph& graph, Window& window, const Config& config) {
  Linearizer linearizer;
  hold_fixed_blocks(linearizer, window, config);
  for (const Term& term : graph.terms()) {
    if (term.landmark != nullptr && !term.landmark->triangulated()) continue;
    linearizer.add(*term.cost, term.loss, term.blocks);
  }
  const double* newest = window.newest().state.pose.data();
  PoseInformation found;
  found.absolute = linearizer.marginal_information(newest);
  if (window.frames.size() < 2) return found;
  linearizer.hold_constant(window.frames.front()->state.pose.data());
  found.over_window = linearizer.marginal_information(newest);
  return found;
}

Prior calibration_knowledge(const Graph& graph, Window& window, const Config& config) {
  Linearizer linearizer;
  hold_fixed_blocks(linearizer, window, config);
  std::set<const double*> calibration;
  for (const CalibrationBlock& part : blocks(window.calibration, config.calibration)) {
    calibration.insert(part.block.data);
  }
  std::vector<double*> drop;
  for (const Term& term : graph.terms()) {
    if (term.is_hold || (term.landmark != nullptr && !term.landmark->triangulated())) continue;
    linearizer.add(*term.cost, term.loss, term.blocks);
    for (const Block& block : term.blocks) {
      if (!calibration.contains(block.data)) drop.push_back(block.data);
    }
  }
  return linearizer.marginalize(drop, Linearizer::Method::schur);
}

void marginalize_oldest(const Graph& graph, Window& window, const Config& config) {
  Frame* oldest = window.frames.front().get();
  const std::set<const Landmark*> landmarks = landmarks_to_marginalize(window, config);
  Linearizer linearizer;
  hold_fixed_blocks(linearizer, window, config);
  for (const Term& term : graph.terms()) {
    if (is_marginalized(term, oldest, landmarks))
      linearizer.add(*term.cost, term.loss, term.blocks);
  }
  std::vector<double*> drop{oldest->state.pose.data(), oldest->state.motion.data()};
  for (auto& [id, landmark] : window.landmarks) {
    if (landmarks.contains(&landmark)) drop.push_back(&landmark.inverse_depth);
  }
  window.prior = std::make_shared<Prior>(linearizer.marginalize(
      drop, config.window.square_root_marginalization ? Linearizer::Method::square_root
                                                      : Linearizer::Method::schur));
  fix_first_estimates(window);
  for (auto& [id, landmark] : window.landmarks) {
    if (!landmarks.contains(&landmark)) continue;
    const bool reuse = config.window.continuing_tracks == ContinuingTracks::reuse;
    if (!reuse || landmark.observations.back().frame != &window.newest())
      landmark.observations.clear();
  }
  remove_frame(window, 0);
}

}  // namespace apvi::vio
