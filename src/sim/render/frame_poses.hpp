// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/types.hpp>
#include <vector>

#include "sim/render/lens_rays.hpp"
#include "sim/render/renderer.hpp"
#include "sim/render/shading.hpp"

namespace apvi::sim {

/// Poses of one frame: one per exposure sample, or one per sample and row (rolling shutter).
struct FramePoses {
  int samples = 1;
  std::vector<SE3> poses{};
  std::size_t rows = 1;
  const SE3& at(int sample, int row) const {
    return poses[static_cast<std::size_t>(sample) * rows +
                 (rows > 1 ? static_cast<std::size_t>(row) : 0)];
  }
};

struct ExposureSetup {
  const CameraModel& camera;
  const CameraEffectsConfig& effects;
  const RayCaster& world;
};

/// Poses during the exposure of a frame; as many samples as its motion in the image needs.
FramePoses frame_poses(const ImageRequest& request, const ExposureSetup& setup);
/// Rays of the pixels of a tile at one sample, not cast yet.
void fill_rays(const Lens& lens, const FramePoses& poses, int sample, const cv::Rect& tile,
               TileRays& out);

}  // namespace apvi::sim
