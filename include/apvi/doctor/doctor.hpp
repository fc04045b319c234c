// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include "apvi/doctor/report.hpp"
#include "apvi/io/sequence.hpp"

/// Looks for what is wrong with a recording or its calibration, before anyone blames the estimator.
namespace apvi::doctor {

struct Options {
  std::function<void(double fraction)>
      progress;                       ///< called now and then while reading; may be empty
  std::function<bool()> interrupted;  ///< stop reading and judge what was read
};

/// Reads the recording once and judges it. The statistics cover all of it; the fits of sensors
/// against each other use ten minutes from the first DVL ping that moves, so memory does not grow
/// with the length of the recording. Throws InputError when no sensor of it can be opened;
/// everything else that is wrong, a bad rig included, is a finding.
Report examine(const io::DatasetConfig& config, const Options& options = {});

}  // namespace apvi::doctor
