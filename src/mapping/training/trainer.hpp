// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <vector>

#include "apvi/mapping/options.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/training/deferred_loss_readback.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {

/// The images of a session, with what is known of its water and light.
struct TrainingSession {
  KeyframeStore* keyframes = nullptr;  ///< must outlive the trainer, which sets its tone curve
  TrainerOptions options;              ///< of the first session: of the training, too
  std::optional<medium::Medium> medium = std::nullopt;  ///< to begin with; optimized
  torch::Tensor light = {};  ///< [3], not of the first session; see SessionLight
  /// From an earlier training. Unknown gains are found from the images.
  std::optional<CameraResponse> response = std::nullopt;
};

/// Trains a map offline from the complete keyframes of one or more sessions. Single-threaded; every
/// call of `step` is one iteration, so the caller decides when to evaluate, save or stop. Without a
/// time budget the same options give bit-identical maps, also through `save` and `resume`.
///
/// When the device runs out of memory, the least important Gaussians are removed and the remaining
/// number becomes the limit (`max_gaussians`). Throws c10::Error when that does not help.
class Trainer {
 public:
  /// Throws c10::Error without keyframes or Gaussians.
  Trainer(const std::vector<TrainingSession>& sessions, const gaussians::Gaussians& initial);
  /// Of one session.
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
  /// Progress of the schedule, 0 to 1, by iterations or time, whichever is further.
  double progress() const;
  std::int64_t iteration() const { return iteration_; }
  /// Time spent in `step` so far, including before a `resume` [s].
  double seconds() const { return seconds_; }

  /// The current Gaussians; share memory with the trainer.
  gaussians::Gaussians map() const { return optimizer().map(); }
  /// The same with the medium, light and camera response of a session.
  Map full_map(std::size_t session = 0) const { return sessions_.at(session).optimizer.full_map(); }
  std::int64_t size() const { return optimizer().size(); }
  /// Maximum number of Gaussians: as configured, or less after running out of memory.
  std::int64_t max_gaussians() const { return optimizer().max_gaussians(); }
  std::optional<medium::Medium> medium() const { return optimizer().medium(); }
  /// Of the first session; see MapOptimizer.
  const RobustWeights* robust_weights() const { return optimizer().robust_weights(); }
  const ViewCorrections& corrections(std::size_t session = 0) const {
    return sessions_.at(session).optimizer.corrections();
  }

 private:
  struct Session {
    KeyframeStore* keyframes = nullptr;
    TrainerOptions options;
    bool estimates_medium = false;
    MapOptimizer optimizer;
  };
  /// A training image.
  struct TrainingView {
    std::size_t session = 0;
    std::size_t keyframe = 0;
  };

  void add(const TrainingSession& session, MapOptimizer optimizer);
  const MapOptimizer& optimizer() const { return sessions_.front().optimizer; }
  MapOptimizer& optimizer() { return sessions_.front().optimizer; }
  bool reduce_memory();
  void retry_on_oom(const std::function<void()>& work);
  std::size_t choose_view() const;
  int reduction() const;
  void maybe_densify();
  void maybe_estimate_medium();
  void estimate_medium_of(Session& session);
  void insert_random();

  TrainerOptions options_;
  double extent_;
  std::int64_t initial_size_;
  std::vector<Session> sessions_;  ///< of the same Gaussians
  std::vector<TrainingView> views_;
  DeferredLossReadback losses_;
  std::int64_t iteration_ = 0;
  double seconds_ = 0.0;
  std::size_t medium_estimations_ = 0;  ///< completed so far
};

}  // namespace apvi::mapping
