// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/io/sequence.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <fstream>

#include "apvi/core/error.hpp"
#include "core/foreign_file.hpp"
#include "core/text.hpp"
#include "io/merged_reader.hpp"
#include "io/readers.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;

bool any_sensor_yaml(const fs::path& mav) {
  for (const auto& entry : fs::directory_iterator(mav)) {
    if (fs::exists(entry.path() / "sensor.yaml")) return true;
  }
  return false;
}

bool has_bag_magic(const fs::path& path) {
  std::string magic(7, '\0');
  std::ifstream(path, std::ios::binary).read(magic.data(), 7);
  return magic == "#ROSBAG";
}

bool has_bag2_extension(const fs::path& path) {
  const std::string extension = text::to_lower(path.extension().string());
  return extension == ".mcap" || extension == ".db3";
}

bool has_bag2_file(const fs::path& folder) {
  const fs::directory_iterator entries(folder);
  return std::any_of(begin(entries), end(entries),
                     [](const auto& entry) { return has_bag2_extension(entry.path()); });
}

// The first ROS1 bag of the folder; "" when there is none.
std::string name_of_bag(const fs::path& folder) {
  std::vector<std::string> bags;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string extension = text::to_lower(entry.path().extension().string());
    if (extension == ".bag") bags.push_back(entry.path().string());
  }
  return bags.empty() ? "" : *std::min_element(bags.begin(), bags.end());
}

// The folder in this one that has a data set, as archives are unpacked; "" when there is none, or
// more than one.
std::string only_data_set_within(const fs::path& folder) {
  std::string found;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (!fs::is_directory(entry.path() / "mav0")) continue;
    if (!found.empty()) return "";
    found = entry.path().string();
  }
  return found;
}

DatasetFormat detect_file(const fs::path& path) {
  const bool is_bag = has_bag_magic(path);
  const auto foreign = is_bag ? std::nullopt : describe_foreign_file(path);
  if (foreign) fail_input("{}: not a recording, but {}", path.string(), *foreign);
  if (text::to_lower(path.extension().string()) == ".bag" || is_bag) {
    return DatasetFormat::rosbag;
  }
  if (has_bag2_extension(path)) return DatasetFormat::rosbag2;
  fail_input(
      "{}: not a data set; specify a folder, or a .bag, .mcap or .db3 file, or `apvi import` a "
      "video or the log of an autopilot",
      path.string());
}

DatasetFormat detect_folder(const fs::path& path) {
  if (fs::is_directory(path / "mav0")) {
    const bool published = !fs::exists(path / "rig.yaml") && any_sensor_yaml(path / "mav0");
    return published ? DatasetFormat::euroc : DatasetFormat::folder;
  }
  if (fs::exists(path / "imu.csv") || fs::is_directory(path / "IMG_L")) return DatasetFormat::tank;
  if (fs::exists(path / "metadata.yaml") || has_bag2_file(path)) return DatasetFormat::rosbag2;
  if (fs::exists(path / "imu0" / "data.csv") || fs::exists(path / "cam0" / "data.csv")) {
    fail_input("{}: specify the folder that contains mav0, not mav0 itself", path.string());
  }
  if (fs::is_empty(path))
    fail_input("{}: no data set in this folder, which is empty", path.string());
  const std::string inner = only_data_set_within(path);
  if (!inner.empty()) fail_input("{}: specify the folder in it: {}", path.string(), inner);
  const std::string bag = name_of_bag(path);
  if (!bag.empty()) fail_input("{}: specify the bag in this folder: {}", path.string(), bag);
  fail_input(
      "{}: no data set in this folder (no mav0/, no imu.csv, no IMG_L/); see docs/formats.md. "
      "Videos, photographs, COLMAP models and logs of autopilots: `apvi import`",
      path.string());
}

DatasetFormat detect(const fs::path& path) {
  return fs::is_directory(path) ? detect_folder(path) : detect_file(path);
}

Recording open_recording(DatasetFormat format, const DatasetConfig& config,
                         const SensorChoice& choice) {
  const fs::path path = config.path;
  const bool wants_folder = format != DatasetFormat::rosbag;
  if (format != DatasetFormat::rosbag2 && wants_folder != fs::is_directory(path)) {
    fail_input("{}: dataset.format requires a {}, but this is a {}", config.path,
               wants_folder ? "folder" : ".bag file", wants_folder ? "file" : "folder");
  }
  switch (format) {
    case DatasetFormat::automatic:
      break;
    case DatasetFormat::folder:
      return open_folder(path, config, choice);
    case DatasetFormat::euroc:
      return open_euroc(path, config, choice);
    case DatasetFormat::tank:
      return open_tank(path, config, choice);
    case DatasetFormat::rosbag:
      return open_bag(path, config, choice);
    case DatasetFormat::rosbag2:
      return open_rosbag2(path, config, choice);
  }
  APVI_CHECK(false);
  return {};
}

void check(const DatasetConfig& config) {
  if (config.path.empty())
    fail_input("dataset.path: missing; specify a folder, or a .bag, .mcap or .db3 file");
  std::error_code unreadable;
  if (!fs::exists(config.path, unreadable)) {
    fail_input("{}: no such file or folder; check dataset.path", config.path);
  }
  for (const auto& span : config.blackout_s) {
    if (!(span[0] >= 0.0 && span[1] > span[0])) {
      fail_input("dataset.blackout_s: [{}, {}] is not a span; use [from, to] with from < to",
                 span[0], span[1]);
    }
  }
}

}  // namespace

std::string_view to_string(DropReason reason) {
  switch (reason) {
    case DropReason::malformed:
      return "malformed";
    case DropReason::not_finite:
      return "not finite";
    case DropReason::implausible:
      return "implausible";
    case DropReason::out_of_order:
      return "out of order";
    case DropReason::duplicate_stamp:
      return "duplicate stamp";
    case DropReason::broken_stamp:
      return "broken stamp";
  }
  return "unknown";
}

SensorChoice::SensorChoice(const std::vector<std::string>& sensors)
    : chosen_(sensors.begin(), sensors.end()) {
  const std::vector<std::string> known = {"camera", "imu", "dvl", "pressure"};
  for (const std::string& sensor : sensors) {
    if (std::find(known.begin(), known.end(), sensor) == known.end()) {
      fail_input("sensors.use: no sensor \"{}\"; use {}", sensor, fmt::join(known, ", "));
    }
  }
}

std::unique_ptr<SequenceReader> open_sequence(const DatasetConfig& config,
                                              const std::vector<std::string>& sensors) {
  check(config);
  const SensorChoice choice(sensors);
  const DatasetFormat format =
      config.format == DatasetFormat::automatic ? detect(config.path) : config.format;
  try {
    Recording recording = open_recording(format, config, choice);
    check_any_sensor(recording, config.path);
    return std::make_unique<MergedReader>(std::move(recording), config);
  } catch (const fs::filesystem_error& e) {
    fail_input("{}: {}", e.path1().string(), e.code().message());
  }
}

}  // namespace apvi::io
