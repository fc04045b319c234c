// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <exception>
#include <map>
#include <mutex>
#include <stop_token>
#include <string>
#include <utility>

#include "apvi/core/bounded_queue.hpp"
#include "apvi/io/sequence.hpp"

namespace apvi::io {

struct LiveOptions {
  std::size_t capacity = 4096;    ///< samples that wait to be read; a full queue makes `push` wait
  double reorder_s = 0.1;         ///< samples wait so long for older ones of other sensors [s]
  double max_time_jump_s = 60.0;  ///< as DatasetConfig::max_time_jump_s
};

/// A sequence that other threads feed while one thread reads it: drivers push, an estimator reads.
///
/// Samples of one sensor must come in their order; those that do not, and those that no estimator
/// could use, are dropped and counted as those of a recording are. Between sensors, samples are put
/// in order as far as `reorder_s` allows; one that comes later still (a DVL's ping, say) is handed
/// on when it comes, for the acoustic odometry takes it in at its own time.
class LiveSequence : public SequenceReader {
 public:
  /// `rig` as in a rig.yaml; sensors that it describes are expected.
  explicit LiveSequence(config::Node rig, const LiveOptions& options = {});

  /// From any thread. Waits while the queue is full. False once the sequence is over: nobody will
  /// read the sample.
  bool push(SensorEvent event) { return queue_.push(std::move(event), stop_.get_token()); }
  /// Nothing more comes; what was pushed is still read.
  void finish() { queue_.close(); }
  /// The same, and then `next` throws what the source has thrown.
  void fail(std::exception_ptr error);
  /// Ends it at once, for the reader and for everyone who waits in `push`.
  void stop();

  const config::Node& rig() const override { return rig_; }
  /// Waits for a sample; nothing at the end or after `stop`.
  std::optional<SensorEvent> next() override;
  /// Nobody knows how much will come: 0 until the end, then 1.
  double fraction() const override { return finished_ ? 1.0 : 0.0; }
  const std::map<std::string, StreamReport>& report() const override { return report_; }
  std::optional<Trajectory> reference() const override { return std::nullopt; }

 private:
  struct Cleaners;  // per sensor
  void take(SensorEvent event);
  void collect();
  bool is_due() const;

  config::Node rig_;
  LiveOptions options_;
  BoundedQueue<SensorEvent> queue_;
  std::stop_source stop_;
  std::map<std::string, StreamReport> report_;
  std::shared_ptr<Cleaners> cleaners_;
  std::multimap<Stamp, SensorEvent> waiting_;  // for older ones
  Stamp newest_ = Stamp::min();
  bool ended_ = false;     // nothing comes any more, some may wait
  bool finished_ = false;  // nothing waits either
  std::mutex mutex_;
  std::exception_ptr error_;  // guarded
};

}  // namespace apvi::io
