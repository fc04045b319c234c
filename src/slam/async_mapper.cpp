// SPDX-License-Identifier: BSD-3-Clause
#include "slam/async_mapper.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "gaussians/device.hpp"
#include "mapping/keyframes/image_visibility.hpp"
#include "sensors/camera_mask.hpp"
#include "slam/map_access.hpp"

namespace apvi::slam {
namespace {

using torch::Tensor;

constexpr std::size_t kQueueSize = 16;
// A CPU in real time never catches up: frames that wait longer are outdated when their turn comes.
// On a GPU only fits of the medium keep frames waiting.
constexpr std::size_t kRealtimeCpuQueueSize = 4;

Tensor to_rows(const std::vector<Eigen::Vector3d>& points) {
  Tensor rows = torch::empty({static_cast<std::int64_t>(points.size()), 3}, torch::kFloat64);
  double* x = rows.data_ptr<double>();
  for (const Eigen::Vector3d& p : points) x = std::copy_n(p.data(), 3, x);
  return rows;
}

mapping::SparsePoints to_points(const std::vector<localization::MapPoint>& points) {
  std::vector<Eigen::Vector3d> positions;
  std::vector<std::int64_t> ids;
  std::vector<double> sigmas;
  for (const localization::MapPoint& point : points) {
    positions.push_back(point.position);
    ids.push_back(point.id);
    sigmas.push_back(point.sigma_m);
  }
  return {.ids = torch::tensor(ids, torch::kInt64),
          .positions = to_rows(positions),
          .sigmas = torch::tensor(sigmas, torch::kFloat64)};
}

bool is_rejected(mapping::KeyframeDecision decision) {
  using enum mapping::KeyframeDecision;
  return decision != accepted && decision != held_out && decision != no_image;
}

// A GPU makes so many steps in the time that localization takes, and they pay: on a seabed of 100 s
// 34 dB instead of 28 dB.
constexpr int kStepsCpu = 30;
constexpr int kStepsGpu = 100;
constexpr int kFinalIterationsGpu = 5000;  // about 15 s

// With the number of steps that the device allows where the options leave it open.
AsyncMapperOptions with_steps(AsyncMapperOptions options) {
  const bool on_gpu = gaussians::active_device().is_cuda();
  int& steps = options.mapper.online.steps_per_keyframe;
  if (steps == 0) steps = on_gpu ? kStepsGpu : kStepsCpu;
  std::optional<int>& final_iterations = options.mapper.trainer.final_iterations;
  const bool may_wait = options.thread != MappingThread::dropping;
  if (!final_iterations) final_iterations = on_gpu && may_wait ? kFinalIterationsGpu : 0;
  return options;
}

std::size_t queue_size(MappingThread thread) {
  const bool keeps_up = thread == MappingThread::blocking || gaussians::active_device().is_cuda();
  return keeps_up ? kQueueSize : kRealtimeCpuQueueSize;
}

}  // namespace

LoopClosureMethod resolve_loop_closure_method(LoopClosureMethod asked, bool has_graph,
                                              bool has_lamp) {
  if (asked != LoopClosureMethod::automatic) return asked;
  return has_graph || !has_lamp ? LoopClosureMethod::pose_graph : LoopClosureMethod::alignment;
}

AsyncMapper::AsyncMapper(const AsyncMapperOptions& options, const Rig& rig,
                         AsyncMapperCallbacks callbacks)
    : options_(with_steps(options)),
      callbacks_(std::move(callbacks)),
      undistort_(rig.cameras.front().model, options.image_scale),
      mask_(rig.cameras.front().mask),
      T_rig_body_camera_(rig.cameras.front().T_body_camera),
      T_body_camera_(T_rig_body_camera_),
      mapper_(options_.mapper),
      scheduler_({.realtime = options.thread == MappingThread::dropping,
                  .steps_per_keyframe = options_.mapper.online.steps_per_keyframe}) {
  if (!mask_.empty()) mapper_.set_mask(scene_of(undistort_.mask(mask_)));
  const bool may_drop = options_.thread == MappingThread::dropping;
  if (options_.thread == MappingThread::none) return;
  worker_ = std::make_unique<Worker<localization::MapFrame>>(
      queue_size(options_.thread), may_drop ? Overflow::drop_oldest : Overflow::block,
      [this](const localization::MapFrame& frame) { run_guarded([&] { process(frame); }); });
}

void AsyncMapper::make_loop_closer() {
  const bool may_drop = options_.thread == MappingThread::dropping;
  loop_closure::CloserOptions closer = loop_closure::closer_options(options_.loop_closure);
  closer.mask = undistort_.mask(mask_);
  loop_closer_.emplace(
      closer, CameraModel(to_parameters(undistort_.intrinsics())),
      may_drop ? loop_closure::LoopThread::skipping : loop_closure::LoopThread::none);
  corrections_ = loop_closer_->corrections();
}

void AsyncMapper::push(localization::MapFrame frame) {
  const bool follows = loop_closure_method(frame) == LoopClosureMethod::pose_graph && !failed_;
  if (frame.corrections && !follows) frame.corrections->close();
  if (!worker_) return run_guarded([&] { process(frame); });
  worker_->push(std::move(frame));
}

void AsyncMapper::finish() {
  scheduler_.finish();
  if (worker_) {
    worker_->wait();
    dropped_ = worker_->dropped();
  }
  run_guarded([this] { finish_map(); });
}

void AsyncMapper::stop() {
  if (worker_) worker_->stop();
}

// The trajectory is useful without a map too.
void AsyncMapper::run_guarded(const std::function<void()>& work) {
  if (failed_) return;
  try {
    work();
  } catch (...) {
    failure_ = std::current_exception();
    failed_ = true;
    callbacks_.failed();
  }
}

void AsyncMapper::finish_map() {
  if (loop_closer_) loop_closer_->finish();
  if (corrections_) correct(corrections_->read_all());
  flush_depth();
}

// The newest keyframes wait for neighbors that do not come anymore.
void AsyncMapper::flush_depth() {
  const auto count = static_cast<int>(mapper_.waiting());
  if (count == 0 || !mapper_.ready() || callbacks_.interrupted()) return;
  const int steps = scheduler_.flush_steps(count, static_cast<double>(keyframe_count_),
                                           static_cast<double>(mapper_.iteration()), depth_s());
  if (steps == 0) return;
  FinalProgress progress{.work = FinalWork::finishing};
  callbacks_.final_progress(progress);
  {
    const std::scoped_lock lock(mutex_);
    mapper_.flush_depth_queue();
  }
  for (int k = 0; k < steps && mapper_.ready() && !callbacks_.interrupted(); ++k) {
    step();
    progress.fraction = static_cast<double>(k) / steps;
    callbacks_.final_progress(progress);
  }
  gaussian_count_ = mapper_.size();
  progress.ended = true;
  callbacks_.final_progress(progress);
}

std::string AsyncMapper::status() const {
  return fmt::format("{}{} keyframes, {} Gaussians", failed_ ? "mapping disabled: " : "",
                     keyframe_count_.load(), gaussian_count_.load());
}

void AsyncMapper::process(const localization::MapFrame& frame) {
  torch::set_num_threads(options_.threads);  // a property of the calling thread
  optimize_outage(frame);
  if (frame.scale_change) change_scale(*frame.scale_change);
  if (frame.T_body_camera) T_body_camera_ = *frame.T_body_camera;
  const mapping::KeyframeDecision decision = add_frame(frame);
  const bool accepted = decision == mapping::KeyframeDecision::accepted;
  if (accepted) ++keyframe_count_;
  if (is_rejected(decision) && mapper_.counts().at(decision) == 1) {
    log::warning("image {}: not mapped: {}", frame.image_stamp.ns, mapping::to_string(decision));
  }
  if (accepted || options_.thread == MappingThread::dropping) optimize();
  gaussian_count_ = mapper_.size();
  callbacks_.progress();
}

// The few places seen so far are forgotten.
void AsyncMapper::change_scale(const ScaleChange& change) {
  if (loop_closer_) make_loop_closer();
  const std::scoped_lock lock(mutex_);
  const Eigen::Vector3d& c = change.center;
  mapper_.change_scale({change.scale, torch::tensor({c.x(), c.y(), c.z()}, torch::kFloat64)});
}

mapping::KeyframeDecision AsyncMapper::add_frame(const localization::MapFrame& frame) {
  const auto entry = times_.scope("keyframes");
  return scheduler_.measure_keyframe([&] {
    mapping::MapperInput input = to_input(frame);
    follow_graph(frame);
    input.skip_depth = scheduler_.should_skip_depth(queued_frames(), depth_s());
    input.skip_medium_fit = scheduler_.should_skip_medium_fit(queued_frames());
    const std::scoped_lock lock(mutex_);
    return mapper_.add(input);
  });
}

void AsyncMapper::optimize() {
  for (int steps = 0; mapper_.ready() && !callbacks_.interrupted(); ++steps) {
    if (paused_ || !scheduler_.may_step(steps, queued_frames())) return;
    step();
  }
}

// A medium that is learned by gradient adapts while VIO fails, although no keyframes come then.
void AsyncMapper::optimize_outage(const localization::MapFrame& frame) {
  using enum mapping::MediumEstimationMethod;
  const mapping::MapperOptions& mapper = options_.mapper;
  if (!mapper.medium || mapper.trainer.medium_estimation != gradient) return;
  if (!first_frame_) first_frame_ = frame.stamp;
  if (failing_since_) {
    const double mapped_s = seconds_between(*first_frame_, *failing_since_) - outages_s_;
    const double outage_s = seconds_between(*failing_since_, frame.stamp);
    const int steps =
        scheduler_.outage_steps(outage_s, mapped_s, static_cast<double>(keyframe_count_));
    for (int k = 0; k < steps && mapper_.ready() && !callbacks_.interrupted(); ++k) step();
    outages_s_ += outage_s;
    failing_since_.reset();
  }
  if (frame.vio_failing) failing_since_ = frame.stamp;
}

double AsyncMapper::step() {
  const std::scoped_lock lock(mutex_);
  return scheduler_.measure_step([this] { return mapper_.step(); });
}

// Only in real time do queued frames shorten the work on the present one.
std::size_t AsyncMapper::queued_frames() const {
  return options_.thread == MappingThread::dropping ? worker_->waiting() : 0;
}

double AsyncMapper::depth_s() const {
  return mapper_.depth_s();
}

MapCopy AsyncMapper::snapshot() const {
  const std::scoped_lock lock(mutex_);
  return {.map = mapper_.snapshot(), .keyframes = keyframes(), .iteration = mapper_.iteration()};
}

MapCopy AsyncMapper::preview() const {
  const std::scoped_lock lock(mutex_);
  return {.map = mapper_.stored() == 0 ? mapper_.snapshot() : mapper_.preview(),
          .keyframes = keyframes(),
          .iteration = mapper_.iteration()};
}

mapping::MapRendering AsyncMapper::render(const gaussians::View& view) const {
  const std::scoped_lock lock(mutex_);
  if (mapper_.size() == 0) return {};
  return render_image(mapper_.preview(), view);
}

std::map<std::string, double> AsyncMapper::times() const {
  std::map<std::string, double> all(times_.seconds().begin(), times_.seconds().end());
  all.insert(mapper_.times().seconds().begin(), mapper_.times().seconds().end());
  return all;
}

std::map<std::string, std::size_t> AsyncMapper::rejected() const {
  std::map<std::string, std::size_t> counts;
  for (const auto& [decision, count] : mapper_.counts()) {
    if (is_rejected(decision)) counts[std::string(mapping::to_string(decision))] = count;
  }
  return counts;
}

std::optional<std::size_t> AsyncMapper::closed_loops() const {
  return corrections_ ? std::optional(corrections_->closures()) : std::nullopt;
}

std::vector<loop_closure::ClosedLoop> AsyncMapper::loops() const {
  return corrections_ ? corrections_->loops() : std::vector<loop_closure::ClosedLoop>{};
}

mapping::MapperInput AsyncMapper::to_input(const localization::MapFrame& frame) {
  const auto entry = times_.scope("images");
  mapping::MapperInput input;
  input.vio_failing = frame.vio_failing;
  for (const StampedPose& kept : frame.window) {
    input.moved.push_back({kept.stamp.ns, camera_pose(kept.T_world_body)});
  }
  if (frame.image.empty()) return input;
  input.keyframe.stamp_ns = frame.stamp.ns;
  input.keyframe.name = std::to_string(frame.image_stamp.ns);
  input.keyframe.intrinsics = undistort_.intrinsics();
  input.keyframe.T_camera_world = camera_pose(frame.T_world_body);
  const cv::Mat undistorted = undistort_(frame.image);
  input.keyframe.image = to_tensor(undistorted);
  const cv::Mat own = own_mask(frame);
  input.keyframe.scene = scene_of(undistort_.mask(own));
  input.low_visibility =
      mapping::has_low_visibility(to_tensor(frame.image), scene_of(combined(mask_, own)));
  input.keyframe.held_out = frame.held_out;
  input.keyframe.number = frame.heldout_index;
  input.points = to_points(frame.points);
  if (frame.newest_keyframe) input.follows_ns = frame.newest_keyframe->ns;
  if (options_.use_dvl_ranges) input.depth_samples = to_rows(frame.range_points);
  const LoopClosureMethod method = loop_closure_method(frame);
  input.align = method == LoopClosureMethod::alignment;
  const bool closes_loops = method == LoopClosureMethod::pose_graph && !frame.corrections;
  if (closes_loops && !frame.held_out && !input.low_visibility) close_loops(frame, undistorted);
  return input;
}

// A damaged mask hides nothing.
cv::Mat AsyncMapper::own_mask(const localization::MapFrame& frame) const {
  if (!frame.mask) return {};
  try {
    const cv::Mat mask = frame.mask();
    if (mask.empty() || mask.size() == frame.image.size()) return mask;
    log::warning("image {}: its mask has another size; not used", frame.image_stamp.ns);
  } catch (const RunError& error) {
    log::warning("image {}: mask: {}; not used", frame.image_stamp.ns, error.what());
  }
  return {};
}

void AsyncMapper::close_loops(const localization::MapFrame& frame, const cv::Mat& undistorted) {
  if (!loop_closer_) make_loop_closer();
  const auto entry = times_.scope("loops");
  loop_closure::LoopInput job;
  job.keyframe.stamp = frame.stamp;
  job.keyframe.T_world_camera = frame.T_world_body * T_body_camera_;
  for (const StampedPose& kept : frame.window) {
    job.moved.push_back({kept.stamp, kept.T_world_body * T_body_camera_});
  }
  job.gray = loop_closure::to_gray(undistorted);
  loop_closer_->push(std::move(job));
}

LoopClosureMethod AsyncMapper::loop_closure_method(const localization::MapFrame& frame) const {
  return resolve_loop_closure_method(options_.loop_closure.method, frame.corrections != nullptr,
                                     options_.has_lamp);
}

// Applies what the keyframes up to this frame have caused. In real time the graph may be behind.
void AsyncMapper::follow_graph(const localization::MapFrame& frame) {
  if (loop_closure_method(frame) != LoopClosureMethod::pose_graph) return;
  if (frame.corrections) {
    corrections_ = frame.corrections;
    if (frame.graph_keyframes == 0 && !frame.image.empty()) before_graph_.push_back(frame.stamp);
    if (frame.graph_keyframes > 0 && !graph_begin_) graph_begin_ = frame.stamp;
    const bool wait = options_.thread != MappingThread::dropping;
    return correct(corrections_->read(frame.graph_keyframes, wait));
  }
  if (corrections_) correct(corrections_->read_all());
}

void AsyncMapper::correct(const std::vector<loop_closure::KeyframeCorrections>& all) {
  for (const loop_closure::KeyframeCorrections& corrections : all) {
    std::vector<mapping::LoopCorrection> moved;
    // Images of a start up to scale are not in the graph; they stay with its first keyframe.
    if (corrections.front().stamp == graph_begin_) {
      const Tensor motion = to_tensor(corrections.front().T_after_before);
      for (const Stamp stamp : before_graph_) moved.push_back({stamp.ns, motion});
    }
    for (const loop_closure::KeyframeCorrection& keyframe : corrections) {
      moved.push_back({keyframe.stamp.ns, to_tensor(keyframe.T_after_before)});
    }
    const std::scoped_lock lock(mutex_);
    mapper_.correct(moved);
  }
}

Tensor AsyncMapper::camera_pose(const SE3& T_world_body) const {
  return to_tensor((T_world_body * T_body_camera_).inverse());
}

bool AsyncMapper::refine() {
  torch::set_num_threads(options_.threads);
  mapper_.begin_final();
  FinalProgress progress{.work = FinalWork::refining};
  callbacks_.final_progress(progress);
  while (!mapper_.final_done() && !callbacks_.interrupted()) {
    const double latest = step();
    progress.loss = progress.loss == 0.0 ? latest : 0.98 * progress.loss + 0.02 * latest;
    progress.fraction = mapper_.progress();
    callbacks_.final_progress(progress);
    callbacks_.progress();
  }
  progress.ended = true;
  callbacks_.final_progress(progress);
  return mapper_.final_done();
}

void AsyncMapper::resume(const std::filesystem::path& checkpoint) {
  mapper_.resume(checkpoint);
}

Trajectory AsyncMapper::keyframes() const {
  Trajectory trajectory;
  const mapping::KeyframeStore& store = mapper_.keyframes();
  for (std::size_t i = 0; i < store.size(); ++i) {
    const SE3 T_camera_world = to_se3(mapper_.pose(i));
    trajectory.poses.push_back(
        {Stamp{store[i].stamp_ns}, T_camera_world.inverse() * T_rig_body_camera_.inverse()});
  }
  return trajectory;
}

}  // namespace apvi::slam
