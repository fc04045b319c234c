// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/rig_file.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/sensors/central_fit.hpp"
#include "apvi/sensors/lens.hpp"
#include "apvi/sensors/rig.hpp"
#include "cli/camera_mask.hpp"
#include "cli/commands.hpp"
#include "cli/configurations.hpp"
#include "sensors/central_rig.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  fs::path rig;
  fs::path output;
  std::optional<double> range_m;
  std::optional<Distortion> lens;
};

// The rig with the central models that the arguments ask for.
void refit(const Arguments& a, CameraCalibration& camera) {
  PortCalibration& port = *camera.port;
  if (!a.range_m && !a.lens) return;
  port.working_range_m = a.range_m.value_or(port.working_range_m);
  const CentralCamera central = fit_central_camera(port.camera, port.working_range_m, a.lens);
  camera.T_body_camera = {camera.T_body_camera.rotation, camera.T_body_lens() * central.center};
  camera.model = central.model;
  port.p_camera_lens = -central.center;
}

void print_fit(const std::string& name, const CameraCalibration& camera) {
  const PortCalibration& port = *camera.port;
  const CentralCamera central{camera.model, -port.p_camera_lens};
  const CameraModel::Parameters& p = camera.model.parameters();
  const Eigen::Vector3d& c = central.center;
  fmt::print("{}: {} port, nearest central camera at {:g} m\n", name,
             port.camera.port().kind == PortKind::flat ? "flat" : "dome", port.working_range_m);
  fmt::print("  intrinsics: [{:.4f}, {:.4f}, {:.4f}, {:.4f}]\n  distortion: {}\n", p.fx, p.fy, p.cx,
             p.cy, lens_name(p.distortion));
  fmt::print("  coefficients: [{:.7g}]\n", fmt::join(coefficients_of(p), ", "));
  fmt::print("  center of the rays from the lens center: [{:.5f}, {:.5f}, {:.5f}] m\n\n", c.x(),
             c.y(), c.z());
  fmt::print("| range [m] | RMS error [px] | largest error [px] |\n|---|---|---|\n");
  for (const double range : {0.5, 1.0, 3.0, 10.0}) {
    const CentralError error = central_error(port.camera, central, range);
    fmt::print("| {:g} | {:.3f} | {:.3f} |\n", range, error.rms_px, error.max_px);
  }
}

void fit(const Arguments& a) {
  const config::Node node = io::load_rig_file(a.rig, configuration_folders());
  Rig rig = make_rig(node);
  bool any = false;
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    if (!rig.cameras[i].port) continue;
    refit(a, rig.cameras[i]);
    print_fit(fmt::format("cam{}", i), rig.cameras[i]);
    any = true;
  }
  std::fflush(stdout);
  if (!any) fail_input("{}: no camera has a section port; nothing to fit", a.rig.string());
  if (a.output.empty()) return;
  io::write_text_file(a.output, "# Central cameras by `apvi camera fit` from " +
                                    a.rig.filename().string() + ".\n" +
                                    config::to_yaml(central_rig(node, rig)) + "\n");
  log::info("rig without ports written to {}", a.output.string());
}

void add_fit(CLI::App& camera) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = camera.add_subcommand(
      "fit", "find the central camera nearest to one behind a port, and how far it is off");
  command->add_option("RIG", a->rig, "calibration file with a section port")
      ->type_name("FILE")
      ->required();
  command->add_option("--range", a->range_m, "working range (default: working_range_m of the rig)")
      ->check(CLI::Range(0.05, 100.0))
      ->type_name("M");
  command->add_option("--lens", a->lens, "lens model (default: the one with the smaller error)")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, Distortion>{{"radtan", Distortion::radtan},
                                            {"equidistant", Distortion::equidistant}},
          CLI::ignore_case));
  command->add_option("-o,--output", a->output, "write the rig with central cameras to this file")
      ->type_name("FILE");
  command->callback([a] { fit(*a); });
}

}  // namespace

void add_camera(CLI::App& app) {
  CLI::App* command = app.add_subcommand("camera", "tools for camera calibrations");
  command->require_subcommand(1);
  add_fit(*command);
  add_camera_mask(*command);
}

}  // namespace apvi::cli
