// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/torch.h>

#include <cstdint>
#include <string>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/render/render.hpp"
#include "mapping/keyframes/keyframe_store.hpp"

/// A small known scene: colored Gaussians on a curved wall, and cameras in front of it.
namespace apvi::test {

inline gaussians::Gaussians gaussian_wall(std::int64_t count = 400) {
  torch::manual_seed(11);
  const torch::Tensor xy = torch::rand({count, 2}) * 4.0 - 2.0;
  const torch::Tensor z = 3.0 + 0.3 * (2.0 * xy.select(1, 0)).sin();
  torch::Tensor quaternions = torch::zeros({count, 4});
  quaternions.select(1, 0).fill_(1.0);
  return {.means = torch::stack({xy.select(1, 0), xy.select(1, 1), z}, 1),
          .log_scales = torch::full({count, 3}, std::log(0.12F)),
          .quaternions = quaternions,
          .logit_opacities = torch::full({count}, 2.0F),
          .sh_dc = torch::rand({count, 3}) * 3.0 - 1.5,
          .sh_rest = torch::zeros({count, 0, 3})};
}

inline torch::Tensor camera_at(double x, double y) {
  torch::Tensor pose = torch::eye(4, torch::kFloat64);
  pose[0][3] = -x;
  pose[1][3] = -y;
  return pose;
}

/// Whether two maps are bitwise equal, on any device.
inline bool bitwise_equal(const gaussians::Gaussians& a, const gaussians::Gaussians& b) {
  for (std::size_t i = 0; i < a.tensors().size(); ++i) {
    if (!torch::equal(a.tensors()[i]->cpu(), b.tensors()[i]->cpu())) return false;
  }
  return true;
}

inline gaussians::Intrinsics small_camera() {
  return {.fx = 40.0, .fy = 40.0, .cx = 24.0, .cy = 16.0, .width = 48, .height = 32};
}

inline mapping::Keyframe render_keyframe(const gaussians::Gaussians& world,
                                         const torch::Tensor& pose, std::int64_t number,
                                         bool held_out = false) {
  const torch::NoGradGuard no_grad;
  gaussians::View view;
  view.intrinsics = small_camera();
  view.T_camera_world = pose;
  mapping::Keyframe keyframe;
  keyframe.stamp_ns = (number + 1) * 1000000000LL;
  keyframe.name = std::to_string(keyframe.stamp_ns);
  keyframe.intrinsics = view.intrinsics;
  keyframe.T_camera_world = pose;
  keyframe.image =
      (gaussians::render(world, view, {}).color.clamp(0.0, 1.0) * 255.0 + 0.5).to(torch::kUInt8);
  keyframe.held_out = held_out;
  return keyframe;
}

/// Nine cameras in three rows; the middle one is held out.
inline mapping::KeyframeStore render_keyframes(const gaussians::Gaussians& world) {
  mapping::KeyframeStore store;
  for (std::int64_t i = 0; i < 9; ++i) {
    const double x = 0.4 * static_cast<double>(i % 3 - 1);
    const std::int64_t row = i / 3;
    const double y = 0.3 * static_cast<double>(row - 1);
    store.add(render_keyframe(world, camera_at(x, y), i, i == 4));
  }
  return store;
}

}  // namespace apvi::test
