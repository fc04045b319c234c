// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "apvi/core/random.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Which keyframe is learnt from next, while new ones come in: more likely the larger its last loss
/// is and the less it was used lately, and with a given share of all draws one of the newest. Uses
/// of long ago do not count: what came after may have undone them.
class ViewSchedule {
 public:
  /// `share` in [0, 1] of the draws is among the `recent` newest views.
  ViewSchedule(std::size_t recent, double share) : recent_(recent), share_(share) {}

  /// Views are known by their index in the keyframe store; the newest is added last.
  void add(std::size_t view);
  void remove(std::size_t view);
  std::size_t size() const { return entries_.size(); }

  /// A view. Throws c10::Error when there is none.
  std::size_t draw(Random& random) const;
  /// The view was used.
  void use(std::size_t view);
  /// Its loss in some use, by now.
  void report(std::size_t view, double loss);
  /// How often a view was used.
  std::int64_t uses(std::size_t view) const;
  /// From now on all views are alike but for loss and use.
  void forget_recency() { share_ = 0.0; }
  /// What the map shows has changed at once: views that it could not explain get another chance.
  void pardon();

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  struct Entry {
    std::size_t view = 0;
    std::int64_t uses = 0;
    std::int64_t tries = 0;  ///< uses since the last pardon
    double loss = 0.0;       ///< 0: not known yet
    double lately = 0.0;     ///< uses, those of the past less and less
  };
  Entry* find(std::size_t view);
  double weight(const Entry& entry, double mean_loss, double mean_uses) const;

  std::size_t recent_;
  double share_;
  std::vector<Entry> entries_;  ///< in order of time
};

}  // namespace apvi::mapping
