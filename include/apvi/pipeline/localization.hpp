// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/dipo/dipo.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::pipeline {

/// One output: the pose at a DVL ping, with what the filter thinks of itself and of its sensors.
struct LocalizationOutput {
  dipo::Estimate estimate;
  dipo::Report ping;
};

struct LocalizationCounts {
  std::map<dipo::Verdict, std::size_t> pings;
  std::map<dipo::Verdict, std::size_t> depths;
};

/// Localization without a camera: feeds samples to DIPO and gives a pose at every DVL ping, causal:
/// the pose of a ping is given out once, as soon as the inertial data have reached it.
class Localization {
 public:
  Localization(const dipo::Config& config, const Rig& rig) : dipo_(config, rig) {}

  /// Takes one sample in; returns the outputs it completes.
  std::vector<LocalizationOutput> process(const SensorEvent& event);

  const dipo::Dipo& dipo() const { return dipo_; }
  const LocalizationCounts& counts() const { return counts_; }

 private:
  void take_reports();

  dipo::Dipo dipo_;
  std::deque<Stamp> wanted_;  // pings whose pose has not been given out
  std::map<Stamp, dipo::Report> reports_;
  LocalizationCounts counts_;
};

}  // namespace apvi::pipeline
