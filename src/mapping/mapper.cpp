// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/mapper.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <utility>

#include "apvi/core/constants.hpp"
#include "core/stopwatch.hpp"
#include "gaussians/device.hpp"
#include "gaussians/model/archive.hpp"
#include "mapping/storage/stored_memory.hpp"
#include "mapping/training/retry_on_oom.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

TrainerOptions optimizer_options(const MapperOptions& options) {
  TrainerOptions trainer = options.trainer;
  trainer.sparse_adam = trainer.sparse_adam.value_or(options.online.sparse_adam);
  return trainer;
}

MapOptimizer empty_map(const MapperOptions& options, std::size_t views) {
  return {gaussians::Gaussians::empty(options.trainer.sh_degree, torch::kFloat32),
          optimizer_options(options), views};
}

PoseSigmas drift_per_second(const OnlineOptions& options) {
  return {.translation_m = options.drift_m_s,
          .rotation_rad = kRadiansPerDegree * options.drift_deg_s};
}

}  // namespace

Mapper::Mapper(const MapperOptions& options)
    : options_(options),
      storage_folder_(std::make_shared<StorageFolder>(options.storage_folder,
                                                      stored_memory(options.online).disk)),
      optimizer_(empty_map(options, 0)),
      region_(stored_memory(options.online).gaussians, storage_folder_),
      selection_(options.online),
      poses_(drift_per_second(options.online)),
      aligner_(optimizer_.max_gaussians()),
      point_seeder_(options.online),
      depth_queue_(options.online),
      depth_seeder_(options),
      inserter_(options),
      densification_(options),
      medium_(options),
      training_(options) {
  keyframes_.set_folder(storage_folder_);
  keyframes_.set_tone_curve(optimizer_.tone_curve());
}

KeyframeDecision Mapper::add(const MapperInput& input) {
  const torch::NoGradGuard no_grad;
  move_map(input);
  optimizer_.set_vio_failing(input.vio_failing);
  if (input.low_visibility) lose_visibility(input.keyframe.stamp_ns);
  const KeyframeDecision decision =
      selection_.decide(input.keyframe, input.low_visibility, keyframes_);
  if (decision == KeyframeDecision::held_out) add_held_out(input);
  if (decision == KeyframeDecision::accepted) add_training_keyframe(input);
  return decision;
}

// Gaussians move with their keyframe.
void Mapper::move_map(const MapperInput& input) {
  const auto entry = times_.scope("poses");
  const KeyframeMotions updated = poses_.update(input.moved, keyframes_);
  region_.move(updated);
  retry_on_oom([&] { optimizer_.move(updated); });
}

void Mapper::correct(const std::vector<LoopCorrection>& loop_corrections) {
  const torch::NoGradGuard no_grad;
  const auto entry = times_.scope("poses");
  const KeyframeMotions corrected = poses_.correct(loop_corrections, keyframes_);
  aligner_.move(corrected, keyframes_);
  region_.move(corrected);
  retry_on_oom([&] { optimizer_.move(corrected); });
}

void Mapper::lose_visibility(std::int64_t stamp_ns) {
  for (const std::size_t view : selection_.lose_visibility(stamp_ns, keyframes_)) {
    training_.remove_view(view);
    depth_queue_.remove(view);
  }
}

void Mapper::add_keyframe(const Keyframe& keyframe) {
  poses_.add(keyframe, keyframes_);
  retry_on_oom([&] { optimizer_.add_view(); });
}

void Mapper::add_held_out(const MapperInput& input) {
  add_keyframe(input.keyframe);
  if (input.follows_ns) {
    const auto leader = keyframes_.by_stamp().find(*input.follows_ns);
    if (leader != keyframes_.by_stamp().end()) {
      poses_.follow(leader->second, keyframes_.size() - 1);
    }
  }
  selection_.thin_held_out(keyframes_);
}

void Mapper::add_training_keyframe(const MapperInput& input) {
  const std::size_t accepted = selection_.accepted();
  medium_.observe(input.keyframe.stamp_ns, keyframes_, accepted);
  add_keyframe(input.keyframe);
  const std::size_t view = keyframes_.size() - 1;
  training_.add_view(view);
  {
    const auto entry = times_.scope("storage");
    retry_on_oom([&] { region_.follow(view, extent(), keyframes_, optimizer_, training_); });
  }
  {
    const auto entry = times_.scope("gains");
    retry_on_oom([&] { optimizer_.match_gain(keyframes_, view); });
  }
  if (input.align) align(view);
  insert_gaussians(view, input);
  limit_image_memory();
  // Under load, only the first estimation runs; later ones are deferred.
  const bool busy = input.skip_depth || input.skip_medium_fit;
  if (medium_.take_due(accepted, busy, optimizer_)) estimate_medium();
}

// Held-out images are not aligned; they share the drift of the preceding keyframe.
void Mapper::align(std::size_t view) {
  if (!inserter_.started()) return;
  const auto entry = times_.scope("alignment");
  const PoseSigmas sigmas = poses_.map_odom().sigmas(keyframes_[view].stamp_ns);
  std::optional<Tensor> pose;
  retry_on_oom([&] { pose = aligner_.align(keyframes_, view, sigmas, optimizer_); });
  if (pose) poses_.register_newest(*pose, keyframes_);
}

void Mapper::insert_gaussians(std::size_t view, const MapperInput& input) {
  densification_.add_budget(optimizer_.room());
  insert_from_points(view, input);
  if (options_.trainer.densify.kind == Densification::random) insert_random(view);
  if (options_.trainer.densify.kind == Densification::quadtree) {
    insert_from_queue(view, input.skip_depth);
  }
}

void Mapper::insert_from_points(std::size_t view, const MapperInput& input) {
  const auto entry = times_.scope("insertion");
  const auto in_map = [this](const Tensor& points) {
    return points.defined() ? poses_.map_odom().points_in_map(points) : points;
  };
  SparsePoints points = input.points;
  points.positions = in_map(points.positions);
  const Seeds seeds =
      point_seeder_.seeds(keyframes_.view(view, 1), points, in_map(input.depth_samples));
  if (seeds.size() == 0) return;
  retry_on_oom([&] { inserter_.insert(seeds, view, keyframes_, optimizer_); });
}

void Mapper::insert_random(std::size_t view) {
  if (!inserter_.started()) return;
  const auto entry = times_.scope("insertion");
  retry_on_oom([&] { inserter_.insert_random(view, keyframes_, optimizer_); });
}

void Mapper::insert_from_queue(std::size_t view, bool skip_depth) {
  depth_queue_.push(view, selection_.accepted());
  const std::optional<std::size_t> due = depth_queue_.due();
  if (!due) return;
  if (skip_depth) return depth_queue_.thin();
  insert_from_depth(*due);
  depth_queue_.pop();
}

void Mapper::flush_depth_queue() {
  const torch::NoGradGuard no_grad;
  for (const std::size_t view : depth_queue_.views()) insert_from_depth(view);
  depth_queue_.clear();
}

void Mapper::insert_from_depth(std::size_t view) {
  if (!keyframes_.has_image(view)) return;
  retry_on_oom([&] {
    const depth::DepthRequest request = depth_seeder_.request(view, keyframes_, poses_, optimizer_);
    depth::DepthEstimate estimate;
    {
      const auto entry = times_.scope("depth");
      estimate =
          depth_seeder_.estimate(request, keyframes_.scene(view, 1, gaussians::active_device()));
    }
    if (estimate.status != depth::DepthStatus::estimated) return;
    const auto entry = times_.scope("depth_insertion");
    depth_seeder_.clear_free_space(estimate, keyframes_.view(view, 1), optimizer_);
    const Seeds seeds =
        depth_seeder_.seeds(estimate, view, keyframes_, optimizer_, point_seeder_.positions());
    if (seeds.size() > 0) inserter_.insert(seeds, view, keyframes_, optimizer_);
  });
}

void Mapper::limit_image_memory() {
  for (const std::size_t view : selection_.limit_image_memory(keyframes_)) {
    training_.remove_view(view);
  }
}

void Mapper::estimate_medium() {
  const auto entry = times_.scope("medium");
  bool has_changed = false;
  retry_on_oom(
      [&] { has_changed = medium_.estimate(iteration(), extent(), keyframes_, optimizer_); });
  if (has_changed) training_.reset_penalties();
}

double Mapper::step() {
  TORCH_CHECK(ready(), "mapper: no Gaussians or no keyframes to optimize yet");
  const Stopwatch watch;
  if (training_.is_final() && region_.stored() > 0) revisit();
  const auto entry = times_.scope("steps");
  training_.step(extent(), optimizer_, keyframes_);
  densify();
  training_.add_final_time(watch.seconds());
  return training_.loss();
}

// The final refinement goes along the path, so that all parts have their turn on the device.
void Mapper::revisit() {
  const std::vector<std::size_t>& views = keyframes_.training();
  const auto n = static_cast<double>(views.size());
  const auto due = static_cast<std::size_t>(std::min(n - 1.0, n * training_.progress()));
  if (revisited_ == views[due]) return;
  const auto entry = times_.scope("storage");
  const torch::NoGradGuard no_grad;
  revisited_ = views[due];
  retry_on_oom([&] { region_.revisit(views[due], extent(), keyframes_, optimizer_, training_); });
}

void Mapper::densify() {
  if (training_.is_final() || !densification_.is_due(iteration(), training_.views())) return;
  const auto entry = times_.scope("densification");
  densification_.run(iteration(), extent(), optimizer_, keyframes_);
}

void Mapper::begin_final() {
  if (training_.is_final()) return;
  const torch::NoGradGuard no_grad;
  // Needs iterations afterwards: new Gaussians and a new medium, which changes colors and gains at
  // once, take steps to converge.
  if (options_.trainer.final_iterations.value_or(0) > 0) {
    flush_depth_queue();
    if (medium_.is_estimated(optimizer_)) estimate_medium();
  }
  training_.begin_final();
}

bool Mapper::final_done() const {
  return training_.is_final() && (!ready() || training_.final_done());
}

void Mapper::retry_on_oom(const std::function<void()>& work) {
  mapping::retry_on_oom(work, optimizer_, keyframes_);
}

Map Mapper::snapshot(const torch::Device& device) const {
  const torch::NoGradGuard no_grad;
  Map map = this->map();
  map.gaussians = region_.complete(keyframes_, optimizer_, device);
  if (map.log_gains.defined()) map.log_gains = map.log_gains.clone();
  return map;
}

Map Mapper::preview() const {
  Map map = this->map();
  map.gaussians = region_.preview(keyframes_, optimizer_);
  if (map.log_gains.defined()) map.log_gains = map.log_gains.clone();
  return map;
}

Tensor Mapper::pose(std::size_t i) const {
  return corrected_pose(keyframes_[i].T_camera_world,
                        optimizer_.corrections().pose_delta(i, false));
}

void Mapper::change_scale(const gaussians::ScaleChange& change) {
  region_.load_all(keyframes_, optimizer_, training_);
  poses_.change_scale(change, keyframes_);
  point_seeder_.change_scale(change);
  aligner_.change_scale(change);
  inserter_.change_scale(change);
  optimizer_.change_scale(change);
}

void Mapper::save(const std::filesystem::path& checkpoint) const {
  torch::serialize::OutputArchive archive;
  StorageFiles files = keyframes_.save(archive);
  selection_.save(archive);
  poses_.save(archive);
  aligner_.save(archive);
  point_seeder_.save(archive);
  depth_queue_.save(archive);
  inserter_.save(archive);
  densification_.save(archive);
  medium_.save(archive);
  training_.save(archive);
  torch::serialize::OutputArchive optimizer;
  optimizer_.save(optimizer);
  archive.write("optimizer", optimizer);
  torch::serialize::OutputArchive region;
  const StorageFiles of_region = region_.save(region, optimizer_);
  files.insert(files.end(), of_region.begin(), of_region.end());
  archive.write("region", region);
  gaussians::write_archive(checkpoint, archive);
  storage_folder_->keep(files);
}

void Mapper::resume(const std::filesystem::path& checkpoint) {
  MapperOptions options = options_;
  options.trainer.densify.max_gaussians = optimizer_.max_gaussians();
  Mapper read(options);
  StorageFiles files;
  gaussians::read_archive(checkpoint, [&](torch::serialize::InputArchive& archive) {
    files = read.keyframes_.load(archive);
    read.selection_.load(archive);
    read.poses_.load(archive);
    read.aligner_.load(archive);
    read.point_seeder_.load(archive);
    read.depth_queue_.load(archive);
    read.inserter_.load(archive);
    read.densification_.load(archive);
    read.medium_.load(archive);
    read.training_.load(archive);
    read.optimizer_ = empty_map(read.options_, read.keyframes_.size());
    torch::serialize::InputArchive optimizer;
    archive.read("optimizer", optimizer);
    read.optimizer_.load(optimizer);
    read.keyframes_.set_tone_curve(read.optimizer_.tone_curve());
    torch::serialize::InputArchive region;
    archive.read("region", region);
    const StorageFiles of_region =
        read.region_.load(region, read.keyframes_, read.optimizer_, read.training_);
    files.insert(files.end(), of_region.begin(), of_region.end());
  });
  read.storage_folder_->restore(files);
  *this = std::move(read);
}

}  // namespace apvi::mapping
