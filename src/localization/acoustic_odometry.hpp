// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/samples.hpp"
#include "dipo/dipo.hpp"

namespace apvi::localization {

/// Output at a DVL ping: the filter's estimate and the result of the ping's update.
struct PingOutput {
  dipo::Estimate estimate;
  dipo::Report ping;
};

struct UpdateCounts {
  std::map<dipo::Verdict, std::size_t> pings;
  std::map<dipo::Verdict, std::size_t> depths;
};

/// Odometry without a camera: feeds samples to the DIPO filter and outputs a pose per DVL ping. It
/// is causal: the pose of a ping is output once, as soon as IMU data have reached its stamp.
class AcousticOdometry {
 public:
  AcousticOdometry(const dipo::Config& config, const Rig& rig) : dipo_(config, rig) {}

  /// Processes one sample; returns the outputs that it completes.
  std::vector<PingOutput> process(const SensorEvent& event);

  const dipo::Dipo& dipo() const { return dipo_; }
  const UpdateCounts& counts() const { return counts_; }

 private:
  void collect_reports();

  dipo::Dipo dipo_;
  std::deque<Stamp> pending_stamps_;  // pings whose pose has not been output
  std::map<Stamp, dipo::Report> reports_;
  UpdateCounts counts_;
};

}  // namespace apvi::localization
