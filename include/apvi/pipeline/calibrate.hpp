// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "apvi/fusion/calibration.hpp"
#include "apvi/pipeline/run_config.hpp"

namespace apvi::pipeline {

struct CalibrateOptions {
  std::vector<std::filesystem::path> inputs;  ///< recordings, or folders of runs that are finished
  std::filesystem::path config;               ///< for recordings; what `apvi run` takes
  std::vector<std::string> overrides;
  std::filesystem::path folder;  ///< for all of it
  bool overwrite = false;
  fusion::Normalisation normalisation = fusion::Normalisation::none;
  double max_false_alarm = 0.01;  ///< share of healthy frames that may be rejected
  std::function<bool()> interrupted = [] { return false; };
};

/// One run and what it gave.
struct CalibrationRun {
  std::string name;
  std::string fingerprint;  ///< of its configuration, paths left out, and of its health.csv
  fusion::RecordedFrames frames;
  fusion::FineOutcome healthy;  ///< under the thresholds that came out
  fusion::FineOutcome blind;
};

struct CalibrationResult {
  std::vector<CalibrationRun> runs;
  fusion::FineCalibration plain;
  fusion::FineCalibration per_inlier;
  fusion::Normalisation normalisation = fusion::Normalisation::none;
  int min_directions = 3;

  const fusion::FineCalibration& chosen() const {
    return normalisation == fusion::Normalisation::none ? plain : per_inlier;
  }
};

/// Finds the thresholds of step 3. A recording is run twice with camera and IMU in the graph
/// (`vio.graph: paper`): as it is, for healthy frames; and without other sensors and with spells of
/// darkness, for windows that see nothing. Writes thresholds.yaml (to be inherited),
/// calibration.json and eigenvalues.csv (for scripts/plot_calibration.py) into the folder. Throws
/// InputError for a bad input, RunError when an input has no healthy frames or it was interrupted.
CalibrationResult calibrate(const CalibrateOptions& options);

/// The frames of a finished run: healthy ones passed steps 1 and 2, blind ones had no landmark.
/// Eigenvalues are those of a camera with the focal length that the default thresholds are for.
fusion::RecordedFrames recorded_frames(const std::filesystem::path& run);

/// The comparison of the ways to test, and the runs, as text.
std::string to_table(const CalibrationResult& result);
/// thresholds.yaml.
std::string to_yaml(const CalibrationResult& result);

}  // namespace apvi::pipeline
