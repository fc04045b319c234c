// SPDX-License-Identifier: BSD-3-Clause
#include "slam/map_access.hpp"

#include <torch/torch.h>

#include <exception>

#include "slam/camera_conversion.hpp"

namespace apvi::slam {
namespace {

using torch::Tensor;

std::vector<float> to_vector(const Tensor& tensor) {
  const Tensor flat = tensor.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  return {flat.data_ptr<float>(), flat.data_ptr<float>() + flat.numel()};
}

std::array<double, 3> to_array(const Tensor& rgb) {
  const Tensor v = rgb.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  const double* const x = v.data_ptr<double>();
  return {x[0], x[1], x[2]};
}

MapSnapshot to_snapshot(const MapCopy& copy) {
  const gaussians::Gaussians& g = copy.map.gaussians;
  const Tensor sh = torch::cat({g.sh_dc.unsqueeze(1), g.sh_rest}, 1);
  MapSnapshot out = {.iteration = copy.iteration,
                     .count = static_cast<std::size_t>(g.size()),
                     .means = to_vector(g.means),
                     .log_scales = to_vector(g.log_scales),
                     .quaternions = to_vector(g.quaternions),
                     .logit_opacities = to_vector(g.logit_opacities),
                     .sh_coefficients = static_cast<std::size_t>(sh.size(1)),
                     .spherical_harmonics = to_vector(sh),
                     .medium = std::nullopt,
                     .keyframes = copy.keyframes};
  if (const auto& medium = copy.map.medium) {
    out.medium = {.beta_d = to_array(medium->beta_d),
                  .beta_b = to_array(medium->beta_b),
                  .b_inf = to_array(medium->b_inf)};
  }
  return out;
}

gaussians::View to_view(const RenderView& view) {
  const CameraModel::Parameters& camera = view.camera;
  if (camera.width <= 0 || camera.height <= 0 || camera.fx <= 0.0 || camera.fy <= 0.0) {
    fail_input("render: a camera of {} x {} pixels with focal lengths {}, {}", camera.width,
               camera.height, camera.fx, camera.fy);
  }
  return {.intrinsics = to_intrinsics(camera),
          .T_camera_world = to_tensor(view.T_world_camera.inverse()),
          .pose_delta = {}};
}

}  // namespace

std::optional<MapSnapshot> snapshot_of(const AsyncMapper& mapper) {
  return translate_errors([&]() -> std::optional<MapSnapshot> {
    const MapCopy copy = mapper.snapshot();
    if (copy.map.gaussians.size() == 0) return std::nullopt;
    return to_snapshot(copy);
  });
}

std::optional<RenderedImages> render_of(const AsyncMapper& mapper, const RenderView& view) {
  const gaussians::View camera = to_view(view);
  return translate_errors([&]() -> std::optional<RenderedImages> {
    const mapping::MapRendering images = mapper.render(camera);
    if (!images.color.defined()) return std::nullopt;
    return RenderedImages{.width = view.camera.width,
                          .height = view.camera.height,
                          .color = to_vector(images.color),
                          .restored = to_vector(images.restored),
                          .depth = to_vector(images.depth),
                          .alpha = to_vector(images.alpha)};
  });
}

std::string error_of(const AsyncMapper& mapper) {
  if (!mapper.failed()) return "";
  try {
    translate_errors([&] { std::rethrow_exception(mapper.failure()); });
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

}  // namespace apvi::slam
