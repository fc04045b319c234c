// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "apvi/sensors/samples.hpp"
#include "doctor/camera_rates.hpp"

/// Where in the log of a gyro the rotation of a camera is found.
namespace apvi::importer {

inline constexpr double kRateStep_s = 0.1;  ///< of RateGrid

/// Angular rates at evenly spaced times [rad/s].
struct RateGrid {
  Stamp start;
  std::vector<Eigen::Vector3d> rates;
  std::vector<bool> known;  ///< of each; the others are zero

  std::size_t count_known() const;
  /// Root mean square of the known rates about their mean [rad/s].
  double variation() const;
};

/// Rates of a camera, interpolated where they are dense.
RateGrid rate_grid(const std::vector<doctor::CameraRate>& rates);
/// Means of a gyro's rates over the time between the images that `camera_rates` compares.
RateGrid rate_grid(const std::vector<ImuSample>& imu);

struct RateMatch {
  double lag_s = 0.0;        ///< from the start of the gyro's grid to the start of the camera's
  double correlation = 0.0;  ///< 0 to 1
  double elsewhere = 0.0;    ///< the largest correlation at another time
  double sigmas = 0.0;       ///< how clearly it is the best; negative: it may be chance
  Eigen::Quaterniond R_camera_body = Eigen::Quaterniond::Identity();
};

/// The time at which the rates of the camera fit those of the gyro best, over all times at which
/// most of the camera's rates are within the log. At each time the rotation from body to camera is
/// the best one (Wahba's problem), with axes of either handedness: the correlation is the nuclear
/// norm of the covariance of both rates over their root mean squares. So neither the mounting nor
/// the bias of the gyro matters. `within` limits the lags [s]. nullopt if no lag is possible.
std::optional<RateMatch> match_rates(const RateGrid& camera, const RateGrid& gyro,
                                     std::optional<std::pair<double, double>> within = {});

}  // namespace apvi::importer
