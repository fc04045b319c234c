// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string_view>
#include <vector>

#include "apvi/mapping/options.hpp"
#include "core/profiler.hpp"
#include "mapping/alignment/frozen_reference_map.hpp"
#include "mapping/alignment/map_odom_transform.hpp"
#include "mapping/density/seeds.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/keyframes/view_schedule.hpp"
#include "mapping/medium/medium_schedule.hpp"
#include "mapping/rendering.hpp"
#include "mapping/training/deferred_loss_readback.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {

/// Sparse world points; all tensors have the same length n.
struct SparsePoints {
  torch::Tensor ids;        ///< [n] int64, never reused for another point
  torch::Tensor positions;  ///< [n,3] float64 [m]
  torch::Tensor sigmas;     ///< [n] float64 standard deviation along the ray [m]
};

/// Updated pose of an existing keyframe.
struct MovedKeyframe {
  std::int64_t stamp_ns = 0;
  torch::Tensor T_camera_world;  ///< [4,4] float64
};

/// A loop closure correction: the rigid motion of the world around one keyframe.
struct LoopCorrection {
  std::int64_t stamp_ns = 0;
  torch::Tensor motion;  ///< [4,4] float64, rigid, relative to the current map
};

/// One update from localization.
struct MapperInput {
  Keyframe keyframe;  ///< without `image`: only the other members are used
  SparsePoints points;
  torch::Tensor depth_samples;  ///< [m,3] float64 world points from range sensors; or undefined
  std::vector<MovedKeyframe> moved;
  /// In order of time; the last also applies to all later keyframes. Keyframes in between that are
  /// not listed do not move.
  std::vector<LoopCorrection> loop_corrections;
  /// Stamp of the keyframe that a held-out image moves with; optional.
  std::optional<std::int64_t> follows_ns;
  bool vio_failing = false;
  bool low_visibility = false;  ///< has_low_visibility() of the raw camera image
  /// Input is queued: defer depth estimation and keep a bounded, thinned queue.
  bool skip_depth = false;
  /// The input queue is long: do not estimate the medium now.
  bool skip_medium_fit = false;
};

/// How an input keyframe was handled.
enum class KeyframeDecision {
  accepted,
  held_out,   ///< kept for evaluation
  no_image,   ///< pose and point updates only
  duplicate,  ///< its stamp is already in the map
  bad_pose,   ///< not a rigid transform, or not finite
  bad_image,  ///< not [H,W,3] uint8 of the camera's size
  black,
  low_visibility,  ///< no visible structure, in this image or shortly before it
};
std::string_view to_string(KeyframeDecision decision);

/// Builds a map incrementally from keyframes. Single-threaded: `add` processes one input and
/// inserts Gaussians where the map has none, `step` runs one optimizer iteration. The same calls
/// give bit-identical maps.
///
/// When the device runs out of memory, images move to the host; if that is not enough, the least
/// important Gaussians are removed and the remaining number becomes the limit (`most_gaussians`).
/// Throws c10::Error when that does not help either.
///
/// Every Gaussian is anchored to the keyframe that created it and moves with it. Input poses are in
/// the odometry frame, which equals the map frame until odometry drifts (see MapOdomTransform).
class Mapper {
 public:
  explicit Mapper(const MapperOptions& options);

  /// Does not throw for an invalid keyframe; the result tells what is wrong.
  KeyframeDecision add(const MapperInput& input);
  /// Whether there are Gaussians and keyframes to optimize.
  bool ready() const { return optimizer_.has_value() && schedule_.size() > 0; }
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
  double progress() const;

  /// The current map, empty before the first Gaussian; shares memory with the mapper.
  Map map() const;
  /// A deep copy of the current map.
  Map snapshot() const;
  const KeyframeStore& keyframes() const { return keyframes_; }
  /// Pose of a keyframe with its learned correction.
  torch::Tensor pose(std::size_t i) const;
  std::int64_t size() const { return optimizer_ ? optimizer_->size() : 0; }
  /// Maximum number of Gaussians: as configured, or less after running out of memory.
  std::int64_t most_gaussians() const { return options_.trainer.densify.max_gaussians; }
  std::int64_t iteration() const { return iteration_; }
  /// Time spent so far: poses, gains, alignment, insertion, depth, filling (insertion from depth),
  /// water, growth, steps. On a GPU, time is attributed to the scope that synchronizes.
  const Profiler& times() const { return times_; }
  /// Total time of depth estimation [s].
  double depth_s() const { return depth_s_; }
  double extent() const { return extent_; }
  const std::map<KeyframeDecision, std::size_t>& counts() const { return counts_; }
  /// The underlying optimizer; only when `ready`.
  const MapOptimizer& optimizer() const { return *optimizer_; }

  /// Saves the full state, images included. Throws RunError when it cannot be written.
  void save(const std::filesystem::path& checkpoint) const;
  /// Restores the state from `save`, with the same options, or with fewer `max_gaussians`. Throws
  /// InputError when the file is damaged.
  void resume(const std::filesystem::path& checkpoint);

 private:
  void retry_on_oom(const std::function<void()>& work);
  bool reduce_memory();
  KeyframeDecision validate(const MapperInput& input) const;
  void apply_pose_updates(const std::vector<MovedKeyframe>& moved);
  torch::Tensor update_pose(std::size_t i, const torch::Tensor& T_camera_odometry);
  void apply_loop_corrections(const std::vector<LoopCorrection>& loop_corrections);
  void move_followers(std::size_t view, const torch::Tensor& motion);
  void move_gaussians(const std::map<std::int64_t, torch::Tensor>& motions);
  void add_keyframe(const Keyframe& keyframe);
  void drop_low_visibility(std::int64_t stamp_ns);
  void update_reference_map(std::int64_t stamp_ns);
  void align(std::size_t view);
  void limit_image_memory();
  void thin_held_out();

  void insert_points(std::size_t view, const MapperInput& input);
  Seeds point_seeds(std::size_t view, const MapperInput& input);
  void queue_depth(std::size_t view, bool skip_depth);
  void insert_from_depth(std::size_t view);
  void insert_random(std::size_t view);
  void insert(std::size_t view, Seeds seeds);
  std::int64_t room() const;
  std::int64_t make_room(std::int64_t wanted);
  void detect_outage(std::int64_t stamp_ns);
  void maybe_estimate_medium(const MapperInput& input);
  void estimate_medium();
  void fit_medium();
  void start_medium();
  std::int64_t densify_interval_steps() const;
  void maybe_densify();
  int reduction(std::size_t view) const;
  LearningRates rates() const;

  MapperOptions options_;
  depth::DepthOptions insertion_depth_;  ///< medium estimation uses options_.depth unchanged
  KeyframeStore keyframes_;              ///< with their poses in the map frame
  MapOdomTransform map_odom_;
  FrozenReferenceMap reference_map_;
  std::size_t reference_end_ = 0;  ///< keyframes before this index are in it
  std::map<std::int64_t, std::size_t> by_stamp_;
  ViewSchedule schedule_;
  MediumSchedule medium_schedule_;
  std::optional<MapOptimizer> optimizer_;
  DeferredLossReadback losses_;
  torch::Tensor points_;                          ///< [n,3] float64: the newest sparse points
  std::map<std::int64_t, bool> inserted_points_;  ///< by id, of the last input: whether inserted
  std::map<std::size_t, std::vector<std::size_t>>
      followers_;                        ///< held-out images by leading keyframe
  std::deque<std::size_t> depth_queue_;  ///< keyframes awaiting depth estimation
  std::map<KeyframeDecision, std::size_t> counts_;
  double growth_budget_ = 0.0;  ///< Gaussians that may still be added by cloning and splitting
  double extent_ = 0.0;         ///< scene extent that scales sizes and rates [m]; 0: unknown
  std::int64_t iteration_ = 0;
  std::int64_t last_densify_ = 0;  ///< iteration of the last densification
  std::optional<std::int64_t> final_start_;
  double final_seconds_ = 0.0;
  Profiler times_;
  double depth_s_ = 0.0;
  std::int64_t heldout_stride_ = 1;
  std::int64_t low_visibility_until_ns_ = 0;  ///< images before this stamp are rejected
  bool vio_failing_ = false;
};

}  // namespace apvi::mapping
