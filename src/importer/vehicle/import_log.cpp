// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/config/node.hpp"
#include "apvi/core/log.hpp"
#include "importer/sources.hpp"
#include "importer/vehicle/sensor_files.hpp"
#include "importer/vehicle/sensor_rig.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

void report_missing(const fs::path& path, const SensorData& data) {
  if (data.dvl.empty()) {
    log::warning(
        "{}: no velocities of a DVL (VISION_POSITION_DELTA, VISO), and without them or images no "
        "position can be estimated; add the log of the DVL with --sensors, or import a video with "
        "this file as --sensors",
        path.string());
  }
  if (data.imu.empty()) {
    log::warning("{}: no samples of an IMU, which a DVL needs to give a position", path.string());
  }
}

std::string rig_yaml(const SensorData& data, const ImportOptions& options) {
  if (options.rig.empty()) {
    log::warning(
        "rig.yaml: the mounting of the sensors is ASSUMED; correct it there, or give --rig");
    return sensor_yaml(data, body_axes(data, /*has_images=*/false), {});
  }
  const config::Node node = config::load_with_inheritance(options.rig);
  const Rig rig = make_rig(node);
  return sensor_yaml(data, body_axes(rig), rig) + config::to_yaml(node);
}

}  // namespace

ImportResult import_log(const fs::path& path, const ImportOptions& options, DiveWriter& dive) {
  ImportResult result;
  std::vector<fs::path> files = {path};
  files.insert(files.end(), options.sensors.begin(), options.sensors.end());
  const SensorData data = read_sensor_files(files);
  result.interrupted = options.interrupted();
  if (result.interrupted) return result;
  report_missing(path, data);
  write_sensors(data, dive);
  dive.write_text("rig.yaml", rig_yaml(data, options));
  result.imu_samples = data.imu.size();
  result.dvl_samples = data.dvl.size();
  result.pressure_samples = data.pressure.size() + data.depth.size();
  const auto [first, last] = *data.span();
  result.length_s = seconds_between(first, last);
  return result;
}

}  // namespace apvi::importer
