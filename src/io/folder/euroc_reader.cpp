// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/foreign_rig.hpp"
#include "io/readers.hpp"

namespace apvi::io {

Recording open_euroc(const std::filesystem::path& root, const DatasetConfig& config,
                     const SensorChoice& choice) {
  Recording recording;
  recording.rig = config.rig.empty() ? load_euroc_rig(root / "mav0") : load_rig(config, "");
  add_asl_sensors(root, config, choice, recording);
  return recording;
}

}  // namespace apvi::io
