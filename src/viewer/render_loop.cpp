// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/render_loop.hpp"

#include <algorithm>
#include <exception>
#include <utility>

#include "apvi/core/log.hpp"
#include "viewer/frame_image.hpp"

namespace apvi::viewer {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kPoll(20);  // views at rest and maps that change
constexpr int kMovingQuality = 80;              // of JPEG
constexpr int kRestQuality = 93;

double seconds(Clock::duration d) {
  return std::chrono::duration<double>(d).count();
}

double focal_px(const View& view) {
  return view.viewpoint.focal * view.viewpoint.height;
}

ImageHeader header_of(const View& view, const LayerImage& image) {
  return {.layer = view.layer,
          .width = image.bgr.cols,
          .height = image.bgr.rows,
          .near_m = image.near_m,
          .far_m = image.far_m};
}

// The point that a pixel's middle shows at a depth along the optical axis, in the camera frame.
Eigen::Vector3d camera_point(const MeasureMessage& m, double depth) {
  const Viewpoint& v = m.viewpoint;
  const double focal = v.focal * v.height;
  return {depth * (m.column + 0.5 - 0.5 * v.width) / focal,
          depth * (m.row + 0.5 - 0.5 * v.height) / focal, depth};
}

}  // namespace

RenderLoop::RenderLoop(Scene& scene, double share)
    : scene_(scene),
      share_(std::clamp(share, 0.01, 1.0)),
      thread_([this](const std::stop_token& stop) { run(stop); }) {}

RenderLoop::~RenderLoop() {
  stop();
}

void RenderLoop::stop() {
  thread_.request_stop();
  if (thread_.joinable()) thread_.join();
}

void RenderLoop::add(std::uint64_t watcher, Deliver deliver) {
  const std::scoped_lock lock(mutex_);
  seats_[watcher].deliver = std::move(deliver);
}

void RenderLoop::remove(std::uint64_t watcher) {
  const std::scoped_lock lock(mutex_);
  seats_.erase(watcher);
}

void RenderLoop::receive(std::uint64_t watcher, const Message& message) {
  {
    const std::scoped_lock lock(mutex_);
    if (const auto seat = seats_.find(watcher); seat != seats_.end()) {
      seat->second.watcher.receive(message, Clock::now());
    }
  }
  changed_.notify_all();
}

void RenderLoop::written(std::uint64_t watcher, std::uint32_t frame) {
  const std::scoped_lock lock(mutex_);
  if (const auto seat = seats_.find(watcher); seat != seats_.end()) {
    seat->second.watcher.written(frame);
  }
}

// Round robin: the search begins after the watcher served last. Called with the lock held.
std::optional<RenderLoop::Turn> RenderLoop::next_turn() {
  const auto now = Clock::now();
  const std::uint64_t version = scene_.version();
  auto seat = seats_.upper_bound(last_served_);
  for (std::size_t i = 0; i < seats_.size(); ++i, ++seat) {
    if (seat == seats_.end()) seat = seats_.begin();
    if (auto job = seat->second.watcher.next(now, version)) {
      last_served_ = seat->first;
      return Turn{seat->first, std::move(*job)};
    }
  }
  return std::nullopt;
}

void RenderLoop::run(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    std::optional<Turn> turn;
    {
      std::unique_lock lock(mutex_);
      changed_.wait_for(lock, stop, kPoll, [&] { return (turn = next_turn()).has_value(); });
    }
    if (!turn) continue;
    const auto began = Clock::now();
    execute(*turn);
    rest(stop, Clock::now() - began);
  }
}

void RenderLoop::execute(const Turn& turn) {
  try {
    if (const auto* frame = std::get_if<FrameJob>(&turn.job)) draw(turn.watcher, *frame);
    if (const auto* image = std::get_if<SnapshotMessage>(&turn.job)) snapshot(turn.watcher, *image);
    if (const auto* point = std::get_if<MeasureMessage>(&turn.job)) measure(turn.watcher, *point);
  } catch (const std::exception& error) {
    log::warning("viewer: a view was not drawn: {}", error.what());
    skip(turn);
  }
}

void RenderLoop::skip(const Turn& turn) {
  const auto* frame = std::get_if<FrameJob>(&turn.job);
  const std::scoped_lock lock(mutex_);
  const auto seat = seats_.find(turn.watcher);
  if (frame != nullptr && seat != seats_.end()) seat->second.watcher.skipped(frame->frame);
}

void RenderLoop::draw(std::uint64_t watcher, const FrameJob& job) {
  const auto began = Clock::now();
  const auto rendering = scene_.render(job.view);
  std::string data;
  if (rendering) {
    const LayerImage image = layer_image(*rendering, job.view.layer, focal_px(job.view));
    ImageHeader header = header_of(job.view, image);
    header.id = job.frame;
    header.view = job.view_id;
    header.complete = job.complete;
    data = with_header(header, jpeg(image.bgr, job.complete ? kRestQuality : kMovingQuality));
  }
  const auto now = Clock::now();
  const std::scoped_lock lock(mutex_);
  const auto seat = seats_.find(watcher);
  if (seat == seats_.end()) return;
  if (!rendering) return seat->second.watcher.skipped(job.frame);
  const auto moving =
      std::ranges::count_if(seats_, [](const auto& s) { return s.second.watcher.moving(); });
  const double sharing = static_cast<double>(std::max<std::ptrdiff_t>(1, moving)) / share_;
  seat->second.watcher.sent(job.frame, seconds(now - began) * sharing, data.size(), now);
  seat->second.deliver({.data = std::move(data), .binary = true, .frame = job.frame});
}

void RenderLoop::snapshot(std::uint64_t watcher, const SnapshotMessage& job) {
  const auto rendering = scene_.render(job.view);
  if (!rendering) return;
  const LayerImage image = layer_image(*rendering, job.view.layer, focal_px(job.view));
  ImageHeader header = header_of(job.view, image);
  header.kind = ImageKind::snapshot;
  header.id = job.id;
  deliver(watcher, {.data = with_header(header, png(image.bgr)), .binary = true});
}

void RenderLoop::measure(std::uint64_t watcher, const MeasureMessage& job) {
  std::optional<Eigen::Vector3d> point;
  double range_m = 0.0;
  if (const auto depth = scene_.depth(job.viewpoint, job.column, job.row)) {
    const Eigen::Vector3d seen = camera_point(job, *depth);
    range_m = seen.norm();
    point = job.viewpoint.T_world_camera * seen;
  }
  deliver(watcher, {.data = point_message(job.id, point, range_m)});
}

void RenderLoop::deliver(std::uint64_t watcher, Outgoing message) {
  const std::scoped_lock lock(mutex_);
  const auto seat = seats_.find(watcher);
  if (seat != seats_.end()) seat->second.deliver(std::move(message));
}

void RenderLoop::rest(const std::stop_token& stop, Clock::duration worked) {
  if (share_ >= 1.0) return;
  const auto pause = worked * (1.0 / share_ - 1.0);
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, stop, pause, [] { return false; });
}

}  // namespace apvi::viewer
