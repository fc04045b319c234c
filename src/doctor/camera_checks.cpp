// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "doctor/checks.hpp"
#include "doctor/static_parts.hpp"

namespace apvi::doctor {
namespace {

void check_size(const CameraObservations& observed, const std::string& name,
                const CameraModel::Parameters& p, Report& report) {
  const auto [width, height] = *observed.size;
  Finding f{Severity::ok, name,
            "size",       fmt::format("{}x{}, as in the rig", width, height),
            "",           {{"width_px", width}, {"height_px", height}}};
  if (width != p.width || height != p.height) {
    f.severity = Severity::error;
    f.message =
        fmt::format("images are {}x{}, the rig says {}x{}", width, height, p.width, p.height);
    f.advice = "intrinsics are for one image size: calibrate at this size, or scale fx, fy, cx, cy";
  }
  report.add(std::move(f));
}

// The principal point is usually near the image center.
void check_principal_point(const CameraModel::Parameters& p, const std::string& name,
                           Report& report) {
  const bool inside = p.cx > 0.2 * p.width && p.cx < 0.8 * p.width && p.cy > 0.2 * p.height &&
                      p.cy < 0.8 * p.height;
  if (inside) return;
  report.add({Severity::warning,
              name,
              "principal point",
              fmt::format("({:.1f}, {:.1f}) is far from the center of {}x{}", p.cx, p.cy, p.width,
                          p.height),
              "intrinsics are fx, fy, cx, cy in pixels: check their order and image size",
              {{"cx_px", p.cx}, {"cy_px", p.cy}}});
}

void check_static_parts(double share, const std::string& name, Report& report) {
  constexpr double kMinShare = 0.002;
  if (share < kMinShare || share > StaticParts::kMaxShare) return;
  report.add({Severity::warning,
              name,
              "static parts",
              fmt::format("{:.1f} % of the image is always the same: a part of the vehicle, or an "
                          "overlay",
                          100.0 * share),
              fmt::format("hide it from localization and map: `apvi camera mask`, and {}.mask in "
                          "the rig",
                          name),
              {{"share", share}}});
}

}  // namespace

void check_cameras(const CheckInput& c, Report& report) {
  for (std::size_t i = 0; i < c.observed.cameras.size(); ++i) {
    const CameraObservations& observed = c.observed.cameras[i];
    const std::string name = fmt::format("cam{}", i);
    if (!observed.decode_error.empty()) {
      report.add({Severity::error,
                  name,
                  "first image",
                  observed.decode_error,
                  "copy the file again; damaged images are dropped",
                  {}});
    }
    if (i >= c.rig.cameras.size()) continue;
    const CameraModel::Parameters& p = c.rig.cameras[i].model.parameters();
    check_principal_point(p, name, report);
    if (observed.size) check_size(observed, name, p, report);
    if (i < c.static_shares.size()) check_static_parts(c.static_shares[i], name, report);
  }
}

}  // namespace apvi::doctor
