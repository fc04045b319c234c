// SPDX-License-Identifier: BSD-3-Clause
#include "runs/live/live_scene.hpp"

#include <torch/torch.h>

#include <utility>

#include "runs/maps/stored_map.hpp"
#include "runs/views/dive_view.hpp"
#include "runs/views/stored_scene.hpp"
#include "viewer/message.hpp"

namespace apvi::runs {
namespace {

constexpr double kVersionPeriod_s = 1.0;

}  // namespace

LiveScene::LiveScene(std::string name) {
  description_.name = std::move(name);
  description_.live = true;
}

void LiveScene::set_rig(const Rig& rig) {
  const std::scoped_lock lock(mutex_);
  description_.up = -rig.gravity(1.0);
  dvl_ = rig.dvl;
  if (dvl_) description_.beams = shown_beams(*dvl_);
  if (rig.cameras.empty()) return;
  const CameraCalibration& camera = rig.cameras.front();
  describe_camera({slam::Undistorter(camera.model, 1.0).intrinsics(), camera.T_body_camera},
                  description_);
}

void LiveScene::set_mapper(slam::AsyncMapper* mapper, std::function<void()> save) {
  copier_.set_mapper(mapper);
  const std::scoped_lock lock(mapper_mutex_, mutex_);
  mapper_ = mapper;
  save_ = std::move(save);
  description_.can_pause = description_.can_save = mapper != nullptr;
}

void LiveScene::add(const SensorEvent& event) {
  const std::scoped_lock lock(mutex_);
  spans_.add(event);
  const auto* ping = std::get_if<DvlSample>(&event);
  if (ping != nullptr && dvl_) description_.beams->pings.push_back(shown_ping(*ping, *dvl_));
}

std::vector<viewer::BeamPing> LiveScene::take_new_pings() {
  const std::scoped_lock lock(mutex_);
  if (!description_.beams) return {};
  const std::vector<viewer::BeamPing>& pings = description_.beams->pings;
  const std::size_t from = std::exchange(taken_pings_, pings.size());
  return {pings.begin() + static_cast<std::ptrdiff_t>(from), pings.end()};
}

std::vector<viewer::SensorTrack> LiveScene::sensors() const {
  const std::scoped_lock lock(mutex_);
  return shown_sensors(spans_.all());
}

void LiveScene::set_loops(const std::vector<loop_closure::ClosedLoop>& loops) {
  const std::scoped_lock lock(mutex_);
  if (loops.size() == description_.loops.size()) return;
  description_.loops = shown_loops(loops);
  loops_are_new_ = true;
}

std::optional<std::vector<viewer::LoopLine>> LiveScene::take_loops() {
  const std::scoped_lock lock(mutex_);
  if (!std::exchange(loops_are_new_, false)) return std::nullopt;
  return description_.loops;
}

void LiveScene::save() {
  const std::scoped_lock lock(mapper_mutex_);
  if (mapper_ == nullptr || mapper_->failed()) return set_saved("mapping has ended");
  save_();
}

void LiveScene::set_saved(const std::string& error) {
  const std::scoped_lock lock(mutex_);
  saved_ = error;
}

std::optional<std::string> LiveScene::take_saved() {
  const std::scoped_lock lock(mutex_);
  return std::exchange(saved_, std::nullopt);
}

void LiveScene::add(const StampedPose& pose, const std::string& state) {
  const std::scoped_lock lock(mutex_);
  trace_.add(pose, state);
}

void LiveScene::add(const localization::FrameOutput& output) {
  const std::scoped_lock lock(mutex_);
  if (trace_.rewrite(output)) rewritten_ = true;
  if (const auto pose = output.fused()) trace_.add(*pose, std::string(output.pose_source()));
}

std::optional<std::vector<viewer::TracePose>> LiveScene::take_new_poses() {
  const std::scoped_lock lock(mutex_);
  const std::vector<viewer::TracePose>& trace = trace_.poses();
  const std::size_t from = std::exchange(taken_, trace.size());
  if (std::exchange(rewritten_, false)) return std::nullopt;
  return std::vector(trace.begin() + static_cast<std::ptrdiff_t>(from), trace.end());
}

std::string LiveScene::take_map_message() {
  const std::scoped_lock lock(mutex_);
  return std::exchange(map_is_new_, false) ? viewer::map_message(description_) : "";
}

std::int64_t LiveScene::keyframes() const {
  const std::scoped_lock lock(mapper_mutex_);
  return mapper_ == nullptr ? 0 : mapper_->keyframe_count();
}

bool LiveScene::paused() const {
  const std::scoped_lock lock(mapper_mutex_);
  return mapper_ != nullptr && mapper_->paused();
}

void LiveScene::pause(bool paused) {
  const std::scoped_lock lock(mapper_mutex_);
  if (mapper_ != nullptr) mapper_->pause(paused);
}

std::uint64_t LiveScene::version() const {
  return static_cast<std::uint64_t>(since_start_.seconds() / kVersionPeriod_s);
}

viewer::SceneDescription LiveScene::description() const {
  const std::scoped_lock lock(mutex_);
  viewer::SceneDescription description = description_;
  description.trace = trace_.poses();
  description.sensors = shown_sensors(spans_.all());
  return description;
}

void LiveScene::refresh() {
  auto copy = copier_.take();
  if (!copy) return;
  const MapExtent& extent = copy->extent;
  const Trajectory keyframes = std::move(copy->map.keyframes);
  painter_.set_map(std::move(copy->map.map), {}, /*with_levels=*/false);
  const std::scoped_lock lock(mutex_);
  description_.gaussians = extent.gaussians;
  description_.medium = extent.medium;
  description_.center = extent.center;
  description_.radius_m = extent.radius_m;
  description_.keyframes.clear();
  for (const StampedPose& pose : keyframes.poses) {
    description_.keyframes.push_back(pose.T_world_body);
  }
  map_is_new_ = true;
  if (trace_.follow(keyframes)) rewritten_ = true;
}

std::optional<viewer::Rendering> LiveScene::render(const viewer::View& view) {
  torch::set_num_threads(1);  // of this thread: the others are for the run
  refresh();
  return painter_.render(view);
}

std::optional<double> LiveScene::depth(const viewer::Viewpoint& viewpoint, int column, int row) {
  return painter_.depth(viewpoint, column, row);
}

}  // namespace apvi::runs
