// SPDX-License-Identifier: BSD-3-Clause
#include "slam/map_access.hpp"

#include <torch/torch.h>

#include <exception>

#include "gaussians/host_values.hpp"
#include "gaussians/model/rows.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::slam {
namespace {

using gaussians::host_values;
using torch::Tensor;

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

RenderedImages to_images(const mapping::MapRendering& images, const RenderView& view) {
  return {.width = view.camera.width,
          .height = view.camera.height,
          .color = host_values<float>(images.color),
          .restored = host_values<float>(images.restored),
          .depth = host_values<float>(images.depth),
          .alpha = host_values<float>(images.alpha)};
}

}  // namespace

mapping::MapRendering render_image(const mapping::Map& map, const gaussians::View& view) {
  mapping::MapRendering rendering = mapping::render_map(map, view);
  rendering.color = map.tone_curve.encode(rendering.color);
  rendering.restored = map.tone_curve.encode(rendering.restored);
  return rendering;
}

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
    return to_images(images, view);
  });
}

RenderedImages render(const MapSnapshot& map, const RenderView& view) {
  RenderView relative = view;
  relative.T_world_camera.translation -=
      Eigen::Vector3d(map.origin[0], map.origin[1], map.origin[2]);
  const gaussians::View camera = to_view(relative);
  return translate_errors([&] {
    mapping::Map drawable = to_map(map);
    drawable.gaussians = gaussians::on_device(drawable.gaussians, gaussians::active_device());
    return to_images(render_image(drawable, camera), view);
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
