// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "doctor/checks.hpp"

namespace apvi::doctor {
namespace {

void check_size(const CameraObservations& seen, const std::string& name,
                const CameraModel::Parameters& p, Report& report) {
  const auto [width, height] = *seen.size;
  Finding f{Severity::ok, name,
            "size",       fmt::format("{}x{}, as the rig says", width, height),
            "",           {{"width_px", width}, {"height_px", height}}};
  if (width != p.width || height != p.height) {
    f.severity = Severity::error;
    f.message =
        fmt::format("images are {}x{}, the rig says {}x{}", width, height, p.width, p.height);
    f.advice =
        "intrinsics belong to one size: calibrate at this one, or scale fx, fy, cx, cy with it";
  }
  report.add(std::move(f));
}

// Lenses do not point far past the middle of their sensor.
void check_centre(const CameraModel::Parameters& p, const std::string& name, Report& report) {
  const bool inside = p.cx > 0.2 * p.width && p.cx < 0.8 * p.width && p.cy > 0.2 * p.height &&
                      p.cy < 0.8 * p.height;
  if (inside) return;
  report.add({Severity::warning,
              name,
              "principal point",
              fmt::format("({:.1f}, {:.1f}) is far from the middle of {}x{}", p.cx, p.cy, p.width,
                          p.height),
              "intrinsics are fx, fy, cx, cy in pixels: check their order and image size",
              {{"cx_px", p.cx}, {"cy_px", p.cy}}});
}

}  // namespace

void check_cameras(const Case& c, Report& report) {
  for (std::size_t i = 0; i < c.seen.cameras.size(); ++i) {
    const CameraObservations& seen = c.seen.cameras[i];
    const std::string name = fmt::format("cam{}", i);
    if (!seen.damage.empty()) {
      report.add({Severity::error,
                  name,
                  "first image",
                  seen.damage,
                  "copy it again; damaged images are dropped",
                  {}});
    }
    if (i >= c.rig.cameras.size()) continue;
    const CameraModel::Parameters& p = c.rig.cameras[i].model.parameters();
    check_centre(p, name, report);
    if (seen.size) check_size(seen, name, p, report);
  }
}

}  // namespace apvi::doctor
