// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/config/node.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// What a source says when asked for its next sample. `pending`: nothing of this sensor is near in
/// the recording; the others should go on without it.
enum class SourceState { sample, malformed, pending, end };

/// The samples of one sensor as the recording has them: not cleaned, lazily read.
class SampleSource {
 public:
  virtual ~SampleSource() = default;
  /// Fills `event` when the answer is `sample`.
  virtual SourceState next(SensorEvent& event) = 0;
  /// Where the sample just read stands: "file:line", or topic and time.
  virtual std::string where() const = 0;
  /// How much has been read, in [0, 1].
  virtual double fraction() const = 0;
};

/// A recording taken apart, as every format's reader returns it.
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
