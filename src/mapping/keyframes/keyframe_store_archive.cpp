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
  if (keyframe.scene.defined()) archive.write("scene", keyframe.scene);
}

void write_image(OutputArchive& archive, const Tensor& image) {
  archive.write("has_image", c10::IValue(image.defined()));
  if (image.defined()) archive.write("image", image);
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
  archive.try_read("scene", keyframe.scene);
  if (gaussians::read_bool(archive, "has_image")) archive.read("image", keyframe.image);
  return keyframe;
}

}  // namespace

StorageFiles KeyframeStore::save(OutputArchive& archive) const {
  StorageFiles used;
  archive.write("keyframes", c10::IValue(static_cast<std::int64_t>(size())));
  if (scene_.defined()) archive.write("scene", scene_);
  for (std::size_t i = 0; i < size(); ++i) {
    OutputArchive inner;
    write(inner, keyframes_[i]);
    const auto file = files_.find(i);
    if (file == files_.end()) {
      write_image(inner, keyframes_[i].image);
    } else {
      write_image(inner, Tensor());
      inner.write("file", c10::IValue(file->second->name()));
      inner.write("saturates", c10::IValue(keyframes_[i].saturates));
      used.push_back(file->second);
    }
    archive.write("keyframe" + std::to_string(i), inner);
  }
  return used;
}

StorageFiles KeyframeStore::load(InputArchive& archive) {
  StorageFiles used;
  const std::int64_t count = gaussians::read_int(archive, "keyframes");
  if (Tensor scene; archive.try_read("scene", scene)) set_mask(scene);
  InputArchive part;
  for (std::int64_t i = 0; i < count; ++i) {
    archive.read("keyframe" + std::to_string(i), part);
    add(read_keyframe(part));
    c10::IValue name;
    if (!part.try_read("file", name)) continue;
    TORCH_CHECK(folder_ != nullptr, "checkpoint: its images are in files, but there is no folder");
    Keyframe& keyframe = keyframes_.back();
    keyframe.saturates = gaussians::read_bool(part, "saturates");
    const gaussians::Intrinsics& camera = keyframe.intrinsics;
    used.push_back(
        folder_->open(name.toStringRef(), std::int64_t{3} * camera.width * camera.height));
    files_[keyframes_.size() - 1] = used.back();
    list_view(keyframes_.size() - 1);
  }
  return used;
}

}  // namespace apvi::mapping
