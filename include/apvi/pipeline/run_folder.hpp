// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <fstream>
#include <string>

#include "apvi/pipeline/localization.hpp"
#include "apvi/pipeline/localizer.hpp"

namespace apvi::pipeline {

/// Makes the folder of a run and takes away what an earlier run has left there and this one may not
/// write again. Throws InputError when it holds a run already and `overwrite` is false, RunError
/// when it cannot be made.
void prepare_folder(const std::filesystem::path& path, bool overwrite);

/// The files of a run, written as the run goes on, so that a stop at any time leaves what was
/// computed: trajectory.tum (the pose that counts), dipo.tum, calibration.csv (what the filter
/// learns about its sensors) and pings.csv (what became of every ping); with a camera vio.tum,
/// keyframes.tum, health.csv and timing.csv (a line per frame) too.
///
/// The two `write` may be called from different threads.
class RunFolder {
 public:
  /// Makes the folder. Throws InputError when it holds a run already and `overwrite` is false,
  /// RunError when it cannot be written.
  RunFolder(const std::filesystem::path& path, bool overwrite, bool camera);

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path file(const std::string& name) const { return path_ / name; }

  /// Appends a ping; without a camera its pose is the trajectory's.
  void write(const LocalizationOutput& output);
  /// Appends a camera frame.
  void write(const FrameOutput& output);
  /// Closes the files; throws RunError when anything could not be written (disk full).
  void close();

 private:
  void check(const std::ofstream& out) const;

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

}  // namespace apvi::pipeline
