// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "apvi/mapping/options.hpp"
#include "core/profiler.hpp"
#include "mapping/alignment/keyframe_poses.hpp"
#include "mapping/alignment/map_aligner.hpp"
#include "mapping/density/depth_queue.hpp"
#include "mapping/density/depth_seeder.hpp"
#include "mapping/density/gaussian_inserter.hpp"
#include "mapping/density/online_densification.hpp"
#include "mapping/density/point_seeder.hpp"
#include "mapping/keyframes/keyframe_selection.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/medium/online_medium.hpp"
#include "mapping/rendering.hpp"
#include "mapping/storage/active_region.hpp"
#include "mapping/training/map_optimizer.hpp"
#include "mapping/training/online_training.hpp"

namespace apvi::mapping {

/// One update from localization.
struct MapperInput {
  Keyframe keyframe;  ///< without `image`: only the other members are used
  SparsePoints points;
  torch::Tensor depth_samples;  ///< [m,3] float64 world points from range sensors; or undefined
  std::vector<MovedKeyframe> moved;
  /// Stamp of the keyframe that a held-out image moves with; optional.
  std::optional<std::int64_t> follows_ns;
  bool vio_failing = false;
  bool low_visibility = false;  ///< has_low_visibility() of the raw camera image
  bool align = false;           ///< register the keyframe to previously mapped areas
  /// Input is queued: defer depth estimation and keep a bounded, thinned queue.
  bool skip_depth = false;
  /// The input queue is long: do not estimate the medium now.
  bool skip_medium_fit = false;
};

/// Builds a map incrementally from keyframes. Single-threaded: `add` processes one input and
/// inserts Gaussians where the map has none, `step` runs one optimizer iteration. The same calls
/// give bit-identical maps.
///
/// When the device runs out of memory, images move to the host; if that is not enough, the least
/// important Gaussians are removed and the remaining number becomes the limit (`max_gaussians`).
/// Throws c10::Error when that does not help either.
///
/// Every Gaussian is anchored to the keyframe that created it and moves with it. Input poses are in
/// the odometry frame, which equals the map frame until odometry drifts (see MapOdomTransform).
///
/// This class only orders the work and measures its time; its members do it.
class Mapper {
 public:
  explicit Mapper(const MapperOptions& options);

  /// See KeyframeStore::set_mask. Before the first keyframe.
  void set_mask(const torch::Tensor& scene) { keyframes_.set_mask(scene); }

  /// Does not throw for an invalid keyframe; the result tells what is wrong.
  KeyframeDecision add(const MapperInput& input);
  /// Moves keyframes and their Gaussians. In order of time; the last correction also applies to all
  /// later keyframes, those to come included. Keyframes in between that are not listed do not move.
  void correct(const std::vector<LoopCorrection>& loop_corrections);
  /// Changes the unit of length of everything so far: images of the map stay the same.
  void change_scale(const gaussians::ScaleChange& change);
  /// Whether there are Gaussians and keyframes to optimize.
  bool ready() const { return inserter_.started() && training_.views() > 0; }
  /// One iteration; returns the latest available loss. On a GPU it lags some iterations, because
  /// each readback synchronizes. Throws c10::Error unless `ready`.
  double step();

  /// Number of keyframes queued for depth estimation until they have neighbors on both sides.
  std::size_t waiting() const { return depth_queue_.size(); }
  /// Estimates depth for all of them with the neighbors available.
  void flush_depth_queue();

  /// Starts the final refinement after the last keyframe: flushes the depth queue and decays the
  /// learning rates over `TrainerOptions::final_iterations`, or `time_budget_s` if that is shorter;
  /// without densification.
  void begin_final();
  bool final_done() const;
  /// Progress of the final refinement, 0 to 1; 0 before it.
  double progress() const { return training_.progress(); }

  /// The part of the current map that is on the device, empty before the first Gaussian; shares
  /// memory with the mapper. It is the whole map unless the dive is large (see ActiveRegion).
  Map map() const { return optimizer_.full_map(); }
  /// A copy of the whole map on `device`.
  Map snapshot(const torch::Device& device = gaussians::active_device()) const;
  /// The whole map, with fewer Gaussians where it is not on the device; a copy unless all are
  /// there.
  Map preview() const;
  const KeyframeStore& keyframes() const { return keyframes_; }
  /// Pose of a keyframe with its learned correction.
  torch::Tensor pose(std::size_t i) const;
  /// Of the whole map.
  std::int64_t size() const { return optimizer_.size() + region_.stored(); }
  /// Number of Gaussians that are not on the device, which `map` does not contain.
  std::int64_t stored() const { return region_.stored(); }
  /// Maximum number of Gaussians on the device: as configured, or less after running out of memory.
  std::int64_t max_gaussians() const { return optimizer_.max_gaussians(); }
  std::int64_t iteration() const { return training_.iteration(); }
  /// Time spent so far: poses, gains, alignment, insertion, depth, depth_insertion, medium,
  /// densification, steps, storage. On a GPU, time is attributed to the scope that synchronizes.
  const Profiler& times() const { return times_; }
  /// Time spent on estimating depth [s], by which the mapping thread divides its time.
  double depth_s() const { return depth_seeder_.estimation_s(); }
  double extent() const { return inserter_.extent(); }
  const std::map<KeyframeDecision, std::size_t>& counts() const { return selection_.counts(); }
  /// The underlying optimizer.
  const MapOptimizer& optimizer() const { return optimizer_; }

  /// Saves the full state, images included; what is in MapperOptions::storage_folder stays there,
  /// as part of the checkpoint. Throws RunError when it cannot be written.
  void save(const std::filesystem::path& checkpoint) const;
  /// Restores the state from `save`, with the same options, or with fewer `max_gaussians`. Files of
  /// the storage folder that the checkpoint does not need are deleted. Throws InputError when the
  /// checkpoint is damaged.
  void resume(const std::filesystem::path& checkpoint);

 private:
  void retry_on_oom(const std::function<void()>& work);
  void move_map(const MapperInput& input);
  void lose_visibility(std::int64_t stamp_ns);
  void add_keyframe(const Keyframe& keyframe);
  void add_held_out(const MapperInput& input);
  void add_training_keyframe(const MapperInput& input);
  void align(std::size_t view);
  void insert_gaussians(std::size_t view, const MapperInput& input);
  void insert_from_points(std::size_t view, const MapperInput& input);
  void insert_from_queue(std::size_t view, bool skip_depth);
  void insert_from_depth(std::size_t view);
  void insert_random(std::size_t view);
  void limit_image_memory();
  void estimate_medium();
  void densify();
  void revisit();

  MapperOptions options_;
  std::shared_ptr<StorageFolder> storage_folder_;
  KeyframeStore keyframes_;  ///< with their poses in the map frame
  MapOptimizer optimizer_;
  ActiveRegion region_;
  KeyframeSelection selection_;
  KeyframePoses poses_;
  MapAligner aligner_;
  PointSeeder point_seeder_;
  DepthQueue depth_queue_;
  DepthSeeder depth_seeder_;
  GaussianInserter inserter_;
  OnlineDensification densification_;
  OnlineMedium medium_;
  OnlineTraining training_;
  std::optional<std::size_t> revisited_;  ///< keyframe around which the map was last refined
  Profiler times_;
};

}  // namespace apvi::mapping
