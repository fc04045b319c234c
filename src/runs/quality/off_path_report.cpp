// SPDX-License-Identifier: BSD-3-Clause
#include "runs/quality/off_path_report.hpp"

#include <torch/torch.h>

#include <nlohmann/json.hpp>

#include "gaussians/metrics/metrics.hpp"
#include "mapping/appearance/view_gains.hpp"
#include "runs/quality/simulated_truth.hpp"
#include "runs/views/image_files.hpp"

namespace apvi::runs {
namespace {

using torch::Tensor;

/// Image values [H,W,3] of the map from beside keyframe i. Its moving light is left out: that is
/// known in its own image only.
Tensor render_beside(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                     std::size_t i, const Tensor& T_camera_view) {
  gaussians::View view = keyframes.view(i, 1);
  view.T_camera_world = mapping::rigid_inverse(T_camera_view).mm(view.T_camera_world);
  const Tensor light = mapping::render_map(map, view).color;
  const Tensor response = mapping::camera_gain(map, keyframes, i) *
                          mapping::lens_falloff(view.intrinsics, map.vignetting, light.device());
  return map.tone_curve.encode(light * response).clamp(0.0, 1.0);
}

}  // namespace

void add_off_path_views(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                        const SimulatedTruth& truth, const std::filesystem::path& folder,
                        eval::Json& json) {
  double psnr_db = 0.0;
  double ssim = 0.0;
  int count = 0;
  for (const std::size_t i : keyframes.held_out()) {
    const auto seen = truth.off_path(keyframes[i].name);
    if (!seen) continue;
    const Tensor image = render_beside(map, keyframes, i, seen->T_camera_view);
    const Tensor expected = mapping::to_float_image(seen->image.to(image.device()), 1);
    psnr_db += gaussians::psnr(image, expected);
    ssim += gaussians::ssim(image, expected).value_or(0.0);
    ++count;
    write_png(folder / (keyframes[i].name + "_off_path.png"), image);
    write_png(folder / (keyframes[i].name + "_off_path_truth.png"), seen->image);
  }
  if (count == 0) return;
  json["off_path_psnr_db"] = psnr_db / count;
  json["off_path_ssim"] = ssim / count;
  json["off_path_views"] = count;
}

}  // namespace apvi::runs
