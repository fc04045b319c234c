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
