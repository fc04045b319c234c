// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/core/constants.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/slam/options.hpp"
#include "eval/trajectory_metrics.hpp"
#include "live/options.hpp"

namespace apvi::runs {

/// Where poses come from.
struct LocalizationSection {
  bool enabled = true;
  std::string poses_file;
  double gravity = kStandardGravity;
  template <typename V>
  void visit(V& v) {
    v("enabled", enabled, "estimate poses; false: use given poses");
    v("poses_file", poses_file,
      "given body poses as a TUM or EuRoC file; empty: the recording's reference");
    v("gravity", gravity, config::Range{9.0, 10.5}, "local gravitational acceleration [m/s²]");
  }
};

/// Configuration file of a run: the options of localization and mapping, with the recording, its
/// calibration and its evaluation.
struct RunConfig {
  io::DatasetConfig dataset;
  config::Node rig;
  localization::SensorOptions sensors;
  localization::ExecutionOptions run;
  LocalizationSection localization;
  dipo::Config dipo;
  vio::Config vio;
  fusion::Config fusion;
  fusion::FreezeConfig freeze;
  loop_closure::SmoothingOptions smoothing;
  eval::EvalOptions eval;
  slam::MappingOptions mapping;
  live::Options live;

  template <typename V>
  void visit(V& v) {
    v("dataset", dataset, "recording to process");
    v("rig", rig, "keys that override the recording's rig.yaml");
    v("sensors", sensors, "sensors to use");
    v("run", run, "execution");
    v("localization", localization, "pose estimation");
    v("dipo", dipo, "odometry from DVL, IMU and pressure (error-state Kalman filter)");
    v("vio", vio, "visual-inertial odometry");
    v("fusion", fusion, "fusion and failure detection");
    v("freeze", freeze, "VIO window during a vision failure");
    v("smoothing", smoothing, "pose graph of the whole dive, beside the odometry");
    v("eval", eval, "evaluation against the reference");
    v("mapping", mapping, "3-D Gaussian map");
    v("live", live, "sources and outputs of `apvi live`");
  }
};

/// The options of localization alone, and of localization with mapping.
localization::Options localization_options(const RunConfig& config);
slam::Options slam_options(const RunConfig& config);

/// Reads a configuration file with its inherited files, applies the overrides "key=value" in order,
/// and checks constraints between keys. `search`: see config::load_with_inheritance. Throws
/// InputError.
RunConfig load_run_config(const std::filesystem::path& file,
                          const std::vector<std::string>& overrides,
                          const std::vector<std::filesystem::path>& search = {});
/// Reads the resolved.yaml of a run, also of an older version. Throws InputError.
RunConfig load_recorded_run_config(const std::filesystem::path& file);
/// Throws InputError for contradictory values, or a map that this build cannot make.
void check(const RunConfig& config);

/// Whether the run builds a map: as configured, or because the recording, opened with
/// `config.sensors.use`, has a camera. Throws InputError for a bad calibration.
bool makes_map(const RunConfig& config, const io::SequenceReader& recording);

/// The configuration for resolved.yaml: with the rig as used, and absolute paths.
RunConfig resolved(const RunConfig& config, const config::Node& rig);

/// The rig of a run: `dataset.rig` or the recording's own, with the configuration's `rig` merged
/// over it. Throws InputError when there is none.
config::Node resolve_rig(const RunConfig& config, const config::Node& recorded);

}  // namespace apvi::runs
