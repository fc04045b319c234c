// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <stop_token>
#include <thread>

#include "runs/views/map_painter.hpp"
#include "slam/async_mapper.hpp"

namespace apvi::runs {

/// Copies the map of a running mapper, twice a second at most, on a thread of its own: a copy waits
/// for the mapper's step, and whoever draws the map does not. Thread-safe.
class MapCopier {
 public:
  struct Copy {
    slam::MapCopy map;
    MapExtent extent;
  };

  MapCopier();

  /// Null: there is none any more. Waits for a copy that is being made.
  void set_mapper(slam::AsyncMapper* mapper);
  /// The newest copy, if there is one since the last call. Nothing is copied until it was taken.
  std::optional<Copy> take();

 private:
  void run(const std::stop_token& stop);
  std::optional<Copy> copy();

  std::mutex mapper_mutex_;  // of the mapper, while it is copied
  slam::AsyncMapper* mapper_ = nullptr;
  std::int64_t iteration_ = -1;  // of the thread
  std::mutex mutex_;
  std::condition_variable_any taken_;
  std::optional<Copy> newest_;
  std::jthread thread_;  // last: it uses the others
};

}  // namespace apvi::runs
