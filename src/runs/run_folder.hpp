// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <fstream>
#include <span>
#include <string>

#include "localization/acoustic_odometry.hpp"
#include "localization/fusion_stage.hpp"

namespace apvi::runs {

/// Checkpoint that a mapping run resumes from, in the run folder.
inline constexpr const char* kCheckpointFile = "checkpoint.pt";
/// Parts of a large map that belong to the checkpoint.
inline constexpr const char* kStorageFolder = "storage";

/// Throws InputError when the folder already holds a run and `overwrite` is false.
void check_vacant(const std::filesystem::path& path, bool overwrite);

/// Creates the folder of a run and deletes files of an earlier run that this one may not overwrite.
/// Throws InputError when it already holds a run and `overwrite` is false, RunError when it cannot
/// be created.
void prepare_folder(const std::filesystem::path& path, bool overwrite);

/// Copies those of the named files that a run has into another folder, over what is there. Throws
/// RunError when one cannot be copied.
void copy_files(const std::filesystem::path& from, const std::filesystem::path& to,
                std::span<const char* const> names);

struct RunFolderOptions {
  bool overwrite = false;  ///< replace an existing run
  bool camera = false;     ///< with the files of a run with a camera
};

/// The output files of a run, written incrementally so that an interrupted run keeps its results:
/// trajectory.tum (fused trajectory), dipo.tum, calibration.csv (sensor calibration estimated by
/// the filter) and pings.csv (result of every DVL update); with a camera also vio.tum,
/// keyframes.tum, health.csv and timing.csv (a line per frame).
///
/// The two `write` functions may be called from different threads.
class RunFolder {
 public:
  /// Creates the folder. Throws InputError when it already holds a run and `overwrite` is false,
  /// RunError when it cannot be written.
  RunFolder(const std::filesystem::path& path, const RunFolderOptions& options);

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path file(const std::string& name) const { return path_ / name; }

  /// Appends a ping; without a camera its pose also goes to the trajectory.
  void write(const localization::PingOutput& output);
  /// Appends a camera frame.
  void write(const localization::FrameOutput& output);
  /// Closes the files; throws RunError when anything could not be written (disk full).
  void close();

 private:
  void check(const std::ofstream& out) const;
  void rewrite(std::ofstream& out, const std::string& name,
               const localization::FrameOutput& output) const;

  std::filesystem::path path_;
  bool camera_;
  std::ofstream trajectory_;
  std::ofstream dipo_;
  std::ofstream calibration_;
  std::ofstream pings_;
  std::ofstream vio_;
  std::ofstream keyframes_;
  std::ofstream health_;
  std::ofstream timing_;
};

}  // namespace apvi::runs
