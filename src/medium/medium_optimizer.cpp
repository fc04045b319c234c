// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium_optimizer.hpp"

#include <torch/torch.h>

#include <string>
#include <vector>

namespace apvi::medium {
namespace {

using torch::Tensor;

std::array<Tensor*, 3> tensors(MediumParameters& parameters) {
  return {&parameters.raw_beta_d, &parameters.raw_beta_b, &parameters.raw_b_inf};
}
std::array<const Tensor*, 3> tensors(const MediumParameters& parameters) {
  return {&parameters.raw_beta_d, &parameters.raw_beta_b, &parameters.raw_b_inf};
}

constexpr double kPriorRateScale = 0.1;  // of the learning rate
constexpr double kPriorPull = 0.02;      // fraction of the distance to the prior, per step

constexpr std::array<const char*, 3> kNames = {"raw_beta_d", "raw_beta_b", "raw_b_inf"};

/// The three raw parameters by channel [3,3].
Tensor stacked(const MediumParameters& parameters) {
  return torch::stack({parameters.raw_beta_d, parameters.raw_beta_b, parameters.raw_b_inf}, 1)
      .detach();
}

/// Derivatives [3,3] of the medium's logarithms with respect to its raw parameters.
Tensor log_slopes(const Medium& m) {
  const auto of_beta = [](const Tensor& beta) { return -torch::expm1(-beta) / beta; };
  return torch::stack({of_beta(m.beta_d), of_beta(m.beta_b), 1.0 - m.b_inf}, 1);
}

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
    : parameters_(MediumParameters::from(start)), lamp_(start.lamp), rate_(rate) {
  TORCH_CHECK(rate > 0.0, "medium: the learning rate must be positive, not ", rate);
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    Tensor& leaf = *tensors(parameters_)[k];
    leaf = leaf.detach().clone().requires_grad_(true);
    first_[k] = torch::zeros_like(leaf, leaf.options().requires_grad(false));
    second_[k] = torch::zeros_like(first_[k]);
  }
}

Medium MediumOptimizer::medium() const {
  Medium medium = parameters_.medium();
  medium.lamp = lamp_;
  return medium;
}

double MediumOptimizer::rate() const {
  const double usual = has_prior() ? kPriorRateScale * rate_ : rate_;
  return vio_failing_ ? 2.0 * usual : usual;
}

void MediumOptimizer::set_prior(const Medium& prior, const Tensor& resolution) {
  const torch::NoGradGuard no_grad;
  const auto like = parameters_.raw_beta_d.options().requires_grad(false);
  const Medium medium = {.beta_d = prior.beta_d.to(torch::kCPU, torch::kFloat64),
                         .beta_b = prior.beta_b.to(torch::kCPU, torch::kFloat64),
                         .b_inf = prior.b_inf.to(torch::kCPU, torch::kFloat64)};
  const MediumParameters raw = MediumParameters::from(medium);
  const Tensor slopes = log_slopes(medium);
  prior_ = stacked(raw).to(like);
  lamp_ = prior.lamp;
  resolution_ =
      (resolution.to(torch::kCPU, torch::kFloat64) * slopes.unsqueeze(1) / slopes.unsqueeze(2))
          .to(like);
  const std::array<const Tensor*, 3> to = {&raw.raw_beta_d, &raw.raw_beta_b, &raw.raw_b_inf};
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    tensors(parameters_)[k]->detach().copy_(*to[k]);
    first_[k].zero_();
    second_[k].zero_();
  }
  steps_ = 0;
}

void MediumOptimizer::step(const gaussians::AdamOptions& options) {
  const torch::NoGradGuard no_grad;
  const Tensor before = has_prior() ? stacked(parameters_).clone() : Tensor();
  std::vector<gaussians::AdamGroup> groups;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    const Tensor& leaf = *tensors(parameters_)[k];
    groups.push_back({.parameter = leaf.detach(),
                      .gradient = leaf.grad(),
                      .first = first_[k],
                      .second = second_[k],
                      .rate = rate()});
  }
  gaussians::adam_step(groups, ++steps_, options);
  for (Tensor* leaf : tensors(parameters_)) leaf->mutable_grad() = Tensor();
  if (!has_prior()) return;
  const Tensor made = stacked(parameters_) - before;
  const Tensor after = before + torch::bmm(resolution_, made.unsqueeze(2)).squeeze(2) +
                       kPriorPull * (prior_ - before);
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    tensors(parameters_)[k]->detach().copy_(after.select(1, static_cast<std::int64_t>(k)));
  }
}

void MediumOptimizer::save(torch::serialize::OutputArchive& archive) const {
  archive.write("steps", c10::IValue(steps_));
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    archive.write(kNames[k], tensors(parameters_)[k]->detach());
    archive.write(std::string("first.") + kNames[k], first_[k]);
    archive.write(std::string("second.") + kNames[k], second_[k]);
  }
  archive.write("lamp", lamp_ ? lamp_to_tensor(*lamp_) : torch::empty({0}, torch::kFloat64));
  archive.write("has_prior", c10::IValue(has_prior()));
  if (!has_prior()) return;
  archive.write("prior", prior_);
  archive.write("resolution", resolution_);
}

void MediumOptimizer::load(torch::serialize::InputArchive& archive) {
  c10::IValue steps;
  archive.read("steps", steps);
  TORCH_CHECK(steps.isInt() && steps.toInt() >= 0,
              "medium: the archive contains no valid step count");
  std::array<Tensor, 3> parameters;
  std::array<Tensor, 3> first;
  std::array<Tensor, 3> second;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    parameters[k] = read(archive, kNames[k], first_[k]);
    first[k] = read(archive, std::string("first.") + kNames[k], first_[k]);
    second[k] = read(archive, std::string("second.") + kNames[k], first_[k]);
  }
  c10::IValue held;
  archive.read("has_prior", held);
  Tensor prior;
  Tensor resolution;
  if (held.toBool()) {
    const auto like = first_[0].options();
    prior = read(archive, "prior", torch::empty({3, 3}, like));
    resolution = read(archive, "resolution", torch::empty({3, 3, 3}, like));
  }
  Tensor lamp;
  archive.read("lamp", lamp);
  std::optional<LampLight> light;
  if (lamp.numel() > 0) light = lamp_from_tensor(lamp);
  for (std::size_t k = 0; k < kNames.size(); ++k) {  // all reads succeeded: commit
    *tensors(parameters_)[k] = parameters[k].requires_grad_(true);
  }
  first_ = first;
  second_ = second;
  prior_ = prior;
  resolution_ = resolution;
  lamp_ = light;
  steps_ = steps.toInt();
}

}  // namespace apvi::medium
