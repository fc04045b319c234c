// SPDX-License-Identifier: BSD-3-Clause
// Localizes a recording, builds its map, and prints what the map and the water look like.
//
//   02_map_folder DIVE/
#include <cstdio>

#include "apvi/apvi.hpp"

namespace {

void print(const apvi::slam::MapSnapshot& map) {
  std::printf("%zu Gaussians, %zu keyframes\n", map.count, map.keyframes.size());
  if (!map.medium) return;
  const auto& m = *map.medium;
  std::printf("attenuation %.3f %.3f %.3f 1/m, veiling light %.3f %.3f %.3f\n", m.beta_d[0],
              m.beta_d[1], m.beta_d[2], m.b_inf[0], m.b_inf[1], m.b_inf[2]);
}

void map(const char* path) {
  apvi::io::DatasetConfig dataset;
  dataset.path = path;
  const apvi::slam::Options options;
  const auto recording = apvi::io::open_sequence(dataset, options.localization.sensors.use);
  apvi::slam::System system(options, apvi::make_rig(recording->rig()));
  while (const auto sample = recording->next()) system.process(*sample);
  system.finish();
  const auto snapshot = system.map();
  if (!snapshot) throw apvi::RunError("no map: vision was never stable enough for a keyframe");
  print(*snapshot);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: 02_map_folder DIVE/\n", stderr);
    return 2;
  }
  try {
    map(argv[1]);
  } catch (const std::exception& error) {
    apvi::log::error("{}", error.what());
    return 1;
  }
  return 0;
}
