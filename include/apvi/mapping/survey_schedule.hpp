// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// When the mapper surveys the water, counted in keyframes that it took: again whenever there are
/// four tenths more than at the last survey, and twenty after an outage. Over a time without
/// pictures a camera's gain may go anywhere, and what comes into sight then takes whatever gain it
/// is given for its own brightness: the water tells.
class SurveySchedule {
 public:
  /// The first survey comes when there are `first` keyframes.
  explicit SurveySchedule(std::size_t first) : first_(first) {}

  /// Pictures come again, after a time without; `taken` with the first of them.
  void sight_returned(std::size_t taken);
  bool is_due(std::size_t taken) const;
  void surveyed(std::size_t taken);

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  std::size_t first_;
  std::size_t last_ = 0;                     ///< keyframes there were at the last survey
  std::optional<std::size_t> after_outage_;  ///< when there are so many, besides
};

}  // namespace apvi::mapping
