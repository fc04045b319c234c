// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/appearance/session_light.hpp"

#include <torch/torch.h>

#include "gaussians/optimizer/adam.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kRate = 1e-3;  // a step in which all images agree changes the light by 0.1 %

}  // namespace

SessionLight::SessionLight(const Tensor& start, const torch::Device& device)
    : logs_(start.detach().to(device, torch::kFloat32).log().contiguous()),
      first_(torch::zeros_like(logs_)),
      second_(torch::zeros_like(logs_)) {
  TORCH_CHECK(start.sizes() == at::IntArrayRef({3}) && torch::isfinite(logs_).all().item<bool>(),
              "light of a session: must be three positive numbers");
  logs_.requires_grad_(true);
}

Tensor SessionLight::color(bool learn) const {
  return (learn ? logs_ : logs_.detach()).exp();
}

void SessionLight::step() {
  const torch::NoGradGuard no_grad;
  gaussians::adam_step({{.parameter = logs_.detach(),
                         .gradient = logs_.grad(),
                         .first = first_,
                         .second = second_,
                         .rate = kRate}},
                       ++steps_);
  logs_.mutable_grad() = Tensor();
}

void SessionLight::save(torch::serialize::OutputArchive& archive) const {
  archive.write("logs", logs_.detach());
  archive.write("first", first_);
  archive.write("second", second_);
  archive.write("steps", torch::IValue(steps_));
}

void SessionLight::load(torch::serialize::InputArchive& archive) {
  const auto read = [&archive, this](const char* name) {
    Tensor values;
    archive.read(name, values);
    TORCH_CHECK(values.sizes() == logs_.sizes(), "light of a session: damaged archive");
    return values.to(logs_.device(), torch::kFloat32);
  };
  logs_ = read("logs").requires_grad_(true);
  first_ = read("first");
  second_ = read("second");
  torch::IValue steps;
  archive.read("steps", steps);
  steps_ = steps.toInt();
}

}  // namespace apvi::mapping
