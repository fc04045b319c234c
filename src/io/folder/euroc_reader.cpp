// SPDX-License-Identifier: BSD-3-Clause
#include <sstream>

#include "io/folder/csv_file.hpp"
#include "io/folder/euroc_rig.hpp"
#include "io/readers.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;

config::Node read_rig(const fs::path& mav) {
  std::map<std::string, config::Node> sensors;
  for (const char* name : {"imu0", "cam0", "cam1"}) {
    const fs::path yaml = mav / name / "sensor.yaml";
    if (!fs::exists(yaml)) continue;
    std::ostringstream text;
    text << open_text(yaml)->rdbuf();
    sensors[name] = parse_sensor_yaml(text.str(), yaml.string());
  }
  return sensors.empty() ? config::Node{} : rig_of_sensor_yamls(sensors);
}

}  // namespace

Recording open_euroc(const fs::path& root, const DatasetConfig& config,
                     const SensorChoice& choice) {
  Recording recording;
  recording.rig = config.rig.empty() ? read_rig(root / "mav0") : load_rig(config, "");
  add_asl_sensors(root, config, choice, recording);
  return recording;
}

}  // namespace apvi::io
