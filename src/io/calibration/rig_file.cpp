// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/io/rig_file.hpp"

#include "apvi/core/error.hpp"
#include "io/calibration/foreign_rig.hpp"
#include "sensors/camera_mask.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;

config::Node load_folder(const fs::path& path) {
  config::Node rig = load_euroc_rig(path);
  if (rig.is_null()) {
    fail_input("{}: no calibration in this folder; expected a file, or a folder with {}",
               path.string(), "imu0/sensor.yaml or cam0/sensor.yaml");
  }
  return rig;
}

}  // namespace

config::Node load_rig_file(const fs::path& path, const std::vector<fs::path>& search) {
  if (fs::is_directory(path)) return load_folder(path);
  bool foreign = false;
  config::Node rig = config::load_with_inheritance(
      path,
      [&](config::Node& file) {
        foreign = convert_foreign(file) || foreign;
        if (file.source) resolve_masks(file, *file.source);
      },
      search);
  if (rig.is_null()) {
    fail_input("{}: empty; describe the sensors in it, see docs/your-vehicle.md", path.string());
  }
  if (foreign) finish_foreign(rig, path.string());
  return rig;
}

}  // namespace apvi::io
