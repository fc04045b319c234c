// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/bridge/run_config.hpp"

#include <algorithm>

#include "apvi/bridge/camera_conversion.hpp"
#include "apvi/core/error.hpp"
#include "apvi/splat/device.hpp"

namespace apvi::bridge {
namespace {

constexpr int kMostOnCpu = 100000;  // a step of more is no use to a map that is made as one swims
constexpr int kMostOnGpu = 600000;  // more follow the noise of 640 x 480 pixels, and depth suffers

void check_power_of_two(const char* key, int value) {
  if ((value & (value - 1)) != 0)
    fail_input("mapping.depth.quadtree.{}: {} is no power of two", key, value);
}

void check_depth(const DepthSection& depth) {
  const mapping::DepthOptions options = depth.options();
  if (options.near_m >= options.far_m) {
    fail_input("mapping.depth.near_m: {} m is not before mapping.depth.far_m, {} m", options.near_m,
               options.far_m);
  }
  const mapping::QuadtreeOptions& q = options.quadtree;
  check_power_of_two("largest_px", q.largest_px);
  check_power_of_two("smallest_px", q.smallest_px);
  if (q.smallest_px > q.largest_px) {
    fail_input("mapping.depth.quadtree.smallest_px: {} is more than largest_px, {}", q.smallest_px,
               q.largest_px);
  }
}

void check_mapping(const RunConfig& config) {
  const MappingConfig& m = config.mapping;
  if (m.densify.kind == mapping::Densification::quadtree && !config.localization.enabled) {
    fail_input(
        "mapping.densification: quadtree needs localization; with given poses use none, "
        "gradient or random");
  }
  if (!m.initial_box_m.empty()) {
    bool ordered = m.initial_box_m.size() == 6;
    for (std::size_t i = 0; ordered && i < 3; ++i) {
      ordered = m.initial_box_m[i] < m.initial_box_m[i + 3];
    }
    if (!ordered) {
      fail_input("mapping.initial_box_m: expected [x, y, z, x, y, z], the low corner first");
    }
  }
  if (m.trainer.coarsest == 3 || (m.trainer.coarsest > 4 && m.trainer.coarsest < 8)) {
    fail_input("mapping.coarsest: {} is none of 1, 2, 4, 8", m.trainer.coarsest);
  }
  check_depth(m.depth);
  if (m.densify.begin > m.densify.end) {
    fail_input("mapping.densify.begin: {} is after mapping.densify.end, {}", m.densify.begin,
               m.densify.end);
  }
  if (!config.localization.enabled && m.trainer.iterations + m.trainer.final_iterations == 0) {
    fail_input("mapping.iterations: 0 steps make no map");
  }
}

void check_run(const RunConfig& config) {
  if (!config.localization.enabled && !config.mapping.enabled) {
    fail_input(
        "localization.enabled: with given poses and mapping.enabled: false nothing is left "
        "to do");
  }
  if (!config.mapping.enabled) return;
  if (config.localization.enabled && !config.sensors.includes("camera")) {
    fail_input("sensors.use: camera is missing; mapping.enabled: true needs it");
  }
  check_mapping(config);
}

}  // namespace

int most_gaussians(const RunConfig& config) {
  const int given = config.mapping.densify.max_gaussians;
  if (given > 0) return given;
  return splat::active_device().is_cuda() ? kMostOnGpu : kMostOnCpu;
}

mapping::TrainerOptions trainer_options(const RunConfig& config, const Rig& rig) {
  mapping::TrainerOptions options = config.mapping.trainer;
  options.seed = static_cast<std::uint64_t>(config.run.seed);
  options.rates = config.mapping.rates;
  options.densify = config.mapping.densify;
  options.densify.max_gaussians = most_gaussians(config);
  options.poses = config.mapping.poses;
  options.exposure = config.mapping.exposure;
  if (config.mapping.lamp) options.lamp = lamp_of(rig);
  return options;
}

Revisits revisits_of(const RunConfig& config, const Rig& rig) {
  const Revisits asked = config.mapping.revisits;
  if (asked != Revisits::automatic) return asked;
  return lamp_of(rig) ? Revisits::alignment : Revisits::loops;
}

mapping::MapperOptions mapper_options(const RunConfig& config, const Rig& rig) {
  mapping::OnlineOptions online = config.mapping.online;
  online.align = revisits_of(config, rig) == Revisits::alignment;
  return {.medium = config.mapping.medium,
          .trainer = trainer_options(config, rig),
          .online = online,
          .depth = config.mapping.depth.options()};
}

RunConfig load_run_config(const std::filesystem::path& file,
                          const std::vector<std::string>& overrides) {
  auto config = pipeline::read_run_config<RunConfig>(file, overrides);
  check_run(config);
  return config;
}

}  // namespace apvi::bridge
