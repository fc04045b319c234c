// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/core/stamp.hpp"
#include "apvi/geometry/spline.hpp"
#include "apvi/sim/waves.hpp"

/// How the simulated vehicle moves. World: z up, mean water surface at z = 0. Body: x forward, y
/// left, z up.
namespace apvi::sim {

enum class PathKind { lawnmower, wall, orbit, waypoints, hover, file };
enum class Look { along, left, right, fixed, centre };
enum class FileFrame { up, ned };

/// Roll and pitch of a vehicle that is neither a rail nor a brick.
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
    v("trim_roll_deg", trim_roll_deg, Range{-30.0, 30.0}, "constant roll, right side down [deg]");
    v("trim_pitch_deg", trim_pitch_deg, Range{-60.0, 60.0}, "constant pitch, nose up [deg]");
    v("bank_gain", bank_gain, Range{-5.0, 5.0}, "roll into turns, 1 for a coordinated turn");
    v("climb_gain", climb_gain, Range{-2.0, 2.0}, "share of the path's slope that pitch follows");
    v("oscillation_deg", oscillation_deg, Range{0.0, 20.0},
      "roll and pitch wobble, one sigma [deg]");
    v("oscillation_period_s", oscillation_period_s, Range{0.5, 60.0}, "its dominant period [s]");
    v("sway_m", sway_m, Range{0.0, 1.0}, "unsteadiness of the position, one sigma [m]");
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
  bool revisit = true;
  double radius_m = 4.0;
  double aspect = 1.0;
  double climb_m = 0.0;
  int laps = 2;
  std::vector<std::array<double, 3>> waypoints;
  std::string file;
  FileFrame file_frame = FileFrame::up;
  double file_period_s = 0.5;
  bool file_place = false;
  Look look = Look::along;
  double look_heading_deg = 0.0;
  std::array<double, 2> centre{0.0, 0.0};
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

/// Height of the terrain's surface [m] at world x, y; nothing where there is none.
using HeightFunction = std::function<std::optional<double>(double x, double y)>;

struct MotionContext {
  Stamp start;
  double duration_s = 60.0;
  double gravity = 9.80665;  ///< [m/s²]
  std::uint64_t seed = 1;
  HeightFunction height;  ///< needed for `altitude_m` alone
};

/// Time that a planned motion goes on before the start and after the end, so that exposures, time
/// offsets and derivatives there find a curve [s].
inline constexpr double kMotionMargin = 1.0;

/// The curve that the vehicle's body flies, at least from `start` to `start + duration_s`. A path
/// that ends early begins again (lawnmower and wall return to their first point over a leg that
/// crosses what was seen, when `revisit` is set). Throws InputError when a path has no extent,
/// `altitude_m` meets a place without terrain, or the trajectory file is shorter than the duration.
Se3Spline plan_motion(const MotionConfig& config, const MotionContext& context);

/// The waves that `plan_motion` uses; the pressure sensor feels the same.
WaveField make_waves(const WaveConfig& config, std::uint64_t seed, double gravity);

template <typename V>
void MotionConfig::visit(V& v) {
  using config::Choices;
  using config::Range;
  const Range<double> metres{-1e5, 1e5};
  v("path", path,
    Choices<PathKind>{{"lawnmower", PathKind::lawnmower},
                      {"wall", PathKind::wall},
                      {"orbit", PathKind::orbit},
                      {"waypoints", PathKind::waypoints},
                      {"hover", PathKind::hover},
                      {"file", PathKind::file}},
    "pattern to fly");
  v("speed_m_s", speed_m_s, Range{0.05, 3.0}, "cruising speed [m/s]");
  v("origin", origin, metres, "first corner (lawnmower, wall), centre (orbit), place (hover) [m]");
  v("heading_deg", heading_deg, Range{-360.0, 360.0}, "of the first line, from world x to y [deg]");
  v("length_m", length_m, Range{0.1, 1e4}, "of a line [m]");
  v("spacing_m", spacing_m, Range{-100.0, 100.0}, "from line to line: to the left, or upwards [m]");
  v("lines", lines, Range{1, 1000}, "number of lines");
  v("revisit", revisit, "return across the lines and begin again; false: fly them back");
  v("radius_m", radius_m, Range{0.1, 1e4}, "of an orbit, along heading_deg [m]");
  v("aspect", aspect, Range{0.1, 10.0}, "other half axis of the orbit / radius_m");
  v("climb_m", climb_m, Range{-100.0, 100.0}, "height won in a lap of an orbit [m]");
  v("laps", laps, Range{1, 1000}, "laps before the orbit comes down again");
  v("waypoints", waypoints, metres, "[x, y, z] in the world, for path: waypoints [m]");
  v("file", file, "trajectory (TUM or EuRoC csv) of the body, for path: file");
  v("file_frame", file_frame, Choices<FileFrame>{{"up", FileFrame::up}, {"ned", FileFrame::ned}},
    "the file's world: z up with body forward-left-up, or NED with body forward-right-down");
  v("file_period_s", file_period_s, Range{0.05, 10.0}, "knots of the curve through the file [s]");
  v("file_place", file_place, "move the file's first pose to origin and heading_deg");
  v("look", look,
    Choices<Look>{{"along", Look::along},
                  {"left", Look::left},
                  {"right", Look::right},
                  {"fixed", Look::fixed},
                  {"centre", Look::centre}},
    "where the bow points: along the path, square to it, to look_heading_deg, or at a point");
  v("look_heading_deg", look_heading_deg, Range{-360.0, 360.0}, "for look: fixed [deg]");
  v("centre", centre, metres, "x, y for look: centre [m]");
  v("altitude_m", altitude_m, Range{0.1, 100.0},
    "follow the terrain at this height, instead of z [m]");
  v("corner_m", corner_m, Range{0.0, 20.0}, "how far corners are cut [m]");
  v("max_turn_deg_s", max_turn_deg_s, Range{1.0, 180.0},
    "slows down rather than turn faster [deg/s]");
  v("rest_s", rest_s, Range{0.0, 60.0}, "stands still at the beginning [s]");
  v("ramp_s", ramp_s, Range{0.1, 60.0}, "time to reach cruising speed [s]");
  v("surge_m", surge_m, Range{0.0, 5.0}, "amplitude of a to and fro along the bow [m]");
  v("surge_period_s", surge_period_s, Range{1.0, 60.0}, "its period [s]");
  v("clearance_m", clearance_m, Range{0.0, 10.0}, "closest the vehicle may come to anything [m]");
  v("attitude", attitude, "roll and pitch");
  v("waves", waves, "waves at the surface");
}

}  // namespace apvi::sim
