// SPDX-License-Identifier: BSD-3-Clause
#include "vio/window/graph.hpp"

#include <algorithm>
#include <cmath>

#include "vio/window/window_update.hpp"

namespace apvi::vio {
namespace {

Block pose_block(Frame& frame) {
  return {frame.state.pose.data(), kPoseSize};
}
Block motion_block(Frame& frame) {
  return {frame.state.motion.data(), kMotionSize};
}

}  // namespace

Graph::Graph(Window& window, const Config& config, const Rig& rig)
    : window_(window),
      config_(config),
      rig_(rig),
      vision_loss_(config.vision.huber_px / config.vision.pixel_sigma),
      sensor_loss_(config.tight.huber_sigmas) {
  terms_.reserve(2048);
  add_prior(window_.prior, nullptr);
  if (window_.calibration_hold) {
    add_prior(window_.calibration_hold, nullptr);
    terms_.back().is_hold = true;
  }
  add_inertial();
  for (const auto& frame : window.frames) {
    add_dvl(*frame);
    add_pressure_depth(*frame);
    add_prior(frame->state_prior, frame.get());
  }
  for (auto& [id, landmark] : window.landmarks) add_landmark(landmark);
}

const FirstEstimate* Graph::first(const Frame& frame) const {
  return config_.window.first_estimate_jacobians ? &frame.first : nullptr;
}

void Graph::add_prior(const std::shared_ptr<const Prior>& prior, const Frame* frame) {
  if (!prior || prior->kept.empty()) return;
  priors_.emplace_back(prior);
  Term term{.cost = &priors_.back(), .blocks = {}, .frame = frame};
  for (const Prior::Kept& kept : prior->kept) term.blocks.push_back(kept.block);
  terms_.push_back(std::move(term));
}

void Graph::add_inertial() {
  const Eigen::Vector3d gravity = rig_.gravity(config_.gravity);
  for (std::size_t k = 1; k < window_.frames.size(); ++k) {
    Frame& i = *window_.frames[k - 1];
    Frame& j = *window_.frames[k];
    if (!j.from_previous) continue;
    inertial_.emplace_back(j.from_previous, gravity, first(i), first(j));
    terms_.push_back({.cost = &inertial_.back(),
                      .blocks = {pose_block(i), motion_block(i), pose_block(j), motion_block(j)},
                      .frame = &i});
  }
}

void Graph::add_dvl(Frame& frame) {
  for (const Frame::Ping& ping : frame.pings) {
    velocities_.emplace_back(ping.factor, rig_.gravity(config_.gravity), first(frame));
    terms_.push_back({.cost = &velocities_.back(),
                      .loss = &sensor_loss_,
                      .blocks = {pose_block(frame),
                                 motion_block(frame),
                                 {window_.calibration.T_body_dvl.data(), kPoseSize},
                                 {&window_.calibration.dvl_log_scale, 1}},
                      .frame = &frame});
  }
}

void Graph::add_pressure_depth(Frame& frame) {
  if (!frame.depth) return;
  depths_.emplace_back(frame.depth->depth_m, frame.depth->sigma_m, pressure_sensor_position(rig_),
                       rig_.down_sign(), first(frame));
  terms_.push_back({.cost = &depths_.back(),
                    .loss = &sensor_loss_,
                    .blocks = {pose_block(frame), {&*window_.depth_zero_m, 1}},
                    .frame = &frame});
}

void Graph::add_landmark(Landmark& landmark) {
  const auto& seen = landmark.observations;
  if (!is_in_graph(landmark, config_.vision.min_observations) ||
      seen.front().frame->vision_excluded)
    return;
  const auto included =
      std::ranges::count_if(seen, [](const auto& s) { return !s.frame->vision_excluded; });
  if (included < config_.vision.min_observations) return;
  ++landmarks_;
  for (std::size_t k = 1; k < seen.size(); ++k) {
    if (!seen[k].frame->vision_excluded) add_observation(landmark, seen[k]);
  }
}

// The information of an observation grows with its track length (the visual covariance of the
// paper, with beta = short_track_weight and alpha = long_track_weight - beta).
double Graph::weight(const Landmark::Observation& observation) const {
  const VisionConfig& c = config_.vision;
  const double span = static_cast<double>(c.long_track_frames - c.short_track_frames);
  const double u =
      std::clamp((observation.track_length - c.short_track_frames) / std::max(span, 1.0), 0.0, 1.0);
  const double information =
      c.short_track_weight + u * (c.long_track_weight - c.short_track_weight);
  const auto camera = static_cast<std::size_t>(observation.camera);
  return std::sqrt(information) * rig_.cameras[camera].model.parameters().fx / c.pixel_sigma;
}

void Graph::add_observation(Landmark& landmark, const Landmark::Observation& seen) {
  const Landmark::Observation& anchor = landmark.observations.front();
  Frame& i = *anchor.frame;
  Frame& j = *seen.frame;
  Calibration& calibration = window_.calibration;
  const auto camera = [&](int index) -> Block {
    return {calibration.T_body_camera[static_cast<std::size_t>(index)].data(), kPoseSize};
  };
  const auto lens = [&](int index) -> Block {
    return {calibration.lenses[static_cast<std::size_t>(index)].data(), kLensSize};
  };
  const Block depth{&landmark.inverse_depth, 1};
  const Block offset{&calibration.camera_time_offset_s, 1};
  Term term{.loss = &vision_loss_, .blocks = {}, .landmark = &landmark};
  if (&i == &j) {
    stereos_.emplace_back(anchor.view.point, seen.view.point, weight(seen));
    term.cost = &stereos_.back();
    term.blocks = {camera(anchor.camera), camera(seen.camera), depth, lens(anchor.camera),
                   lens(seen.camera)};
  } else if (anchor.camera == seen.camera) {
    reprojections_.emplace_back(anchor.view, seen.view, weight(seen), first(i), first(j));
    term.cost = &reprojections_.back();
    term.blocks = {pose_block(i), pose_block(j), camera(seen.camera),
                   depth,         offset,        lens(seen.camera)};
  } else {
    cross_camera_.emplace_back(anchor.view, seen.view, weight(seen), first(i), first(j));
    term.cost = &cross_camera_.back();
    term.blocks = {pose_block(i), pose_block(j), camera(anchor.camera), camera(seen.camera),
                   depth,         offset,        lens(anchor.camera),   lens(seen.camera)};
  }
  terms_.push_back(std::move(term));
}

}  // namespace apvi::vio
