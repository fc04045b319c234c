// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/stored_map.hpp"

#include <torch/torch.h>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/sensors/rig.hpp"
#include "gaussians/device.hpp"
#include "gaussians/model/rows.hpp"
#include "map_io/map_file.hpp"
#include "runs/survey/export.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::runs {

namespace fs = std::filesystem;

CameraMount mount_of_run(const RunConfig& config) {
  const Rig rig = make_rig(config.rig);
  if (rig.cameras.empty()) fail_input("{}: the run's rig has no cam0", config.dataset.path);
  const CameraCalibration& camera = rig.cameras.front();
  return {slam::Undistorter(camera.model, config.mapping.image_scale).intrinsics(),
          camera.T_body_camera};
}

gaussians::View view_at(const SE3& T_world_body, const CameraMount& mount) {
  gaussians::View view;
  view.intrinsics = mount.intrinsics;
  view.T_camera_world = slam::to_tensor((T_world_body * mount.T_body_camera).inverse());
  return view;
}

fs::path map_file_of(const fs::path& source) {
  return fs::is_directory(source) ? source / "map.ply" : source;
}

StoredMap load_drawable_map(const fs::path& source) {
  const map_io::MapFile stored = load_map(source);
  StoredMap out;
  out.map.gaussians = gaussians::on_device(stored.gaussians, gaussians::active_device());
  out.map.medium = stored.medium;
  out.map.tone_curve = stored.tone_curve;
  out.map.antialiased = stored.antialiased;
  out.origin = stored.origin;
  return out;
}

Trajectory load_path(const fs::path& run) {
  for (const char* name : {"trajectory_smoothed.tum", "trajectory.tum", "keyframes.tum"}) {
    if (fs::exists(run / name)) return io::read_trajectory(run / name);
  }
  return {};
}

}  // namespace apvi::runs
