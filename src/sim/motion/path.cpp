// SPDX-License-Identifier: BSD-3-Clause
#include "sim/motion/path.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;
using Points = std::vector<Vector3d>;

Vector3d origin_of(const MotionConfig& config) {
  return {config.origin[0], config.origin[1], config.origin[2]};
}

// Lines across the others, evenly spaced over their length, from where these end.
void add_cross_lines(const MotionConfig& config, const Vector3d& along, const Vector3d& across,
                     Points& corners) {
  const bool ends_near = config.lines % 2 == 0;
  const Vector3d width = (config.lines - 1) * across;
  for (int i = 0; i < config.cross_lines; ++i) {
    const double part = (i + 0.5) / config.cross_lines;
    const Vector3d near =
        origin_of(config) + config.length_m * (ends_near ? part : 1.0 - part) * along;
    corners.emplace_back(i % 2 == 0 ? near + width : near);
    corners.emplace_back(i % 2 == 0 ? near : near + width);
  }
}

// Parallel lines, `across` apart, in alternating direction, then the lines across them. With
// `revisit`, a leg returns to the first corner, a diagonal across the lines unless others have
// crossed them; without, all is traversed in reverse.
Points line_pattern_corners(const MotionConfig& config, const Vector3d& along,
                            const Vector3d& across) {
  Points corners;
  for (int i = 0; i < config.lines; ++i) {
    const Vector3d near = origin_of(config) + i * across;
    const Vector3d far = near + config.length_m * along;
    corners.push_back(i % 2 == 0 ? near : far);
    corners.push_back(i % 2 == 0 ? far : near);
  }
  add_cross_lines(config, along, across, corners);
  if (!config.revisit) {
    for (std::size_t i = corners.size() - 1; i-- > 1;) corners.push_back(corners[i]);
  } else if (config.lines % 2 == 0 && config.cross_lines == 0) {
    // The last line ends on the side of the first corner: return along its length, so that the
    // diagonal crosses all lines.
    corners.push_back(origin_of(config) + config.length_m * along);
  }
  corners.push_back(corners.front());
  return corners;
}

Points orbit_corners(const MotionConfig& config) {
  constexpr int kPerLap = 90;
  const double heading = config.heading_deg * kRadiansPerDegree;
  const Vector3d u(std::cos(heading), std::sin(heading), 0.0);
  const Vector3d v(-u.y(), u.x(), 0.0);
  const int up = config.laps * kPerLap;
  Points corners;
  for (int i = 0; i <= 2 * up; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / kPerLap;
    const double climbed = static_cast<double>(i <= up ? i : 2 * up - i) / kPerLap;
    corners.push_back(origin_of(config) + config.radius_m * std::cos(angle) * u +
                      config.radius_m * config.aspect_ratio * std::sin(angle) * v +
                      Vector3d(0.0, 0.0, config.climb_m * climbed));
  }
  return corners;
}

Points waypoint_corners(const MotionConfig& config) {
  if (config.waypoints.size() < 2) {
    fail_input("motion.waypoints: at least two [x, y, z] points are required");
  }
  Points corners;
  for (const auto& w : config.waypoints) corners.emplace_back(w[0], w[1], w[2]);
  if (config.revisit) {
    corners.push_back(corners.front());
  } else {
    for (std::size_t i = config.waypoints.size() - 1; i-- > 0;) corners.push_back(corners[i]);
  }
  return corners;
}

// Samples the closed polyline repeatedly until the length is reached.
Points sample_polyline(const Points& corners, double length_m) {
  Points dense{corners.front()};
  const auto wanted = static_cast<std::size_t>(std::ceil(length_m / kPathStep)) + 2;
  double left = kPathStep;  // until the next point
  for (std::size_t i = 0; dense.size() < wanted; i = (i + 1) % (corners.size() - 1)) {
    const Vector3d leg = corners[i + 1] - corners[i];
    const double length = leg.norm();
    double done = 0.0;
    while (done + left <= length && dense.size() < wanted) {
      done += left;
      left = kPathStep;
      dense.push_back(corners[i] + leg * (done / length));
    }
    left -= length - done;
  }
  return dense;
}

void follow_terrain(Points& path, double altitude_m, const HeightFunction& height) {
  if (!height)
    fail_input("motion.altitude_m: there is no terrain to follow; set z in motion.origin");
  for (Vector3d& p : path) {
    const auto ground = height(p.x(), p.y());
    if (!ground) {
      fail_input(
          "motion.altitude_m: no terrain below the path at x {:.1f}, y {:.1f} m; move the path "
          "inside the world or enlarge the world",
          p.x(), p.y());
    }
    p.z() = *ground + altitude_m;
  }
  constexpr double kTerrainSmoothing = 1.2;  // [m]: small objects are not followed
  smooth(path, kTerrainSmoothing / kPathStep);
}

// Moving average over 2 half + 1 samples; the window shrinks symmetrically near the ends.
template <typename T>
void moving_average(std::vector<T>& values, std::size_t half) {
  const std::vector<T> in = values;
  std::vector<T> sums{T(in[0] * 0.0)};
  for (const T& value : in) sums.push_back(T(sums.back() + (value - in[0])));
  for (std::size_t i = 0; i < in.size(); ++i) {
    const std::size_t h = std::min({half, i, in.size() - 1 - i});
    values[i] = in[0] + (sums[i + h + 1] - sums[i - h]) / static_cast<double>(2 * h + 1);
  }
}

template <typename T>
void smooth_any(std::vector<T>& values, double sigma) {
  constexpr int kPasses = 3;
  // A mean over n samples has the variance (n² - 1) / 12.
  const double width = std::sqrt(12.0 * sigma * sigma / kPasses + 1.0);
  const auto half = static_cast<std::size_t>(std::lround((width - 1.0) / 2.0));
  if (values.size() < 3 || half == 0) return;
  for (int pass = 0; pass < kPasses; ++pass) moving_average(values, half);
}

}  // namespace

void smooth(Points& values, double sigma) {
  smooth_any(values, sigma);
}
void smooth(std::vector<double>& values, double sigma) {
  smooth_any(values, sigma);
}

Points pattern_corners(const MotionConfig& config) {
  const double heading = config.heading_deg * kRadiansPerDegree;
  const Vector3d along(std::cos(heading), std::sin(heading), 0.0);
  const Vector3d left(-along.y(), along.x(), 0.0);
  Points corners;
  switch (config.path) {
    case PathKind::lawnmower:
      corners = line_pattern_corners(config, along, config.spacing_m * left);
      break;
    case PathKind::wall:
      corners = line_pattern_corners(config, along, Vector3d(0.0, 0.0, config.spacing_m));
      break;
    case PathKind::orbit:
      corners = orbit_corners(config);
      break;
    case PathKind::waypoints:
      corners = waypoint_corners(config);
      break;
    case PathKind::hover:
    case PathKind::file:
      APVI_CHECK(false);
  }
  double length = 0.0;
  for (std::size_t i = 1; i < corners.size(); ++i) length += (corners[i] - corners[i - 1]).norm();
  if (length < 0.1)
    fail_input("motion: the path is only {:.2f} m long; increase its extent", length);
  return corners;
}

Points dense_path(const MotionConfig& config, double length_m, const HeightFunction& height) {
  Points path = sample_polyline(pattern_corners(config), length_m);
  if (config.altitude_m) follow_terrain(path, *config.altitude_m, height);
  smooth(path, config.corner_m / kPathStep);
  return path;
}

}  // namespace apvi::sim
