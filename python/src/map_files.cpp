// SPDX-License-Identifier: BSD-3-Clause
#include "map_files.hpp"

#include <torch/torch.h>

#include "apvi/io/tum.hpp"
#include "gaussians/model/point_cloud.hpp"
#include "map_io/map_file.hpp"
#include "runs/survey/export.hpp"
#include "slam/map_access.hpp"

namespace apvi::python {

slam::MapSnapshot read_map(const std::filesystem::path& source) {
  return slam::translate_errors([&] {
    const map_io::MapFile file = runs::load_map(source);
    slam::MapCopy copy{.map = {.gaussians = file.gaussians,
                               .medium = file.medium,
                               .antialiased = file.antialiased,
                               .vignetting = file.vignetting,
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
                             .tone_curve = map.tone_curve,
                             .vignetting = map.vignetting});
  });
}

std::vector<float> image_colors(const slam::MapSnapshot& snapshot) {
  const mapping::Map map = slam::to_map(snapshot);
  const torch::Tensor light = gaussians::sh_dc_to_color(map.gaussians.sh_dc).clamp(0.0, 1.0);
  const torch::Tensor values = map.tone_curve.encode(light).to(torch::kCPU).contiguous();
  return {values.data_ptr<float>(), values.data_ptr<float>() + values.numel()};
}

}  // namespace apvi::python
