// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/sensors/rig.hpp"

namespace apvi {

/// `port` of a camera in rig.yaml.
struct PortSection {
  PortKind kind = PortKind::flat;
  std::optional<double> distance_m;
  std::array<double, 2> tilt_deg{};
  std::optional<double> radius_m;
  std::array<double, 3> center_m{};
  double glass_thickness_m = Port{}.glass_thickness_m;
  double air_index = Port{}.air_index;
  double glass_index = Port{}.glass_index;
  double water_index = Port{}.water_index;
  double working_range_m = 2.0;
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("kind", kind, config::Choices<PortKind>{{"flat", PortKind::flat}, {"dome", PortKind::dome}},
      "form of the window");
    v("distance_m", distance_m, Range{1e-4, 1.0},
      "flat: lens center to the inside of the glass [m]");
    v("tilt_deg", tilt_deg, Range{-45.0, 45.0},
      "flat: rotation of the normal about the camera's x and y axes [deg]");
    v("radius_m", radius_m, Range{1e-3, 1.0}, "dome: inner radius [m]");
    v("center_m", center_m, Range{-1.0, 1.0},
      "dome: center of its spheres in the camera frame [m]; 0, 0, 0 is the lens center");
    v("glass_thickness_m", glass_thickness_m, Range{0.0, 0.2}, "thickness of the window [m]");
    v("air_index", air_index, Range{1.0, 1.1}, "index of refraction behind the window");
    v("glass_index", glass_index, Range{1.0, 2.5},
      "index of refraction of the window: acrylic 1.49, glass 1.52, sapphire 1.77");
    v("water_index", water_index, Range{1.0, 1.5},
      "index of refraction of the water: fresh 1.333, sea 1.34");
    v("working_range_m", working_range_m, Range{0.05, 100.0},
      "range for which the nearest central camera is made [m]");
  }
};

/// A camera in rig.yaml.
struct CameraSection {
  std::string model = "pinhole";
  std::array<double, 4> intrinsics{};
  std::optional<Distortion> distortion;
  std::vector<double> coefficients;
  std::array<int, 2> resolution{};
  double rate_hz = 20.0;
  config::Node T_body_sensor;
  double time_offset_s = 0.0;
  std::optional<PortSection> port;
  std::string mask;
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("model", model, "camera model; only pinhole, the lens is `distortion`");
    v("intrinsics", intrinsics, "fx, fy, cx, cy [px]; the center of the first pixel is (0, 0)");
    v("distortion", distortion,
      config::Choices<Distortion>{{"none", Distortion::none},
                                  {"radtan", Distortion::radtan},
                                  {"equidistant", Distortion::equidistant},
                                  {"double_sphere", Distortion::double_sphere},
                                  {"eucm", Distortion::eucm}},
      "lens model; may be left out without coefficients (none) and with five or eight (radtan)");
    v("coefficients", coefficients,
      "radtan: k1, k2, p1, p2 [, k3 [, k4, k5, k6]]; equidistant: k1, k2, k3, k4; double_sphere: "
      "xi, alpha; eucm: alpha, beta");
    v("resolution", resolution, Range{1, 100000}, "width, height [px]");
    v("rate_hz", rate_hz, Range{0.01, 10000.0}, "nominal frame rate [Hz]");
    v("T_body_sensor", T_body_sensor, "camera to body: 4x4 matrix, row-major");
    v("time_offset_s", time_offset_s, Range{-10.0, 10.0}, "delay of the stamps [s]");
    v("port", port, "window between camera and water; intrinsics and lens are then those in air");
    v("mask", mask,
      "image file, black where the camera always sees the vehicle or an overlay; relative to the "
      "rig's file");
  }
};

/// Throws InputError with file and line. A camera with a port gets its nearest central model.
CameraCalibration to_camera(const CameraSection& section, const config::Node& node,
                            const std::string& key);

}  // namespace apvi
