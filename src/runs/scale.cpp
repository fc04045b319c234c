// SPDX-License-Identifier: BSD-3-Clause
#include "runs/scale.hpp"

#include <nlohmann/json.hpp>

#include "apvi/config/node.hpp"
#include "apvi/core/log.hpp"

namespace apvi::runs {
namespace {

const char* name_of(ScaleSource source) {
  switch (source) {
    case ScaleSource::dvl:
      return "dvl";
    case ScaleSource::stereo:
      return "stereo";
    case ScaleSource::pressure:
      return "pressure";
    case ScaleSource::accelerometer:
      return "accelerometer";
    case ScaleSource::images:
      return "images";
    case ScaleSource::given_poses:
      return "given poses";
    case ScaleSource::unknown:
      break;
  }
  return "unknown";
}

}  // namespace

ScaleSource scale_of(const Rig& rig, const localization::ActiveSensors& sensors) {
  if (sensors.dvl || sensors.dvl_scale) return ScaleSource::dvl;
  if (!sensors.imu) return sensors.pressure_scale ? ScaleSource::pressure : ScaleSource::images;
  return sensors.cameras > 1 && rig.cameras.size() > 1 ? ScaleSource::stereo
                                                       : ScaleSource::accelerometer;
}

ScaleSource source_of(localization::ScaleSensor sensor) {
  switch (sensor) {
    case localization::ScaleSensor::imu:
      return ScaleSource::accelerometer;
    case localization::ScaleSensor::dvl:
      return ScaleSource::dvl;
    case localization::ScaleSensor::pressure:
      break;
  }
  return ScaleSource::pressure;
}

ScaleSource scale_of_given_poses(const std::filesystem::path& recording,
                                 const std::filesystem::path& poses_file) {
  const std::filesystem::path notes = recording / "import.yaml";
  if (!poses_file.empty() || !std::filesystem::exists(notes)) return ScaleSource::given_poses;
  const config::Node node = config::load_file(notes);
  const config::Node* scale = node.find("scale");
  return scale != nullptr && scale->text == "unknown" ? ScaleSource::unknown
                                                      : ScaleSource::given_poses;
}

bool is_known(ScaleSource source) {
  return source != ScaleSource::unknown && source != ScaleSource::images;
}

eval::Json scale_json(ScaleSource source) {
  return {{"source", name_of(source)}, {"known", is_known(source)}};
}

void warn_about_scale(ScaleSource source) {
  if (source == ScaleSource::accelerometer) {
    log::warning(
        "scale: from the accelerometer alone, since there is no DVL; distances are uncertain");
  }
  if (source == ScaleSource::pressure) {
    log::warning(
        "scale: from changes of depth alone; unknown until the camera has moved up or down");
  }
  if (source == ScaleSource::images) {
    log::warning(
        "scale: unknown, as images alone do not show it; distances are not meters, but in a unit "
        "in which the first scene is vio.visual.start_distance away. If you know a length in the "
        "scene: apvi scale");
  }
  if (source == ScaleSource::unknown) {
    log::warning(
        "scale: unknown; distances are in units of the given poses, not meters. If you know the "
        "unit: apvi import --meters-per-unit; if you know a length in the scene: apvi scale");
  }
}

}  // namespace apvi::runs
