// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>

#include "apvi/mapping/options.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/keyframes/view_schedule.hpp"
#include "mapping/training/deferred_loss_readback.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {

/// Chooses view, image size and learning rates of the optimization steps of incremental mapping and
/// of its final refinement.
class OnlineTraining {
 public:
  explicit OnlineTraining(const MapperOptions& options);

  void add_view(std::size_t view) { schedule_.add(view); }
  void remove_view(std::size_t view) { schedule_.remove(view); }
  /// See ViewSchedule::pause.
  void pause(const std::set<std::size_t>& views) { schedule_.pause(views); }
  std::size_t views() const { return schedule_.size(); }
  /// Clears the penalties of outlier views, after the map has changed abruptly.
  void reset_penalties() { schedule_.reset_penalties(); }

  /// One step; frees memory as `retry_on_oom`. Throws c10::Error without views.
  void step(double extent, MapOptimizer& optimizer, KeyframeStore& keyframes);
  /// The latest loss read back.
  double loss() const { return losses_.newest(); }
  std::int64_t iteration() const { return iteration_; }

  void begin_final();
  bool is_final() const { return final_start_.has_value(); }
  /// Counts time spent on the final refinement, for `TrainerOptions::time_budget_s`.
  void add_final_time(double seconds);
  /// Progress of the final refinement, 0 to 1; 0 before it.
  double progress() const;
  /// Whether the steps or the time of the final refinement are used up.
  bool final_done() const;

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  int reduction(std::size_t view) const;
  LearningRates rates() const;
  StepSettings settings(std::size_t view, double extent) const;

  TrainerOptions trainer_;
  OnlineOptions online_;
  ViewSchedule schedule_;
  DeferredLossReadback losses_;
  std::int64_t iteration_ = 0;
  std::optional<std::int64_t> final_start_;
  double final_seconds_ = 0.0;
};

}  // namespace apvi::mapping
