// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <fstream>
#include <string>

#include "apvi/pipeline/localization.hpp"

namespace apvi::pipeline {

/// The files of a run, written as the run goes on, so that a stop at any time leaves what was
/// computed: trajectory.tum and dipo.tum (poses), calibration.csv (what the filter learns about its
/// sensors), health.csv (what became of every ping).
class RunFolder {
 public:
  /// Makes the folder. Throws InputError when it holds a run already and `overwrite` is false,
  /// RunError when it cannot be written.
  RunFolder(const std::filesystem::path& path, bool overwrite);

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path file(const std::string& name) const { return path_ / name; }

  /// Appends one output to every file.
  void write(const LocalizationOutput& output);
  /// Closes the files; throws RunError when anything could not be written (disk full).
  void close();

 private:
  void check() const;

  std::filesystem::path path_;
  std::ofstream trajectory_;
  std::ofstream dipo_;
  std::ofstream calibration_;
  std::ofstream health_;
};

}  // namespace apvi::pipeline
