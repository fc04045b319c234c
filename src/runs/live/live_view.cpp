// SPDX-License-Identifier: BSD-3-Clause
#include "runs/live/live_view.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "apvi/core/log.hpp"
#include "core/stopwatch.hpp"
#include "runs/live/live_scene.hpp"
#include "runs/live/track_image.hpp"
#include "viewer/message.hpp"

namespace apvi::runs {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kPeriod(200);  // of poses and camera images
constexpr int kStatusEvery = 5;       // of these periods
constexpr double kMinSpan_s = 0.1;

/// The newest frame, for the page's figures.
struct Newest {
  std::string state = "waiting";
  int corners = 0;
  std::size_t frames = 0;
  double frame_s = 0.0;  ///< tracking and estimation
};

}  // namespace

struct LiveView::Implementation {
  Implementation(const std::string& name, const viewer::ServerOptions& options)
      : scene(name),
        server(scene, options),
        thread([this](const std::stop_token& stop) { run(stop); }) {}

  void run(const std::stop_token& stop) {
    std::mutex none;
    std::unique_lock lock(none);
    for (int turn = 0; !stop.stop_requested(); ++turn) {
      publish(turn);
      wake.wait_for(lock, stop, kPeriod, [] { return false; });
    }
  }

  void publish(int turn) {
    try {
      publish_poses();
      publish_pings();
      publish_image();
      if (const auto error = scene.take_saved()) server.broadcast(viewer::saved_message(*error));
      if (const std::string map = scene.take_map_message(); !map.empty()) server.broadcast(map);
      if (turn % kStatusEvery != 0) return;
      publish_status();
      publish_sensors();
    } catch (const std::exception& error) {
      log::warning("viewer: {}", error.what());
    }
  }

  void publish_poses() {
    const auto poses = scene.take_new_poses();
    if (!poses) return server.broadcast(viewer::scene_message(scene.description()));
    if (!poses->empty()) server.broadcast(viewer::poses_message(*poses));
  }

  void publish_pings() {
    const std::vector<viewer::BeamPing> pings = scene.take_new_pings();
    if (!pings.empty()) server.broadcast(viewer::pings_message(pings));
  }

  void publish_sensors() {
    server.broadcast(viewer::sensors_message(scene.sensors()));
    {
      const std::scoped_lock lock(mutex);
      if (corrections) scene.set_loops(corrections->loops());
    }
    if (const auto loops = scene.take_loops()) server.broadcast(viewer::loops_message(*loops));
  }

  void publish_image() {
    std::optional<TrackImage> image;
    {
      const std::scoped_lock lock(mutex);
      image = std::exchange(newest_image, std::nullopt);
    }
    if (!image) return;
    server.broadcast_image(camera_image(*image));
  }

  void publish_status() {
    Newest now;
    {
      const std::scoped_lock lock(mutex);
      now = newest;
      newest.frames = 0;
    }
    const double span_s = since_status.seconds();
    since_status.reset();
    const double rate = static_cast<double>(now.frames) / std::max(span_s, kMinSpan_s);
    server.broadcast(
        viewer::status_message({{"State", now.state},
                                {"Frames", fmt::format("{:.1f} /s", rate)},
                                {"Time per frame", fmt::format("{:.0f} ms", 1e3 * now.frame_s)},
                                {"Corners", fmt::format("{}", now.corners)},
                                {"Keyframes", fmt::format("{}", scene.keyframes())}},
                               scene.paused()));
  }

  LiveScene scene;
  std::mutex mutex;
  Newest newest;
  std::optional<TrackImage> newest_image;
  std::optional<CameraCalibration> camera;
  std::shared_ptr<loop_closure::CorrectionLog> corrections;  // of the pose graph
  Stopwatch since_status;
  std::condition_variable_any wake;
  viewer::Server server;
  std::jthread thread;  // last: it uses the others
};

LiveView::LiveView(const std::string& name, const viewer::ServerOptions& options)
    : implementation_(std::make_unique<Implementation>(name, options)) {
  log::info("open {} in a browser", implementation_->server.url());
}

LiveView::~LiveView() = default;

void LiveView::begin(const Rig& rig) {
  implementation_->scene.set_rig(rig);
  if (!rig.cameras.empty()) implementation_->camera = rig.cameras.front();
  implementation_->server.broadcast(viewer::scene_message(implementation_->scene.description()));
}

void LiveView::sample(const SensorEvent& event) {
  implementation_->scene.add(event);
}

void LiveView::ping(const localization::PingOutput& output) {
  const dipo::Estimate& estimate = output.estimate;
  implementation_->scene.add({estimate.stamp, estimate.state.nav.pose()}, "dipo_only");
  const std::scoped_lock lock(implementation_->mutex);
  Newest& newest = implementation_->newest;
  newest.state = "dipo_only";
  ++newest.frames;
}

void LiveView::frame(const localization::FrameOutput& output) {
  implementation_->scene.add(output);
  const std::scoped_lock lock(implementation_->mutex);
  Newest& newest = implementation_->newest;
  newest.state = output.pose_source();
  newest.corners = output.statistics.tracked;
  newest.frame_s = output.timing.track_s + output.timing.localize_s;
  ++newest.frames;
}

void LiveView::image(const localization::MapFrame& frame) {
  if (frame.corrections) {
    const std::scoped_lock lock(implementation_->mutex);
    implementation_->corrections = frame.corrections;
  }
  if (frame.image.empty() || !implementation_->camera) return;
  TrackImage image{
      .image = frame.image,
      .camera = implementation_->camera->model,
      .T_world_camera =
          frame.T_world_body * frame.T_body_camera.value_or(implementation_->camera->T_body_camera),
      .points = {}};
  for (const localization::MapPoint& point : frame.points) image.points.push_back(point.position);
  const std::scoped_lock lock(implementation_->mutex);
  implementation_->newest_image = std::move(image);
}

void LiveView::map_begins(slam::AsyncMapper& mapper, std::function<void()> save) {
  implementation_->scene.set_mapper(&mapper, std::move(save));
}

void LiveView::map_ends() {
  implementation_->scene.set_mapper(nullptr, {});
}

void LiveView::map_saved(const std::string& error) {
  implementation_->scene.set_saved(error);
}

}  // namespace apvi::runs
