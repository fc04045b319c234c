// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/appearance/illumination.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "core/median.hpp"
#include "gaussians/model/archive.hpp"
#include "gaussians/optimizer/adam.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kCorrelationTime_s = 0.15;  // of moving light; caustics change within tenths
constexpr std::int64_t kRows = 24;
constexpr double kRate = 0.01;
constexpr double kPrior = 1e-3;  // loss of a mean squared logarithm of one
constexpr std::int64_t kCenteringInterval = 50;

/// Weights [size,nodes] of the grid's nodes at pixel centers.
Tensor bilinear_weights(std::int64_t size, std::int64_t nodes,
                        const torch::TensorOptions& options) {
  const Tensor x = (torch::arange(size, options) + 0.5) *
                   (static_cast<double>(nodes - 1) / static_cast<double>(size));
  return (1.0 - (x.unsqueeze(1) - torch::arange(nodes, options)).abs()).clamp_min(0.0);
}

std::pair<Tensor, Tensor> interpolation_of(const Tensor& logs, std::int64_t height,
                                           std::int64_t width) {
  const auto options = logs.options().requires_grad(false);
  return {bilinear_weights(height, logs.size(1), options),
          bilinear_weights(width, logs.size(2), options).t().contiguous()};
}

// Products of matrices: unlike LibTorch's interpolation, their gradients have the same bits from
// run to run on a GPU.
Tensor gain_of(const Tensor& logs, const std::pair<Tensor, Tensor>& interpolation) {
  return torch::matmul(torch::matmul(interpolation.first, logs), interpolation.second)
      .exp()
      .permute({1, 2, 0})
      .contiguous();
}

}  // namespace

bool resolves_moving_light(const KeyframeStore& keyframes) {
  const std::vector<std::size_t>& views = keyframes.training();
  if (views.size() < 3) return false;
  std::vector<std::int64_t> gaps;
  for (std::size_t k = 1; k < views.size(); ++k)
    gaps.push_back(keyframes[views[k]].stamp_ns - keyframes[views[k - 1]].stamp_ns);
  return 1e-9 * static_cast<double>(median(std::move(gaps))) <= kCorrelationTime_s;
}

Illumination::Illumination(std::size_t views, const std::vector<std::size_t>& training,
                           const gaussians::Intrinsics& camera, const torch::Device& device)
    : training_(
          torch::tensor(std::vector<std::int64_t>(training.begin(), training.end()), torch::kInt64)
              .to(device)),
      view_steps_(views, 0) {
  const auto columns = static_cast<std::int64_t>(
      std::lround(static_cast<double>(kRows * camera.width) / camera.height));
  logs_ =
      torch::zeros({static_cast<std::int64_t>(views), 3, kRows, std::max<std::int64_t>(2, columns)},
                   torch::dtype(torch::kFloat32).device(device));
  first_ = torch::zeros_like(logs_);
  second_ = torch::zeros_like(logs_);
}

Tensor Illumination::apply(std::size_t view, const Tensor& image, double contrast) {
  leaf_ = logs_.select(0, static_cast<std::int64_t>(view)).clone().requires_grad_(true);
  auto& interpolation = interpolation_[image.size(1)];
  if (!interpolation.first.defined()) {
    interpolation = interpolation_of(leaf_, image.size(0), image.size(1));
  }
  return image * gain_of(leaf_ * contrast, interpolation);
}

void Illumination::step(std::size_t view) {
  if (!leaf_.defined() || !leaf_.grad().defined()) return;
  const torch::NoGradGuard no_grad;
  const auto row = static_cast<std::int64_t>(view);
  const double prior = 2.0 * kPrior / static_cast<double>(leaf_.numel());
  gaussians::adam_step({{.parameter = logs_.select(0, row),
                         .gradient = torch::add(leaf_.grad(), leaf_.detach(), prior),
                         .first = first_.select(0, row),
                         .second = second_.select(0, row),
                         .rate = kRate}},
                       ++view_steps_[view]);
  leaf_ = Tensor();
  if (++steps_ % kCenteringInterval == 0) {
    logs_.sub_(logs_.index_select(0, training_).mean(0, true));
  }
}

Tensor illumination_gain(const Tensor& logs, double contrast, std::int64_t height,
                         std::int64_t width) {
  return gain_of(logs * contrast, interpolation_of(logs, height, width));
}

void Illumination::save(torch::serialize::OutputArchive& archive) const {
  archive.write("logs", logs_, /*is_buffer=*/true);
  archive.write("first", first_, /*is_buffer=*/true);
  archive.write("second", second_, /*is_buffer=*/true);
  archive.write("view_steps", torch::tensor(view_steps_, torch::kInt64), /*is_buffer=*/true);
  archive.write("steps", torch::IValue(steps_));
}

void Illumination::load(torch::serialize::InputArchive& archive) {
  // Reading into a tensor that is defined keeps its memory and type.
  for (const auto& [name, tensor] :
       {std::pair{"logs", &logs_}, std::pair{"first", &first_}, std::pair{"second", &second_}}) {
    Tensor part;
    archive.read(name, part, /*is_buffer=*/true);
    TORCH_CHECK(part.sizes() == tensor->sizes(), "checkpoint: illumination of ", part.sizes(),
                " instead of ", tensor->sizes());
    *tensor = part.to(tensor->options());
  }
  Tensor steps;
  archive.read("view_steps", steps, /*is_buffer=*/true);
  TORCH_CHECK(steps.dim() == 1 && steps.scalar_type() == torch::kInt64 &&
                  steps.size(0) == static_cast<std::int64_t>(view_steps_.size()),
              "checkpoint: illumination of another number of images");
  view_steps_.assign(steps.data_ptr<std::int64_t>(),
                     steps.data_ptr<std::int64_t>() + steps.numel());
  steps_ = gaussians::read_int(archive, "steps");
}

}  // namespace apvi::mapping
