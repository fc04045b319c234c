// SPDX-License-Identifier: BSD-3-Clause
// Localizes a recording and prints the trajectory as TUM lines.
//
//   01_localize_folder DIVE/
#include <cstdio>

#include "apvi/apvi.hpp"

namespace {

void localize(const char* path) {
  apvi::io::DatasetConfig dataset;
  dataset.path = path;
  const apvi::localization::Options options;
  const auto recording = apvi::io::open_sequence(dataset, options.sensors.use);
  const apvi::Rig rig = apvi::make_rig(recording->rig());

  apvi::localization::SystemCallbacks callbacks;
  callbacks.pose = [](const apvi::StampedPose& pose) {
    std::fputs(apvi::io::tum_line(pose).c_str(), stdout);
  };
  apvi::localization::System system(options, rig, callbacks);
  while (const auto sample = recording->next()) system.process(*sample);
  system.finish();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: 01_localize_folder DIVE/\n", stderr);
    return 2;
  }
  try {
    localize(argv[1]);
  } catch (const std::exception& error) {
    apvi::log::error("{}", error.what());
    return 1;
  }
  return 0;
}
