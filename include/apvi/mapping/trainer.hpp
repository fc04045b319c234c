// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>

#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/late_losses.hpp"
#include "apvi/mapping/map_learner.hpp"
#include "apvi/mapping/options.hpp"

namespace apvi::mapping {

/// Makes a map of keyframes that are all there from the start. One thread; every call of `step` is
/// one iteration, so the caller decides when to look, save or stop. Without a time budget the same
/// map comes out of the same options to the bit, also through `save` and `resume`.
///
/// Where the device's memory ends the least important Gaussians go, and the map grows no larger
/// than what stays (`most_gaussians`). Where that is not enough, c10::Error.
class Trainer {
 public:
  /// `keyframes` must outlive the trainer. With `medium`, the map is seen through water that is
  /// learnt too, from there. Throws c10::Error when there is nothing to learn from.
  Trainer(const KeyframeStore& keyframes, const splat::Gaussians& initial,
          const TrainerOptions& options, const std::optional<splat::Medium>& medium = std::nullopt);

  /// Goes on from what `save` left, with the same keyframes and options, or with fewer
  /// `max_gaussians`. Throws InputError when the file is damaged, or of other keyframes.
  void resume(const std::filesystem::path& checkpoint);
  /// Everything that `resume` needs, in one step. Throws RunError when it cannot be written.
  void save(const std::filesystem::path& checkpoint) const;

  bool done() const;
  /// One iteration; returns the newest loss that is known, as `Mapper::step`.
  double step();
  /// How far the training is, 0 to 1; by iterations or by time, whichever is further.
  double progress() const;
  std::int64_t iteration() const { return iteration_; }
  /// Time spent in `step` so far, also before a `resume` [s].
  double seconds() const { return seconds_; }

  /// The map as it is; shares memory with the trainer's.
  splat::Gaussians map() const { return learner_.map(); }
  /// The same with water and camera.
  Map whole_map() const { return learner_.whole_map(); }
  std::int64_t size() const { return learner_.size(); }
  /// That the map may have: what the options say, or less since memory ended.
  std::int64_t most_gaussians() const { return options_.densify.max_gaussians; }
  std::optional<splat::Medium> medium() const { return learner_.medium(); }
  const ViewCorrections& corrections() const { return learner_.corrections(); }

 private:
  bool economise();
  void within_memory(const std::function<void()>& work);
  std::size_t choose_view() const;
  int reduction() const;
  void maybe_densify();
  void maybe_survey_water();
  void insert_random();

  const KeyframeStore& keyframes_;
  TrainerOptions options_;
  double extent_;
  std::int64_t initial_size_;
  MapLearner learner_;
  LateLosses losses_;
  std::int64_t iteration_ = 0;
  double seconds_ = 0.0;
  std::size_t surveys_ = 0;  ///< of the water, so far
};

}  // namespace apvi::mapping
