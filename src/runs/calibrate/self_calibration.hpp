// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "apvi/config/node.hpp"
#include "apvi/sensors/rig.hpp"
#include "eval/metrics_file.hpp"
#include "vio/window/calibration.hpp"

namespace apvi::runs {

/// As DIPO estimates it [s].
struct DvlTimeOffset {
  double value_s = 0.0;
  double sigma_s = 0.0;
};

/// Appends the parameter "dvl0.time_offset_s", as independent of the others. `rig_s`: its value in
/// the rig; `prior_sigma_s`: the uncertainty of that.
void append_time_offset(const DvlTimeOffset& offset, double rig_s, double prior_sigma_s,
                        vio::CalibrationEstimate& estimate);

/// The rig, changed by the parameters' changes.
Rig changed(const Rig& rig, const std::vector<vio::CalibrationParameter>& parameters);

/// The nodes of a rig.yaml with the intrinsics, extrinsics, time offsets and DVL scale of
/// `estimate`; all else as in `rig`.
config::Node estimated_rig(const config::Node& rig, const Rig& estimate);

/// Section `self_calibration` of metrics.json: for each parameter `change` from the rig's value,
/// its `sigma` (lists for vectors), whether the recording told it (`observable`) and whether the
/// rig's value was used all the same (`held`).
eval::Json self_calibration_json(const std::vector<vio::CalibrationParameter>& parameters);

/// Writes rig_estimated.yaml, for `dataset.rig` of a later run, and returns the section of
/// metrics.json; neither when the recording told no parameter. Held parameters stay as in `rig`.
/// Logs what differs from the rig by more than three standard deviations of either. Throws RunError
/// when the file cannot be written.
eval::Json report_self_calibration(const std::filesystem::path& file, const config::Node& rig,
                                   const std::vector<vio::CalibrationParameter>& parameters);

}  // namespace apvi::runs
