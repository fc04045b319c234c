// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/storage/detached_gaussians.hpp"

#include <torch/torch.h>

#include "gaussians/device.hpp"
#include "gaussians/model/archive.hpp"
#include "gaussians/render/tone_curve.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;
using torch::serialize::InputArchive;
using torch::serialize::OutputArchive;

/// An undefined tensor is saved as one without elements.
void write(OutputArchive& archive, const char* key, const Tensor& tensor) {
  archive.write(key, tensor.defined() ? tensor.to(torch::kCPU) : torch::empty({0}));
}

Tensor read(InputArchive& archive, const char* key) {
  Tensor tensor;
  archive.read(key, tensor);
  return tensor.numel() > 0 ? tensor.to(gaussians::active_device()) : Tensor();
}

void write_medium(OutputArchive& archive, const medium::Medium& water) {
  archive.write("medium", torch::stack({water.beta_d, water.beta_b, water.b_inf}).to(torch::kCPU));
  write(archive, "lamp", water.lamp ? medium::lamp_to_tensor(*water.lamp) : Tensor());
}

medium::Medium read_medium(InputArchive& archive) {
  const Tensor rows = read(archive, "medium");
  TORCH_CHECK(rows.defined() && rows.dim() == 2 && rows.size(0) == 3,
              "checkpoint: the medium of stored Gaussians does not match");
  medium::Medium water = {.beta_d = rows[0], .beta_b = rows[1], .b_inf = rows[2]};
  Tensor lamp;
  archive.read("lamp", lamp);
  if (lamp.numel() > 0) water.lamp = medium::lamp_from_tensor(lamp);
  return water;
}

}  // namespace

std::vector<Tensor*> tensors_of(DetachedGaussians& detached) {
  gaussians::GaussianRows& rows = detached.rows;
  std::vector<Tensor*> all = {&rows.anchors, &detached.importance};
  for (gaussians::Gaussians* part : {&rows.parameters, &rows.first, &rows.second}) {
    for (Tensor* tensor : part->tensors()) all.push_back(tensor);
  }
  return all;
}

void save(OutputArchive& archive, const DetachedGaussians& detached) {
  gaussians::write_gaussians(archive, "", detached.rows.parameters);
  gaussians::write_gaussians(archive, "first.", detached.rows.first);
  gaussians::write_gaussians(archive, "second.", detached.rows.second);
  archive.write("anchors", detached.rows.anchors.clone());
  archive.write("importance", detached.importance.clone());
}

DetachedGaussians load_detached(InputArchive& archive) {
  DetachedGaussians out;
  out.rows = {.parameters = gaussians::read_gaussians(archive, ""),
              .first = gaussians::read_gaussians(archive, "first."),
              .second = gaussians::read_gaussians(archive, "second."),
              .anchors = {}};
  archive.read("anchors", out.rows.anchors);
  archive.read("importance", out.importance);
  for (const Tensor* tensor : tensors_of(out)) {
    TORCH_CHECK(tensor->size(0) == out.rows.size(), "checkpoint: stored Gaussians do not match");
  }
  return out;
}

void save_appearance(OutputArchive& archive, const Map& map) {
  archive.write("has_medium", c10::IValue(map.medium.has_value()));
  if (map.medium) write_medium(archive, *map.medium);
  write(archive, "light", map.light);
  write(archive, "log_gains", map.log_gains);
  archive.write("vignetting_square", c10::IValue(map.vignetting.square));
  archive.write("vignetting_fourth", c10::IValue(map.vignetting.fourth));
  archive.write("tone_curve", gaussians::to_tensor(map.tone_curve));
  archive.write("antialiased", c10::IValue(map.antialiased));
}

Map load_appearance(InputArchive& archive) {
  Map map;
  if (gaussians::read_bool(archive, "has_medium")) map.medium = read_medium(archive);
  map.light = read(archive, "light");
  map.log_gains = read(archive, "log_gains");
  map.vignetting = {.square = gaussians::read_double(archive, "vignetting_square"),
                    .fourth = gaussians::read_double(archive, "vignetting_fourth")};
  Tensor curve;
  archive.read("tone_curve", curve);
  map.tone_curve = gaussians::tone_curve_of(curve);
  map.antialiased = gaussians::read_bool(archive, "antialiased");
  return map;
}

std::int64_t known_keyframes(const Map& appearance) {
  return appearance.log_gains.defined() ? appearance.log_gains.size(0) : 0;
}

}  // namespace apvi::mapping
