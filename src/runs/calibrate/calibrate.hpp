// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "fusion/calibration.hpp"
#include "runs/run_config.hpp"

namespace apvi::runs {

struct CalibrateOptions {
  std::vector<std::filesystem::path> inputs;  ///< recordings, or folders of finished runs
  std::filesystem::path config;               ///< run configuration, for recordings
  std::vector<std::filesystem::path> search;  ///< of inherited files: config::load_with_inheritance
  std::vector<std::string> overrides;
  std::filesystem::path folder;  ///< output folder
  bool overwrite = false;
  fusion::Normalization normalization = fusion::Normalization::none;
  double max_false_alarm = 0.01;  ///< fraction of healthy frames that may be rejected
  std::function<bool()> interrupted = [] { return false; };
};

/// One run and its results.
struct CalibrationRun {
  std::string name;
  std::string fingerprint;  ///< hash of its configuration without paths, and of health.csv
  fusion::RecordedFrames frames;
  fusion::ThresholdOutcome healthy;  ///< with the resulting thresholds
  fusion::ThresholdOutcome blind;
};

struct CalibrationResult {
  std::vector<CalibrationRun> runs;
  fusion::DegeneracyCalibration plain;
  fusion::DegeneracyCalibration per_inlier;
  fusion::Normalization normalization = fusion::Normalization::none;
  int min_directions = 3;

  const fusion::DegeneracyCalibration& chosen() const {
    return normalization == fusion::Normalization::none ? plain : per_inlier;
  }
};

/// Finds the thresholds of step 3, the degeneracy check. A recording is run twice with camera and
/// IMU in the graph (`vio.graph: paper`): unchanged, for healthy frames; and with camera and IMU
/// only and with blackouts, for windows without landmarks. Writes thresholds.yaml (to be
/// inherited), calibration.json and eigenvalues.csv (for scripts/plot_calibration.py) into the
/// folder. Throws InputError for a bad input, RunError when an input has no healthy frames or when
/// interrupted.
CalibrationResult calibrate(const CalibrateOptions& options);

/// The frames of a finished run: healthy ones passed steps 1 and 2, blind ones had no landmark.
/// Eigenvalues are scaled to the focal length of the default thresholds.
fusion::RecordedFrames recorded_frames(const std::filesystem::path& run);

/// Comparison of the tests and list of the runs, as Markdown tables.
std::string to_table(const CalibrationResult& result);
/// Content of thresholds.yaml.
std::string to_yaml(const CalibrationResult& result);

}  // namespace apvi::runs
