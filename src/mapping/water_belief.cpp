// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/water_belief.hpp"

#include <torch/torch.h>

#include "archive.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kKept = 0.8;  // of what is known, from one survey to the next
// What a survey may be off besides what its sightings say, one sigma. Gains that follow distance
// pass for the same attenuation in all channels.
constexpr double kStray_per_m = 0.03;  // of beta_d
constexpr double kRatioStray = 0.05;   // of log(beta_b / beta_d)
constexpr double kVeilStray = 0.2;     // of log(b_inf)
constexpr double kSeenVeilStray = 0.05;

}  // namespace

void WaterBelief::begin() {
  if (!empty()) return;
  information_ = torch::zeros({3, 2, 2}, torch::kFloat64);
  weighted_ = torch::zeros({3, 2}, torch::kFloat64);
  veil_ = torch::zeros({2, 3}, torch::kFloat64);
}

void WaterBelief::add(const Tensor& information, const Tensor& weighted, const Tensor& logs) {
  begin();
  information_ = kKept * information_;
  weighted_ = kKept * weighted_;
  for (std::int64_t c = 0; c < 3; ++c) {
    const double beta = kStray_per_m / logs[c][0].exp().item<double>();
    const Tensor stray = torch::diag(torch::tensor({beta, kRatioStray}, torch::kFloat64).square());
    // (L^-1 + Q)^-1 = (1 + L Q)^-1 L, which needs no inverse of L: some directions are not seen.
    const Tensor damped = torch::inverse(torch::eye(2, torch::kFloat64) + information[c].mm(stray));
    information_[c] += damped.mm(information[c]);
    weighted_[c] += damped.mv(weighted[c]);
  }
}

Tensor WaterBelief::add_veil(const Tensor& logs, const Tensor& sigmas, bool sees_open_water) {
  begin();
  const double stray = sees_open_water ? kSeenVeilStray : kVeilStray;
  const Tensor weights = 1.0 / (sigmas.square() + stray * stray);
  veil_ = kKept * veil_ + torch::stack({weights, weights * logs});
  return veil_[1] / veil_[0];
}

void WaterBelief::save(torch::serialize::OutputArchive& archive) const {
  archive.write("empty", torch::IValue(empty()));
  if (empty()) return;
  archive.write("information", information_);
  archive.write("weighted", weighted_);
  archive.write("veil", veil_);
}

void WaterBelief::load(torch::serialize::InputArchive& archive) {
  if (read_bool(archive, "empty")) {
    *this = {};
    return;
  }
  archive.read("information", information_);
  archive.read("weighted", weighted_);
  archive.read("veil", veil_);
  TORCH_CHECK(information_.sizes() == at::IntArrayRef({3, 2, 2}) &&
                  weighted_.sizes() == at::IntArrayRef({3, 2}) &&
                  veil_.sizes() == at::IntArrayRef({2, 3}),
              "water: the archive's surveys are none");
}

}  // namespace apvi::mapping
