// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "viewer/watcher.hpp"

namespace apvi::viewer {

/// A message to a page.
struct Outgoing {
  std::string data;
  bool binary = false;
  std::uint32_t frame = 0;  ///< of a frame, to be reported as written; else 0
};

/// Draws for all watchers in turn, on a thread of its own.
class RenderLoop {
 public:
  using Deliver = std::function<void(Outgoing)>;

  /// `share`: greatest fraction of the time to draw in, 0 to 1.
  RenderLoop(Scene& scene, double share);
  ~RenderLoop();
  RenderLoop(const RenderLoop&) = delete;
  RenderLoop& operator=(const RenderLoop&) = delete;

  /// Draws no more. Before what `deliver` uses goes.
  void stop();
  /// `deliver` is called from the loop's thread, until `remove` has returned.
  void add(std::uint64_t watcher, Deliver deliver);
  void remove(std::uint64_t watcher);
  void receive(std::uint64_t watcher, const Message& message);
  void written(std::uint64_t watcher, std::uint32_t frame);

 private:
  struct Seat {
    Watcher watcher;
    Deliver deliver;
  };
  struct Turn {
    std::uint64_t watcher = 0;
    Job job;
  };

  void run(const std::stop_token& stop);
  std::optional<Turn> next_turn();
  void execute(const Turn& turn);
  void skip(const Turn& turn);
  void draw(std::uint64_t watcher, const FrameJob& job);
  void snapshot(std::uint64_t watcher, const SnapshotMessage& job);
  void measure(std::uint64_t watcher, const MeasureMessage& job);
  void deliver(std::uint64_t watcher, Outgoing message);
  void rest(const std::stop_token& stop, std::chrono::steady_clock::duration worked);

  Scene& scene_;
  double share_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::map<std::uint64_t, Seat> seats_;
  std::uint64_t last_served_ = 0;
  std::jthread thread_;  // last: it uses the others
};

}  // namespace apvi::viewer
