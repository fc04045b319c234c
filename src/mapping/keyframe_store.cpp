// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/keyframe_store.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <utility>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kLeastExtent = 0.1;  // [m] a camera that only turns still needs a scale

splat::Intrinsics reduced(const splat::Intrinsics& full, int factor) {
  const double f = 1.0 / factor;
  return {.fx = f * full.fx,
          .fy = f * full.fy,
          .cx = f * full.cx,
          .cy = f * full.cy,
          .width = full.width / factor,
          .height = full.height / factor};
}

}  // namespace

void KeyframeStore::add(Keyframe keyframe) {
  const Tensor& image = keyframe.image;
  TORCH_CHECK(image.dim() == 3 && image.size(2) == 3 && image.scalar_type() == torch::kUInt8,
              keyframe.name, ": the picture must be [H,W,3] uint8, not ", image.toString(),
              image.sizes());
  TORCH_CHECK(
      image.size(0) == keyframe.intrinsics.height && image.size(1) == keyframe.intrinsics.width,
      keyframe.name, ": the picture is ", image.sizes(), ", its camera ", keyframe.intrinsics.width,
      " x ", keyframe.intrinsics.height);
  TORCH_CHECK(keyframe.T_camera_world.sizes() == at::IntArrayRef({4, 4}) &&
                  keyframe.T_camera_world.scalar_type() == torch::kFloat64,
              keyframe.name, ": the pose must be [4,4] float64");
  (keyframe.held_out ? held_out_ : training_).push_back(keyframes_.size());
  keyframes_.push_back(std::move(keyframe));
}

Tensor KeyframeStore::image(std::size_t i, int factor, const torch::Device& device) const {
  const Tensor numbers = keyframes_.at(i).image.to(device).to(torch::kFloat32) / 255.0;
  if (factor == 1) return numbers;
  const Tensor planes = numbers.permute({2, 0, 1}).unsqueeze(0);
  return torch::avg_pool2d(planes, factor).squeeze(0).permute({1, 2, 0}).contiguous();
}

splat::View KeyframeStore::view(std::size_t i, int factor) const {
  const Keyframe& keyframe = keyframes_.at(i);
  return {.intrinsics = reduced(keyframe.intrinsics, factor),
          .T_camera_world = keyframe.T_camera_world,
          .pose_delta = {}};
}

Tensor camera_center(const Tensor& T_camera_world) {
  const Tensor R = T_camera_world.slice(0, 0, 3).slice(1, 0, 3);
  return -R.t().mv(T_camera_world.slice(0, 0, 3).select(1, 3));
}

double scene_extent(const KeyframeStore& store) {
  std::vector<Tensor> centers;
  for (const std::size_t i : store.training()) {
    centers.push_back(camera_center(store[i].T_camera_world));
  }
  if (centers.empty()) return kLeastExtent;
  const Tensor all = torch::stack(centers);
  const double radius = (all - all.mean(0)).norm(2, 1).max().item<double>();
  return std::max(kLeastExtent, 1.1 * radius);
}

}  // namespace apvi::mapping
