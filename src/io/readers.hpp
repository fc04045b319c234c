// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "apvi/io/sequence.hpp"
#include "io/sample_source.hpp"

/// One function per format; `open_sequence` chooses.
namespace apvi::io {

/// The requested sensors: "imu", "dvl", "pressure", "camera"; an empty list means all.
class SensorChoice {
 public:
  /// Throws InputError for an unknown sensor name.
  explicit SensorChoice(const std::vector<std::string>& sensors);
  bool all() const { return chosen_.empty(); }
  bool wants(const std::string& sensor) const { return all() || chosen_.contains(sensor); }

 private:
  std::set<std::string> chosen_;
};

/// rig.yaml above mav0/<sensor>/data.csv.
Recording open_folder(const std::filesystem::path& root, const DatasetConfig& config,
                      const SensorChoice& choice);
/// As above, with a sensor.yaml in each sensor's folder instead of rig.yaml.
Recording open_euroc(const std::filesystem::path& root, const DatasetConfig& config,
                     const SensorChoice& choice);
/// IMG_L/, imu.csv, dvl.csv, depth.csv, gt.csv.
Recording open_tank(const std::filesystem::path& root, const DatasetConfig& config,
                    const SensorChoice& choice);
/// A ROS1 bag. Throws InputError in a build without rosbag_storage.
Recording open_bag(const std::filesystem::path& path, const DatasetConfig& config,
                   const SensorChoice& choice);
/// A ROS 2 bag: an .mcap or .db3 file, or a folder of such files.
Recording open_rosbag2(const std::filesystem::path& path, const DatasetConfig& config,
                       const SensorChoice& choice);

/// The calibration: `config.rig` if set, else `own` if it exists, else null.
config::Node load_rig(const DatasetConfig& config, const std::filesystem::path& own);

/// The atmospheric pressure of the rig, or the default [Pa].
double atmospheric_pressure_pa(const config::Node& rig);

/// One sensor of a file-based recording.
struct SensorFile {
  std::string name;    ///< section of the rig: "imu0", "cam1", …
  std::string kind;    ///< of the events: "imu", "camera", …
  std::string choice;  ///< name in sensors.use
  std::filesystem::path path;
  std::function<std::unique_ptr<SampleSource>(const std::filesystem::path&)> open;
};

/// Adds the sensors whose files exist. Throws InputError when a sensor that the rig describes is
/// missing. Cameras that the rig does not describe are ignored.
void add_sensors(const std::vector<SensorFile>& files, const SensorChoice& choice,
                 Recording& recording);

/// Adds the sensors below `root`/mav0 to a recording whose rig is set. Throws InputError when a
/// requested sensor that the rig describes is missing, or the folder does not exist.
void add_asl_sensors(const std::filesystem::path& root, const DatasetConfig& config,
                     const SensorChoice& choice, Recording& recording);

/// Throws InputError when a recording has no sensor to read.
void check_any_sensor(const Recording& recording, const std::filesystem::path& root);

/// A trajectory file as reference, without its bad lines; nullopt when it has a header only.
std::optional<Trajectory> read_reference(const std::filesystem::path& path);

}  // namespace apvi::io
