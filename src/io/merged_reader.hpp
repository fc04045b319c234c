// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/io/sequence.hpp"
#include "io/clock_monitor.hpp"
#include "io/sample_source.hpp"
#include "io/stream_cleaner.hpp"
#include "io/time_units.hpp"

namespace apvi::io {

/// Cleans the streams of a recording and merges them chronologically, within the configured span.
class MergedReader : public SequenceReader {
 public:
  MergedReader(Recording recording, const DatasetConfig& config);

  const config::Node& rig() const override { return recording_.rig; }
  std::optional<SensorEvent> next() override;
  double fraction() const override;
  const std::map<std::string, StreamReport>& report() const override { return report_; }
  std::optional<Trajectory> reference() const override { return recording_.reference(); }

 private:
  struct Stream {
    std::size_t index = 0;
    SampleSource* source = nullptr;
    StreamReport* report = nullptr;
    StreamCleaner cleaner;
    bool ended = false;
  };

  bool fill(Stream& stream);
  Stream* earliest();
  void find_start();
  void drop_before_clock_sets();
  std::optional<Stamp> begin_of_others(const Stream& stream) const;
  bool drop_before(Stream& stream, Stamp begin);
  void leave_out_other_clocks(const std::vector<SettledStamps>& settled);
  void leave_out(Stream& stream, const std::string& remark);
  bool in_blackout(const SensorEvent& event) const;

  Recording recording_;
  DatasetConfig config_;
  std::map<std::string, StreamReport> report_;
  ClockMonitor clocks_;
  std::vector<Stream> streams_;
  std::optional<Stamp> begin_;  // of the recording; origin of the span
  Stamp from_;
  Stamp until_ = Stamp::max();
  Stamp latest_ = Stamp::min();
  bool finished_ = false;
};

}  // namespace apvi::io
