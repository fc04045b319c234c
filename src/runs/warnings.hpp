// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/sensors/rig.hpp"
#include "localization/acoustic_odometry.hpp"
#include "localization/image_monitor.hpp"
#include "runs/sample_statistics.hpp"
#include "vio/window/observation.hpp"

namespace apvi::runs {

/// What visual-inertial odometry contributed to a run.
struct VioService {
  std::size_t frames = 0;
  std::size_t with_pose = 0;
  std::size_t up_to_scale = 0;   ///< of `with_pose`, by images alone
  std::size_t used = 0;          ///< frames whose pose is VIO's, or fused with it
  std::string waiting_for = {};  ///< detail of the last frame without a VIO pose
  std::size_t uniform = 0;       ///< frames whose image shows no structure
  double uniform_gray = 0.0;     ///< sum of their mean gray values, in [0, 255]

  /// Counts a frame whose image shows no structure.
  void add_image(const vio::FrameStatistics& image);
};

/// What DVL and pressure contributed to a run.
struct AcousticService {
  localization::UpdateCounts counts;
  std::string waiting_for = {};  ///< empty once the filter has started
  std::size_t saturated_imu = 0;
  double accel_factor = 1.0;  ///< adaptive accelerometer noise at the end
  double max_accel_factor = 1.0;
};

/// What a run saw of its sensors and its result.
struct Evidence {
  std::vector<std::string> sensors_in_use;          ///< `sensors.use`
  std::map<std::string, io::StreamReport> streams;  ///< by kind of sensor
  std::vector<localization::ImageCounts> images;    ///< by camera in use
  std::optional<VioService> vio;                    ///< with a camera
  std::optional<AcousticService> acoustic;          ///< with a DVL
  SampleStatistics samples;
  double gravity = kStandardGravity;  ///< [m/s²]
};

/// Sensors that are recorded and in use but did not serve, each with the reason and what to look
/// at. A sensor did not serve when none, or less than half, of its data could be used.
std::vector<std::string> check_inputs(const Evidence& evidence, const Rig& rig);

/// Implausible magnitudes in the samples and in the result, each with what to look at.
std::vector<std::string> check_result(const Evidence& evidence, const Trajectory& fused);

/// What the times of the sensors tell: clocks that differ, sensors that served for a part of the
/// recording only or begin late, and poses that begin late.
std::vector<std::string> check_spans(const SampleStatistics& samples, const Trajectory& fused);

/// Whether all poses are by images alone.
bool has_unknown_scale(const VioService& vio);
bool has_unknown_scale(const Evidence& evidence);

/// Whether a pose of VIO was used, and a ping by DIPO. Figures of an estimator that never served
/// are those of the other one, or zeros.
bool vio_served(const Evidence& evidence);
bool dipo_served(const Evidence& evidence);

}  // namespace apvi::runs
