// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/rig_file.hpp"
#include "apvi/sensors/rig.hpp"
#include "core/text.hpp"
#include "io/folder/csv_sensors.hpp"
#include "io/folder/waterlinked_log.hpp"
#include "io/readers.hpp"
#include "io/trajectory/trajectory_text.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;

// Whether a missing file is an error, rather than a sensor that was not recorded.
bool is_expected(const SensorFile& file, const config::Node& rig) {
  if (file.name == "cam1") return false;  // one camera is sufficient
  const bool folder_without_file =
      file.path.filename() == "data.csv" && fs::is_directory(file.path.parent_path());
  // Recordings are often shared without images; the other sensors are sufficient.
  if (file.kind == "camera" && !folder_without_file) return false;
  return folder_without_file || rig.find(file.name) != nullptr;
}

// The csv file of the DVL, or else a log of the device.
fs::path dvl_file(const fs::path& csv) {
  if (fs::exists(csv)) return csv;
  for (const char* extension : {".jsonl", ".json", ".log"}) {
    fs::path log = csv;
    if (fs::exists(log.replace_extension(extension))) return log;
  }
  return csv;
}

std::unique_ptr<SampleSource> open_dvl(const fs::path& path) {
  return path.extension() == ".csv" ? csv_dvl(CsvFile(path)) : waterlinked_dvl(path);
}

// Reads both sensors, whatever else is wrong with them: it is reported when they are used.
std::optional<VerticalMotion> motion_in(const fs::path& imu, const fs::path& dvl,
                                        const config::Node& rig) {
  const auto calibration = dvl_of_rig(rig);
  if (!calibration || !fs::exists(imu) || !fs::exists(dvl)) return std::nullopt;
  VerticalMotion motion(*calibration);
  try {
    SensorEvent event;
    for (const auto& source : {csv_imu_as_written(CsvFile(imu)), open_dvl(dvl)}) {
      for (SourceState state{}; (state = source->next(event)) != SourceState::end;) {
        if (state != SourceState::sample) continue;
        if (const auto* sample = std::get_if<ImuSample>(&event)) motion.add(*sample);
        if (const auto* ping = std::get_if<DvlSample>(&event)) motion.add(*ping);
      }
    }
  } catch (const InputError&) {
    return std::nullopt;
  }
  return motion;
}

}  // namespace

config::Node load_rig(const DatasetConfig& config, const fs::path& own) {
  if (!config.rig.empty()) return load_rig_file(config.rig);
  if (fs::exists(own)) return load_rig_file(own);
  return {};
}

double atmospheric_pressure_pa(const config::Node& rig) {
  const config::Node* sensor = rig.find("pressure0");
  const config::Node* air = sensor == nullptr ? nullptr : sensor->find("atmospheric_pressure_pa");
  const auto number = air == nullptr ? std::nullopt : text::parse_double(air->text);
  return number.value_or(PressureCalibration{}.atmospheric_pressure_pa);
}

std::optional<Trajectory> read_reference(const fs::path& path) {
  Trajectory trajectory = parse_trajectory(*open_text(path), path.string(), BadLines::drop);
  if (trajectory.empty()) return std::nullopt;
  return trajectory;
}

void check_any_sensor(const Recording& recording, const fs::path& root) {
  if (!recording.sources.empty()) return;
  fail_input("{}: none of the requested sensors is in this recording; check sensors.use",
             root.string());
}

void add_sensors(const std::vector<SensorFile>& files, const SensorChoice& choice,
                 Recording& recording) {
  for (const SensorFile& file : files) {
    if (!choice.wants(file.choice)) continue;
    const bool described = recording.rig.find(file.name) != nullptr;
    if (!fs::exists(file.path)) {
      if (!is_expected(file, recording.rig)) continue;
      fail_input("{}: missing; add it, or remove {} from {}", file.path.string(), file.name,
                 described ? "the rig, or " + file.choice + " from sensors.use" : "the folder");
    }
    if (file.kind == "camera" && !recording.rig.is_null() && !described) {
      log::info("{}: ignored: the rig does not describe {}", file.path.string(), file.name);
      continue;
    }
    recording.add(file.kind, file.open(file.path));
  }
}

void add_asl_sensors(const fs::path& root, const DatasetConfig& config, const SensorChoice& choice,
                     Recording& recording) {
  const fs::path mav = root / "mav0";
  if (!fs::is_directory(mav)) {
    fail_input("{}: missing; this folder must contain the sensors", mav.string());
  }
  const auto csv = [&](const char* name) { return mav / name / "data.csv"; };
  const auto camera = [](int index) {
    return [index](const fs::path& path) {
      return csv_camera(CsvFile(path), path.parent_path() / "data", index);
    };
  };
  const auto motion = [imu = csv("imu0"), dvl = dvl_file(csv("dvl0")), rig = recording.rig] {
    return motion_in(imu, dvl, rig);
  };
  const auto pressure = [&](const fs::path& path) {
    const double air = atmospheric_pressure_pa(recording.rig);
    return csv_pressure(CsvFile(path), config.pressure_unit, air, motion);
  };
  add_sensors({{"imu0", "imu", "imu", csv("imu0"), [](auto& p) { return csv_imu(CsvFile(p)); }},
               {"dvl0", "dvl", "dvl", dvl_file(csv("dvl0")), open_dvl},
               {"pressure0", "pressure", "pressure", csv("pressure0"), pressure},
               {"depth0", "depth", "pressure", csv("depth0"),
                [](auto& p) { return csv_depth(CsvFile(p)); }},
               {"cam0", "camera", "camera", csv("cam0"), camera(0)},
               {"cam1", "camera", "camera", csv("cam1"), camera(1)}},
              choice, recording);
  const fs::path gnss = csv("gnss0");
  if (choice.all() && fs::exists(gnss)) recording.add("gnss", csv_gnss(CsvFile(gnss)));
  const fs::path truth = csv("state_groundtruth_estimate0");
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
