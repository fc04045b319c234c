// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/slam/options.hpp"

#include <cstddef>

#include "apvi/core/error.hpp"

namespace apvi::slam {
namespace {

void check_depth(const depth::DepthOptions& options) {
  if (options.min_depth_m >= options.max_depth_m) {
    fail_input("mapping.depth.min_depth_m: {} m must be less than mapping.depth.max_depth_m, {} m",
               options.min_depth_m, options.max_depth_m);
  }
  const depth::QuadtreeOptions& q = options.quadtree;
  if ((q.max_block_px & (q.max_block_px - 1)) != 0) {
    fail_input("mapping.depth.quadtree.max_block_px: {} is not a power of two", q.max_block_px);
  }
  if (q.min_block_px > q.max_block_px) {
    fail_input("mapping.depth.quadtree.min_block_px: {} exceeds max_block_px, {}", q.min_block_px,
               q.max_block_px);
  }
}

}  // namespace

void MappingOptions::check() const {
  if (!initial_box_m.empty()) {
    bool ordered = initial_box_m.size() == 6;
    for (std::size_t i = 0; ordered && i < 3; ++i) {
      ordered = initial_box_m[i] < initial_box_m[i + 3];
    }
    if (!ordered) {
      fail_input("mapping.initial_box_m: expected [x, y, z, x, y, z], minimum corner first");
    }
  }
  if (trainer.initial_downscale == 3 ||
      (trainer.initial_downscale > 4 && trainer.initial_downscale < 8)) {
    fail_input("mapping.initial_downscale: {} is not one of 1, 2, 4, 8", trainer.initial_downscale);
  }
  check_depth(depth);
  if (trainer.densify.start_fraction > trainer.densify.end_fraction) {
    fail_input("mapping.densify.start_fraction: {} is after mapping.densify.end_fraction, {}",
               trainer.densify.start_fraction, trainer.densify.end_fraction);
  }
}

void Options::check() const {
  localization.check();
  if (mapping.enabled == MapSwitch::off) return;
  if (mapping.enabled == MapSwitch::on && !localization.sensors.includes("camera")) {
    fail_input("sensors.use: camera is missing; mapping.enabled: true requires it");
  }
  mapping.check();
}

}  // namespace apvi::slam
