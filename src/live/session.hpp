// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "apvi/io/live_sequence.hpp"
#include "live/latency.hpp"
#include "live/merger.hpp"
#include "live/recorder.hpp"
#include "live/source.hpp"

namespace apvi::live {

struct SessionOptions {
  double max_wait_s = 0.5;  ///< see MergerOptions
  double duration_s = 0.0;  ///< 0: until interrupted, or the end of all recordings
  Recorder* recorder = nullptr;
  LatencyMonitor* latency = nullptr;
  std::string latency_kind = "camera";  ///< of samples whose arrival the latency counts from
};

/// The sources of a run and the sequence of samples that they make: merged in order of time,
/// recorded as the reader gets them.
class Session {
 public:
  /// `rig` as of io::LiveSequence.
  Session(std::vector<std::unique_ptr<Source>> sources, config::Node rig, SessionOptions options);
  ~Session() { stop(); }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  /// Begins. `interrupted` is polled; the sequence then ends at once.
  void start(std::function<bool()> interrupted);
  /// Ends all threads.
  void stop();

  /// For one thread; its `next` waits for samples.
  io::SequenceReader& sequence() { return sequence_; }
  /// Of all sources. Thread-safe.
  std::vector<SourceStatus> sources() const;
  /// For a status line: what each source does that is not well, or that all are. Thread-safe.
  std::string status() const;
  /// Samples that came too late, by stream. Thread-safe.
  std::map<std::string, std::size_t> late() const;

 private:
  void take(SensorEvent event, Stamp arrival);
  void deliver(const SensorEvent& event, Stamp arrival);
  void watch(const std::stop_token& stop, const std::function<bool()>& interrupted);
  bool advance(Stamp now, bool over);
  bool all_ended() const;

  SessionOptions options_;
  io::LiveSequence sequence_;
  mutable std::mutex mutex_;
  Merger merger_;  // guarded by mutex_
  std::vector<std::unique_ptr<Source>> sources_;
  std::jthread watcher_;
};

}  // namespace apvi::live
