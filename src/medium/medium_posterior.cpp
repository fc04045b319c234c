// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium_posterior.hpp"

#include <torch/torch.h>

#include "gaussians/model/archive.hpp"

namespace apvi::medium {
namespace {

using torch::Tensor;

constexpr double kForgettingFactor = 0.8;  // of the accumulated information, per estimation
// Standard deviation of an estimation's bias, in addition to its own covariance. A gain that varies
// with range is indistinguishable from the same additional attenuation in all channels.
constexpr double kBetaBias_per_m = 0.03;      // of beta_d
constexpr double kLogRatioBias = 0.05;        // of log(beta_b / beta_d)
constexpr double kLogVeilingLightBias = 0.2;  // of log(b_inf)
constexpr double kOpenWaterLogVeilingLightBias = 0.05;

}  // namespace

void MediumPosterior::initialize() {
  if (!empty()) return;
  information_ = torch::zeros({3, 2, 2}, torch::kFloat64);
  information_mean_ = torch::zeros({3, 2}, torch::kFloat64);
  veiling_light_ = torch::zeros({2, 3}, torch::kFloat64);
}

void MediumPosterior::add(const Tensor& information, const Tensor& weighted, const Tensor& logs) {
  initialize();
  information_ = kForgettingFactor * information_;
  information_mean_ = kForgettingFactor * information_mean_;
  for (std::int64_t c = 0; c < 3; ++c) {
    const double beta = kBetaBias_per_m / logs[c][0].exp().item<double>();
    const Tensor bias = torch::diag(torch::tensor({beta, kLogRatioBias}, torch::kFloat64).square());
    // (L^-1 + Q)^-1 = (1 + L Q)^-1 L avoids inverting L, which may be singular.
    const Tensor damped = torch::inverse(torch::eye(2, torch::kFloat64) + information[c].mm(bias));
    information_[c] += damped.mm(information[c]);
    information_mean_[c] += damped.mv(weighted[c]);
  }
}

Tensor MediumPosterior::add_veiling_light(const Tensor& logs, const Tensor& sigmas,
                                          bool sees_open_water) {
  initialize();
  const double bias = sees_open_water ? kOpenWaterLogVeilingLightBias : kLogVeilingLightBias;
  const Tensor weights = 1.0 / (sigmas.square() + bias * bias);
  veiling_light_ = kForgettingFactor * veiling_light_ + torch::stack({weights, weights * logs});
  return veiling_light_[1] / veiling_light_[0];
}

void MediumPosterior::save(torch::serialize::OutputArchive& archive) const {
  archive.write("empty", torch::IValue(empty()));
  if (empty()) return;
  archive.write("information", information_);
  archive.write("information_mean", information_mean_);
  archive.write("veiling_light", veiling_light_);
}

void MediumPosterior::load(torch::serialize::InputArchive& archive) {
  if (gaussians::read_bool(archive, "empty")) {
    *this = {};
    return;
  }
  archive.read("information", information_);
  archive.read("information_mean", information_mean_);
  archive.read("veiling_light", veiling_light_);
  TORCH_CHECK(information_.sizes() == at::IntArrayRef({3, 2, 2}) &&
                  information_mean_.sizes() == at::IntArrayRef({3, 2}) &&
                  veiling_light_.sizes() == at::IntArrayRef({2, 3}),
              "medium: the archive contains no valid posterior");
}

}  // namespace apvi::medium
