// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>

#include "apvi/mapping/options.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/training/deferred_loss_readback.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {

/// Trains a map offline from a complete set of keyframes. Single-threaded; every call of `step` is
/// one iteration, so the caller decides when to evaluate, save or stop. Without a time budget the
/// same options give bit-identical maps, also through `save` and `resume`.
///
/// When the device runs out of memory, the least important Gaussians are removed and the remaining
/// number becomes the limit (`most_gaussians`). Throws c10::Error when that does not help.
class Trainer {
 public:
  /// `keyframes` must outlive the trainer, which sets their tone curve. With `medium`, the water is
  /// optimized too, starting from it. Throws c10::Error without keyframes or Gaussians.
  Trainer(KeyframeStore& keyframes, const gaussians::Gaussians& initial,
          const TrainerOptions& options,
          const std::optional<medium::Medium>& medium = std::nullopt);

  /// Restores the state from `save`, with the same keyframes and options, or with fewer
  /// `max_gaussians`. Throws InputError when the file is damaged or of other keyframes.
  void resume(const std::filesystem::path& checkpoint);
  /// Saves everything that `resume` needs, atomically. Throws RunError when it cannot be written.
  void save(const std::filesystem::path& checkpoint) const;

  bool done() const;
  /// One iteration; returns the latest available loss, as `Mapper::step`.
  double step();
  /// Progress of the training, 0 to 1, by iterations or time, whichever is further.
  double progress() const;
  std::int64_t iteration() const { return iteration_; }
  /// Time spent in `step` so far, including before a `resume` [s].
  double seconds() const { return seconds_; }

  /// The current Gaussians; share memory with the trainer.
  gaussians::Gaussians map() const { return optimizer_.map(); }
  /// The same with medium and camera response.
  Map full_map() const { return optimizer_.full_map(); }
  std::int64_t size() const { return optimizer_.size(); }
  /// Maximum number of Gaussians: as configured, or less after running out of memory.
  std::int64_t most_gaussians() const { return optimizer_.max_gaussians(); }
  std::optional<medium::Medium> medium() const { return optimizer_.medium(); }
  const ViewCorrections& corrections() const { return optimizer_.corrections(); }

 private:
  bool reduce_memory();
  void retry_on_oom(const std::function<void()>& work);
  std::size_t choose_view() const;
  int reduction() const;
  void maybe_densify();
  void maybe_estimate_medium();
  void insert_random();

  KeyframeStore& keyframes_;
  TrainerOptions options_;
  double extent_;
  std::int64_t initial_size_;
  bool estimates_medium_;
  MapOptimizer optimizer_;
  DeferredLossReadback losses_;
  std::int64_t iteration_ = 0;
  double seconds_ = 0.0;
  std::size_t medium_estimations_ = 0;  ///< completed so far
};

}  // namespace apvi::mapping
