// SPDX-License-Identifier: BSD-3-Clause
#include "localization/visual_pipeline.hpp"

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/stopwatch.hpp"
#include "sensors/reduced_camera.hpp"

namespace apvi::localization {
namespace {

constexpr std::size_t kQueueSize = 32;

// In real time an image is skipped when more than this many wait behind it.
constexpr std::size_t kMaxQueuedImages = 2;

std::vector<CameraCalibration> first_cameras(const Rig& rig, std::size_t count) {
  return {rig.cameras.begin(), rig.cameras.begin() + static_cast<std::ptrdiff_t>(count)};
}

// A time limit makes results depend on the machine; only real time needs one.
vio::Config vio_config(const Options& options) {
  vio::Config out = options.vio;
  out.gravity = options.gravity;
  if (options.run.mode != RunMode::realtime) out.window.max_solve_s = 1e3;
  return out;
}

}  // namespace

VisualPipeline::VisualPipeline(const Options& options, const Rig& rig, const ActiveSensors& sensors,
                               Sink sink, MapSink* map, MapToOdometry map_to_odometry)
    : mode_(options.run.mode),
      image_monitor_(first_cameras(rig, sensors.cameras)),
      tracker_(options.vio.tracker, first_cameras(rig, sensors.cameras)),
      fusion_stage_(vio_config(options), options.fusion, options.freeze,
                    reduced(rig, options.vio.tracker.max_image_side_px), sensors,
                    options.dipo.inertial.segment_gap_s),
      sink_(std::move(sink)),
      map_(map),
      map_to_odometry_(std::move(map_to_odometry)) {
  // Without an IMU the vertical is unknown.
  if (options.smoothing.enabled && sensors.imu) {
    smoother_.emplace(options, rig, sensors, map != nullptr);
  }
  if (map_ != nullptr || smoother_) map_feed_.emplace(options, rig);
  if (mode_ == RunMode::sequential) return;
  fusion_worker_ = std::make_unique<Worker<Tracked>>(
      kQueueSize, Overflow::block, [this](const Tracked& tracked) { fuse(tracked); });
  tracking_worker_ =
      std::make_unique<Worker<FrameJob>>(kQueueSize, Overflow::block, [this](FrameJob job) {
        const bool process_image =
            mode_ != RunMode::realtime || tracking_worker_->waiting() <= kMaxQueuedImages;
        fusion_worker_->push(track(std::move(job), process_image));
      });
}

void VisualPipeline::push(FrameJob job) {
  if (mode_ == RunMode::sequential) return fuse(track(std::move(job), true));
  // A stage has stopped: finish() rethrows its exception.
  if (fusion_worker_->closed() || !tracking_worker_->push(std::move(job))) finish();
}

void VisualPipeline::finish() {
  if (mode_ != RunMode::sequential) {
    tracking_worker_->wait();
    fusion_worker_->wait();
  }
  if (smoother_) smoother_->finish();
}

void VisualPipeline::adjust(const std::function<void(int iteration)>& progress) {
  if (smoother_) smoother_->adjust(progress);
}

void VisualPipeline::stop() {
  if (mode_ != RunMode::sequential) {
    tracking_worker_->stop();
    fusion_worker_->stop();
  }
  if (smoother_) smoother_->stop();
}

VisualPipeline::Tracked VisualPipeline::track(FrameJob job, bool process_image) {
  if (skipped_rotation_ && job.R_before_now) {
    job.R_before_now = (*skipped_rotation_ * *job.R_before_now).normalized();
  }
  if (!process_image) {
    ++dropped_images_;
    skipped_rotation_ = job.R_before_now;
    return {.job = std::move(job), .frame = std::nullopt, .image = {}};
  }
  skipped_rotation_.reset();
  Stopwatch watch;
  std::vector<cv::Mat> images;
  for (const ImageFrame& image : job.images) {
    images.push_back(image_monitor_.decode(image));
  }
  Tracked tracked{.job = std::move(job), .frame = std::nullopt, .image = {}};
  tracked.decode_s = watch.seconds();
  watch.reset();
  if (map_feed_ && !images.empty()) tracked.image = images.front();
  tracked.frame = tracker_.process(images, tracked.job.stamp, tracked.job.R_before_now);
  tracked.track_s = watch.seconds();
  return tracked;
}

void VisualPipeline::fuse(const Tracked& tracked) {
  FrameOutput output = fusion_stage_.process(tracked.job, tracked.frame);
  output.timing.decode_s = tracked.decode_s;
  output.timing.track_s = tracked.track_s;
  sink_(output);
  if (!map_feed_) return;
  auto map_frame = map_feed_->process(tracked.job, tracked.image, output, fusion_stage_.window());
  if (smoother_) {
    smoother_->add(output, tracked.image, map_frame);
    if (map_to_odometry_) map_to_odometry_(smoother_->T_map_odom());
  }
  if (map_ == nullptr || !map_frame) return;
  if (smoother_) smoother_->connect(*map_frame);
  map_->push(*std::move(map_frame));
}

}  // namespace apvi::localization
