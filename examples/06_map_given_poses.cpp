// SPDX-License-Identifier: BSD-3-Clause
// Maps the images of a recording with the poses of a trajectory file (TUM or EuRoC).
//
//   06_map_given_poses DIVE/ POSES
#include <cstdio>

#include "apvi/apvi.hpp"

namespace {

constexpr apvi::Duration kMaxGap{500'000'000};  // between the poses that are interpolated

void map(const char* path, const char* poses_file) {
  apvi::io::DatasetConfig dataset;
  dataset.path = path;
  const auto recording = apvi::io::open_sequence(dataset, {"camera"});
  const apvi::Rig rig = apvi::make_rig(recording->rig());
  const apvi::Trajectory poses = apvi::io::read_trajectory(poses_file);
  apvi::slam::Mapper mapper({}, rig);
  apvi::Stamp next = apvi::Stamp{};  // two images a second are enough
  while (const auto sample = recording->next()) {
    const auto* image = std::get_if<apvi::ImageFrame>(&*sample);
    if (image == nullptr || image->camera != 0 || image->stamp < next) continue;
    const auto pose = poses.at(image->stamp, kMaxGap);
    if (!pose) continue;
    mapper.add(*image, *pose);
    next = image->stamp + apvi::Duration{500'000'000};
  }
  mapper.finish();
  const auto snapshot = mapper.map();
  if (!snapshot) throw apvi::RunError("no map: no image has a pose, or none shows a surface");
  std::printf("%zu Gaussians, %zu keyframes\n", snapshot->count, snapshot->keyframes.size());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fputs("usage: 06_map_given_poses DIVE/ POSES\n", stderr);
    return 2;
  }
  try {
    map(argv[1], argv[2]);
  } catch (const std::exception& error) {
    apvi::log::error("{}", error.what());
    return 1;
  }
  return 0;
}
