// SPDX-License-Identifier: BSD-3-Clause
// Soak test of the mapper on a long survey: checks that memory and time per keyframe stay bounded.
// Images show an unbounded sea floor, ray-cast through water; poses are exact.
//
//   map_soak [MINUTES] [KEYFRAMES_PER_S] [WIDTH] [KEY=VALUE]...
//
// prints a line every minute of the dive. The mapper runs with default settings, quadtree insertion
// and the water medium, plus overrides (e.g. mapping.online.image_memory_mib=100). Each keyframe is
// followed by as many optimization steps as with `run.mode: replay`.
#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "core/stopwatch.hpp"
#include "gaussians/device.hpp"
#include "mapping/evaluation.hpp"
#include "mapping/mapper.hpp"
#include "runs/run_config.hpp"
#include "synthetic_dive.hpp"

namespace apvi::bench {
namespace {

using torch::Tensor;

constexpr double kSpeed = 0.4;                // [m/s]
constexpr double kAltitude = 2.0;             // above the floor [m]
constexpr double kLane_m = 24.0;              // length of a survey line
constexpr double kLaneWidth = 0.8;            // line spacing [m]
constexpr double kTilt = 0.9;                 // camera pitch below horizontal [rad]
constexpr int kRayIterations = 12;            // of the ray-floor intersection
constexpr std::size_t kScoredKeyframes = 10;  // newest keyframes in the PSNR

// Height of the floor at points [n], within +-0.25 m.
Tensor floor_height(const Tensor& x, const Tensor& y) {
  return 0.15 * torch::sin(1.3 * x + 0.4 * y) + 0.1 * torch::sin(2.1 * y - 0.7 * x);
}

// Deterministic pseudo-random value in [0, 1) per grid cell.
Tensor hashed(const Tensor& i, const Tensor& j) {
  const Tensor h = torch::sin(12.9898 * i + 78.233 * j) * 43758.5453;
  return h - torch::floor(h);
}

Tensor value_noise(const Tensor& x, const Tensor& y) {
  const Tensor i = torch::floor(x);
  const Tensor j = torch::floor(y);
  const auto smooth = [](const Tensor& t) { return t * t * (3.0 - 2.0 * t); };
  const Tensor u = smooth(x - i);
  const Tensor v = smooth(y - j);
  const Tensor near = hashed(i, j) * (1 - u) + hashed(i + 1, j) * u;
  const Tensor far = hashed(i, j + 1) * (1 - u) + hashed(i + 1, j + 1) * u;
  return near * (1 - v) + far * v;
}

// Range to the floor of rays from `eye` [3] along `rays` [n,3].
Tensor intersect_floor(const Tensor& eye, const Tensor& rays) {
  Tensor range = -eye[2] / rays.select(1, 2).clamp_max(-0.05);
  for (int k = 0; k < kRayIterations; ++k) {
    const Tensor at = eye + range.unsqueeze(1) * rays;
    const Tensor above = at.select(1, 2) - floor_height(at.select(1, 0), at.select(1, 1));
    range = range + 0.7 * above / -rays.select(1, 2).clamp_max(-0.05);
  }
  return range;
}

/// Camera image [H,W,3] uint8.
Tensor render_seafloor(const Tensor& T_world_camera, const gaussians::Intrinsics& k) {
  const auto options = torch::kFloat64;
  const Tensor u = (torch::arange(k.width, options) + 0.5 - k.cx) / k.fx;
  const Tensor v = (torch::arange(k.height, options) + 0.5 - k.cy) / k.fy;
  const std::vector<Tensor> grid = torch::meshgrid({v, u}, "ij");
  Tensor rays = torch::stack({grid[1], grid[0], torch::ones_like(grid[0])}, 2).reshape({-1, 3});
  rays = rays / rays.norm(2, 1, true);
  rays = torch::mm(rays, T_world_camera.slice(0, 0, 3).slice(1, 0, 3).t());
  const Tensor eye = T_world_camera.slice(0, 0, 3).select(1, 3);
  const Tensor range = intersect_floor(eye, rays);
  const Tensor at = eye + range.unsqueeze(1) * rays;
  const Tensor x = at.select(1, 0);
  const Tensor y = at.select(1, 1);
  const Tensor light = 0.15 + 0.3 * value_noise(2.0 * x, 2.0 * y) +
                       0.35 * value_noise(9.0 * x, 9.0 * y) + 0.2 * value_noise(31.0 * x, 31.0 * y);
  const Tensor sand = torch::tensor({0.9, 0.75, 0.55}, options);
  const Tensor clear = light.unsqueeze(1) * sand;
  const Tensor beta = torch::tensor({0.25, 0.12, 0.10}, options);
  const Tensor water = torch::tensor({0.05, 0.25, 0.30}, options);
  const Tensor through = torch::exp(-range.unsqueeze(1) * beta);
  const Tensor seen = clear * through + water * (1.0 - through);
  return (255.0 * seen).round().clamp(0, 255).to(torch::kUInt8).reshape({k.height, k.width, 3});
}

/// T_world_camera of a lawnmower survey at `t` seconds.
Tensor pose_at(double t) {
  const double way = kSpeed * t;
  const int lane = static_cast<int>(way / (kLane_m + kLaneWidth));
  const double along = way - lane * (kLane_m + kLaneWidth);
  const double in_lane = std::min(along, kLane_m);
  const double side = lane * kLaneWidth + std::max(0.0, along - kLane_m);
  const double x = lane % 2 == 0 ? in_lane : kLane_m - in_lane;
  const double s = std::sin(kTilt);
  const double c = std::cos(kTilt);
  // Columns: the camera's right, down and forward axes; it looks along the lines and down.
  return torch::tensor(
      {{0.0, -s, c, x}, {-1.0, 0.0, 0.0, side}, {0.0, -c, -s, kAltitude}, {0.0, 0.0, 0.0, 1.0}},
      torch::kFloat64);
}

class MapSoak {
 public:
  MapSoak(double minutes, double keyframe_hz, int width, const runs::RunConfig& config)
      : minutes_(minutes),
        keyframe_hz_(keyframe_hz),
        steps_(config.mapping.online.steps_per_keyframe),
        mapper_(runs::mapper_options(config)) {
    const int height = 3 * width / 4;
    const double f = 0.66 * width;
    camera_ = {f, f, 0.5 * width, 0.5 * height, width, height};
  }

  void run() {
    fmt::print(
        "| minutes | RSS, MiB | GPU memory, MiB | keyframes | with image | Gaussians | "
        "per keyframe, ms | PSNR of newest, dB |\n|---|---|---|---|---|---|---|---|\n");
    int reported = 0;
    std::size_t since = 0;
    Stopwatch watch;
    for (std::int64_t n = 0; n < static_cast<std::int64_t>(60.0 * minutes_ * keyframe_hz_); ++n) {
      const double t = static_cast<double>(n) / keyframe_hz_;
      if (t >= 60.0 * (reported + 1)) {
        report(++reported, watch.seconds() / static_cast<double>(since));
        since = 0;
        watch.reset();
      }
      feed(t);
      ++since;
    }
    report(reported + 1, watch.seconds() / static_cast<double>(since));
  }

 private:
  void feed(double t) {
    const Tensor T_world_camera = pose_at(t);
    mapping::MapperInput input;
    input.keyframe.stamp_ns = static_cast<std::int64_t>(1e9 * t) + 1;
    input.keyframe.name = fmt::format("{:.3f}", t);
    input.keyframe.intrinsics = camera_;
    input.keyframe.T_camera_world = mapping::rigid_inverse(T_world_camera);
    input.keyframe.image = render_seafloor(T_world_camera, camera_);
    mapper_.add(input);
    for (int k = 0; k < steps_ && mapper_.ready(); ++k) mapper_.step();
  }

  void report(int minute, double seconds_each) {
    const std::vector<std::size_t>& seen = mapper_.keyframes().training();
    const std::vector<std::size_t> newest(seen.end() - std::min(kScoredKeyframes, seen.size()),
                                          seen.end());
    const auto psnr = mapping::mean_psnr(mapper_.snapshot(), mapper_.keyframes(), newest);
    const auto memory = gaussians::device_memory();
    fmt::print("| {} | {:.0f} | {} | {} | {} | {} | {:.0f} | {:.1f} |\n", minute, resident_mib(),
               memory ? fmt::format("{:.0f}", memory->allocated_mib) : "-",
               mapper_.keyframes().size(), seen.size(), mapper_.size(), 1e3 * seconds_each,
               psnr.value_or(0.0));
    std::fflush(stdout);
  }

  double minutes_;
  double keyframe_hz_;
  int steps_;
  mapping::Mapper mapper_;
  gaussians::Intrinsics camera_;
};

runs::RunConfig config(const std::vector<std::string>& overrides) {
  std::vector<std::string> all{"mapping.enabled=true", "mapping.densification=quadtree",
                               "mapping.medium=true"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  return runs::load_run_config(APVI_SOURCE_DIR "/configs/default.yaml", all);
}

}  // namespace
}  // namespace apvi::bench

int main(int argc, char** argv) {
  try {
    const double minutes = argc > 1 ? std::stod(argv[1]) : 60.0;
    const double keyframe_hz = argc > 2 ? std::stod(argv[2]) : 1.0;
    const int width = argc > 3 ? std::stoi(argv[3]) : 320;
    const std::vector<std::string> overrides(argv + std::min(argc, 4), argv + argc);
    apvi::bench::MapSoak(minutes, keyframe_hz, width, apvi::bench::config(overrides)).run();
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "map_soak: %s\n", error.what());
    return 2;
  }
}
