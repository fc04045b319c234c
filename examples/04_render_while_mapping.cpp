// SPDX-License-Identifier: BSD-3-Clause
// Renders the map as the vehicle sees it, without the water, while the map grows: every five
// seconds of the recording one image, render_000.ppm, render_001.ppm, ...
//
//   04_render_while_mapping DIVE/
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <string>

#include "apvi/apvi.hpp"

namespace {

constexpr double kEvery_s = 5.0;

void write_ppm(const std::string& path, const apvi::slam::RenderedImages& images) {
  std::ofstream out(path, std::ios::binary);
  out << "P6\n" << images.width << ' ' << images.height << "\n255\n";
  for (const float value : images.restored) {
    out.put(static_cast<char>(static_cast<int>(255.0F * std::clamp(value, 0.0F, 1.0F) + 0.5F)));
  }
}

void render(const char* path) {
  apvi::io::DatasetConfig dataset;
  dataset.path = path;
  const apvi::slam::Options options;
  const auto recording = apvi::io::open_sequence(dataset, options.localization.sensors.use);
  const apvi::Rig rig = apvi::make_rig(recording->rig());
  apvi::CameraModel::Parameters camera = rig.cameras.at(0).model.parameters();
  camera.distortion = apvi::Distortion::none;

  apvi::slam::System system(options, rig);
  apvi::Stamp next = apvi::Stamp::min();
  int count = 0;
  while (const auto sample = recording->next()) {
    system.process(*sample);
    const auto pose = system.pose();
    if (!pose || pose->stamp < next) continue;
    next = pose->stamp + apvi::Duration::from_seconds(kEvery_s);
    const auto images =
        system.render({camera, pose->T_world_body * rig.cameras.at(0).T_body_camera});
    if (!images) continue;
    char name[32];
    std::snprintf(name, sizeof(name), "render_%03d.ppm", count++);
    write_ppm(name, *images);
  }
  system.finish();
  std::printf("%d images\n", count);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: 04_render_while_mapping DIVE/\n", stderr);
    return 2;
  }
  try {
    render(argv[1]);
  } catch (const std::exception& error) {
    apvi::log::error("{}", error.what());
    return 1;
  }
  return 0;
}
