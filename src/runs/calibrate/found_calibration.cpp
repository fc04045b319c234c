// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/found_calibration.hpp"

#include "runs/calibrate/bundle_calibration.hpp"

namespace apvi::runs {

vio::CalibrationEstimate found_calibration(const RunConfig& config, const Rig& rig,
                                           const localization::VisualPipeline& visual,
                                           const std::optional<DvlTimeOffset>& dvl_time_offset) {
  vio::CalibrationEstimate found = visual.fusion_stage().estimator().calibration();
  if (visual.smoother() != nullptr) {
    if (const auto& camera = visual.smoother()->closer().adjusted_camera()) {
      adopt_camera(*camera, rig, found);
    }
  }
  const dipo::CalibrationState& offset = config.dipo.dvl.time_offset;
  if (rig.dvl && offset.estimate && dvl_time_offset) {
    append_time_offset(*dvl_time_offset, rig.dvl->time_offset_s, offset.sigma, found);
  }
  return found;
}

}  // namespace apvi::runs
