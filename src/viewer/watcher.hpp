// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <variant>
#include <vector>

#include "viewer/frame_rate.hpp"
#include "viewer/message.hpp"

namespace apvi::viewer {

using Time = std::chrono::steady_clock::time_point;

/// An image of a view to draw for a watcher.
struct FrameJob {
  std::uint32_t frame = 0;
  std::uint32_t view_id = 0;  ///< ViewMessage::id
  View view;                  ///< of the size to draw
  bool complete = false;
};
using Job = std::variant<FrameJob, SnapshotMessage, MeasureMessage>;

/// One watcher: what it wants to see, what it has been sent, and what to draw for it next. Not
/// thread-safe. Its memory is bounded, whatever the page sends.
class Watcher {
 public:
  void receive(const Message& message, Time now);
  /// The next job, if there is one now. `version`: of the scene.
  std::optional<Job> next(Time now, std::uint64_t version);
  /// A frame was handed to the connection after `render_s`, times the watchers that share the
  /// renderer.
  void sent(std::uint32_t frame, double render_s, std::size_t bytes, Time now);
  /// There is no map yet: the frame was not sent.
  void skipped(std::uint32_t frame);
  /// The connection has written a frame. Only then the page can have drawn it.
  void written(std::uint32_t frame);
  /// Whether images of a moving view are asked for.
  bool moving() const { return view_ && view_->moving; }

 private:
  struct Flight {
    std::uint32_t frame = 0;
    bool counts = false;  ///< for the frame rate
    bool written = false;
    double render_s = 0.0;
    std::size_t bytes = 0;
    Time sent;
  };

  void drawn(std::uint32_t frame, Time now);
  std::optional<bool> due(Time now, std::uint64_t version) const;
  FrameJob make_frame(bool complete) const;

  std::optional<ViewMessage> view_;
  Time view_time_;
  bool view_is_new_ = false;     // not drawn yet
  bool needs_complete_ = false;  // the last image was not at full size
  std::uint64_t drawn_version_ = 0;
  Time drawn_time_;
  std::uint32_t next_frame_ = 1;
  std::vector<Flight> flights_;
  std::deque<Job> requests_;
  FrameRate rate_{1.0 / 20.0};
};

}  // namespace apvi::viewer
