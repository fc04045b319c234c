// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <optional>

#include "apvi/mapping/options.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Keyframes that wait for depth estimation until they have neighbors on both sides.
class DepthQueue {
 public:
  explicit DepthQueue(const OnlineOptions& options);

  /// Adds every `depth_every_keyframes`-th keyframe; `number` counts them from 1.
  void push(std::size_t view, std::size_t number);
  /// The oldest keyframe if enough later ones are in the queue; `pop` removes it.
  std::optional<std::size_t> due() const;
  void pop() { views_.pop_front(); }
  /// Bounds the queue while depth estimation is deferred: drops every second keyframe of a full
  /// queue, which keeps the rest evenly spread.
  void thin();
  void remove(std::size_t view);
  void clear() { views_.clear(); }

  std::size_t size() const { return views_.size(); }
  const std::deque<std::size_t>& views() const { return views_; }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  std::size_t every_;
  std::size_t lag_;
  std::deque<std::size_t> views_;
};

}  // namespace apvi::mapping
