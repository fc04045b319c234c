// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "io/csv_sensors.hpp"
#include "io/readers.hpp"
#include "io/trajectory_text.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;
using Make = std::function<std::unique_ptr<SampleSource>(const fs::path& csv)>;

struct SensorFolder {
  std::string name;    // of the folder below mav0, and of the rig's section
  std::string kind;    // of the events
  std::string choice;  // the word in sensors.use
  Make make;
};

std::vector<SensorFolder> sensor_folders(PressureUnit unit) {
  const auto camera = [](int index) {
    return [index](const fs::path& csv) {
      return csv_camera(CsvFile(csv), csv.parent_path() / "data", index);
    };
  };
  return {
      {"imu0", "imu", "imu", [](const fs::path& csv) { return csv_imu(CsvFile(csv)); }},
      {"dvl0", "dvl", "dvl", [](const fs::path& csv) { return csv_dvl(CsvFile(csv)); }},
      {"pressure0", "pressure", "pressure",
       [unit](const fs::path& csv) { return csv_pressure(CsvFile(csv), unit); }},
      {"depth0", "depth", "pressure", [](const fs::path& csv) { return csv_depth(CsvFile(csv)); }},
      {"cam0", "camera", "camera", camera(0)},
      {"cam1", "camera", "camera", camera(1)},
  };
}

void add_sensor(const SensorFolder& sensor, const fs::path& mav, Recording& recording) {
  const fs::path folder = mav / sensor.name;
  const bool described = recording.rig.find(sensor.name) != nullptr;
  const fs::path csv = folder / "data.csv";
  if (fs::is_directory(folder)) {
    if (!recording.rig.is_null() && !described && sensor.name.starts_with("cam")) {
      log::info("{}: left out, because the rig does not describe {}", folder.string(), sensor.name);
      return;
    }
    if (!fs::exists(csv)) fail_input("{}: missing; the folder is there without it", csv.string());
    recording.add(sensor.kind, sensor.make(csv));
  } else if (described) {
    fail_input("{}: missing, though the rig describes {}; add it, or leave {} out of sensors.use",
               csv.string(), sensor.name, sensor.choice);
  }
}

}  // namespace

config::Node load_rig(const DatasetConfig& config, const fs::path& own) {
  if (!config.rig.empty()) return config::load_with_inheritance(config.rig);
  if (fs::exists(own)) return config::load_with_inheritance(own);
  return {};
}

std::optional<Trajectory> read_reference(const fs::path& path) {
  Trajectory trajectory = parse_trajectory(*open_text(path), path.string());
  if (trajectory.empty()) return std::nullopt;
  return trajectory;
}

void check_any_sensor(const Recording& recording, const fs::path& root) {
  if (!recording.sources.empty()) return;
  fail_input("{}: none of the sensors asked for is in this recording; look at sensors.use",
             root.string());
}

void add_asl_sensors(const fs::path& root, const DatasetConfig& config, const SensorChoice& choice,
                     Recording& recording) {
  const fs::path mav = root / "mav0";
  if (!fs::is_directory(mav)) {
    fail_input("{}: missing; a data set keeps its sensors there", mav.string());
  }
  for (const SensorFolder& sensor : sensor_folders(config.pressure_unit)) {
    if (choice.wants(sensor.choice)) add_sensor(sensor, mav, recording);
  }
  const fs::path gnss = mav / "gnss0" / "data.csv";
  if (choice.all() && fs::exists(gnss)) recording.add("gnss", csv_gnss(CsvFile(gnss)));
  const fs::path truth = mav / "state_groundtruth_estimate0" / "data.csv";
  recording.reference = [truth, gnss]() -> std::optional<Trajectory> {
    if (fs::exists(truth)) {
      if (auto trajectory = read_reference(truth)) return trajectory;
    }
    return fs::exists(gnss) ? read_reference(gnss) : std::nullopt;
  };
}

Recording open_folder(const fs::path& root, const DatasetConfig& config,
                      const SensorChoice& choice) {
  Recording recording;
  recording.rig = load_rig(config, root / "rig.yaml");
  add_asl_sensors(root, config, choice, recording);
  return recording;
}

}  // namespace apvi::io
