// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/visual_pipeline.hpp"

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/core/stopwatch.hpp"

namespace apvi::pipeline {
namespace {

constexpr std::size_t kQueue = 32;

// In real time an image is not looked at when so many are waiting behind it.
constexpr std::size_t kMostBehind = 2;

std::vector<CameraCalibration> first_cameras(const Rig& rig, std::size_t count) {
  return {rig.cameras.begin(), rig.cameras.begin() + static_cast<std::ptrdiff_t>(count)};
}

// A cap on time makes results depend on the machine; only real time needs one.
vio::Config without_cap(vio::Config config, RunMode mode) {
  if (mode != RunMode::realtime) config.window.max_solve_s = 1e3;
  return config;
}

// A file that cannot be decoded is a lost image, not the end of the run.
cv::Mat decoded(const ImageFrame& image) {
  if (!image.decode) return {};
  try {
    return image.decode();
  } catch (const RunError& error) {
    log::warning("camera {}: {}", image.camera, error.what());
    return {};
  }
}

}  // namespace

VisualPipeline::VisualPipeline(const RunConfig& config, const Rig& rig, std::size_t cameras,
                               Sink sink, MapSink* map)
    : mode_(config.run.mode),
      tracker_(config.vio.tracker, first_cameras(rig, cameras)),
      localizer_(without_cap(config.vio, config.run.mode), config.fusion, config.freeze, rig),
      sink_(std::move(sink)),
      map_(map) {
  if (map_ != nullptr) map_feed_.emplace(config, rig);
  if (mode_ == RunMode::sequential) return;
  localize_worker_ = std::make_unique<Worker<Tracked>>(
      kQueue, Overflow::block, [this](const Tracked& tracked) { localize(tracked); });
  track_worker_ = std::make_unique<Worker<FrameJob>>(kQueue, Overflow::block, [this](FrameJob job) {
    const bool look = mode_ != RunMode::realtime || track_worker_->waiting() <= kMostBehind;
    localize_worker_->push(track(std::move(job), look));
  });
}

void VisualPipeline::push(FrameJob job) {
  if (mode_ == RunMode::sequential) return localize(track(std::move(job), true));
  // A stage that has ended says why.
  if (localize_worker_->ended() || !track_worker_->push(std::move(job))) finish();
}

void VisualPipeline::finish() {
  if (mode_ == RunMode::sequential) return;
  track_worker_->wait();
  localize_worker_->wait();
}

void VisualPipeline::stop() {
  if (mode_ == RunMode::sequential) return;
  track_worker_->stop();
  localize_worker_->stop();
}

VisualPipeline::Tracked VisualPipeline::track(FrameJob job, bool look) {
  if (skipped_turn_ && job.R_before_now) {
    job.R_before_now = (*skipped_turn_ * *job.R_before_now).normalized();
  }
  if (!look) {
    ++dropped_images_;
    skipped_turn_ = job.R_before_now;
    return {.job = std::move(job), .frame = std::nullopt, .image = {}};
  }
  skipped_turn_.reset();
  Stopwatch watch;
  std::vector<cv::Mat> images;
  for (const ImageFrame& image : job.images) images.push_back(decoded(image));
  Tracked tracked{.job = std::move(job), .frame = std::nullopt, .image = {}};
  tracked.decode_s = watch.seconds();
  watch.reset();
  if (map_ != nullptr && !images.empty()) tracked.image = images.front();
  tracked.frame = tracker_.process(images, tracked.job.stamp, tracked.job.R_before_now);
  tracked.track_s = watch.seconds();
  return tracked;
}

void VisualPipeline::localize(const Tracked& tracked) {
  FrameOutput output = localizer_.process(tracked.job, tracked.frame);
  output.timing.decode_s = tracked.decode_s;
  output.timing.track_s = tracked.track_s;
  sink_(output);
  if (map_ == nullptr) return;
  auto news = map_feed_->process(tracked.job, tracked.image, output, localizer_.window());
  if (news) map_->take(*std::move(news));
}

}  // namespace apvi::pipeline
