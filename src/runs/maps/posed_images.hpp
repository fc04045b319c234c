// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/geometry/se3.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "map_io/origin.hpp"
#include "mapping/appearance/view_corrections.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "runs/run_config.hpp"

namespace apvi::runs {

/// The usable images of a recording with their poses, and counts of the discarded ones.
struct PosedImages {
  mapping::KeyframeStore store;  ///< with poses relative to `origin`
  map_io::Origin origin{};       ///< see `local_origin`
  config::Node rig;              ///< as used
  CameraModel camera;
  SE3 T_body_camera;
  Duration camera_delay;  ///< how late the image stamps are
  std::size_t missing_pose = 0;
  std::size_t damaged = 0;
  std::size_t black = 0;           ///< black images
  std::size_t low_visibility = 0;  ///< images that show only water, silt or glare
};

/// Images of a recording as a map uses them. Loading the same ones again does not decode them
/// again, as far as they fit in `max_bytes`.
class ImageCache {
 public:
  struct Image {
    torch::Tensor pixels;  ///< [H,W,3] uint8 RGB on the CPU, undistorted and downscaled
    torch::Tensor scene;   ///< see mapping::Keyframe
    bool low_visibility = false;
  };

  explicit ImageCache(std::size_t max_bytes) : max_bytes_(max_bytes) {}
  /// Null if it is not there.
  const Image* find(Stamp stamp) const;
  void keep(Stamp stamp, const Image& image);

 private:
  std::size_t max_bytes_;
  std::size_t bytes_ = 0;
  std::map<std::int64_t, Image> images_;  ///< by stamp
};

struct PosedImageOptions {
  /// That poses become relative to; nothing: the local origin of the given poses.
  std::optional<map_io::Origin> origin = std::nullopt;
  /// Body poses at the only images that are loaded, instead of the given poses of a recording.
  std::optional<Trajectory> poses_of_images = std::nullopt;
  ImageCache* cache = nullptr;  ///< of this recording and configuration
};

/// Loads the images of camera 0 with given poses, undistorted and downscaled; every
/// `eval.heldout_every`-th is held out. Images without a pose and damaged, black or low-visibility
/// images are skipped, counted and logged. Throws InputError when the recording has no images, no
/// poses or no camera in its rig, or when no image is usable.
PosedImages load_posed_images(const RunConfig& config, const PosedImageOptions& options = {});

/// An image of a recording and the pose of the body when it was taken.
struct ImagePose {
  Stamp image;  ///< the image's own stamp
  StampedPose pose;
  bool held_out = false;
};
/// Finds the images of camera 0 that body poses such as those of a run's keyframes.tum belong to,
/// held out as `load_posed_images` does it. No image is decoded.
std::vector<ImagePose> list_posed_images(const RunConfig& config, const Trajectory& poses);

/// Poses of the body at the images, with their optimized corrections, in the coordinates of the
/// recording.
Trajectory body_poses(const PosedImages& images, const mapping::ViewCorrections& corrections);

}  // namespace apvi::runs
