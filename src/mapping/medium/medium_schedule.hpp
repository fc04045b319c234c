// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Schedules medium estimations by the number of accepted keyframes: again when it has grown by 40
/// % or by 300 since the last estimation, and 20 keyframes after an outage. During an outage the
/// camera's gain may change arbitrarily; only the medium can then separate gain from surface
/// brightness.
class MediumSchedule {
 public:
  /// The first estimation is due at `first` keyframes.
  explicit MediumSchedule(std::size_t first) : first_(first) {}

  /// Images have resumed after an outage; `keyframes` includes the first of them.
  void images_resumed(std::size_t keyframes);
  bool is_due(std::size_t keyframes) const;
  void mark_estimated(std::size_t keyframes);

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  std::size_t first_;
  std::size_t last_ = 0;                     ///< keyframes at the last estimation
  std::optional<std::size_t> after_outage_;  ///< additionally due at this number
};

}  // namespace apvi::mapping
