// SPDX-License-Identifier: BSD-3-Clause
#include "map_files.hpp"

#include "apvi/io/tum.hpp"
#include "map_io/map_file.hpp"
#include "runs/export.hpp"
#include "slam/map_access.hpp"

namespace apvi::python {

slam::MapSnapshot read_map(const std::filesystem::path& source) {
  return slam::translate_errors([&] {
    const map_io::MapFile file = runs::load_map(source);
    slam::MapCopy copy{.map = {.gaussians = file.gaussians,
                               .medium = file.medium,
                               .antialiased = file.antialiased,
                               .tone_curve = file.tone_curve},
                       .keyframes = {}};
    const std::filesystem::path keyframes = source / "keyframes.tum";
    if (std::filesystem::exists(keyframes)) copy.keyframes = io::read_trajectory(keyframes);
    slam::MapSnapshot snapshot = slam::to_snapshot(copy);
    snapshot.origin = file.origin;
    return snapshot;
  });
}

void save_map(const slam::MapSnapshot& snapshot, const std::filesystem::path& path) {
  slam::translate_errors([&] {
    const mapping::Map map = slam::to_map(snapshot);
    map_io::write_map(path, {.gaussians = map.gaussians,
                             .medium = map.medium,
                             .origin = snapshot.origin,
                             .antialiased = map.antialiased,
                             .tone_curve = map.tone_curve});
  });
}

}  // namespace apvi::python
