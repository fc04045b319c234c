// SPDX-License-Identifier: BSD-3-Clause
// KeyframeStore: checkpoints.
#include <torch/torch.h>

#include <string>

#include "gaussians/model/archive.hpp"
#include "mapping/keyframes/keyframe_store.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;
using torch::serialize::InputArchive;
using torch::serialize::OutputArchive;

void write(OutputArchive& archive, const Keyframe& keyframe) {
  const gaussians::Intrinsics& k = keyframe.intrinsics;
  archive.write("stamp", c10::IValue(keyframe.stamp_ns));
  archive.write("name", c10::IValue(keyframe.name));
  archive.write("held_out", c10::IValue(keyframe.held_out));
  archive.write("number", c10::IValue(keyframe.number));
  archive.write("width", c10::IValue(static_cast<std::int64_t>(k.width)));
  archive.write("height", c10::IValue(static_cast<std::int64_t>(k.height)));
  const auto& [a, b, c] = k.lens_spread;
  archive.write("lens", torch::tensor({k.fx, k.fy, k.cx, k.cy, a, b, c}, torch::kFloat64));
  archive.write("pose", keyframe.T_camera_world);
  const bool has_image = keyframe.image.defined();
  archive.write("has_image", c10::IValue(has_image));
  if (has_image) archive.write("image", keyframe.image);
  if (keyframe.scene.defined()) archive.write("scene", keyframe.scene);
}

Keyframe read_keyframe(InputArchive& archive) {
  Keyframe keyframe;
  keyframe.stamp_ns = gaussians::read_int(archive, "stamp");
  c10::IValue name;
  archive.read("name", name);
  keyframe.name = name.toStringRef();
  keyframe.held_out = gaussians::read_bool(archive, "held_out");
  keyframe.number = gaussians::read_int(archive, "number");
  Tensor lens;
  archive.read("lens", lens);
  const auto f = lens.accessor<double, 1>();
  TORCH_CHECK(f.size(0) == 7, "checkpoint: ", f.size(0), " lens parameters instead of 7");
  keyframe.intrinsics = {.fx = f[0],
                         .fy = f[1],
                         .cx = f[2],
                         .cy = f[3],
                         .width = static_cast<int>(gaussians::read_int(archive, "width")),
                         .height = static_cast<int>(gaussians::read_int(archive, "height")),
                         .lens_spread = {f[4], f[5], f[6]}};
  archive.read("pose", keyframe.T_camera_world);
  if (gaussians::read_bool(archive, "has_image")) archive.read("image", keyframe.image);
  archive.try_read("scene", keyframe.scene);
  return keyframe;
}

}  // namespace

void KeyframeStore::save(OutputArchive& archive) const {
  archive.write("keyframes", c10::IValue(static_cast<std::int64_t>(size())));
  if (scene_.defined()) archive.write("scene", scene_);
  for (std::size_t i = 0; i < size(); ++i) {
    OutputArchive inner;
    write(inner, keyframes_[i]);
    archive.write("keyframe" + std::to_string(i), inner);
  }
}

void KeyframeStore::load(InputArchive& archive) {
  const std::int64_t count = gaussians::read_int(archive, "keyframes");
  if (Tensor scene; archive.try_read("scene", scene)) set_mask(scene);
  InputArchive part;
  for (std::int64_t i = 0; i < count; ++i) {
    archive.read("keyframe" + std::to_string(i), part);
    add(read_keyframe(part));
  }
}

}  // namespace apvi::mapping
