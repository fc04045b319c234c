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

#include "apvi/core/timesheet.hpp"
#include "apvi/mapping/drift.hpp"
#include "apvi/mapping/first_sight.hpp"
#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/late_losses.hpp"
#include "apvi/mapping/map_learner.hpp"
#include "apvi/mapping/options.hpp"
#include "apvi/mapping/rendering.hpp"
#include "apvi/mapping/seeds.hpp"
#include "apvi/mapping/survey_schedule.hpp"
#include "apvi/mapping/view_schedule.hpp"

namespace apvi::mapping {

/// Points of the world with what is known of them; all of one length n.
struct SparsePoints {
  torch::Tensor ids;        ///< [n] int64, never used again for another point
  torch::Tensor positions;  ///< [n,3] float64 [m]
  torch::Tensor sigmas;     ///< [n] float64 along the ray [m]
};

/// A keyframe that is known already stands elsewhere.
struct MovedKeyframe {
  std::int64_t stamp_ns = 0;
  torch::Tensor T_camera_world;  ///< [4,4] float64
};

/// A closed loop has bent the way: how the world is moved about a keyframe.
struct Relocated {
  std::int64_t stamp_ns = 0;
  torch::Tensor motion;  ///< [4,4] float64, rigid: from where the map had it
};

/// What localization has to say, at one time.
struct MapperInput {
  Keyframe keyframe;  ///< without `image`: nothing but the rest is news
  SparsePoints points;
  torch::Tensor
      depth_samples;  ///< [m,3] float64 points of the world that were ranged; or undefined
  std::vector<MovedKeyframe> moved;
  /// In order of time; the last holds for all keyframes after it too. Those in between that are
  /// not named stay.
  std::vector<Relocated> relocated;
  /// Stamp of the keyframe that a held-out one moves with; optional.
  std::optional<std::int64_t> follows_ns;
  bool vio_failing = false;
  bool murky = false;  ///< its picture, as the camera made it, shows nothing (is_murky)
  /// Others wait: no depth is estimated now. The newest keyframes that want it keep waiting.
  bool hurry = false;
  /// So many wait that the water is not surveyed now.
  bool crowded = false;
};

/// What became of a keyframe.
enum class Intake {
  taken,
  held_out,     ///< kept for evaluation
  no_picture,   ///< news only
  duplicate,    ///< its stamp is known
  bad_pose,     ///< no rigid motion, or not finite
  bad_picture,  ///< no [H,W,3] bytes of the camera's size
  black,
  murky,  ///< there is light, but nothing to see, then or less than a second away
};
std::string_view to_string(Intake intake);

/// Makes a map of keyframes while they come in. A plain class without a thread: `add` takes news in
/// and makes Gaussians where the map has none, `step` is one iteration. The same calls give the
/// same map to the bit.
///
/// Where the device's memory ends pictures go to the host, and when that has been done the least
/// important Gaussians go, and the map grows no larger than what stays (`most_gaussians`). Where
/// that is not enough, c10::Error.
///
/// A Gaussian belongs to the keyframe that made it, and moves with it. What is said of poses is in
/// odometry's world; the map's is the same until odometry has drifted (see Drift).
class Mapper {
 public:
  explicit Mapper(const MapperOptions& options);

  /// Never throws for what is wrong with a keyframe: says so.
  Intake add(const MapperInput& input);
  /// Whether there is something to learn.
  bool ready() const { return learner_.has_value() && schedule_.size() > 0; }
  /// One iteration; returns the newest loss that is known: on a GPU, that of some iterations ago,
  /// because reading one waits for all that was begun. Throws c10::Error unless `ready`.
  double step();

  /// Keyframes that wait for neighbours, to have their depth estimated.
  std::size_t waiting() const { return waiting_.size(); }
  /// Does so with the neighbours they have.
  void fill_waiting();

  /// No more keyframes: what waits for neighbours is done with, and rates fall from now on over
  /// `TrainerOptions::final_iterations`, or `time_budget_s` if that is shorter; without growth.
  void begin_final();
  bool final_done() const;
  /// Of the final refinement, 0 to 1; 0 before it.
  double progress() const;

  /// The map as it is now, empty before the first Gaussian; shares memory with the mapper's.
  Map map() const;
  /// The same of its own memory.
  Map snapshot() const;
  const KeyframeStore& keyframes() const { return keyframes_; }
  /// Pose of a keyframe with what was learnt about it.
  torch::Tensor pose(std::size_t i) const;
  std::int64_t size() const { return learner_ ? learner_->size() : 0; }
  /// That the map may have: what the options say, or less since memory ended.
  std::int64_t most_gaussians() const { return options_.trainer.densify.max_gaussians; }
  std::int64_t iteration() const { return iteration_; }
  /// Where its time went so far: poses, gains, alignment, insertion, depth, filling (what depth is
  /// used for), water, growth, steps. On a GPU work counts where it is waited for.
  const Timesheet& times() const { return times_; }
  double extent() const { return extent_; }
  const std::map<Intake, std::size_t>& counts() const { return counts_; }
  /// The learner behind; only when `ready`.
  const MapLearner& learner() const { return *learner_; }

  /// Everything, pictures too. Throws RunError when it cannot be written.
  void save(const std::filesystem::path& checkpoint) const;
  /// Goes on from what `save` left, with the same options, or with fewer `max_gaussians`. Throws
  /// InputError when it is damaged.
  void resume(const std::filesystem::path& checkpoint);

 private:
  void within_memory(const std::function<void()>& work);
  bool economise();
  Intake judge(const MapperInput& input) const;
  void move(const std::vector<MovedKeyframe>& moved);
  torch::Tensor place(std::size_t i, const torch::Tensor& T_camera_odometry);
  void relocate(const std::vector<Relocated>& relocated);
  void move_followers(std::size_t view, const torch::Tensor& motion);
  void move_gaussians(const std::map<std::int64_t, torch::Tensor>& motions);
  void keep(const Keyframe& keyframe);
  void forget_veiled(std::int64_t stamp_ns);
  void remember_until(std::int64_t stamp_ns);
  void align(std::size_t view);
  void make_memory();
  void thin_held_out();

  void insert_points(std::size_t view, const MapperInput& input);
  Seeds point_seeds(std::size_t view, const MapperInput& input);
  void want_depth(std::size_t view, bool hurry);
  void fill_from_depth(std::size_t view);
  void insert_random(std::size_t view);
  void insert(std::size_t view, Seeds seeds);
  std::int64_t room() const;
  std::int64_t make_room(std::int64_t wanted);
  void note_outage(std::int64_t stamp_ns);
  void maybe_survey_water(const MapperInput& input);
  void survey_water();
  std::int64_t round_length() const;
  void maybe_densify();
  int reduction(std::size_t view) const;
  LearningRates rates() const;

  MapperOptions options_;
  DepthOptions insertion_depth_;  ///< surveys of the water sweep as the options say
  KeyframeStore keyframes_;       ///< where the map has them
  Drift drift_;
  FirstSight first_sight_;
  std::size_t remembered_ = 0;  ///< keyframes before are in it
  std::map<std::int64_t, std::size_t> by_stamp_;
  ViewSchedule schedule_;
  SurveySchedule surveys_;
  std::optional<MapLearner> learner_;
  LateLosses losses_;
  torch::Tensor points_;                ///< [n,3] float64: sparse ones, the newest
  std::map<std::int64_t, bool> known_;  ///< ids of the last input's points: whether inserted
  std::map<std::size_t, std::vector<std::size_t>> followers_;  ///< by keyframe: held-out ones
  std::deque<std::size_t> waiting_;  ///< keyframes whose depth is still to be estimated
  std::map<Intake, std::size_t> counts_;
  double growth_ = 0.0;  ///< Gaussians that may still come from doubling and splitting
  double extent_ = 0.0;  ///< what sizes and rates are measured in [m]; 0: nothing seen
  std::int64_t iteration_ = 0;
  std::int64_t last_round_ = 0;  ///< of growth and pruning: the iteration
  std::optional<std::int64_t> final_start_;
  double final_seconds_ = 0.0;
  Timesheet times_;
  std::int64_t heldout_stride_ = 1;
  std::int64_t clears_ns_ = 0;  ///< until then pictures are veiled
  bool vio_failing_ = false;
};

}  // namespace apvi::mapping
