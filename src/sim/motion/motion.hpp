// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/core/constants.hpp"
#include "apvi/core/stamp.hpp"
#include "geometry/spline.hpp"
#include "sim/motion/waves.hpp"

/// Motion of the simulated vehicle. World: z up, mean water surface at z = 0. Body: x forward, y
/// left, z up.
namespace apvi::sim {

enum class PathKind { lawnmower, wall, orbit, waypoints, hover, file };
enum class HeadingMode { along, left, right, fixed, point };
enum class FileFrame { up, ned };

/// Roll, pitch and unsteadiness of the vehicle along its path.
struct AttitudeConfig {
  double trim_roll_deg = 0.5;
  double trim_pitch_deg = -1.0;
  double bank_gain = 1.0;
  double climb_gain = 0.25;
  double oscillation_deg = 1.0;
  double oscillation_period_s = 3.5;
  double sway_m = 0.015;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("trim_roll_deg", trim_roll_deg, Range{-30.0, 30.0}, "constant roll, starboard down [deg]");
    v("trim_pitch_deg", trim_pitch_deg, Range{-60.0, 60.0}, "constant pitch, nose up [deg]");
    v("bank_gain", bank_gain, Range{-5.0, 5.0}, "roll into turns; 1: coordinated turn");
    v("climb_gain", climb_gain, Range{-2.0, 2.0},
      "fraction of the path's slope that pitch follows");
    v("oscillation_deg", oscillation_deg, Range{0.0, 20.0},
      "roll and pitch oscillation, one sigma [deg]");
    v("oscillation_period_s", oscillation_period_s, Range{0.5, 60.0},
      "dominant period of the oscillation [s]");
    v("sway_m", sway_m, Range{0.0, 1.0}, "position oscillation, one sigma [m]");
  }
};

/// The `motion` section of a scene.
struct MotionConfig {
  PathKind path = PathKind::lawnmower;
  double speed_m_s = 0.4;
  std::array<double, 3> origin{0.0, 0.0, 0.0};
  double heading_deg = 0.0;
  double length_m = 8.0;
  double spacing_m = 1.5;
  int lines = 4;
  int cross_lines = 0;
  bool revisit = true;
  double radius_m = 4.0;
  double aspect_ratio = 1.0;
  double climb_m = 0.0;
  int laps = 2;
  std::vector<std::array<double, 3>> waypoints;
  std::string file;
  FileFrame file_frame = FileFrame::up;
  double file_period_s = 0.5;
  bool file_at_origin = false;
  HeadingMode look = HeadingMode::along;
  double look_heading_deg = 0.0;
  std::array<double, 2> look_at{0.0, 0.0};
  std::optional<double> altitude_m;
  double corner_m = 0.8;
  double max_turn_deg_s = 25.0;
  double rest_s = 1.0;
  double ramp_s = 2.5;
  double surge_m = 0.0;
  double surge_period_s = 5.0;
  double clearance_m = 0.3;
  AttitudeConfig attitude;
  WaveConfig waves;

  template <typename V>
  void visit(V& v);
};

/// Height of the terrain [m] at world x, y; nullopt outside the terrain.
using HeightFunction = std::function<std::optional<double>(double x, double y)>;

struct MotionContext {
  Stamp start;
  double duration_s = 60.0;
  double gravity = kStandardGravity;  ///< [m/s²]
  std::uint64_t seed = 1;
  HeightFunction height;  ///< required only for `altitude_m`
};

/// Time by which a planned motion extends before the start and after the end, so that the spline
/// covers exposures, time offsets and derivatives there [s].
inline constexpr double kMotionMargin_s = 1.0;

/// Spline of the body pose, at least from `start` to `start + duration_s`. A path that ends early
/// is repeated (with `revisit`, lawnmower and wall return to their first point on a leg that
/// crosses the earlier lines, unless `cross_lines` did). Throws InputError when a path has no
/// extent, `altitude_m` is set where there is no terrain, or the trajectory file is shorter than
/// the duration.
Se3Spline plan_motion(const MotionConfig& config, const MotionContext& context);

/// The wave field used by `plan_motion`; the pressure sensor must use the same one.
WaveField make_waves(const WaveConfig& config, std::uint64_t seed, double gravity);

template <typename V>
void MotionConfig::visit(V& v) {
  using config::Choices;
  using config::Range;
  const Range<double> meters{-1e5, 1e5};
  v("path", path,
    Choices<PathKind>{{"lawnmower", PathKind::lawnmower},
                      {"wall", PathKind::wall},
                      {"orbit", PathKind::orbit},
                      {"waypoints", PathKind::waypoints},
                      {"hover", PathKind::hover},
                      {"file", PathKind::file}},
    "path pattern");
  v("speed_m_s", speed_m_s, Range{0.05, 3.0}, "cruise speed [m/s]");
  v("origin", origin, meters,
    "first corner (lawnmower, wall), center (orbit) or position (hover) [m]");
  v("heading_deg", heading_deg, Range{-360.0, 360.0},
    "heading of the first line, from world x to y [deg]");
  v("length_m", length_m, Range{0.1, 1e4}, "length of a line [m]");
  v("spacing_m", spacing_m, Range{-100.0, 100.0}, "spacing of lines: to the left, or upward [m]");
  v("lines", lines, Range{1, 1000}, "number of lines");
  v("cross_lines", cross_lines, Range{0, 1000},
    "lines flown across the others after them, evenly spaced over their length");
  v("revisit", revisit, "return across the lines and start again; false: fly the lines back");
  v("radius_m", radius_m, Range{0.1, 1e4}, "radius of the orbit along heading_deg [m]");
  v("aspect_ratio", aspect_ratio, Range{0.1, 10.0}, "other semi-axis of the orbit over radius_m");
  v("climb_m", climb_m, Range{-100.0, 100.0}, "height gained per orbit [m]");
  v("laps", laps, Range{1, 1000}, "orbits before descending again");
  v("waypoints", waypoints, meters, "for path: waypoints: list of [x, y, z] in the world [m]");
  v("file", file, "for path: file: trajectory of the body (TUM or EuRoC csv)");
  v("file_frame", file_frame, Choices<FileFrame>{{"up", FileFrame::up}, {"ned", FileFrame::ned}},
    "axes of the file: z up with body forward-left-up, or NED with body forward-right-down");
  v("file_period_s", file_period_s, Range{0.05, 10.0},
    "knot spacing of the spline fitted to the file [s]");
  v("file_at_origin", file_at_origin, "move the file's first pose to origin and heading_deg");
  v("look", look,
    Choices<HeadingMode>{{"along", HeadingMode::along},
                         {"left", HeadingMode::left},
                         {"right", HeadingMode::right},
                         {"fixed", HeadingMode::fixed},
                         {"point", HeadingMode::point}},
    "heading of the vehicle: along the path, perpendicular to it, fixed at look_heading_deg, or "
    "toward the point look_at");
  v("look_heading_deg", look_heading_deg, Range{-360.0, 360.0}, "for look: fixed [deg]");
  v("look_at", look_at, meters, "for look: point: x, y [m]");
  v("altitude_m", altitude_m, Range{0.1, 100.0},
    "follow the terrain at this altitude instead of the path's z [m]");
  v("corner_m", corner_m, Range{0.0, 20.0}, "distance from a corner at which the turn starts [m]");
  v("max_turn_deg_s", max_turn_deg_s, Range{1.0, 180.0},
    "maximum turn rate; the vehicle slows down instead [deg/s]");
  v("rest_s", rest_s, Range{0.0, 60.0}, "time at rest at the start [s]");
  v("ramp_s", ramp_s, Range{0.1, 60.0}, "time to reach cruise speed [s]");
  v("surge_m", surge_m, Range{0.0, 5.0}, "amplitude of a surge oscillation [m]");
  v("surge_period_s", surge_period_s, Range{1.0, 60.0}, "period of the surge oscillation [s]");
  v("clearance_m", clearance_m, Range{0.0, 10.0}, "minimum distance to the scene [m]");
  v("attitude", attitude, "roll and pitch");
  v("waves", waves, "surface waves");
}

}  // namespace apvi::sim
