// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/bag_writer.hpp"

#include <fstream>
#include <iterator>
#include <system_error>

#include "apvi/core/error.hpp"
#include "sim/writers/dataset_writer.hpp"
#include "sim/writers/formats.hpp"

// Writes a ROS 1 bag with the topics of the Tank dataset: recording.bag, next to rig.yaml.
namespace apvi::sim {
namespace {

namespace fs = std::filesystem;

std::vector<std::uint8_t> read_bytes(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) fail_run("{}: cannot read this file back", path.string());
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

void write_images(io::BagWriter& bag, const fs::path& root, const Scene& scene,
                  const Recording& recording) {
  const std::string_view extension = image_extension(scene.config);
  const char* const encoding = extension == ".jpg" ? "jpeg" : "png";
  for (std::size_t camera = 0; camera < scene.rig.cameras.size(); ++camera) {
    const std::string topic = camera == 0 ? "/camera/left/image_dehazed/compressed"
                                          : "/camera/right/image_dehazed/compressed";
    for (const FrameTime& frame : recording.frames) {
      const fs::path image = image_path(root, OutputFormat::rosbag, camera, frame.stamp, extension);
      bag.write_image(topic, frame.stamp, encoding, read_bytes(image));
    }
  }
}

// The reference poses of the Tank dataset have the rate of its camera.
void write_poses(io::BagWriter& bag, const ImuRecord& record) {
  const Duration spacing = Duration::from_seconds(0.05);
  Stamp due = record.samples.front().stamp;
  for (std::size_t i = 0; i < record.samples.size(); ++i) {
    if (record.samples[i].stamp < due) continue;
    bag.write_pose("/apriltag_slam/GT", {record.samples[i].stamp, record.truth[i].T_world_body});
    due = due + spacing;
  }
}

}  // namespace

void write_bag(const fs::path& root, const Scene& scene, const Recording& recording) {
  write_file(root / "rig.yaml", config::to_yaml(rig_with_depth(scene)) + "\n");
  io::BagWriter bag(root / "recording.bag");
  if (scene.rig.imu) {
    for (const ImuSample& sample : recording.imu.samples) bag.write_imu("/imu/data", sample);
  }
  for (const DvlSample& sample : recording.dvl) bag.write_dvl("/dvl/data", sample);
  for (const PressureDepthSample& sample : depth_samples(scene, recording))
    bag.write_depth("/depth/data", sample);
  write_images(bag, root, scene, recording);
  write_poses(bag, recording.imu);
  bag.close();
  std::error_code ignored;  // leftover frames are harmless
  fs::remove_all(root / "frames", ignored);
}

}  // namespace apvi::sim
