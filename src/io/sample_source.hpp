// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apvi/config/node.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// Result of a request for the next sample. `implausible`: a reading that
/// the sensor cannot have measured. `pending`: no sample within the look-ahead; the other
/// sensors continue without this one.
enum class SourceState { sample, malformed, implausible, pending, end };

/// What a text file tells of the unit of its stamps. Numbers are as written, in that unit.
struct StampSummary {
  std::string column;      ///< "FILE: column NAME", for messages
  bool is_stated = false;  ///< whether the header names the unit
  int power = 0;           ///< of ten nanoseconds: the unit in use, stated or guessed
  std::string order = {};  ///< that rows out of order were sorted, as a warning; else ""
  double first = 0.0;      ///< stamp, whatever a single one is
  double last = 0.0;       ///< stamp, likewise
  double step = 0.0;       ///< median of the positive steps of the first rows
};

/// The raw samples of one sensor of a recording, lazily read.
class SampleSource {
 public:
  virtual ~SampleSource() = default;
  /// Fills `event` when the result is `sample`.
  virtual SourceState next(SensorEvent& event) = 0;
  /// Location of the sample just read: "file:line", or topic and time.
  virtual std::string where() const = 0;
  /// Why the sample just read is malformed: the kind of problem, and the text at fault; both empty
  /// when that is not known.
  virtual std::pair<std::string, std::string> problem() const { return {}; }
  /// Fraction read, in [0, 1].
  virtual double fraction() const = 0;
  /// What was assumed of the samples, as a warning that has been logged; "" when nothing was. To be
  /// asked after the first sample.
  virtual std::string remark() const { return ""; }
  /// To be asked before the first sample; nullopt where the unit of stamps is beyond doubt, or too
  /// few of them tell it.
  virtual std::optional<StampSummary> stamp_summary() { return std::nullopt; }
  /// Replaces the unit of the stamps by this power of ten of nanoseconds.
  virtual void set_stamp_power(int /*power*/) {}
};

/// The parts of a recording, as returned by the reader of each format.
struct Recording {
  config::Node rig;
  std::vector<std::unique_ptr<SampleSource>> sources;
  std::vector<std::string> kinds;  ///< of each source: "imu", "camera", …
  std::function<std::optional<Trajectory>()> reference = [] { return std::nullopt; };

  void add(std::string kind, std::unique_ptr<SampleSource> source) {
    kinds.push_back(std::move(kind));
    sources.push_back(std::move(source));
  }
};

}  // namespace apvi::io
