// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include "apvi/io/sequence.hpp"
#include "doctor/report.hpp"

/// Diagnoses problems of a recording or its calibration.
namespace apvi::doctor {

struct Options {
  std::function<void(double fraction)>
      progress;                       ///< called periodically while reading; may be empty
  std::function<bool()> interrupted;  ///< stops reading; the data read so far are checked
};

/// Reads the recording once, and some of its images again, and checks it. Statistics cover all of
/// it; fits between sensors use ten minutes from the first DVL ping with motion, so memory does not
/// grow with the length of the recording. Throws InputError when no sensor can be opened; all other
/// problems, including an invalid rig, are findings.
Report examine(const io::DatasetConfig& config, const Options& options = {});

}  // namespace apvi::doctor
