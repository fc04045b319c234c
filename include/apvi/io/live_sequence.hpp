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
  std::size_t capacity = 4096;    ///< queued samples; `push` blocks when the queue is full
  double reorder_s = 0.1;         ///< hold-back time for older samples of other sensors [s]
  double max_time_jump_s = 60.0;  ///< as DatasetConfig::max_time_jump_s
  /// Hold the first sample of a sensor until the second one confirms its stamp.
  bool confirm_first = true;
};

/// A live sequence: driver threads push samples while one thread reads them.
///
/// Samples of one sensor must arrive in order; out-of-order and unusable samples are dropped and
/// counted as in a recording. Samples of different sensors are reordered within `reorder_s`; a
/// sample that arrives later (a DVL ping, for example) is delivered on arrival, because the
/// acoustic odometry applies it at its own stamp.
class LiveSequence : public SequenceReader {
 public:
  /// `rig` as in rig.yaml; the sensors that it describes are expected.
  explicit LiveSequence(config::Node rig, const LiveOptions& options = {});

  /// Thread-safe. Blocks while the queue is full. False after the end of the sequence: the sample
  /// will not be read.
  bool push(SensorEvent event) { return queue_.push(std::move(event), stop_.get_token()); }
  /// Ends the input; samples already pushed are still delivered.
  void finish() { queue_.close(); }
  /// As `finish`; after the last sample, `next` throws `error`.
  void fail(std::exception_ptr error);
  /// Ends the sequence at once and unblocks `next` and `push`.
  void stop();

  const config::Node& rig() const override { return rig_; }
  /// Blocks until a sample is available; nullopt at the end or after `stop`.
  std::optional<SensorEvent> next() override;
  /// The length is unknown: 0 until the end, then 1.
  double fraction() const override { return finished_ ? 1.0 : 0.0; }
  const std::map<std::string, StreamReport>& report() const override { return report_; }
  std::optional<Trajectory> reference() const override { return std::nullopt; }

 private:
  struct StreamCleaners;  // per sensor
  void clean(SensorEvent event);
  void collect_cleaned();
  bool is_due() const;

  config::Node rig_;
  LiveOptions options_;
  BoundedQueue<SensorEvent> queue_;
  std::stop_source stop_;
  std::map<std::string, StreamReport> report_;
  std::shared_ptr<StreamCleaners> cleaners_;
  std::multimap<Stamp, SensorEvent> reorder_buffer_;  // held back for older samples
  Stamp newest_ = Stamp::min();
  bool ended_ = false;     // no more input; samples may still be held back
  bool finished_ = false;  // all samples delivered
  std::mutex mutex_;
  std::exception_ptr error_;  // guarded by mutex_
};

}  // namespace apvi::io
