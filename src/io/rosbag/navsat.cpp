// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/navsat.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "apvi/core/constants.hpp"

namespace apvi::io {
namespace {

// WGS84.
constexpr double kSemiMajorAxis_m = 6378137.0;
constexpr double kFlattening = 1.0 / 298.257223563;
constexpr double kEccentricity2 = kFlattening * (2.0 - kFlattening);

double altitude_or(const GeodeticPosition& position, double fallback) {
  return std::isfinite(position.altitude_m) ? position.altitude_m : fallback;
}

Eigen::Vector3d earth_fixed(const GeodeticPosition& position, double altitude_m) {
  const double latitude = kRadiansPerDegree * position.latitude_deg;
  const double longitude = kRadiansPerDegree * position.longitude_deg;
  const double sine = std::sin(latitude);
  const double normal = kSemiMajorAxis_m / std::sqrt(1.0 - kEccentricity2 * sine * sine);
  const double axial = (normal + altitude_m) * std::cos(latitude);
  return {axial * std::cos(longitude), axial * std::sin(longitude),
          (normal * (1.0 - kEccentricity2) + altitude_m) * sine};
}

}  // namespace

std::optional<GeodeticPosition> fix_of(const RosValue& message) {
  const auto latitude = message.number_at("latitude");
  const auto longitude = message.number_at("longitude");
  if (!latitude || !longitude || message.number_at("status.status").value_or(0.0) < 0.0) {
    return std::nullopt;
  }
  const GeodeticPosition fix{*latitude, *longitude,
                             message.number_at("altitude").value_or(std::nan(""))};
  return is_fix(fix) ? std::optional(fix) : std::nullopt;
}

// Comparisons with NaN are false.
bool is_fix(const GeodeticPosition& position) {
  return std::abs(position.latitude_deg) <= 90.0 && std::abs(position.longitude_deg) <= 360.0 &&
         (position.latitude_deg != 0.0 || position.longitude_deg != 0.0);
}

Eigen::Vector3d east_north_up(const GeodeticPosition& position, const GeodeticPosition& origin) {
  const double ground = altitude_or(origin, 0.0);
  const Eigen::Vector3d offset =
      earth_fixed(position, altitude_or(position, ground)) - earth_fixed(origin, ground);
  const double latitude = kRadiansPerDegree * origin.latitude_deg;
  const double longitude = kRadiansPerDegree * origin.longitude_deg;
  const Eigen::Vector3d east(-std::sin(longitude), std::cos(longitude), 0.0);
  const Eigen::Vector3d up(std::cos(latitude) * std::cos(longitude),
                           std::cos(latitude) * std::sin(longitude), std::sin(latitude));
  return {east.dot(offset), up.cross(east).dot(offset), up.dot(offset)};
}

}  // namespace apvi::io
