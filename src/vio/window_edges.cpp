// SPDX-License-Identifier: BSD-3-Clause
#include "window_edges.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "apvi/geometry/so3.hpp"

namespace apvi::vio {
namespace {

using Matrix15 = Eigen::Matrix<double, 15, 15>;

constexpr Duration kDepthReach{60'000'000};

double focal(const Rig& rig, int camera) {
  return rig.cameras[static_cast<std::size_t>(camera)].model.parameters().fx;
}

void hold_what_is_given(Linearizer& linearizer, const Window& window, const Config& config) {
  if (!config.vision.estimate_extrinsics) {
    for (const PoseBlock& block : window.T_body_camera) linearizer.hold_constant(block.data());
  }
  if (!config.vision.estimate_time_offset) linearizer.hold_constant(&window.time_offset_s);
  for (const auto& frame : window.frames) {
    if (frame->frozen) linearizer.hold_constant(frame->state.pose.data());
    if (frame->frozen) linearizer.hold_constant(frame->state.motion.data());
  }
  for (const auto& [id, landmark] : window.landmarks) {
    if (landmark.frozen) linearizer.hold_constant(&landmark.inverse_depth);
  }
}

// Landmarks that leave together with the frame they are anchored in.
std::set<const Landmark*> leaving(const Window& window, const Config& config) {
  const Frame* oldest = window.frames.front().get();
  std::set<const Landmark*> found;
  for (const auto& [id, landmark] : window.landmarks) {
    if (landmark.sightings.empty() || landmark.sightings.front().frame != oldest) continue;
    if (!takes_part(landmark, config.vision.min_sightings)) continue;
    const bool continues = landmark.sightings.back().frame == &window.newest();
    if (continues && config.window.continuing_tracks == ContinuingTracks::reanchor) continue;
    found.insert(&landmark);
  }
  return found;
}

bool concerns(const Term& term, const Frame* oldest, const std::set<const Landmark*>& landmarks) {
  if (term.landmark != nullptr) return landmarks.contains(term.landmark);
  return term.frame == oldest || (term.frame == nullptr);  // the prior belongs to no frame
}

// From now on the derivatives by what the prior knows stay as they are.
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

Window empty_window(const Rig& rig) {
  Window window;
  for (const CameraCalibration& camera : rig.cameras) {
    window.T_body_camera.push_back(to_block(camera.T_body_camera));
  }
  return window;
}

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
  // The prediction's own noise counts too: it grows with the time since the frame.
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
          .sqrt_information = Eigen::LLT<Eigen::Matrix3d>(information).matrixU()};
}

Eigen::Vector3d depth_lever(const Rig& rig) {
  if (rig.pressure) return rig.pressure->p_body_sensor;
  return rig.depth ? rig.depth->p_body_sensor : Eigen::Vector3d::Zero();
}

std::optional<DepthMeasurement> depth_at(const Frame& frame,
                                         const std::deque<DepthMeasurement>& depths,
                                         double depth_sign) {
  const DepthMeasurement* nearest = nullptr;
  Duration best = kDepthReach;
  for (const DepthMeasurement& depth : depths) {
    const Duration apart{std::abs((depth.stamp - frame.stamp).ns)};
    if (apart >= best) continue;
    best = apart;
    nearest = &depth;
  }
  if (nearest == nullptr) return std::nullopt;
  DepthMeasurement carried = *nearest;
  const double rate = depth_sign * frame.state.motion[2];
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

std::shared_ptr<Prior> prior_from(const Frame& frame, const Aid& aid, double least_sigma) {
  // The aid's velocity is in the body frame, the window's is not.
  const Eigen::Matrix3d R = aid.state.R_world_body.toRotationMatrix();
  Matrix15 T = Matrix15::Identity();
  T.block<3, 3>(imu::kVelocity, imu::kTheta) = -R * so3::hat(aid.state.v_body);
  T.block<3, 3>(imu::kVelocity, imu::kVelocity) = R;
  Matrix15 covariance = T * aid.covariance * T.transpose();
  covariance.diagonal().head<6>().array() += least_sigma * least_sigma;
  covariance.diagonal().tail<9>().array() += 1e-10;
  const Matrix15 information = covariance.inverse();
  return make_prior(frame, Eigen::LLT<Matrix15>(information).matrixU());
}

double reprojection_error_px(const Landmark& landmark, const Landmark::Sighting& sighting,
                             const Window& window, const Rig& rig) {
  const SE3 T_world_camera = camera_pose(sighting, window);
  const Eigen::Vector3d p = T_world_camera.inverse() * position(landmark, window);
  if (p.z() < 0.01) return std::numeric_limits<double>::infinity();
  return (p.head<2>() / p.z() - sighting.view.point).norm() * focal(rig, sighting.camera);
}

void give_up_outliers(Window& window, const Rig& rig, double max_error_px) {
  for (auto& [id, landmark] : window.landmarks) {
    if (!landmark.triangulated()) {
      landmark.inverse_depth = 0.0;
      continue;
    }
    double sum = 0.0;
    for (std::size_t k = 1; k < landmark.sightings.size(); ++k) {
      sum += reprojection_error_px(landmark, landmark.sightings[k], window, rig);
    }
    const auto count = static_cast<double>(landmark.sightings.size() - 1);
    if (count == 0.0 || sum / count <= max_error_px) continue;
    landmark.inverse_depth = 0.0;
    window.given_up.insert(id);
  }
}

void forget_given_up(Window& window) {
  for (const std::int64_t id : window.given_up) window.landmarks.erase(id);
}

double newest_rms_px(const Window& window, const Rig& rig) {
  double sum = 0.0;
  int count = 0;
  for (const auto& [id, landmark] : window.landmarks) {
    if (!landmark.triangulated() || landmark.sightings.size() < 2) continue;
    const Landmark::Sighting& last = landmark.sightings.back();
    if (last.frame != &window.newest()) continue;
    const double error = reprojection_error_px(landmark, last, window, rig);
    sum += error * error;
    ++count;
  }
  return count == 0 ? 0.0 : std::sqrt(sum / count);
}

bool is_keyframe(const Window& window, const Config& config, const Rig& rig) {
  const Frame& newest = window.newest();
  const Frame& last = *window.frames[window.frames.size() - 2];
  const WindowConfig& c = config.window;
  if (seconds_between(last.stamp, newest.stamp) >= c.keyframe_interval_s) return true;
  double parallax = 0.0;
  int common = 0;
  for (const auto& [id, landmark] : window.landmarks) {
    const auto seen_by = [&](const Frame& frame) {
      return std::find_if(landmark.sightings.begin(), landmark.sightings.end(),
                          [&](const auto& s) { return s.frame == &frame && s.camera == 0; });
    };
    const auto now = seen_by(newest);
    const auto before = seen_by(last);
    if (now == landmark.sightings.end() || before == landmark.sightings.end()) continue;
    parallax += (now->view.point - before->view.point).norm();
    ++common;
  }
  if (common == 0) return newest.tracks > 0;
  if (common < c.keyframe_survival * last.tracks) return true;
  return parallax / common * focal(rig, 0) >= c.keyframe_parallax_px;
}

Informations newest_informations(const Graph& graph, const Window& window, const Config& config) {
  Linearizer linearizer;
  hold_what_is_given(linearizer, window, config);
  for (const Term& term : graph.terms()) {
    if (term.landmark != nullptr && !term.landmark->triangulated()) continue;
    linearizer.add(*term.cost, term.loss, term.blocks);
  }
  const double* newest = window.newest().state.pose.data();
  Informations found;
  found.absolute = linearizer.marginal_information(newest);
  if (window.frames.size() < 2) return found;
  linearizer.hold_constant(window.frames.front()->state.pose.data());
  found.over_window = linearizer.marginal_information(newest);
  return found;
}

void marginalize_oldest(const Graph& graph, Window& window, const Config& config) {
  Frame* oldest = window.frames.front().get();
  const std::set<const Landmark*> landmarks = leaving(window, config);
  Linearizer linearizer;
  hold_what_is_given(linearizer, window, config);
  for (const Term& term : graph.terms()) {
    if (concerns(term, oldest, landmarks)) linearizer.add(*term.cost, term.loss, term.blocks);
  }
  std::vector<double*> drop{oldest->state.pose.data(), oldest->state.motion.data()};
  for (auto& [id, landmark] : window.landmarks) {
    if (landmarks.contains(&landmark)) drop.push_back(&landmark.inverse_depth);
  }
  window.prior = std::make_shared<Prior>(
      linearizer.marginalize(drop, config.window.square_root ? Linearizer::Method::square_root
                                                             : Linearizer::Method::schur));
  fix_first_estimates(window);
  for (auto& [id, landmark] : window.landmarks) {
    if (!landmarks.contains(&landmark)) continue;
    const bool reuse = config.window.continuing_tracks == ContinuingTracks::reuse;
    if (!reuse || landmark.sightings.back().frame != &window.newest()) landmark.sightings.clear();
  }
  remove_frame(window, 0);
}

}  // namespace apvi::vio
