// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/io/sequence.hpp"
#include "live/link.hpp"

namespace apvi::live {

/// A recording, delivered at its own pace as if it were a vehicle.
class PlaybackLink : public Link {
 public:
  /// `speed`: relative to the recording. `sensors`: as of io::open_sequence. Throws InputError as
  /// that does.
  PlaybackLink(const std::string& path, const std::vector<std::string>& sensors, double speed);
  bool receive(Receiver& receiver) override;

 private:
  std::unique_ptr<io::SequenceReader> reader_;
  double speed_;
  std::optional<SensorEvent> next_;
  std::optional<Stamp> first_;  // of the recording
  Stamp began_;                 // host's clock
};

}  // namespace apvi::live
