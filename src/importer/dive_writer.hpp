// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "importer/byte_reader.hpp"
#include "importer/telemetry.hpp"

namespace apvi::importer {

/// The file that every import leaves in its folder: what was imported, and how.
inline constexpr const char* kImportNotes = "import.yaml";

/// The first stamp of a source without a date (2001-09-09).
inline constexpr Stamp kWithoutDate{1'000'000'000'000'000'000};

/// Where times of a video are in the data set: stamp = `zero` + time.
struct Clock {
  Stamp zero;
  /// nullopt for a time that no stamp can express.
  std::optional<Stamp> at(double time_s) const;
};

/// Writes a data set folder under the name FOLDER.partial, which `finish` renames. Without `finish`
/// the destructor deletes it, so that an interrupted import leaves nothing.
class DiveWriter {
 public:
  /// Throws InputError when the folder exists and `overwrite` is false or no import made it, or
  /// when FOLDER.partial is something else; RunError when it cannot be created.
  DiveWriter(std::filesystem::path folder, bool overwrite);
  ~DiveWriter();
  DiveWriter(const DiveWriter&) = delete;
  DiveWriter& operator=(const DiveWriter&) = delete;

  /// Adds an encoded image of cam0; `extension` is that of its format, with the dot. Throws
  /// RunError when it cannot be written completely. So do the others.
  void add_image(Stamp stamp, const std::string& extension, Bytes encoded);
  /// Adds the mask of the newest image, a PNG.
  void add_mask(Bytes encoded);
  std::size_t images() const { return stamps_.size(); }
  const std::vector<Stamp>& stamps() const { return stamps_; }
  /// The images so far, until `finish`.
  const std::vector<std::filesystem::path>& image_files() const { return image_files_; }
  /// Mean rate of the images, for rig.yaml [Hz]; 1 for a single image.
  double image_rate_hz() const;

  void write_imu(const std::vector<ImuRow>& rows, const Clock& clock);
  void write_exposure(const std::vector<ExposureRow>& rows, const Clock& clock);
  void write_poses(const Trajectory& poses);
  /// A file of the folder, such as rig.yaml.
  void write_text(const std::string& name, const std::string& content);

  /// Writes what remains and gives the folder its name, in place of an earlier one. Without images
  /// the folder has no cam0.
  void finish();

 private:
  std::filesystem::path folder_;
  std::filesystem::path partial_;
  std::vector<Stamp> stamps_;
  std::vector<std::filesystem::path> image_files_;
  std::string images_csv_ = "#timestamp [ns],filename\n";
  bool finished_ = false;
};

/// T_body_sensor, as in rig.yaml, of a sensor whose frame is the body.
inline constexpr const char* kAtBody = "T_body_sensor: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]";
/// Sections of rig.yaml. `note` is a comment above the section.
std::string camera_yaml(const CameraModel::Parameters& camera, double rate_hz,
                        const std::string& note, const std::string& pose = kAtBody);
std::string imu_yaml(double rate_hz, const std::string& note);

}  // namespace apvi::importer
