// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "apvi/io/tum.hpp"
#include "map_io/ply.hpp"
#include "runs/run_config.hpp"
#include "slam/camera_conversion.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"

/// A recording of nine images of a known wall, with poses and initial points.
namespace apvi::test {

inline constexpr const char* kWallPoses = "mav0/state_groundtruth_estimate0/data.csv";

/// Writes the recording of `wall`; returns its poses.
inline Trajectory write_wall_recording(const TmpDir& dir, const gaussians::Gaussians& wall) {
  const mapping::KeyframeStore images = render_keyframes(wall);
  Trajectory poses;
  std::string csv = "#timestamp [ns],filename\n";
  for (std::size_t i = 0; i < images.size(); ++i) {
    const std::string& name = images[i].name;
    csv += name + "," + name + ".png\n";
    cv::imwrite(dir.write("mav0/cam0/data/" + name + ".png", "").string(),
                slam::to_image(images[i].image));
    poses.poses.push_back(
        {Stamp{images[i].stamp_ns}, slam::to_se3(images[i].T_camera_world).inverse()});
  }
  dir.write("mav0/cam0/data.csv", csv);
  std::filesystem::create_directories(dir.path() / "mav0/state_groundtruth_estimate0");
  io::write_euroc(dir.path() / kWallPoses, poses);
  dir.write("rig.yaml",
            "body: imu0\ncam0:\n  model: pinhole\n  intrinsics: [40, 40, 23.5, 15.5]\n"
            "  resolution: [48, 32]\n"
            "  T_body_sensor: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n");
  map_io::write_ply(dir.path() / "points.ply", wall);
  return poses;
}

/// To map it with the given poses.
inline runs::RunConfig wall_config(const TmpDir& dir, int iterations) {
  runs::RunConfig config;
  config.dataset.path = dir.path().string();
  config.localization.enabled = false;
  config.mapping.enabled = slam::MapSwitch::on;
  config.mapping.medium = false;
  config.mapping.initial_points = (dir.path() / "points.ply").string();
  config.mapping.trainer.iterations = iterations;
  config.mapping.trainer.sh_degree = 0;
  config.mapping.trainer.initial_downscale = 1;
  config.mapping.trainer.densify.kind =
      mapping::Densification::none;  // the initial points are complete
  config.eval.heldout_every = 4;
  return config;
}

}  // namespace apvi::test
