// SPDX-License-Identifier: BSD-3-Clause
#include "online_map.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <future>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/core/progress.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/mapping/picture_content.hpp"
#include "apvi/splat/device.hpp"

namespace apvi::bridge {
namespace {

using torch::Tensor;

constexpr std::size_t kQueue = 16;  // frames that wait for the mapper
// In real time on a processor, which never catches up: what waits longer is of the past, and the
// end would come before its turn. On a GPU only surveys of the water keep frames waiting.
constexpr std::size_t kShortQueue = 4;
constexpr std::size_t kCrowd = 4;  // that wait: with more, some would be lost during a survey

// While frames wait in real time, of the time the mapper works.
constexpr double kTrainingShare = 0.5;
constexpr double kDepthShare = 0.3;   // at most
constexpr double kLastSteps_s = 1.0;  // for what waits when the recording ends
constexpr int kSettling = 100;        // steps for each keyframe whose depth comes last

Tensor to_rows(const std::vector<Eigen::Vector3d>& points) {
  Tensor rows = torch::empty({static_cast<std::int64_t>(points.size()), 3}, torch::kFloat64);
  double* x = rows.data_ptr<double>();
  for (const Eigen::Vector3d& p : points) x = std::copy_n(p.data(), 3, x);
  return rows;
}

mapping::SparsePoints to_points(const std::vector<pipeline::MapPoint>& points) {
  std::vector<Eigen::Vector3d> positions;
  std::vector<std::int64_t> ids;
  std::vector<double> sigmas;
  for (const pipeline::MapPoint& point : points) {
    positions.push_back(point.position);
    ids.push_back(point.id);
    sigmas.push_back(point.sigma_m);
  }
  return {.ids = torch::tensor(ids, torch::kInt64),
          .positions = to_rows(positions),
          .sigmas = torch::tensor(sigmas, torch::kFloat64)};
}

bool is_refusal(mapping::Intake intake) {
  using enum mapping::Intake;
  return intake != taken && intake != held_out && intake != no_picture;
}

}  // namespace

OnlineMap::OnlineMap(const RunConfig& config, const MappingRunOptions& options, const Rig& rig)
    : config_(config), options_(options), mapper_(mapper_options(config, rig)) {}

void OnlineMap::begin(const Rig& rig) {
  const CameraCalibration& camera = rig.cameras.front();
  undistort_.emplace(camera.model, config_.mapping.image_scale);
  T_body_camera_ = camera.T_body_camera;
  curve_.emplace(options_.folder / "mapping.csv", config_.mapping.report_every_s, options_.resume);
  const pipeline::RunMode mode = config_.run.mode;
  watch_.reset();
  if (options_.resume) return;
  const bool may_drop = mode == pipeline::RunMode::realtime;
  if (revisits_of(config_, rig) == Revisits::loops) {
    const splat::Intrinsics& k = undistort_->intrinsics();
    const loop::Pinhole pinhole{k.fx, k.fy, k.cx, k.cy, k.width, k.height};
    loops_.emplace(config_.mapping.loops, pinhole, may_drop);
  }
  if (mode == pipeline::RunMode::sequential) return;
  const bool catches_up = !may_drop || splat::active_device().is_cuda();
  worker_ = std::make_unique<Worker<pipeline::MapFrame>>(
      catches_up ? kQueue : kShortQueue, may_drop ? Overflow::drop_oldest : Overflow::block,
      [this](const pipeline::MapFrame& frame) { attempt([&] { process(frame); }); });
}

void OnlineMap::take(pipeline::MapFrame frame) {
  if (!worker_) return attempt([&] { process(frame); });
  worker_->push(std::move(frame));
}

void OnlineMap::finish() {
  since_end_.reset();
  ending_ = true;
  if (worker_) {
    worker_->wait();
    dropped_ = worker_->dropped();
  }
  attempt([this] { finish_map(); });
}

void OnlineMap::stop() {
  if (worker_) worker_->stop();
}

// A trajectory is worth having without a map too.
void OnlineMap::attempt(const std::function<void()>& work) {
  if (failed_) return;
  try {
    work();
  } catch (...) {
    give_up(std::current_exception());
  }
}

void OnlineMap::give_up(std::exception_ptr why) {
  failure_ = std::move(why);
  failed_ = true;
  rescue([this] { save(); });
  try {
    rethrow_failure();
  } catch (const std::exception& error) {
    log::error("no more is mapped, localization goes on: {}", error.what());
  }
}

// What LibTorch says of itself is long.
void OnlineMap::rethrow_failure() const {
  if (!failure_) return;
  try {
    std::rethrow_exception(failure_);
  } catch (const c10::Error& error) {
    if (splat::is_out_of_memory(error)) fail_memory(config_, options_.folder);
    fail_run("mapping: {}", error.what_without_backtrace());
  }
}

void OnlineMap::finish_map() {
  if (loops_) loops_->finish();
  for (auto moved = next_relocation(); !moved.empty(); moved = next_relocation()) {
    mapping::MapperInput news;
    news.relocated = std::move(moved);
    mapper_.add(news);
  }
  fill_end();
}

// The newest keyframes wait for neighbours that do not come any more.
void OnlineMap::fill_end() {
  const auto count = static_cast<int>(mapper_.waiting());
  if (count == 0 || !mapper_.ready() || options_.interrupted()) return;
  const auto per = [](double seconds, std::int64_t n) {
    return seconds / static_cast<double>(std::max<std::int64_t>(1, n));
  };
  const double each_s = per(mapper_.times().of("depth"), shown_keyframes_) +
                        kSettling * per(training_s(), mapper_.iteration());
  if (in_realtime() && since_end_.seconds() + count * each_s > kLastSteps_s) return;
  StatusLine status_line("settling");
  mapper_.fill_waiting();
  const int steps = count * kSettling;
  for (int k = 0; k < steps && mapper_.ready() && !options_.interrupted(); ++k) {
    mapper_.step();
    status_line.update(static_cast<double>(k) / steps, status());
  }
  shown_gaussians_ = mapper_.size();
}

std::string OnlineMap::status() const {
  return fmt::format("{}{} keyframes, {} Gaussians", failed_ ? "no longer mapped: " : "",
                     shown_keyframes_.load(), shown_gaussians_.load());
}

void OnlineMap::process(const pipeline::MapFrame& frame) {
  torch::set_num_threads(config_.run.threads);  // it is a property of the thread
  const mapping::Intake intake = take_in(frame);
  if (intake == mapping::Intake::taken) ++shown_keyframes_;
  if (is_refusal(intake) && mapper_.counts().at(intake) == 1) {
    log::warning("image {}: not mapped: {}", frame.image_stamp.ns, mapping::to_string(intake));
  }
  if (intake == mapping::Intake::taken || in_realtime()) learn();
  shown_gaussians_ = mapper_.size();
  look_after();
}

mapping::Intake OnlineMap::take_in(const pipeline::MapFrame& frame) {
  const auto entry = times_.enter("intake");
  mapping::MapperInput input = to_input(frame);
  input.relocated = next_relocation();
  input.hurry = in_hurry();
  input.crowded = frames_waiting() > kCrowd;
  return mapper_.add(input);
}

// As many steps as the mode has for a keyframe.
void OnlineMap::learn() {
  const bool realtime = in_realtime();
  int left = config_.mapping.online.steps_per_keyframe;
  while (mapper_.ready() && !options_.interrupted()) {
    if (realtime && ending_ && since_end_.seconds() > kLastSteps_s) return;
    if (realtime && (ending_ || frames_waiting() > 0) && training_s() > kTrainingShare * busy_s())
      return;
    if (!realtime && left-- <= 0) return;
    mapper_.step();
  }
}

bool OnlineMap::in_realtime() const {
  return config_.run.mode == pipeline::RunMode::realtime;
}

// What is begun after the end of the recording is all late.
bool OnlineMap::in_hurry() const {
  if (in_realtime() && ending_) return true;
  return frames_waiting() > 0 && mapper_.times().of("depth") > kDepthShare * busy_s();
}

// In real time a map that only takes keyframes in never gets any better, so both have their share
// of the time, and frames are lost instead.
std::size_t OnlineMap::frames_waiting() const {
  return in_realtime() && worker_ ? worker_->waiting() : 0;
}

std::map<std::string, double> OnlineMap::times() const {
  std::map<std::string, double> all(times_.seconds().begin(), times_.seconds().end());
  all.insert(mapper_.times().seconds().begin(), mapper_.times().seconds().end());
  return all;
}

std::map<std::string, std::size_t> OnlineMap::not_mapped() const {
  std::map<std::string, std::size_t> counts;
  for (const auto& [intake, count] : mapper_.counts()) {
    if (is_refusal(intake)) counts[std::string(mapping::to_string(intake))] = count;
  }
  return counts;
}

std::optional<std::size_t> OnlineMap::closed_loops() const {
  return loops_ ? std::optional(loops_->closures()) : std::nullopt;
}

// What a long run leaves in its folder on the way.
void OnlineMap::look_after() {
  if (curve_->due(watch_.seconds()) && mapper_.size() > 0) {
    curve_->write(watch_.seconds(), mapper_.iteration(), mapper_.map(), mapper_.keyframes());
  }
  const double every = config_.mapping.checkpoint_every_s;
  if (every <= 0.0 || since_save_.seconds() < every) return;
  write_map(options_.folder, mapper_.map());
  since_save_.reset();
}

mapping::MapperInput OnlineMap::to_input(const pipeline::MapFrame& frame) {
  const auto entry = times_.enter("pictures");
  mapping::MapperInput input;
  input.vio_failing = frame.vio_failing;
  for (const StampedPose& kept : frame.window) {
    input.moved.push_back({kept.stamp.ns, camera_pose(kept.T_world_body)});
  }
  if (frame.image.empty()) return input;
  input.keyframe.stamp_ns = frame.stamp.ns;
  input.keyframe.name = std::to_string(frame.image_stamp.ns);
  input.keyframe.intrinsics = undistort_->intrinsics();
  input.keyframe.T_camera_world = camera_pose(frame.T_world_body);
  const cv::Mat picture = (*undistort_)(frame.image);
  input.keyframe.image = to_tensor(picture);
  input.murky = mapping::is_murky(to_tensor(frame.image));
  input.keyframe.held_out = frame.held_out;
  input.keyframe.number = frame.number;
  input.points = to_points(frame.points);
  if (frame.newest_keyframe) input.follows_ns = frame.newest_keyframe->ns;
  if (config_.mapping.use_dvl_ranges) input.depth_samples = to_rows(frame.ranged);
  if (!frame.held_out && !input.murky) close_loops(frame, picture);
  return input;
}

void OnlineMap::close_loops(const pipeline::MapFrame& frame, const cv::Mat& picture) {
  if (!loops_) return;
  const auto entry = times_.enter("loops");
  LoopJob job;
  job.stamp = frame.stamp;
  job.T_world_camera = frame.T_world_body * T_body_camera_;
  for (const StampedPose& kept : frame.window) {
    job.moved.push_back({kept.stamp, kept.T_world_body * T_body_camera_});
  }
  job.grey = picture;
  if (picture.channels() == 3) cv::cvtColor(picture, job.grey, cv::COLOR_BGR2GRAY);
  loops_->take(std::move(job));
}

std::vector<mapping::Relocated> OnlineMap::next_relocation() {
  std::vector<mapping::Relocated> relocated;
  if (!loops_) return relocated;
  for (const loop::Relocation& moved : loops_->next()) {
    relocated.push_back({moved.stamp.ns, to_tensor(moved.T_after_before)});
  }
  return relocated;
}

Tensor OnlineMap::camera_pose(const SE3& T_world_body) const {
  return to_tensor((T_world_body * T_body_camera_).inverse());
}

bool OnlineMap::refine() {
  torch::set_num_threads(config_.run.threads);
  mapper_.begin_final();
  StatusLine status("refining");
  double loss = 0.0;
  while (!mapper_.final_done()) {
    if (options_.interrupted()) return false;
    const double latest = mapper_.step();
    loss = loss == 0.0 ? latest : 0.98 * loss + 0.02 * latest;
    status.update(mapper_.progress(), fmt::format("iteration {}, {} Gaussians, loss {:.4f}",
                                                  mapper_.iteration(), mapper_.size(), loss));
    look_after();
  }
  return true;
}

void OnlineMap::resume() {
  mapper_.resume(options_.folder / kCheckpoint);
}

// The two large files side by side.
void OnlineMap::save() {
  const auto entry = times_.enter("saving");
  if (mapper_.size() > 0) {
    auto checkpoint =
        std::async(std::launch::async, [this] { mapper_.save(options_.folder / kCheckpoint); });
    write_map(options_.folder, mapper_.map());
    io::write_tum(options_.folder / "keyframes.tum", keyframes());
    checkpoint.get();
  }
  if (curve_) curve_->close();
}

// Poses of the body, as they were corrected.
Trajectory OnlineMap::keyframes() const {
  Trajectory trajectory;
  const mapping::KeyframeStore& store = mapper_.keyframes();
  for (std::size_t i = 0; i < store.size(); ++i) {
    const SE3 T_camera_world = to_se3(mapper_.pose(i));
    trajectory.poses.push_back(
        {Stamp{store[i].stamp_ns}, T_camera_world.inverse() * T_body_camera_.inverse()});
  }
  return trajectory;
}

}  // namespace apvi::bridge
