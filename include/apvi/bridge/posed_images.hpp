// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

#include "apvi/bridge/run_config.hpp"
#include "apvi/core/stamp.hpp"
#include "apvi/geometry/se3.hpp"
#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/sensors/camera_model.hpp"

namespace apvi::bridge {

/// Pictures of a recording that a map can be made of, and what became of the others.
struct PosedImages {
  mapping::KeyframeStore store;
  config::Node rig;  ///< as used
  CameraModel camera;
  SE3 T_body_camera;
  Duration camera_delay;  ///< by how much the images' stamps are late
  std::size_t without_pose = 0;
  std::size_t damaged = 0;
  std::size_t black = 0;  ///< nothing can be seen in them
  std::size_t murky = 0;  ///< nothing but water, silt or glare can
};

/// Reads the images of camera 0 with the poses that are given for them, undistorted and reduced,
/// with every `eval.heldout_every`-th held out. Images without a pose, damaged, black and murky
/// ones are left out, counted and logged. Throws InputError when the recording has no images, no
/// poses or no camera in its rig, or when nothing of it is left.
PosedImages load_posed_images(const RunConfig& config);

}  // namespace apvi::bridge
