// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/splat/medium_optimizer.hpp"

#include <torch/torch.h>

#include <string>
#include <vector>

namespace apvi::splat {
namespace {

using torch::Tensor;

std::array<Tensor*, 3> tensors(MediumParameters& parameters) {
  return {&parameters.raw_beta_d, &parameters.raw_beta_b, &parameters.raw_b_inf};
}
std::array<const Tensor*, 3> tensors(const MediumParameters& parameters) {
  return {&parameters.raw_beta_d, &parameters.raw_beta_b, &parameters.raw_b_inf};
}

constexpr std::array<const char*, 3> kNames = {"raw_beta_d", "raw_beta_b", "raw_b_inf"};

Tensor read(torch::serialize::InputArchive& archive, const std::string& key, const Tensor& like) {
  Tensor tensor;
  archive.read(key, tensor);
  TORCH_CHECK(tensor.sizes() == like.sizes() && tensor.scalar_type() == like.scalar_type(),
              "medium: ", key, " in the archive is ", tensor.toString(), tensor.sizes(),
              " instead of ", like.toString(), like.sizes());
  return tensor.detach().to(like.device());
}

}  // namespace

MediumOptimizer::MediumOptimizer(const Medium& start, double rate)
    : parameters_(MediumParameters::from(start)), rate_(rate) {
  TORCH_CHECK(rate > 0.0, "medium: the learning rate must be positive, not ", rate);
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    Tensor& leaf = *tensors(parameters_)[k];
    leaf = leaf.detach().clone().requires_grad_(true);
    first_[k] = torch::zeros_like(leaf, leaf.options().requires_grad(false));
    second_[k] = torch::zeros_like(first_[k]);
  }
}

void MediumOptimizer::step(const AdamOptions& options) {
  const torch::NoGradGuard no_grad;
  std::vector<AdamGroup> groups;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    const Tensor& leaf = *tensors(parameters_)[k];
    groups.push_back({.parameter = leaf.detach(),
                      .gradient = leaf.grad(),
                      .first = first_[k],
                      .second = second_[k],
                      .rate = rate()});
  }
  adam_step(groups, ++steps_, options);
  for (Tensor* leaf : tensors(parameters_)) leaf->mutable_grad() = Tensor();
}

void MediumOptimizer::save(torch::serialize::OutputArchive& archive) const {
  archive.write("steps", c10::IValue(steps_));
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    archive.write(kNames[k], tensors(parameters_)[k]->detach());
    archive.write(std::string("first.") + kNames[k], first_[k]);
    archive.write(std::string("second.") + kNames[k], second_[k]);
  }
}

void MediumOptimizer::load(torch::serialize::InputArchive& archive) {
  c10::IValue steps;
  archive.read("steps", steps);
  TORCH_CHECK(steps.isInt() && steps.toInt() >= 0, "medium: the archive's steps are none");
  std::array<Tensor, 3> parameters;
  std::array<Tensor, 3> first;
  std::array<Tensor, 3> second;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    parameters[k] = read(archive, kNames[k], first_[k]);
    first[k] = read(archive, std::string("first.") + kNames[k], first_[k]);
    second[k] = read(archive, std::string("second.") + kNames[k], first_[k]);
  }
  for (std::size_t k = 0; k < kNames.size(); ++k) {  // nothing changes unless all is there
    *tensors(parameters_)[k] = parameters[k].requires_grad_(true);
  }
  first_ = first;
  second_ = second;
  steps_ = steps.toInt();
}

}  // namespace apvi::splat
