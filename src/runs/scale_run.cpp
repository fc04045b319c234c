// SPDX-License-Identifier: BSD-3-Clause
#include "runs/scale_run.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/geometry/scale_change.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/sensors/rig.hpp"
#include "eval/metrics_file.hpp"
#include "gaussians/model/similarity.hpp"
#include "loop_closure/place_map.hpp"
#include "map_io/map_file.hpp"
#include "map_io/ply.hpp"
#include "mapping/surface_depth.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/maps/stored_map.hpp"
#include "runs/run_config.hpp"
#include "runs/run_folder.hpp"
#include "runs/survey/export.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr double kMinAlpha = 0.5;    // of a pixel that shows a surface
constexpr double kMaxSpread = 0.05;  // of the factors of several lengths
constexpr std::array kTrajectories = {"keyframes.tum", "trajectory.tum", "trajectory_smoothed.tum",
                                      "vio.tum"};
constexpr std::array kCopied = {"resolved.yaml", "rig_estimated.yaml"};
// Figures of metrics.json that have no unit of length.
constexpr std::array kKeptFigures = {"psnr_db", "ssim",      "ms_ssim",
                                     "lpips",   "gaussians", "iterations"};

/// A run with a map, from which lengths are taken.
class MeasuredRun {
 public:
  explicit MeasuredRun(const fs::path& run)
      : config_(load_recorded_run_config(run / "resolved.yaml")),
        mount_(mount_of_run(config_)),
        stored_(load_drawable_map(run)),
        poses_(to_local(io::read_trajectory(run / "keyframes.tum"), stored_.origin)) {
    const double delay_s = make_rig(config_.rig).cameras.front().time_offset_s;
    delay_ = Duration::from_seconds(delay_s);
  }

  const SE3& T_body_camera() const { return mount_.T_body_camera; }

  double length(const ScaleBar& bar) const {
    const StampedPose* const pose = pose_at(bar.image - delay_);
    if (pose == nullptr) {
      fail_input("--bar: the map has no image {}; the files in renders/ are named by their stamps",
                 bar.image.ns);
    }
    const gaussians::View view = view_at(pose->T_world_body, mount_);
    const mapping::MapRendering drawn = mapping::render_map(stored_.map, view);
    const Tensor depth = mapping::surface_depth(stored_.map, view, drawn.depth, drawn.alpha)
                             .masked_fill(drawn.alpha < kMinAlpha, 0.0)
                             .to(torch::kCPU, torch::kFloat64)
                             .contiguous();
    return (point(view.intrinsics, depth, bar.from) - point(view.intrinsics, depth, bar.to)).norm();
  }

 private:
  const StampedPose* pose_at(Stamp stamp) const {
    const auto found = std::ranges::min_element(poses_.poses, {}, [&](const StampedPose& pose) {
      return std::abs((pose.stamp - stamp).ns);
    });
    const bool close = found != poses_.poses.end() &&
                       std::abs((found->stamp - stamp).ns) <= Duration::from_seconds(1e-3).ns;
    return close ? &*found : nullptr;
  }

  static Eigen::Vector3d point(const gaussians::Intrinsics& k, const Tensor& depth,
                               const Eigen::Vector2d& pixel) {
    const auto u = static_cast<std::int64_t>(std::floor(pixel.x()));
    const auto v = static_cast<std::int64_t>(std::floor(pixel.y()));
    if (u < 0 || v < 0 || u >= k.width || v >= k.height) {
      fail_input("--bar: pixel {}, {} is outside the image of {} x {}", pixel.x(), pixel.y(),
                 k.width, k.height);
    }
    const double z = depth.accessor<double, 2>()[v][u];
    if (z <= 0.0) fail_input("--bar: the map has no surface at pixel {}, {}", pixel.x(), pixel.y());
    return z * Eigen::Vector3d((pixel.x() - k.cx) / k.fx, (pixel.y() - k.cy) / k.fy, 1.0);
  }

  RunConfig config_;
  CameraMount mount_;
  StoredMap stored_;
  Trajectory poses_;
  Duration delay_;
};

/// A length in units of the run and in meters.
struct Measured {
  double units = 0.0;
  double meters = 0.0;
};

std::vector<Measured> measure(const ScaleRequest& request, const MeasuredRun& run) {
  std::vector<Measured> all;
  for (const ScaleBar& bar : request.bars) all.push_back({run.length(bar), bar.length_m});
  for (const KnownDistance& d : request.distances) {
    all.push_back({(d.to - d.from).norm(), d.length_m});
  }
  for (const Measured& m : all) {
    if (m.meters <= 0.0) fail_input("a known length is {} m; it must be positive", m.meters);
    if (m.units <= 0.0) fail_input("a known length of {} m has no length in the map", m.meters);
    log::info("{:.4f} units are {:g} m: {:.5f} m per unit", m.units, m.meters, m.meters / m.units);
  }
  return all;
}

ScaleResult scale_by(const ScaleRequest& request, const MeasuredRun& run) {
  ScaleResult result;
  const std::vector<Measured> all = measure(request, run);
  if (request.factor) {
    result.meters_per_unit = *request.factor;
    return result;
  }
  if (all.empty()) fail_input("no known length: give --bar, --distance or --factor");
  double product = 0.0;
  double square = 0.0;
  for (const Measured& m : all) {
    product += m.units * m.meters;
    square += m.units * m.units;
    result.of_each.push_back(m.meters / m.units);
  }
  result.meters_per_unit = product / square;
  const auto [least, most] = std::ranges::minmax(result.of_each);
  if (most / least > 1.0 + kMaxSpread) {
    log::warning("the lengths disagree by {:.0f} %; are all pixels on the ends of the bar?",
                 100.0 * (most / least - 1.0));
  }
  return result;
}

medium::Medium scaled(medium::Medium water, double factor) {
  water.beta_d = water.beta_d / factor;
  water.beta_b = water.beta_b / factor;
  if (!water.lamp) return water;
  medium::LampLight& light = *water.lamp;
  light.unit_range_m *= factor;
  light.backscatter = light.backscatter / factor;
  for (medium::Lamp& lamp : light.lamps) {
    for (double& coordinate : lamp.position_m) coordinate *= factor;
  }
  return water;
}

void scale_map(const fs::path& from, const fs::path& to, double factor) {
  map_io::MapFile map = load_map(from);
  map.gaussians = gaussians::transformed(
      map.gaussians, gaussians::scaling({factor, torch::zeros({3}, torch::kFloat64)}));
  if (map.medium) map.medium = scaled(*map.medium, factor);
  for (double& coordinate : map.origin) coordinate *= factor;
  map_io::write_map(to / "map.ply", map);
  map_io::write_origin_json(to / "origin.json", map.origin);
  if (map.medium) map_io::write_medium_json(to / "medium.json", *map.medium);
}

void scale_trajectories(const fs::path& from, const fs::path& to, double factor,
                        const SE3& T_body_camera) {
  const ScaleChange change{.scale = factor};
  for (const char* name : kTrajectories) {
    if (!fs::exists(from / name)) continue;
    Trajectory trajectory = io::read_trajectory(from / name);
    for (StampedPose& pose : trajectory.poses) {
      pose.T_world_body = changed(change, pose.T_world_body, T_body_camera.translation);
    }
    io::write_tum(to / name, trajectory);
  }
}

void scale_places(const fs::path& from, const fs::path& to, double factor) {
  using namespace loop_closure;
  if (!fs::exists(from / kPlacesFile)) return;
  PlaceMap map = load_place_map(from / kPlacesFile);
  for (MapPlace& place : map.places) {
    place.T_map_camera.translation *= factor;
    for (Eigen::Vector3f& point : place.points) point *= static_cast<float>(factor);
  }
  save(map, to / kPlacesFile);
}

void write_metrics(const ScaleRequest& request, const ScaleResult& result) {
  const eval::Json before = eval::read_metrics(request.run / "metrics.json");
  eval::Json sections = {{"scale",
                          {{"source", "known lengths"},
                           {"known", true},
                           {"meters_per_unit", result.meters_per_unit},
                           {"of_each", result.of_each},
                           {"scaled_from", fs::absolute(request.run).string()}}}};
  const eval::Json mapping = before.value("mapping", eval::Json::object());
  for (const char* figure : kKeptFigures) {
    if (mapping.contains(figure)) sections["mapping"][figure] = mapping[figure];
  }
  eval::merge_metrics(request.folder / "metrics.json", sections);
}

void check(const ScaleRequest& request) {
  if (!fs::exists(map_file_of(request.run)) || !fs::exists(request.run / "keyframes.tum")) {
    fail_input("{}: no map in it; is this a run folder?", request.run.string());
  }
  std::error_code ignored;
  if (fs::equivalent(request.run, request.folder, ignored)) {
    fail_input("{}: the run itself; name another folder", request.folder.string());
  }
}

}  // namespace

ScaleResult scale_run(const ScaleRequest& request) {
  check(request);
  const MeasuredRun run(request.run);
  const ScaleResult result = scale_by(request, run);
  prepare_folder(request.folder, request.overwrite);
  scale_map(request.run, request.folder, result.meters_per_unit);
  scale_trajectories(request.run, request.folder, result.meters_per_unit, run.T_body_camera());
  scale_places(request.run, request.folder, result.meters_per_unit);
  copy_files(request.run, request.folder, kCopied);
  write_metrics(request, result);
  return result;
}

}  // namespace apvi::runs
