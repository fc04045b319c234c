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

constexpr double kHeldRate = 0.1;  // of the usual
constexpr double kLean = 0.02;     // back to what is believed, at each step

constexpr std::array<const char*, 3> kNames = {"raw_beta_d", "raw_beta_b", "raw_b_inf"};

/// [3,3]: by channel the three raw parameters.
Tensor stacked(const MediumParameters& parameters) {
  return torch::stack({parameters.raw_beta_d, parameters.raw_beta_b, parameters.raw_b_inf}, 1)
      .detach();
}

/// By how much the logarithms of a medium change with its raw parameters [3,3].
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
  const double usual = held() ? kHeldRate * rate_ : rate_;
  return failing_ ? 2.0 * usual : usual;
}

void MediumOptimizer::hold(const Medium& believed, const Tensor& known) {
  const torch::NoGradGuard no_grad;
  const auto like = parameters_.raw_beta_d.options().requires_grad(false);
  const Medium medium = {.beta_d = believed.beta_d.to(torch::kCPU, torch::kFloat64),
                         .beta_b = believed.beta_b.to(torch::kCPU, torch::kFloat64),
                         .b_inf = believed.b_inf.to(torch::kCPU, torch::kFloat64)};
  const MediumParameters raw = MediumParameters::from(medium);
  const Tensor slopes = log_slopes(medium);
  believed_ = stacked(raw).to(like);
  lamp_ = believed.lamp;
  known_ =
      (known.to(torch::kCPU, torch::kFloat64) * slopes.unsqueeze(1) / slopes.unsqueeze(2)).to(like);
  const std::array<const Tensor*, 3> to = {&raw.raw_beta_d, &raw.raw_beta_b, &raw.raw_b_inf};
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    tensors(parameters_)[k]->detach().copy_(*to[k]);
    first_[k].zero_();
    second_[k].zero_();
  }
  steps_ = 0;
}

void MediumOptimizer::step(const AdamOptions& options) {
  const torch::NoGradGuard no_grad;
  const Tensor before = held() ? stacked(parameters_).clone() : Tensor();
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
  if (!held()) return;
  const Tensor made = stacked(parameters_) - before;
  const Tensor after =
      before + torch::bmm(known_, made.unsqueeze(2)).squeeze(2) + kLean * (believed_ - before);
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
  archive.write("lamp", lamp_ ? to_numbers(*lamp_) : torch::empty({0}, torch::kFloat64));
  archive.write("held", c10::IValue(held()));
  if (!held()) return;
  archive.write("believed", believed_);
  archive.write("known", known_);
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
  c10::IValue held;
  archive.read("held", held);
  Tensor believed;
  Tensor known;
  if (held.toBool()) {
    const auto like = first_[0].options();
    believed = read(archive, "believed", torch::empty({3, 3}, like));
    known = read(archive, "known", torch::empty({3, 3, 3}, like));
  }
  Tensor lamp;
  archive.read("lamp", lamp);
  std::optional<LampLight> light;
  if (lamp.numel() > 0) light = lamp_from_numbers(lamp);
  for (std::size_t k = 0; k < kNames.size(); ++k) {  // nothing changes unless all is there
    *tensors(parameters_)[k] = parameters[k].requires_grad_(true);
  }
  first_ = first;
  second_ = second;
  believed_ = believed;
  known_ = known;
  lamp_ = light;
  steps_ = steps.toInt();
}

}  // namespace apvi::splat
