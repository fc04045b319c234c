// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "apvi/config/node.hpp"
#include "vio/window/calibration.hpp"

/// One rig for several dives, `apvi calibrate rig`.
namespace apvi::runs {

struct RigCalibrationOptions {
  std::vector<std::filesystem::path> dives;   ///< recordings
  std::filesystem::path rig;                  ///< to start from; empty: that of the recordings
  std::filesystem::path config;               ///< run configuration
  std::vector<std::filesystem::path> search;  ///< of inherited files: config::load_with_inheritance
  std::vector<std::string> overrides;
  std::filesystem::path output;  ///< the rig.yaml to write
  std::filesystem::path runs;    ///< keeps the runs in this folder; empty: they are deleted
  std::function<bool()> interrupted = [] { return false; };
};

/// A component of the calibration, in the unit of its name.
struct RigComponent {
  std::string name;  ///< as "cam0.lever_arm y [m]"
  double rig = 0.0;  ///< zero for rotations, which are relative to the rig's
  double value = 0.0;
  double sigma = 0.0;
  bool observable = false;   ///< else the rig's value is kept
  double consistency = 0.0;  ///< of its parameter, see Combination
  std::vector<double> dives = {};
  std::vector<double> dive_sigmas = {};
};

struct RigCalibration {
  config::Node rig;
  std::vector<std::string> dives;     ///< that were used
  std::vector<std::string> left_out;  ///< with the reasons
  std::vector<RigComponent> components;
  int rounds = 0;
  bool settled = false;  ///< nothing moved by more than its sigma in the last round
};

/// Localizes a dive, counted from 0, with a rig and returns what self-calibration found; nullopt
/// when interrupted. Throws RunError if the dive cannot be localized.
using LocalizeDive = std::function<std::optional<vio::CalibrationEstimate>(
    std::size_t dive, const config::Node& rig, int round)>;

/// Localizes all dives with the rig, combines what they found (`combine`), and repeats this with
/// the resulting rig until nothing moves by more than its standard deviation, three times at most.
/// A dive that cannot be localized is left out. Throws RunError when none is left, or when
/// interrupted.
RigCalibration refine_rig(const config::Node& rig, const std::vector<std::string>& dives,
                          const LocalizeDive& localize);

/// The same with recordings, without maps; writes the rig and the table as its comment. Throws
/// InputError for rigs that differ, or have no camera, and RunError also when interrupted; then the
/// output is not written.
RigCalibration calibrate_rig(const RigCalibrationOptions& options);

/// The components as a Markdown table, and which dives they are from.
std::string to_table(const RigCalibration& calibration);

}  // namespace apvi::runs
