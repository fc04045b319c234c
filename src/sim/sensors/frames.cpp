// SPDX-License-Identifier: BSD-3-Clause
#include "sim/sensors/frames.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <system_error>
#include <thread>
#include <vector>

#include "apvi/core/error.hpp"
#include "core/status_line.hpp"
#include "sim/motion/off_path.hpp"
#include "sim/render/renderer.hpp"
#include "sim/render/shading.hpp"
#include "sim/spectral/exposure_track.hpp"
#include "sim/world/fish.hpp"
#include "sim/world/moving_scene.hpp"
#include "sim/writers/formats.hpp"

namespace apvi::sim {
namespace {

namespace fs = std::filesystem;

struct Job {
  std::size_t camera = 0;
  FrameTime frame;
  fs::path image;
};

// Writes a temporary file and renames it.
void write_atomically(const fs::path& path, const std::string& bytes) {
  fs::path temporary = path;
  temporary += ".tmp";
  write_file(temporary, bytes);
  std::error_code error;
  fs::rename(temporary, path, error);
  if (error) fail_run("{}: cannot write this file: {}", path.string(), error.message());
}

std::string png_bytes(const cv::Mat& image) {
  constexpr int kCompression =
      3;  // higher levels are much slower and barely smaller on noisy images
  std::vector<uchar> buffer;
  if (!cv::imencode(".png", image, buffer, {cv::IMWRITE_PNG_COMPRESSION, kCompression})) {
    fail_run("cannot encode a PNG image");
  }
  return {buffer.begin(), buffer.end()};
}

// With halved color resolution, as cameras do.
std::string jpeg_bytes(const cv::Mat& image, int quality) {
  std::vector<uchar> buffer;
  if (!cv::imencode(".jpg", image, buffer, {cv::IMWRITE_JPEG_QUALITY, quality}))
    fail_run("cannot encode a JPEG image");
  return {buffer.begin(), buffer.end()};
}

// Portable float map: rows from bottom to top, little endian (negative scale).
std::string pfm_bytes(const cv::Mat& depth) {
  std::string bytes = fmt::format("Pf\n{} {}\n-1.0\n", depth.cols, depth.rows);
  for (int row = depth.rows - 1; row >= 0; --row) {
    bytes.append(depth.ptr<char>(row), static_cast<std::size_t>(depth.cols) * sizeof(float));
  }
  return bytes;
}

std::array<double, 3> triple(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

std::string medium_json(const RenderedFrame& frame, Physics physics) {
  nlohmann::ordered_json json = {{"beta_d", triple(frame.medium.beta_d)},
                                 {"beta_b", triple(frame.medium.beta_b)},
                                 {"b_inf", triple(frame.medium.b_inf)},
                                 {"gain", frame.gain}};
  if (physics == Physics::spectral) {
    json["white_balance"] = triple(frame.development.white_balance);
    json["effective"] = true;
  }
  return json.dump(2) + "\n";
}

bool is_undisturbed(const Disturbance& d) {
  return !d.attenuation_length_m && d.darkness == 0.0 && d.silt == 0.0 && d.exposure == 1.0;
}

class FrameRenderer {
 public:
  FrameRenderer(const fs::path& root, const Scene& scene, const EventSchedule& events,
                const Recording& recording, const TriangleMesh& mesh, const RayCaster& world,
                int threads)
      : root_(root),
        scene_(scene),
        events_(events),
        recording_(recording),
        world_(world),
        fish_(scene.config.world, scene.seed()) {
    const SceneConfig& config = scene.config;
    renderers_.reserve(scene.rig.cameras.size());
    for (const CameraCalibration& camera : scene.rig.cameras) {
      renderers_.emplace_back(mesh, world, camera.model,
                              RendererConfig{config.water, config.light, config.camera.effects,
                                             config.physics, config.spectral},
                              scene.seed(), threads, camera.port);
    }
    if (config.physics == Physics::spectral) meter_all(threads);
  }

  void make(const Job& job) const {
    constexpr int kCameraBit = 40;  // every camera has its own noise
    ImageRequest request = request_at(job.camera, job.frame.truth);
    request.frame = job.frame.index + (static_cast<std::uint64_t>(job.camera) << kCameraBit);
    request.truth = wants_truth(job);
    if (!tracks_.empty()) {
      const ExposureTrack& track = tracks_[job.camera];
      request.development = track.at(seconds_between(kSimulationStart, job.frame.truth));
      request.clear_development = track.clear();
    }
    const RenderedFrame rendered = renderers_[job.camera].render(request);
    if (wants_truth(job)) {
      write_frame_truth(job, rendered, request.disturbance);
      write_off_path(job, request, rendered.gain);
    }
    if (job.camera == 0 && !rendered.moving.empty()) {
      write_atomically(truth_file(job, "moving", ".png"), png_bytes(rendered.moving));
    }
    write_atomically(job.image, image_bytes(rendered.image));
  }

  /// Exposure and white balance of the frames of cam0; none with paper physics.
  Exposures exposures() const {
    Exposures all;
    if (tracks_.empty()) return all;
    for (const FrameTime& frame : recording_.frames) {
      const double time_s = seconds_between(kSimulationStart, frame.truth);
      all.push_back(tracks_.front().at(time_s));
      all.back().gain *= events_.disturbance(time_s).exposure;
    }
    return all;
  }

 private:
  static constexpr double kMeterStep_s = 0.2;

  ImageRequest request_at(std::size_t camera, Stamp stamp) const {
    ImageRequest request;
    request.stamp = stamp;
    request.T_world_camera = [this, camera](Stamp at) {
      return recording_.spline.at(at).T_world_body * scene_.rig.cameras[camera].T_body_camera;
    };
    const double time_s = seconds_between(kSimulationStart, stamp);
    request.disturbance = events_.disturbance(time_s);
    if (!fish_.empty()) {
      request.moving = std::make_shared<MovingScene>(
          fish_.at(time_s), world_, sun_direction(scene_.config.light).cast<float>());
    }
    return request;
  }
  // What the exposure control of each camera sees, several times per second.
  void meter_all(int threads) {
    const auto count = static_cast<int>(std::ceil(scene_.config.duration_s / kMeterStep_s)) + 1;
    for (std::size_t camera = 0; camera < renderers_.size(); ++camera) {
      std::vector<Metering> meterings(static_cast<std::size_t>(count));
      parallel_for(count, threads, [&](int i) {
        const double time_s = std::min(i * kMeterStep_s, scene_.config.duration_s);
        const Stamp stamp = kSimulationStart + Duration::from_seconds(time_s);
        meterings[static_cast<std::size_t>(i)] = {
            time_s, renderers_[camera].meter(request_at(camera, stamp))};
      });
      tracks_.emplace_back(meterings, scene_.config.camera.effects, scene_.config.spectral,
                           renderers_[camera].fixed_white_balance());
    }
  }
  std::string image_bytes(const cv::Mat& image) const {
    return image_extension(scene_.config) == ".jpg"
               ? jpeg_bytes(image, scene_.config.spectral.jpeg_quality)
               : png_bytes(image);
  }
  bool wants_truth(const Job& job) const {
    const auto every = static_cast<std::uint64_t>(scene_.config.truth.image_every);
    return job.camera == 0 && every > 0 && job.frame.index % every == 0;
  }
  void write_frame_truth(const Job& job, const RenderedFrame& rendered,
                         const Disturbance& disturbance) const {
    write_atomically(truth_file(job, "depth", ".pfm"), pfm_bytes(rendered.depth));
    write_atomically(truth_file(job, "clear", ".png"), png_bytes(rendered.clear));
    if (!is_undisturbed(disturbance)) return;  // store the nominal medium, not that of an event
    write_atomically(truth_file(job, "medium", ".json"),
                     medium_json(rendered, scene_.config.physics));
  }
  // In the exposure of the frame itself.
  void write_off_path(const Job& job, ImageRequest request, double gain) const {
    constexpr int kOffPathBit = 48;
    const auto every = static_cast<std::uint64_t>(scene_.config.truth.image_every);
    const auto view =
        off_path_view(request.T_world_camera(request.stamp), scene_.config.truth.off_path,
                      job.frame.index / every % 2 == 1, world_);
    if (!view) return;
    request.T_world_camera = [along = request.T_world_camera, view = *view](Stamp at) {
      return along(at) * view;
    };
    request.frame += std::uint64_t{1} << kOffPathBit;
    request.truth = false;
    request.gain = gain;
    const RenderedFrame rendered = renderers_[job.camera].render(request);
    write_atomically(truth_file(job, "off_path", image_extension(scene_.config)),
                     image_bytes(rendered.image));
    write_atomically(truth_file(job, "off_path", ".json"), off_path_json(*view));
  }
  fs::path truth_file(const Job& job, const char* kind, std::string_view extension) const {
    return root_ / "truth" / kind / fmt::format("{}{}", job.frame.stamp.ns, extension);
  }

  const fs::path& root_;
  const Scene& scene_;
  const EventSchedule& events_;
  const Recording& recording_;
  const RayCaster& world_;
  Fish fish_;
  std::vector<Renderer> renderers_;
  std::vector<ExposureTrack> tracks_;  ///< one per camera; none with paper physics
};

// Calls `work` for every index below `count` on several threads; the first exception is rethrown
// here. `idle` runs on this thread ten times per second and cancels the remaining work by returning
// false.
void for_each_index(std::size_t count, int threads, const std::function<void(std::size_t)>& work,
                    const std::function<bool(std::size_t done)>& idle) {
  std::atomic<std::size_t> next = 0;
  std::atomic<std::size_t> done = 0;
  std::atomic<bool> stop = false;
  std::mutex mutex;
  std::condition_variable changed;
  std::exception_ptr error;
  int running = threads;
  const auto loop = [&] {
    try {
      for (std::size_t i = 0; !stop && (i = next++) < count; ++done) work(i);
    } catch (...) {
      const std::lock_guard lock(mutex);
      if (!error) error = std::current_exception();
      stop = true;
    }
    const std::lock_guard lock(mutex);
    --running;
    changed.notify_one();
  };
  std::vector<std::jthread> pool;
  for (int i = 0; i < threads; ++i) pool.emplace_back(loop);
  std::unique_lock lock(mutex);
  while (!changed.wait_for(lock, std::chrono::milliseconds(100), [&] { return running == 0; })) {
    lock.unlock();
    if (!idle(done)) stop = true;
    lock.lock();
  }
  lock.unlock();
  pool.clear();
  if (error) std::rethrow_exception(error);
}

}  // namespace

Exposures render_frames(const fs::path& root, OutputFormat format, const Scene& scene,
                        const EventSchedule& events, const Recording& recording,
                        const TriangleMesh& mesh, const RayCaster& world, int threads,
                        const InterruptGuard& interrupt) {
  std::vector<Job> jobs;
  for (std::size_t camera = 0; camera < scene.rig.cameras.size(); ++camera) {
    for (const FrameTime& frame : recording.frames) {
      const fs::path image =
          image_path(root, format, camera, frame.stamp, image_extension(scene.config));
      if (!fs::exists(image)) jobs.push_back({camera, frame, image});
    }
  }
  const FrameRenderer renderer(root, scene, events, recording, mesh, world, threads);
  if (jobs.empty()) return renderer.exposures();
  const std::size_t total = recording.frames.size() * scene.rig.cameras.size();
  const std::size_t before = total - jobs.size();
  StatusLine status("frames");
  for_each_index(
      jobs.size(), threads, [&](std::size_t i) { renderer.make(jobs[i]); },
      [&](std::size_t done) {
        const std::size_t ready = before + done;
        status.update(static_cast<double>(ready) / static_cast<double>(total),
                      fmt::format("{} of {}", ready, total));
        return !interrupt.interrupted();
      });
  status.finish();
  return renderer.exposures();
}

}  // namespace apvi::sim
