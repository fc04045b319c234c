// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <set>
#include <vector>

#include "core/random.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Samples the keyframe of the next training step during incremental mapping: with a probability
/// that grows with its last loss and falls with its recent uses, and for a given fraction of the
/// draws among the newest. Old uses decay, because later keyframes may have changed the map.
class ViewSchedule {
 public:
  /// `recent_fraction` in [0, 1] of the draws is among the `recent_count` newest views.
  ViewSchedule(std::size_t recent_count, double recent_fraction)
      : recent_count_(recent_count), recent_fraction_(recent_fraction) {}

  /// Adds a view by its index in the keyframe store, in ascending order.
  void add(std::size_t view);
  void remove(std::size_t view);
  std::size_t size() const { return entries_.size(); }

  /// Views that are not drawn for now, unless all are paused.
  void pause(const std::set<std::size_t>& views);
  /// Draws a view. Throws c10::Error when there is none.
  std::size_t draw(Random& random) const;
  /// Counts a use of the view.
  void use(std::size_t view);
  /// Sets the view's latest loss.
  void report(std::size_t view, double loss);
  /// Total number of uses of a view.
  std::int64_t uses(std::size_t view) const;
  /// From now on, newest views are not preferred any more.
  void disable_recency_bias() { recent_fraction_ = 0.0; }
  /// Clears the penalties of outlier views, after the map has changed abruptly.
  void reset_penalties();

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  struct Entry {
    std::size_t view = 0;
    std::int64_t uses = 0;
    std::int64_t uses_since_reset = 0;  ///< uses since the last reset_penalties()
    double loss = 0.0;                  ///< 0: unknown
    double recent_uses = 0.0;           ///< exponentially decaying count
    bool paused = false;
  };
  Entry* find(std::size_t view);
  double weight(const Entry& entry, double mean_loss, double mean_uses) const;
  std::vector<const Entry*> candidates() const;

  std::size_t recent_count_;
  double recent_fraction_;
  std::vector<Entry> entries_;  ///< in order of time
};

}  // namespace apvi::mapping
