// SPDX-License-Identifier: BSD-3-Clause
#include <torch/torch.h>

#include <string>

#include "gaussians/model/archive.hpp"
#include "mapping/mapper.hpp"

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
  return keyframe;
}

}  // namespace

void Mapper::save(const std::filesystem::path& checkpoint) const {
  OutputArchive archive;
  archive.write("keyframes", c10::IValue(static_cast<std::int64_t>(keyframes_.size())));
  for (std::size_t i = 0; i < keyframes_.size(); ++i) {
    OutputArchive inner;
    write(inner, keyframes_[i]);
    archive.write("keyframe" + std::to_string(i), inner);
  }
  OutputArchive map_odom;
  map_odom_.save(map_odom);
  archive.write("map_odom", map_odom);
  OutputArchive reference_map;
  reference_map_.save(reference_map);
  archive.write("reference_map", reference_map);
  archive.write("reference_end", c10::IValue(static_cast<std::int64_t>(reference_end_)));
  OutputArchive schedule;
  schedule_.save(schedule);
  archive.write("schedule", schedule);
  OutputArchive losses;
  losses_.save(losses);
  archive.write("losses", losses);
  archive.write("has_optimizer", c10::IValue(optimizer_.has_value()));
  if (optimizer_) {
    OutputArchive inner;
    optimizer_->save(inner);
    archive.write("optimizer", inner);
  }
  archive.write("points", points_);
  archive.write("extent", c10::IValue(extent_));
  archive.write("growth_budget", c10::IValue(growth_budget_));
  archive.write("iteration", c10::IValue(iteration_));
  archive.write("last_densify", c10::IValue(last_densify_));
  archive.write("heldout_stride", c10::IValue(heldout_stride_));
  const std::vector<std::int64_t> depth_queue(depth_queue_.begin(), depth_queue_.end());
  archive.write("depth_queue", torch::tensor(depth_queue, torch::kInt64));
  OutputArchive medium_schedule;
  medium_schedule_.save(medium_schedule);
  archive.write("medium_schedule", medium_schedule);
  archive.write("low_visibility_until_ns", c10::IValue(low_visibility_until_ns_));
  gaussians::write_archive(checkpoint, archive);
}

void Mapper::resume(const std::filesystem::path& checkpoint) {
  Mapper read(options_);
  gaussians::read_archive(checkpoint, [&read](InputArchive& archive) {
    const std::int64_t count = gaussians::read_int(archive, "keyframes");
    InputArchive part;
    for (std::int64_t i = 0; i < count; ++i) {
      archive.read("keyframe" + std::to_string(i), part);
      const Keyframe keyframe = read_keyframe(part);
      read.by_stamp_[keyframe.stamp_ns] = read.keyframes_.size();
      read.keyframes_.add(keyframe);
    }
    archive.read("map_odom", part);
    read.map_odom_.load(part);
    archive.read("reference_map", part);
    read.reference_map_.load(part, gaussians::active_device());
    read.reference_end_ = static_cast<std::size_t>(gaussians::read_int(archive, "reference_end"));
    archive.read("schedule", part);
    read.schedule_.load(part);
    archive.read("losses", part);
    read.losses_.load(part, gaussians::active_device());
    if (gaussians::read_bool(archive, "has_optimizer")) {
      read.optimizer_.emplace(
          gaussians::Gaussians::empty(read.options_.trainer.sh_degree, torch::kFloat32),
          read.options_.trainer, read.keyframes_.size());
      archive.read("optimizer", part);
      read.optimizer_->load(part);
    }
    archive.read("points", read.points_);
    read.extent_ = gaussians::read_double(archive, "extent");
    read.growth_budget_ = gaussians::read_double(archive, "growth_budget");
    read.iteration_ = gaussians::read_int(archive, "iteration");
    read.last_densify_ = gaussians::read_int(archive, "last_densify");
    read.heldout_stride_ = gaussians::read_int(archive, "heldout_stride");
    read.low_visibility_until_ns_ = gaussians::read_int(archive, "low_visibility_until_ns");
    archive.read("medium_schedule", part);
    read.medium_schedule_.load(part);
    Tensor depth_queue;
    archive.read("depth_queue", depth_queue);
    const auto* const first = depth_queue.data_ptr<std::int64_t>();
    read.depth_queue_.assign(first, first + depth_queue.numel());
  });
  *this = std::move(read);
}

}  // namespace apvi::mapping
