// SPDX-License-Identifier: BSD-3-Clause
#include <torch/torch.h>

#include <string>

#include "apvi/mapping/mapper.hpp"
#include "archive.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;
using torch::serialize::InputArchive;
using torch::serialize::OutputArchive;

void write(OutputArchive& archive, const Keyframe& keyframe) {
  const splat::Intrinsics& k = keyframe.intrinsics;
  archive.write("stamp", c10::IValue(keyframe.stamp_ns));
  archive.write("name", c10::IValue(keyframe.name));
  archive.write("held_out", c10::IValue(keyframe.held_out));
  archive.write("number", c10::IValue(keyframe.number));
  archive.write("width", c10::IValue(static_cast<std::int64_t>(k.width)));
  archive.write("height", c10::IValue(static_cast<std::int64_t>(k.height)));
  const auto& [a, b, c] = k.lens_spread;
  archive.write("lens", torch::tensor({k.fx, k.fy, k.cx, k.cy, a, b, c}, torch::kFloat64));
  archive.write("pose", keyframe.T_camera_world);
  const bool kept = keyframe.image.defined();
  archive.write("kept", c10::IValue(kept));
  if (kept) archive.write("image", keyframe.image);
}

Keyframe read_keyframe(InputArchive& archive) {
  Keyframe keyframe;
  keyframe.stamp_ns = read_int(archive, "stamp");
  c10::IValue name;
  archive.read("name", name);
  keyframe.name = name.toStringRef();
  keyframe.held_out = read_bool(archive, "held_out");
  keyframe.number = read_int(archive, "number");
  Tensor lens;
  archive.read("lens", lens);
  const auto f = lens.accessor<double, 1>();
  TORCH_CHECK(f.size(0) == 7, "a keyframe's lens has ", f.size(0), " numbers instead of 7");
  keyframe.intrinsics = {.fx = f[0],
                         .fy = f[1],
                         .cx = f[2],
                         .cy = f[3],
                         .width = static_cast<int>(read_int(archive, "width")),
                         .height = static_cast<int>(read_int(archive, "height")),
                         .lens_spread = {f[4], f[5], f[6]}};
  archive.read("pose", keyframe.T_camera_world);
  if (read_bool(archive, "kept")) archive.read("image", keyframe.image);
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
  OutputArchive drift;
  drift_.save(drift);
  archive.write("drift", drift);
  OutputArchive first_sight;
  first_sight_.save(first_sight);
  archive.write("first_sight", first_sight);
  archive.write("remembered", c10::IValue(static_cast<std::int64_t>(remembered_)));
  OutputArchive schedule;
  schedule_.save(schedule);
  archive.write("schedule", schedule);
  OutputArchive losses;
  losses_.save(losses);
  archive.write("losses", losses);
  archive.write("learning", c10::IValue(learner_.has_value()));
  if (learner_) {
    OutputArchive inner;
    learner_->save(inner);
    archive.write("learner", inner);
  }
  archive.write("points", points_);
  archive.write("extent", c10::IValue(extent_));
  archive.write("growth", c10::IValue(growth_));
  archive.write("iteration", c10::IValue(iteration_));
  archive.write("last_round", c10::IValue(last_round_));
  archive.write("heldout_stride", c10::IValue(heldout_stride_));
  const std::vector<std::int64_t> waiting(waiting_.begin(), waiting_.end());
  archive.write("waiting", torch::tensor(waiting, torch::kInt64));
  OutputArchive surveys;
  surveys_.save(surveys);
  archive.write("surveys", surveys);
  archive.write("clears_ns", c10::IValue(clears_ns_));
  write_archive(checkpoint, archive);
}

void Mapper::resume(const std::filesystem::path& checkpoint) {
  Mapper read(options_);
  read_archive(checkpoint, [&read](InputArchive& archive) {
    const std::int64_t count = read_int(archive, "keyframes");
    InputArchive part;
    for (std::int64_t i = 0; i < count; ++i) {
      archive.read("keyframe" + std::to_string(i), part);
      const Keyframe keyframe = read_keyframe(part);
      read.by_stamp_[keyframe.stamp_ns] = read.keyframes_.size();
      read.keyframes_.add(keyframe);
    }
    archive.read("drift", part);
    read.drift_.load(part);
    archive.read("first_sight", part);
    read.first_sight_.load(part, splat::active_device());
    read.remembered_ = static_cast<std::size_t>(read_int(archive, "remembered"));
    archive.read("schedule", part);
    read.schedule_.load(part);
    archive.read("losses", part);
    read.losses_.load(part, splat::active_device());
    if (read_bool(archive, "learning")) {
      read.learner_.emplace(
          splat::Gaussians::empty(read.options_.trainer.sh_degree, torch::kFloat32),
          read.options_.trainer, read.keyframes_.size());
      archive.read("learner", part);
      read.learner_->load(part);
    }
    archive.read("points", read.points_);
    read.extent_ = read_double(archive, "extent");
    read.growth_ = read_double(archive, "growth");
    read.iteration_ = read_int(archive, "iteration");
    read.last_round_ = read_int(archive, "last_round");
    read.heldout_stride_ = read_int(archive, "heldout_stride");
    read.clears_ns_ = read_int(archive, "clears_ns");
    archive.read("surveys", part);
    read.surveys_.load(part);
    Tensor waiting;
    archive.read("waiting", waiting);
    const auto* const first = waiting.data_ptr<std::int64_t>();
    read.waiting_.assign(first, first + waiting.numel());
  });
  *this = std::move(read);
}

}  // namespace apvi::mapping
