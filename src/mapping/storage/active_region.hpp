// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "gaussians/render/view_cone.hpp"
#include "mapping/alignment/keyframe_poses.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/storage/gaussian_storage.hpp"
#include "mapping/training/map_optimizer.hpp"
#include "mapping/training/online_training.hpp"

namespace apvi::mapping {

/// Keeps the part of a map around the camera on the device, and the rest in host memory and, when
/// that is full, in files, so that `max_gaussians` limits what is on the device and not the map.
///
/// A part is the Gaussians of a keyframe. When the device is nearly full, those farthest from what
/// the camera sees are stored; they return before the camera can see them. Keyframes that
/// see stored Gaussians are not trained on meanwhile, and their images are not on the device
/// either. When nothing is far enough away, nothing is stored, and the map is limited as before.
class ActiveRegion {
 public:
  /// `max_stored_bytes` of host memory; 0: nothing is stored. The farthest parts of what memory
  /// does not hold go to `folder`.
  ActiveRegion(double max_stored_bytes, std::shared_ptr<StorageFolder> folder)
      : max_stored_bytes_(max_stored_bytes), storage_(std::move(folder)) {}

  /// Prepares the map for keyframe `view`, around which the scene is at distances of about
  /// `range_m`.
  void follow(std::size_t view, double range_m, KeyframeStore& keyframes, MapOptimizer& optimizer,
              OnlineTraining& training);
  /// The same to train around a keyframe again: fills the free part of the device.
  void revisit(std::size_t view, double range_m, KeyframeStore& keyframes, MapOptimizer& optimizer,
               OnlineTraining& training);
  /// Returns all to the device, whatever its limit is.
  void load_all(KeyframeStore& keyframes, MapOptimizer& optimizer, OnlineTraining& training);
  /// Moves the stored Gaussians of each keyframe.
  void move(const KeyframeMotions& motions) { storage_.move(motions); }

  /// Number of Gaussians that are not on the device.
  std::int64_t stored() const { return storage_.size(); }
  /// The whole map on `device`: copies, in the present colors.
  gaussians::Gaussians complete(const KeyframeStore& keyframes, const MapOptimizer& optimizer,
                                const torch::Device& device) const;
  /// The same on the map's device for a look at it, with fewer and larger Gaussians far away.
  gaussians::Gaussians preview(const KeyframeStore& keyframes, const MapOptimizer& optimizer) const;
  /// Returns the files that the archive refers to; so does `load`.
  StorageFiles save(torch::serialize::OutputArchive& archive, const MapOptimizer& optimizer) const;
  StorageFiles load(torch::serialize::InputArchive& archive, KeyframeStore& keyframes,
                    MapOptimizer& optimizer, OnlineTraining& training);

 private:
  struct Place;
  std::vector<Place> places(const std::vector<std::int64_t>& anchors, std::size_t view,
                            double range_m, const KeyframeStore& keyframes) const;
  void center_on(std::size_t view, double range_m, bool fill, KeyframeStore& keyframes,
                 MapOptimizer& optimizer, OnlineTraining& training);
  double load_near(std::size_t view, double range_m, bool fill, const KeyframeStore& keyframes,
                   MapOptimizer& optimizer);
  void store_far(std::size_t view, double range_m, const KeyframeStore& keyframes,
                 MapOptimizer& optimizer);
  void load(const std::vector<std::int64_t>& anchors, const KeyframeStore& keyframes,
            MapOptimizer& optimizer);
  void store(const std::vector<std::int64_t>& anchors, double range_m,
             const KeyframeStore& keyframes, MapOptimizer& optimizer);
  void write_farthest(std::size_t view, double range_m, const KeyframeStore& keyframes);
  void pause_views(const std::vector<std::int64_t>& anchors, const torch::Tensor& which,
                   double range_m, const KeyframeStore& keyframes, const MapOptimizer& optimizer);
  void pause(KeyframeStore& keyframes, OnlineTraining& training) const;
  double far_m(std::size_t view, double range_m) const;

  double max_stored_bytes_ = 0;
  GaussianStorage storage_;
  /// Around most of the Gaussians of a keyframe, in the frame of its camera, as of the last time
  /// that some were stored.
  std::map<std::int64_t, gaussians::Sphere> spheres_;
  /// Keyframes with stored Gaussians, by the keyframe that sees them.
  std::map<std::size_t, std::set<std::int64_t>> missing_;
  std::size_t look_again_ = 0;  ///< keyframe before which no distant parts are looked for
  mutable std::optional<gaussians::Gaussians> thinned_;   ///< of the storage, for `preview`
  mutable std::pair<std::int64_t, int> thinned_version_;  ///< of the storage and the appearance
};

}  // namespace apvi::mapping
